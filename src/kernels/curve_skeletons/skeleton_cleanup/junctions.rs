//! Regions of curves without their junctions.

use super::super::curve_skeleton::{CurveSkeleton, NO_NODE};
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::geometry::point_tree::PointTree;

/// Gives the vertices of junctions to the node of the nearest vertex that belongs to no junction, so
/// that every vertex belongs to one curve. `vertices` are those of the shape.
///
/// Changes nothing where all vertices belong to junctions.
///
/// # Panics
/// If there is not a label for every vertex.
pub fn free_junctions(skeleton: &CurveSkeleton, vertices: &[Vec3]) -> CurveSkeleton {
    let labels = skeleton.node_of_vertex();
    assert_eq!(labels.len(), vertices.len(), "a label for every vertex");
    let degrees = skeleton.degrees();
    let is_junction = |node: u32| node != NO_NODE && degrees[node as usize] > 2;
    let others: Vec<usize> =
        (0..labels.len()).filter(|&it| labels[it] != NO_NODE && !is_junction(labels[it])).collect();
    let tree = PointTree::new(&others.iter().map(|&it| vertices[it]).collect::<Vec<_>>());
    let mut found = vec![];
    let mut freed = labels.to_vec();
    for vertex in (0..labels.len()).filter(|&it| is_junction(labels[it])) {
        tree.nearest(vertices[vertex], 1, &mut found);
        if let Some(&(_, nearest)) = found.first() {
            freed[vertex] = labels[others[nearest as usize]];
        }
    }
    let (positions, radii) = (skeleton.positions().to_vec(), skeleton.radii().to_vec());
    CurveSkeleton::new(positions, radii, skeleton.edges().to_vec(), freed)
        .expect("labels of nodes there are")
}
