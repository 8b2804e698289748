//! How far a fitted surface is from its target.

use rayon::prelude::*;

use super::pulls::Samples;
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::geometry::triangle_tree::TriangleTree;

/// How far a fitted surface is from a target, over the root of the surface's area.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gap {
    /// The mean distance from the target's vertices to the surface.
    pub mean: f64,
    /// Nine tenths of the target are nearer than this.
    pub ninth_tenth: f64,
}

/// Measures the distances of samples of the target from the surface.
///
/// # Panics
/// If the surface has no faces.
pub fn gap(fitted: &TriMesh, target: &TriMesh, samples: usize) -> Gap {
    let tree = TriangleTree::new(fitted);
    let samples = Samples::of(target, samples, 1);
    let root = fitted.area().sqrt();
    let distance = |it: &u32| tree.nearest(target.vertices()[*it as usize]).square.sqrt() / root;
    let distances: Vec<f64> = samples.vertices.par_iter().map(distance).collect();
    let mean = distances.iter().zip(&samples.weights).map(|(it, weight)| it * weight).sum();
    let mut order: Vec<usize> = (0..distances.len()).collect();
    order.sort_by(|&a, &b| distances[a].total_cmp(&distances[b]));
    let mut sum = 0.0;
    let at_nine_tenths = order.iter().find(|&&it| {
        sum += samples.weights[it];
        sum >= 0.9
    });
    let last = order.last().expect("a mesh has vertices");
    Gap { mean, ninth_tenth: distances[*at_nine_tenths.unwrap_or(last)] }
}
