//! Curves in the middle of the surface around them.

use rayon::prelude::*;

use super::super::curve_skeleton::{CurveSkeleton, NO_NODE};
use super::super::skeleton_cleanup::moved_inside;
use super::with_radii;
use crate::kernels::geometry::distance_field::DistanceField;
use crate::kernels::geometry::mesh::Vec3;

/// How nodes are moved to the middle.
#[derive(Debug, Clone, PartialEq)]
pub struct CenterOptions {
    /// Edges longer than so many radii of the shape around them get new nodes.
    pub max_edge: f64,
    /// How often nodes are moved.
    pub rounds: usize,
}

impl Default for CenterOptions {
    fn default() -> Self {
        Self { max_edge: 0.6, rounds: 4 }
    }
}

/// The most new nodes of an edge.
const MOST_NEW: usize = 15;

/// Rays across a curve, of which every other half looks the opposite way.
const RAYS: usize = 16;

/// Rays that go farther than so many median ones look into another limb.
const REACH: f64 = 3.0;

/// Beside the surface half of the rays are short. The median counts as this part of the radius there.
const LEAST_MEDIAN: f64 = 0.7;

/// A node that would be moved by less than this part of the median ray, as would its neighbours, rests.
const SETTLED: f64 = 0.02;

/// The part of a move that is that of the neighbours, for which curves stay smooth.
const BLEND: f64 = 0.3;

/// Nodes nearer to a junction than so many of its distances from the surface rest: across the trunk, from
/// a limb's root, there is no middle to be found.
const TRUNK: f64 = 1.6;

/// Moves curves to the middle of a closed surface, as it is seen from them.
///
/// Long edges get new nodes, inside. Then, some times over, every node of two edges looks across the
/// curve, at right angles to the line between its neighbours, and moves by the mean difference of
/// opposite rays, which for a round limb is half of the way. It never moves through the surface. Where
/// the curve turns back the line tells no direction; such a node moves to the middle of its neighbours,
/// and goes in the end if it has no vertices and is still turned back.
///
/// Leaves, junctions, what is near these, and old nodes that are outside stay. Vertices of a node go to
/// the nearest of it and the new nodes beside it, up to the middles of its edges.
pub fn center(
    skeleton: &CurveSkeleton,
    vertices: &[Vec3],
    field: &DistanceField,
    options: &CenterOptions,
) -> CurveSkeleton {
    let (split, new_beside) = with_short_edges(skeleton, options.max_edge);
    let mut curves = with_new_inside(&split, skeleton.n_nodes(), field);
    let neighbors = curves.neighbors();
    let is_free = free_nodes(&curves, &neighbors, field);
    let mut looks = vec![Look::default(); curves.n_nodes()];
    for _ in 0..options.rounds {
        let round = Round { curves: &curves, neighbors: &neighbors, is_free: &is_free, field };
        let nodes = 0..curves.n_nodes();
        looks = nodes.clone().into_par_iter().map(|it| round.look(it, &looks)).collect();
        let places = nodes.into_par_iter().map(|it| round.moved(it, &looks)).collect();
        curves = curves.with_positions(places).expect("moved by finite lengths of rays");
    }
    let (curves, kept) = without_folds(&curves, field);
    with_vertices_of_new(&curves, vertices, &new_beside, &kept)
}

/// New nodes in long edges; and for every old node those that are nearer to it than to the other end.
fn with_short_edges(old: &CurveSkeleton, max_edge: f64) -> (CurveSkeleton, Vec<Vec<u32>>) {
    let (mut positions, mut radii) = (old.positions().to_vec(), old.radii().to_vec());
    let mut new_beside = vec![Vec::new(); old.n_nodes()];
    let mut edges = Vec::new();
    for (edge, &[from, to]) in old.edges().iter().enumerate() {
        let [a, b] = [from, to].map(|it| it as usize);
        let longest = max_edge * 0.5 * (radii[a] + radii[b]);
        let n_parts = if longest > 0.0 { (old.length(edge) / longest).ceil() } else { 1.0 };
        let n_new = (n_parts as usize).saturating_sub(1).min(MOST_NEW);
        let mut last = from;
        for step in 1..=n_new {
            let share = step as f64 / (n_new + 1) as f64;
            let new = positions.len() as u32;
            positions.push(positions[a].lerp(&positions[b], share));
            radii.push(radii[a] + (radii[b] - radii[a]) * share);
            // The one in the middle is beside both.
            if 2 * step <= n_new + 1 {
                new_beside[a].push(new);
            }
            if 2 * step > n_new {
                new_beside[b].push(new);
            }
            edges.push([last, new]);
            last = new;
        }
        edges.push([last, to]);
    }
    let labels = old.node_of_vertex().to_vec();
    let split = CurveSkeleton::new(positions, radii, edges, labels).expect("nodes between nodes");
    (split, new_beside)
}

