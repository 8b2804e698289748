//! How wide a surface is around the nodes of a skeleton.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::f64::consts::{FRAC_PI_2, SQRT_2};

use super::super::curve_skeleton::CurveSkeleton;
use super::super::local_separators::SpatialGraph;
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::geometry::topology::Edges;

/// For every node, how far a spur may lead from there and still be one of the surface's rim.
///
/// On an open strip curves fork into the corners, over `sqrt(2)` times half the strip's width along the
/// surface, which is the largest distance of the node's vertices from the boundary. It is bounded by a
/// quarter turn around the node's farthest vertex, since a boundary that is far away (the open end of
/// a limb) makes no strip. Never less than the node's radius, which is all there is on closed
/// surfaces. A node without vertices takes the largest value of its neighbours.
pub fn strip_radii(skeleton: &CurveSkeleton, mesh: &TriMesh) -> Vec<f64> {
    let mut radii = skeleton.radii().to_vec();
    let Some(distances) = distances_from_boundary(mesh) else {
        return radii;
    };
    let vertices_of_nodes = skeleton.vertices_of_nodes();
    for (node, vertices) in vertices_of_nodes.iter().enumerate() {
        let position = skeleton.positions()[node];
        let offsets = vertices.iter().map(|&it| (mesh.vertices()[it as usize] - position).norm());
        let quarter_turn = FRAC_PI_2 * offsets.fold(0.0, f64::max);
        let inward = vertices.iter().map(|&it| distances[it as usize]).fold(0.0, f64::max) * SQRT_2;
        radii[node] = radii[node].max(inward.min(quarter_turn));
    }
    let neighbors = skeleton.neighbors();
    let around = |node: usize| {
        neighbors[node].iter().map(|&it| radii[it as usize]).fold(radii[node], f64::max)
    };
    let is_bare = |node: &usize| vertices_of_nodes[*node].is_empty();
    let filled: Vec<(usize, f64)> =
        (0..radii.len()).filter(is_bare).map(|node| (node, around(node))).collect();
    filled.into_iter().for_each(|(node, radius)| radii[node] = radius);
    radii
}

/// The distance of every vertex from the boundary along edges; none if there is no boundary.
fn distances_from_boundary(mesh: &TriMesh) -> Option<Vec<f64>> {
    let edges = Edges::of(&proper_faces(mesh));
    let rims = edges.iter().filter(|it| it.len() == 1).flat_map(|it| [it[0].low, it[0].high]);
    let mut distances = vec![f64::INFINITY; mesh.n_vertices()];
    let mut heap = BinaryHeap::new();
    for vertex in rims {
        distances[vertex as usize] = 0.0;
        heap.push(Reverse((0_u64, vertex)));
    }
    if heap.is_empty() {
        return None;
    }
    let graph = SpatialGraph::of_mesh(mesh);
    while let Some(Reverse((bits, vertex))) = heap.pop() {
        let distance = f64::from_bits(bits);
        if distance > distances[vertex as usize] {
            continue;
        }
        for &next in graph.neighbors(vertex) {
            let length = distance + graph.length(vertex, next);
            if length < distances[next as usize] {
                distances[next as usize] = length;
                heap.push(Reverse((length.to_bits(), next)));
            }
        }
    }
    // What no boundary can be reached from is closed.
    distances.iter_mut().filter(|it| it.is_infinite()).for_each(|it| *it = 0.0);
    Some(distances)
}

fn proper_faces(mesh: &TriMesh) -> Vec<[u32; 3]> {
    let faces = mesh.faces().iter().copied();
    faces.filter(|it| !crate::kernels::geometry::topology::is_collapsed(it)).collect()
}
