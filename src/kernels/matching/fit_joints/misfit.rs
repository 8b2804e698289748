//! How much of a part is off the surface of a pose.

use nalgebra::Isometry3;

use super::blocks::{Point, is_same_side};
use super::parts::moved;
use super::solve::Pose;

/// A part of which more than this share does not lie on the surface is lost.
pub const LOST: f64 = 0.3;

/// The share of a part that does not lie on the surface of a pose, from 0 to 1: a point counts 1 from
/// `reach` on, or where the surface looks another way.
pub fn misfit(points: &[&Point], motion: &Isometry3<f64>, pose: &Pose<'_>, reach: f64) -> f64 {
    let total: f64 = points.iter().map(|it| it.weight).sum();
    if !(total > 0.0) {
        return 0.0;
    }
    let off = |point: &&Point| {
        let near = pose.surface.nearest_within(moved(motion, point.place), reach * reach);
        let normal = motion.rotation * point.normal;
        let near = near.filter(|it| is_same_side(normal, pose.normals[it.face as usize]));
        let share = near.map_or(1.0, |it| it.square / (reach * reach));
        point.weight * share
    };
    points.iter().map(off).sum::<f64>() / total
}

/// The points of every part, at most about `most` of each.
pub fn points_of_parts(points: &[Point], n_parts: usize, most: usize) -> Vec<Vec<&Point>> {
    let mut all: Vec<Vec<&Point>> = vec![Vec::new(); n_parts];
    points.iter().for_each(|it| all[it.part].push(it));
    for list in &mut all {
        let stride = list.len().div_ceil(most.max(1)).max(1);
        *list = list.iter().step_by(stride).copied().collect();
    }
    all
}