/// Nodes that may move: those between two others, inside, and away from junctions.
fn free_nodes(curves: &CurveSkeleton, neighbors: &[Vec<u32>], field: &DistanceField) -> Vec<bool> {
    let junctions = curves.junctions();
    let centers: Vec<Vec3> = junctions.iter().map(|&it| curves.positions()[it as usize]).collect();
    let square_radius = |it: &Vec3| TRUNK * TRUNK * field.nearest(*it).square;
    let trunks: Vec<(Vec3, f64)> = centers.iter().map(|it| (*it, square_radius(it))).collect();
    let is_in_trunk =
        |it: &Vec3| trunks.iter().any(|(center, square)| (center - it).norm_squared() < *square);
    (curves.positions().par_iter().zip(neighbors))
        .map(|(place, around)| around.len() == 2 && !is_in_trunk(place) && field.is_inside(*place))
        .collect()
}

/// With the new nodes, those after the old ones, moved into the shape where edges had left it.
fn with_new_inside(split: &CurveSkeleton, n_old: usize, field: &DistanceField) -> CurveSkeleton {
    let inside = |node: usize| {
        let (place, radius) = (split.positions()[node], split.radii()[node]);
        match node < n_old || field.is_inside(place) {
            true => place,
            false => moved_inside(&place, 0.5 * radius, field).unwrap_or(place),
        }
    };
    let places = (0..split.n_nodes()).into_par_iter().map(inside).collect();
    split.with_positions(places).expect("places beside finite ones")
}

/// What a node saw across the curve.
#[derive(Debug, Clone, Copy)]
struct Look {
    /// To the middle.
    shift: Vec3,
    /// The length of the median ray.
    median: f64,
}

impl Default for Look {
    /// Nothing was seen yet: any length is possible.
    fn default() -> Self {
        Self { shift: Vec3::zeros(), median: f64::INFINITY }
    }
}

impl Look {
    fn is_settled(&self) -> bool {
        self.median.is_finite() && self.shift.norm() < SETTLED * self.median
    }
}

/// All that moving the nodes once needs to know.
struct Round<'a> {
    curves: &'a CurveSkeleton,
    neighbors: &'a [Vec<u32>],
    /// Nodes that may move.
    is_free: &'a [bool],
    field: &'a DistanceField,
}

impl Round<'_> {
    fn place(&self, node: usize) -> Vec3 {
        self.curves.positions()[node]
    }

    /// The neighbours of a node that may move.
    fn around(&self, node: usize) -> Option<[usize; 2]> {
        match self.neighbors[node][..] {
            [from, to] if self.is_free[node] => Some([from as usize, to as usize]),
            _ => None,
        }
    }

    fn look(&self, node: usize, last: &[Look]) -> Look {
        let Some([from, to]) = self.around(node) else { return Look::default() };
        if [from, node, to].iter().all(|&it| last[it].is_settled() || !self.is_free[it]) {
            return last[node];
        }
        let along = self.place(to) - self.place(from);
        self.look_across(node, along, REACH * last[node].median).unwrap_or_default()
    }

    fn look_across(&self, node: usize, along: Vec3, range: f64) -> Option<Look> {
        let along = along.try_normalize(0.0)?;
        let side = along.cross(&Vec3::ith(along.iamin(), 1.0)).normalize();
        let other = along.cross(&side);
        let directions: [Vec3; RAYS] = std::array::from_fn(|ray| {
            let (sin, cos) = (std::f64::consts::TAU * ray as f64 / RAYS as f64).sin_cos();
            side * cos + other * sin
        });
        let lengths = directions.map(|it| {
            let hit = self.field.tree().first_hit(self.place(node), it, [0.0, range]);
            hit.map_or(f64::INFINITY, |it| it.along)
        });
        let mut sorted = lengths;
        sorted.sort_unstable_by(f64::total_cmp);
        let median = sorted[RAYS / 2].max(LEAST_MEDIAN * self.curves.radii()[node]);
        // Only both rays of a pair may be left out: one of them would pull to its side.
        let (mut sum, mut count) = (Vec3::zeros(), 0);
        for (ray, direction) in directions[..RAYS / 2].iter().enumerate() {
            let pair = [lengths[ray], lengths[ray + RAYS / 2]];
            if pair.iter().all(|it| it.is_finite() && *it <= REACH * median) {
                sum += direction * (pair[0] - pair[1]);
                count += 2;
            }
        }
        (count > 0).then(|| Look { shift: sum / f64::from(count), median })
    }

    /// Where a node goes: to the middle, unless that folds the curve or is behind the surface.
    fn moved(&self, node: usize, looks: &[Look]) -> Vec3 {
        let place = self.place(node);
        let Some(around) = self.around(node) else { return place };
        let [from, to] = around.map(|it| self.place(it));
        let new = if turns_back([from, place, to]) {
            (from + to) * 0.5
        } else {
            let beside = around.map(|it| looks[it].shift);
            let shift = looks[node].shift.lerp(&((beside[0] + beside[1]) * 0.5), BLEND);
            let shifted = place + shift;
            if turns_back([from, shifted, to]) {
                return place;
            }
            shifted
        };
        let tree = self.field.tree();
        let leaves = |it: Vec3| tree.is_crossed(new, it) && !tree.is_crossed(place, it);
        if new == place || tree.is_crossed(place, new) || leaves(from) || leaves(to) {
            return place;
        }
        new
    }
}

