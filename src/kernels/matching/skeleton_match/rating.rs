//! How well matched skeletons agree.

use nalgebra::{Rotation3, UnitQuaternion};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::collapse::Collapsed;
use super::graph::SkeletonGraph;
use crate::kernels::geometry::mesh::Vec3;

/// What the first rating compares.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Rating {
    /// Shares of lengths of branches in the length of the skeleton, and numbers of branches at nodes: as the paper
    /// defines it.
    #[default]
    Lengths,
    /// Numbers of nodes between the ends of branches: as the paper's pseudo-code has it.
    NodeCounts,
}

/// What the second rating compares.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SecondRating {
    /// Places of matched nodes, after position and size are taken away: as in the paper.
    #[default]
    Places,
    /// The directions in which branches leave their branch nodes, after each of these has been turned as
    /// fits best. Left and right stay apart where a pose brings one limb to where another was.
    Directions,
}

/// What branches count in the first rating, in the skeleton's own terms.
pub fn sizes(collapsed: &Collapsed, rating: Rating) -> Vec<f64> {
    let total = collapsed.total_length();
    let size = |it: &super::collapse::Branch| match rating {
        Rating::NodeCounts => it.inner.len() as f64,
        Rating::Lengths if total > 0.0 => it.length / total,
        Rating::Lengths => 0.0,
    };
    collapsed.branches.iter().map(size).collect()
}

/// The places of the nodes of a collapsed skeleton, with the mean and the spread of its whole length
/// taken away.
pub fn normalized_places(graph: &SkeletonGraph, collapsed: &Collapsed) -> Vec<Vec3> {
    let (center, spread) = moments(graph);
    let place = |it: &u32| (graph.positions[*it as usize] - center) / spread;
    collapsed.nodes.iter().map(place).collect()
}

/// The mean place of a skeleton's length, and the root of the mean squared distance from it.
fn moments(graph: &SkeletonGraph) -> (Vec3, f64) {
    let segments: Vec<(f64, Vec3, Vec3)> = graph
        .edges
        .iter()
        .map(|ends| ends.map(|it| graph.positions[it as usize]))
        .map(|[a, b]| ((b - a).norm(), a, b))
        .collect();
    let total: f64 = segments.iter().map(|it| it.0).sum();
    if !(total > 0.0) {
        let mean = graph.positions.iter().sum::<Vec3>() / graph.positions.len() as f64;
        return (mean, 1.0);
    }
    let center = segments.iter().map(|(l, a, b)| (a + b) * (l / 2.0)).sum::<Vec3>() / total;
    let second = |(length, a, b): &(f64, Vec3, Vec3)| {
        let (a, b) = (a - center, b - center);
        length * (a.norm_squared() + b.norm_squared() + a.dot(&b)) / 3.0
    };
    let spread = (segments.iter().map(second).sum::<f64>() / total).sqrt();
    (center, if spread > 0.0 { spread } else { 1.0 })
}

/// The mean distance of matched places; with an axis, after the turn about it that makes the squares of
/// distances least. Turns only: left stays left.
pub fn mean_distance(pairs: &[(Vec3, Vec3)], axis: Option<&Vec3>) -> f64 {
    if pairs.is_empty() {
        return 0.0;
    }
    let turn = axis.map_or_else(UnitQuaternion::identity, |axis| best_turn(pairs, axis));
    let sum: f64 = pairs.iter().map(|(a, b)| (turn * a - b).norm()).sum();
    sum / pairs.len() as f64
}

/// The turn about an axis that brings the first places to the second best.
pub fn best_turn(pairs: &[(Vec3, Vec3)], axis: &Vec3) -> UnitQuaternion<f64> {
    let axis = nalgebra::Unit::new_normalize(*axis);
    let (mut cosine, mut sine) = (0.0, 0.0);
    for (a, b) in pairs {
        let [a, b] = [a, b].map(|it| it - *axis * it.dot(&axis));
        cosine += a.dot(&b);
        sine += axis.dot(&a.cross(&b));
    }
    if cosine == 0.0 && sine == 0.0 {
        return UnitQuaternion::identity();
    }
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_axis_angle(&axis, sine.atan2(cosine)))
}

/// No distance of two places is less after any turn about the axis.
pub fn least_distance(a: &Vec3, b: &Vec3, axis: Option<&Vec3>) -> f64 {
    let Some(axis) = axis else { return (a - b).norm() };
    let parts = [a, b].map(|it| {
        let height = it.dot(axis);
        (height, (it - axis * height).norm())
    });
    (parts[0].0 - parts[1].0).hypot(parts[0].1 - parts[1].1)
}
