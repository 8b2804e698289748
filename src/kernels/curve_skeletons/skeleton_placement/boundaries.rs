//! Moving nodes to the middle of the rings between their regions.

use std::collections::BTreeMap;

use super::super::curve_skeleton::{CurveSkeleton, NO_NODE};
use crate::kernels::geometry::mesh::Vec3;

/// Moves every node to the mean of the middles of the rings that separate its vertices from those of
/// its neighbours (Au et al. 2008, section 7); leaves and nodes without rings to the mean of their
/// vertices. Nodes without vertices stay.
///
/// `edges` join vertices on the surface. The middle of a ring is the mean of its vertices, weighted by
/// the lengths of the edges between them.
///
/// # Panics
/// If there is not a label for every vertex.
pub fn place_by_boundaries(
    skeleton: &CurveSkeleton,
    vertices: &[Vec3],
    edges: &[[u32; 2]],
) -> CurveSkeleton {
    let labels = skeleton.node_of_vertex();
    assert_eq!(labels.len(), vertices.len(), "a label for every vertex");
    let mut positions = skeleton.positions().to_vec();
    let mut middles: Vec<(Vec3, f64)> = vec![(Vec3::zeros(), 0.0); positions.len()];
    for ([own, _], middle) in ring_middles(skeleton, vertices, edges) {
        middles[own as usize].0 += middle;
        middles[own as usize].1 += 1.0;
    }
    let mut means: Vec<(Vec3, f64)> = vec![(Vec3::zeros(), 0.0); positions.len()];
    for (vertex, &node) in vertices.iter().zip(labels).filter(|it| *it.1 != NO_NODE) {
        means[node as usize].0 += vertex;
        means[node as usize].1 += 1.0;
    }
    for (node, degree) in skeleton.degrees().into_iter().enumerate() {
        let (sum, count) = match degree > 1 && middles[node].1 > 0.0 {
            true => middles[node],
            false => means[node],
        };
        if count > 0.0 {
            positions[node] = sum / count;
        }
    }
    skeleton.with_positions(positions).expect("means of finite places are finite")
}

/// The middle of the ring of a node's own vertices beside each neighbour's.
fn ring_middles(
    skeleton: &CurveSkeleton,
    vertices: &[Vec3],
    edges: &[[u32; 2]],
) -> Vec<([u32; 2], Vec3)> {
    let labels = skeleton.node_of_vertex();
    let label = |vertex: u32| labels[vertex as usize];
    let neighbors = skeleton.neighbors();
    // A region may reach past its neighbour's to the next: the ring is with the neighbour.
    let across = |own: u32, other: u32| {
        let around = &neighbors[own as usize];
        let is_joined = |it: u32| it == other || neighbors[it as usize].contains(&other);
        around
            .iter()
            .copied()
            .find(|&it| it == other)
            .or(around.iter().copied().find(|&it| is_joined(it)))
    };
    // The nodes beside every vertex.
    let mut beside: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for &[a, b] in edges {
        let (one, other) = (label(a), label(b));
        if one != other && one != NO_NODE && other != NO_NODE {
            beside.entry(a).or_default().extend(across(one, other));
            beside.entry(b).or_default().extend(across(other, one));
        }
    }
    for list in beside.values_mut() {
        list.sort_unstable();
        list.dedup();
    }
    let mut lengths: BTreeMap<([u32; 2], u32), f64> = BTreeMap::new();
    for (&vertex, others) in &beside {
        for &other in others {
            lengths.insert(([label(vertex), other], vertex), 0.0);
        }
    }
    for &[a, b] in edges.iter().filter(|it| label(it[0]) == label(it[1])) {
        let (Some(one), Some(two)) = (beside.get(&a), beside.get(&b)) else { continue };
        let length = (vertices[a as usize] - vertices[b as usize]).norm();
        for &other in one.iter().filter(|it| two.contains(it)) {
            for vertex in [a, b] {
                *lengths.get_mut(&([label(a), other], vertex)).expect("put in above") += length;
            }
        }
    }
    let mut sums: BTreeMap<[u32; 2], (Vec3, f64, Vec3, f64)> = BTreeMap::new();
    for ((pair, vertex), length) in lengths {
        let place = vertices[vertex as usize];
        let sum = sums.entry(pair).or_default();
        sum.0 += place * length;
        sum.1 += length;
        sum.2 += place;
        sum.3 += 1.0;
    }
    let middle = |(pair, (by_length, length, plain, count)): ([u32; 2], (Vec3, f64, Vec3, f64))| {
        (pair, if length > 0.0 { by_length / length } else { plain / count })
    };
    sums.into_iter().map(middle).collect()
}