/// Whether a curve turns by more than a right angle.
fn turns_back([from, place, to]: [Vec3; 3]) -> bool {
    (place - from).dot(&(to - place)) < 0.0
}

/// Without the nodes that have no vertices and at which the curve turns back, as far as it is inside
/// without them; and the new number of every node that is kept.
fn without_folds(curves: &CurveSkeleton, field: &DistanceField) -> (CurveSkeleton, Vec<u32>) {
    let mut neighbors = curves.neighbors();
    let places = curves.positions();
    let mut is_kept = vec![true; curves.n_nodes()];
    for (node, vertices) in curves.vertices_of_nodes().iter().enumerate() {
        let [from, to] = neighbors[node][..] else { continue };
        let [a, b] = [from, to].map(|it| places[it as usize]);
        let is_fold = vertices.is_empty() && turns_back([a, places[node], b]);
        if is_fold && !neighbors[from as usize].contains(&to) && !field.tree().is_crossed(a, b) {
            is_kept[node] = false;
            for [end, other] in [[from, to], [to, from]] {
                let around = &mut neighbors[end as usize];
                around.iter_mut().filter(|it| **it == node as u32).for_each(|it| *it = other);
            }
        }
    }
    let chosen = || (0..curves.n_nodes()).filter(|&it| is_kept[it]);
    let mut kept = vec![NO_NODE; curves.n_nodes()];
    for (new, old) in chosen().enumerate() {
        kept[old] = new as u32;
    }
    let edges = chosen().flat_map(|node| {
        let after = neighbors[node].iter().filter(move |it| **it as usize > node);
        after.map(move |&it| [node as u32, it])
    });
    let edges = edges.map(|it| it.map(|node| kept[node as usize])).collect();
    let labels = curves.node_of_vertex().iter();
    let labels = labels.map(|&it| if it == NO_NODE { it } else { kept[it as usize] }).collect();
    let positions = chosen().map(|it| places[it]).collect();
    let radii = chosen().map(|it| curves.radii()[it]).collect();
    let rest = CurveSkeleton::new(positions, radii, edges, labels).expect("a part of the graph");
    (rest, kept)
}

/// Gives vertices to the nearest of their node and the new ones beside it, and radii by them.
fn with_vertices_of_new(
    curves: &CurveSkeleton,
    vertices: &[Vec3],
    new_beside: &[Vec<u32>],
    kept: &[u32],
) -> CurveSkeleton {
    let mut candidates = vec![Vec::new(); curves.n_nodes()];
    for (node, beside) in new_beside.iter().enumerate().filter(|it| kept[it.0] != NO_NODE) {
        let all = std::iter::once(node as u32).chain(beside.iter().copied());
        let all = all.map(|it| kept[it as usize]).filter(|it| *it != NO_NODE);
        candidates[kept[node] as usize] = all.collect();
    }
    let nearest = |(&node, vertex): (&u32, &Vec3)| {
        if node == NO_NODE {
            return node;
        }
        let distance = |it: u32| (curves.positions()[it as usize] - vertex).norm_squared();
        let all = candidates[node as usize].iter().copied();
        all.min_by(|&a, &b| distance(a).total_cmp(&distance(b))).unwrap_or(node)
    };
    let labels = curves.node_of_vertex().par_iter().zip(vertices).map(nearest).collect();
    let (places, edges) = (curves.positions().to_vec(), curves.edges().to_vec());
    let labelled = CurveSkeleton::new(places, curves.radii().to_vec(), edges, labels);
    let labelled = labelled.expect("labels of nodes there are");
    // Those without vertices keep what was between their neighbours.
    let measured = with_radii(&labelled, vertices);
    let radius = |(new, old): (&f64, &f64)| if *new > 0.0 { *new } else { *old };
    let radii = measured.radii().iter().zip(curves.radii()).map(radius).collect();
    let (places, edges) = (curves.positions().to_vec(), curves.edges().to_vec());
    CurveSkeleton::new(places, radii, edges, labelled.node_of_vertex().to_vec())
        .expect("only radii are others, and they are finite")
}
