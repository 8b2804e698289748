//! Curves without the nodes at which they turn back.

use super::super::super::curve_skeleton::{CurveSkeleton, NO_NODE};
use super::Surroundings;
use crate::kernels::geometry::mesh::Vec3;

/// Whether a curve turns by more than a right angle.
pub fn turns_back([from, place, to]: [Vec3; 3]) -> bool {
    (place - from).dot(&(to - place)) < 0.0
}

/// Without the nodes that have no vertices and at which the curve turns back, as far as it is inside
/// without them; and the new number of every node that is kept.
pub fn without_folds(
    curves: &CurveSkeleton,
    shape: &dyn Surroundings,
) -> (CurveSkeleton, Vec<u32>) {
    let mut neighbors = curves.neighbors();
    let places = curves.positions();
    let mut is_kept = vec![true; curves.n_nodes()];
    for (node, vertices) in curves.vertices_of_nodes().iter().enumerate() {
        let [from, to] = neighbors[node][..] else { continue };
        let [a, b] = [from, to].map(|it| places[it as usize]);
        let is_fold = vertices.is_empty() && turns_back([a, places[node], b]);
        if is_fold && !neighbors[from as usize].contains(&to) && !shape.is_crossed(a, b) {
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
