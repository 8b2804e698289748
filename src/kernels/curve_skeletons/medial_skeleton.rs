//! Curves along the largest balls inside a body.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::curve_skeleton::{CurveSkeleton, NO_NODE};
use crate::kernels::geometry::distance_field::DistanceField;
use crate::kernels::geometry::medial_balls::{BODY_SIZE, Ball, MedialOptions, medial_balls, pack};
use crate::kernels::geometry::medial_graph::MedialGraph;
use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::geometry::shapes::outward;

const MAX_BALLS: usize = 1000;

/// How curves are chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MedialSkeletonOptions {
    /// The least angle between two places where a ball touches the surface, in degrees.
    pub angle_deg: f64,
    /// A curve goes to a ball that sticks out of this many times the balls on the curves so far.
    pub reach: f64,
}

impl Default for MedialSkeletonOptions {
    fn default() -> Self {
        Self { angle_deg: 90.0, reach: 2.5 }
    }
}

/// Extracts the curve skeleton of a closed surface from the balls inside it.
///
/// Balls that touch the surface at several places are packed and connected as for an embedding
/// (Baran & Popović 2007). From the largest ball on, the farthest ball that is not yet covered is joined to
/// what there is, by the way along the thickest balls, until all are covered (Sato et al., "TEASAR",
/// 2000): every connected part is a tree, so handles are open. Nodes are the centres of balls, with
/// their radii; vertices belong to the node whose ball is nearest. There is no node if nothing is
/// inside.
pub fn medial_skeleton(mesh: &TriMesh, options: &MedialSkeletonOptions) -> CurveSkeleton {
    let (low, high) = mesh.bounds();
    let size = (high - low).max();
    let nothing = || {
        let unknown = vec![NO_NODE; mesh.n_vertices()];
        CurveSkeleton::new(vec![], vec![], vec![], unknown).expect("there is no node to be wrong")
    };
    let scale = BODY_SIZE / size;
    if mesh.n_faces() == 0 || !(size > 0.0 && scale.is_finite()) {
        return nothing();
    }
    let scaled = mesh.vertices().iter().map(|it| (it - low) * scale).collect();
    let inside = outward(mesh.with_vertices(scaled).expect("finite vertices stay finite"));
    let field = DistanceField::new(&inside);
    let medial = MedialOptions::for_body(options.angle_deg);
    let balls = pack(&medial_balls(&field, &inside, &medial), MAX_BALLS);
    if balls.is_empty() {
        return nothing();
    }
    let graph = MedialGraph::new(balls, &field);
    let (kept, edges) = curves(&graph, options.reach);
    let mut kept: Vec<Ball> = kept.iter().map(|&it| graph.balls[it]).collect();
    smooth(&mut kept, &edges, &field);
    let places = kept.iter().map(|it| low + it.center / scale).collect();
    let radii = kept.iter().map(|it| it.radius / scale).collect();
    let nearest = |place: &Vec3| {
        let distance = |it: &Ball| (it.center - place).norm() - it.radius;
        let nodes = 0..kept.len() as u32;
        nodes.min_by(|&a, &b| distance(&kept[a as usize]).total_cmp(&distance(&kept[b as usize])))
    };
    let labels = inside.vertices().iter().map(|it| nearest(it).unwrap_or(NO_NODE)).collect();
    CurveSkeleton::new(places, radii, edges, labels).expect("edges join balls that are kept")
}

/// Straightens curves where the body is wide and balls lie side by side: a node between two others moves
/// towards their middle as long as its ball stays almost as large.
fn smooth(balls: &mut [Ball], edges: &[[u32; 2]], field: &DistanceField) {
    const ROUNDS: usize = 20;
    const LEAST: f64 = 0.97;
    let mut neighbors = vec![Vec::new(); balls.len()];
    for &[a, b] in edges {
        neighbors[a as usize].push(b as usize);
        neighbors[b as usize].push(a as usize);
    }
    for _ in 0..ROUNDS {
        let before = balls.to_vec();
        for (ball, neighbors) in balls.iter_mut().zip(&neighbors) {
            let [a, b] = neighbors[..] else { continue };
            let middle = (before[a].center + before[b].center) / 2.0;
            let center = (ball.center + middle) / 2.0;
            let radius = -field.distance(center);
            if radius >= LEAST * ball.radius {
                *ball = Ball { center, radius };
            }
        }
    }
}

/// The balls that curves lead over, in the order in which they were found, and the edges between them.
fn curves(graph: &MedialGraph, reach: f64) -> (Vec<usize>, Vec<[u32; 2]>) {
    let mut kept: Vec<usize> = Vec::new();
    let mut edges: Vec<[u32; 2]> = Vec::new();
    let mut node_of_ball: Vec<Option<u32>> = vec![None; graph.n()];
    let mut is_covered = vec![false; graph.n()];
    // Balls are sorted by their radii, so the first of a component is its largest.
    for root in 0..graph.n() {
        let is_reached = kept.iter().any(|&it| graph.distance(it, root).is_finite());
        if is_reached {
            continue;
        }
        let in_component = |it: &usize| graph.distance(root, *it).is_finite();
        let members: Vec<usize> = (0..graph.n()).filter(in_component).collect();
        // Noise cuts single balls off, and a ball by itself is no curve.
        if members.len() == 1 && !kept.is_empty() {
            continue;
        }
        node_of_ball[root] = Some(kept.len() as u32);
        kept.push(root);
        cover(graph, &[root], reach, &mut is_covered);
        while let Some(end) = farthest(graph, &members, &kept, &is_covered) {
            let way = way_to(graph, &node_of_ball, end);
            let mut last = node_of_ball[way[0]].expect("ways begin at what there is");
            for &ball in &way[1..] {
                let node = kept.len() as u32;
                node_of_ball[ball] = Some(node);
                kept.push(ball);
                edges.push([last, node]);
                last = node;
            }
            cover(graph, &way, reach, &mut is_covered);
            is_covered[end] = true;
        }
    }
    (kept, edges)
}

