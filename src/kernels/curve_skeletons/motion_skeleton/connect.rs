//! One skeleton of several parts, by how they move.

use super::{Moving, paths::mean_places};
use crate::kernels::curve_skeletons::curve_skeleton::{CurveSkeleton, NO_NODE};
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::geometry::point_tree::PointTree;
use crate::kernels::geometry::spanning_tree::spanning_tree;

/// So many vertices of a component stand for all in the search for gaps.
const SAMPLES: usize = 1000;
/// Neighbours of a vertex among which borders of regions are looked for.
const NEIGHBORS: usize = 25;

/// Joins components to one tree (Transfer4D, section 3.2): those first that are closest in the frame in
/// which they are farthest apart (Kruskal 1956).
///
/// Two components are joined by the two nodes whose regions have the longest common border, if the
/// distance between them changes over time by less than a factor of `max_variation`; else by the
/// nearest two (over time) of which that is true; else by those whose distance changes least.
/// Returns the joined skeleton and the number of links.
pub fn connect_over_time(
    skeleton: &CurveSkeleton,
    moving: &Moving<'_>,
    max_variation: f64,
) -> (CurveSkeleton, usize) {
    let n_components = skeleton.n_components();
    if n_components < 2 {
        return (skeleton.clone(), 0);
    }
    let components = skeleton.components();
    let mut pairs: Vec<(f64, usize, usize)> = vec![];
    let samples = samples(skeleton, &components, n_components);
    for a in 0..n_components {
        for b in a + 1..n_components {
            pairs.push((gap(skeleton, moving, &components, &samples, a, b), a, b));
        }
    }
    let tracks = mean_places(skeleton, moving.frames(), moving.rest_places());
    let borders = borders(skeleton, moving, &components);
    let joins = spanning_tree(n_components, pairs);
    let n_links = joins.len();
    let links = joins
        .into_iter()
        .map(|(a, b)| link(skeleton, &components, &tracks, &borders, max_variation, [a, b]));
    let edges = skeleton.edges().iter().copied().chain(links).collect();
    let (positions, radii) = (skeleton.positions().to_vec(), skeleton.radii().to_vec());
    let joined = CurveSkeleton::new(positions, radii, edges, skeleton.node_of_vertex().to_vec())
        .expect("links are between nodes of different components");
    (joined, n_links)
}

/// Vertices of every component, spread over their numbers.
fn samples(skeleton: &CurveSkeleton, components: &[u32], n_components: usize) -> Vec<Vec<u32>> {
    let mut members = vec![vec![]; n_components];
    for (vertex, &node) in (0_u32..).zip(skeleton.node_of_vertex()) {
        if node != NO_NODE {
            members[components[node as usize] as usize].push(vertex);
        }
    }
    members.iter().map(|it| it.iter().copied().step_by(it.len() / SAMPLES + 1).collect()).collect()
}

/// The greatest over all frames of the least distance between vertices of two components; of their nodes
/// at rest where one has no vertices.
fn gap(
    skeleton: &CurveSkeleton,
    moving: &Moving<'_>,
    components: &[u32],
    samples: &[Vec<u32>],
    a: usize,
    b: usize,
) -> f64 {
    if samples[a].is_empty() || samples[b].is_empty() {
        let of = |component: usize| {
            let places = skeleton.positions().iter().zip(components);
            let places = places.filter(|it| *it.1 as usize == component).map(|it| *it.0);
            places.collect::<Vec<Vec3>>()
        };
        return least_distance(&of(a), &of(b));
    }
    let of = |component: usize, frame: &[Vec3]| {
        samples[component].iter().map(|&it| frame[it as usize]).collect::<Vec<Vec3>>()
    };
    let gaps = moving.frames().iter().map(|frame| least_distance(&of(a, frame), &of(b, frame)));
    gaps.fold(0.0, f64::max)
}

fn least_distance(a: &[Vec3], b: &[Vec3]) -> f64 {
    let tree = PointTree::new(b);
    let mut found = vec![];
    let mut least = f64::INFINITY;
    for place in a {
        tree.nearest(*place, 1, &mut found);
        let square = found.first().map(|it| (b[it.1 as usize] - place).norm_squared());
        least = least.min(square.unwrap_or(f64::INFINITY));
    }
    least.sqrt()
}

/// Pairs of nodes of different components with the number of their vertices' neighbourhoods that meet,
/// the smaller component first.
fn borders(
    skeleton: &CurveSkeleton,
    moving: &Moving<'_>,
    components: &[u32],
) -> std::collections::BTreeMap<[u32; 2], usize> {
    let labels = skeleton.node_of_vertex();
    let tree = PointTree::new(moving.rest_places());
    let (mut found, mut counts) = (vec![], std::collections::BTreeMap::new());
    for (vertex, place) in moving.rest_places().iter().enumerate() {
        let own = labels[vertex];
        if own == NO_NODE {
            continue;
        }
        tree.nearest(*place, NEIGHBORS, &mut found);
        for other in found.iter().map(|it| labels[it.1 as usize]).filter(|it| *it != NO_NODE) {
            if components[own as usize] < components[other as usize] {
                *counts.entry([own, other]).or_insert(0) += 1;
            }
        }
    }
    counts
}

/// The two nodes that join two components.
fn link(
    skeleton: &CurveSkeleton,
    components: &[u32],
    tracks: &[Vec<Vec3>],
    borders: &std::collections::BTreeMap<[u32; 2], usize>,
    max_variation: f64,
    [one, other]: [usize; 2],
) -> [u32; 2] {
    let of = |component: usize| {
        let nodes = 0..skeleton.n_nodes() as u32;
        nodes.filter(move |&it| components[it as usize] as usize == component)
    };
    let is_here = |it: &[u32; 2]| {
        let ends = it.map(|node| components[node as usize] as usize);
        ends == [one, other] || ends == [other, one]
    };
    let here = borders.iter().filter(|it| is_here(it.0));
    // Of equal borders the first pair.
    if let Some((&pair, _)) = here.max_by(|a, b| a.1.cmp(b.1).then(b.0.cmp(a.0)))
        && lengths(tracks, pair).1 < max_variation
    {
        return pair;
    }
    let pairs: Vec<([u32; 2], (f64, f64))> = of(one)
        .flat_map(|a| of(other).map(move |b| [a, b]))
        .map(|pair| (pair, lengths(tracks, pair)))
        .collect();
    let steady = pairs.iter().filter(|it| it.1.1 < max_variation);
    let nearest = steady.min_by(|a, b| a.1.0.total_cmp(&b.1.0).then(a.0.cmp(&b.0)));
    let steadiest = || pairs.iter().min_by(|a, b| a.1.1.total_cmp(&b.1.1).then(a.0.cmp(&b.0)));
    nearest.or_else(steadiest).expect("components have nodes").0
}

/// The greatest distance of two nodes over time, and its ratio to the least.
fn lengths(tracks: &[Vec<Vec3>], [a, b]: [u32; 2]) -> (f64, f64) {
    let lengths = tracks.iter().map(|it| (it[a as usize] - it[b as usize]).norm());
    let (least, greatest) =
        lengths.fold((f64::INFINITY, 0.0_f64), |(l, g), it| (l.min(it), g.max(it)));
    (greatest, if least > 0.0 { greatest / least } else { f64::INFINITY })
}