/// Marks balls that do not stick out of the balls of a way, made larger.
fn cover(graph: &MedialGraph, way: &[usize], reach: f64, is_covered: &mut [bool]) {
    for (ball, is_covered) in graph.balls.iter().zip(is_covered) {
        let is_within = |&it: &usize| {
            let over = &graph.balls[it];
            (ball.center - over.center).norm() + ball.radius <= reach * over.radius
        };
        *is_covered = *is_covered || way.iter().any(is_within);
    }
}

/// The ball farthest from the curves so far among those that are not covered.
fn farthest(
    graph: &MedialGraph,
    members: &[usize],
    kept: &[usize],
    is_covered: &[bool],
) -> Option<usize> {
    let distance =
        |ball: usize| kept.iter().map(|&it| graph.distance(it, ball)).fold(f64::INFINITY, f64::min);
    let open = members.iter().copied().filter(|&it| !is_covered[it]);
    let far: Vec<(f64, usize)> = open.map(|it| (distance(it), it)).collect();
    far.into_iter().max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1))).map(|it| it.1)
}

/// The way along thick balls from the curves so far to a ball (Dijkstra 1959): a step costs its length
/// over the smaller radius.
fn way_to(graph: &MedialGraph, node_of_ball: &[Option<u32>], end: usize) -> Vec<usize> {
    let mut costs = vec![f64::INFINITY; graph.n()];
    let mut before = vec![end; graph.n()];
    costs[end] = 0.0;
    // Costs are positive, so their bits are in their order.
    let mut heap = BinaryHeap::from([Reverse((0_u64, end))]);
    while let Some(Reverse((bits, ball))) = heap.pop() {
        let cost = f64::from_bits(bits);
        if cost > costs[ball] {
            continue;
        }
        if node_of_ball[ball].is_some() {
            let mut way = vec![ball];
            while way[way.len() - 1] != end {
                way.push(before[way[way.len() - 1]]);
            }
            return way;
        }
        for &next in &graph.neighbours[ball] {
            let (next, here) = (next as usize, &graph.balls[ball]);
            let there = &graph.balls[next];
            let length = (there.center - here.center).norm();
            let sum = cost + length / here.radius.min(there.radius);
            if sum < costs[next] {
                costs[next] = sum;
                before[next] = ball;
                heap.push(Reverse((sum.to_bits(), next)));
            }
        }
    }
    vec![end]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes::{icosphere, torus};
    use crate::kernels::synthetic::synthesize::{SynthesizeOptions, synthesize};

    fn skeleton(mesh: &TriMesh) -> CurveSkeleton {
        medial_skeleton(mesh, &MedialSkeletonOptions::default())
    }

    #[test]
    fn a_figure_has_a_curve_into_every_limb() {
        let options = SynthesizeOptions { n_vertices: 1000, ..Default::default() };
        let figure = synthesize(&options).unwrap();
        let curves = skeleton(&figure.mesh);
        assert_eq!(curves.n_cycles(), 0);
        assert_eq!(curves.node_of_vertex().len(), figure.mesh.n_vertices());
        let field = DistanceField::new(&figure.mesh);
        for (place, radius) in curves.positions().iter().zip(curves.radii()) {
            assert!((field.distance(*place) + radius).abs() < 0.02 * radius, "{radius}");
        }
        for (name, &vertex) in figure.landmarks.names.iter().zip(&figure.landmarks.vertices) {
            if !["hand", "foot", "head"].iter().any(|it| name.starts_with(it)) {
                continue;
            }
            let place = figure.mesh.vertices()[vertex as usize];
            let beyond = |leaf: u32| {
                let leaf = leaf as usize;
                (curves.positions()[leaf] - place).norm() - curves.radii()[leaf]
            };
            let nearest = curves.leaves().into_iter().map(beyond).fold(f64::INFINITY, f64::min);
            assert!(nearest < 0.1, "{name} {nearest}");
        }
    }

    #[test]
    fn rings_are_open_and_faces_may_look_inward() {
        let ring = torus(1.0, 0.3, 90, 40);
        for mesh in [ring.inverted(), ring] {
            let curves = skeleton(&mesh);
            assert_eq!((curves.n_components(), curves.junctions().len()), (1, 0));
            assert_eq!(curves.leaves().len(), 2);
            assert!(curves.total_length() > 5.0, "{}", curves.total_length());
        }
    }

    #[test]
    fn what_has_no_inside_has_no_curve() {
        let points = TriMesh::from_points(vec![Vec3::x(), Vec3::y()]).unwrap();
        assert_eq!(skeleton(&points).n_nodes(), 0);
        let flat =
            TriMesh::new(vec![Vec3::x(), Vec3::y(), Vec3::zeros()], vec![[0, 1, 2]]).unwrap();
        assert_eq!(skeleton(&flat).n_nodes(), 0);
        assert_eq!(skeleton(&icosphere(2)).n_edges(), 0);
    }
}
