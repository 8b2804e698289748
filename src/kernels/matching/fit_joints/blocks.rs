//! What points say about the motions of the parts that they move with.

use nalgebra::{Isometry3, SMatrix, SVector};

use super::parts::moved;
use super::solve::{Pose, Weights};
use crate::kernels::geometry::mesh::Vec3;

pub type Matrix6 = SMatrix<f64, 6, 6>;
pub type Vector6 = SVector<f64, 6>;

/// A point of a part with its normal, at rest.
#[derive(Debug, Clone, Copy)]
pub struct Point {
    pub place: Vec3,
    pub normal: Vec3,
    pub part: usize,
    pub weight: f64,
    /// Skin near a joint: the joint, and the share with which it moves as the part behind; with the rest it
    /// moves as the part before.
    pub skin: Option<(usize, f64)>,
}

impl Point {
    /// The place in a pose, and the normal, which is shorter where skin folds.
    pub fn in_pose(&self, motions: &[Isometry3<f64>], sides: &[[usize; 2]]) -> (Vec3, Vec3) {
        let by = |it: &Isometry3<f64>| (moved(it, self.place), it.rotation * self.normal);
        let Some((joint, share)) = self.skin else { return by(&motions[self.part]) };
        let [before, behind] = sides[joint].map(|it| by(&motions[it]));
        let mixed = |a: Vec3, b: Vec3| a * (1.0 - share) + b * share;
        (mixed(before.0, behind.0), mixed(before.1, behind.1))
    }
}

/// The normal equations of every part, and of pairs of parts beside joints.
#[derive(Clone)]
pub struct Blocks {
    pub parts: Vec<(Matrix6, Vector6)>,
    /// Rows of the part before, columns of the part behind.
    pub pairs: Vec<Matrix6>,
    /// The weight of points that have something near them.
    pub near: f64,
}

impl Blocks {
    pub fn new(n_parts: usize, n_joints: usize) -> Self {
        Self {
            parts: vec![(Matrix6::zeros(), Vector6::zeros()); n_parts],
            pairs: vec![Matrix6::zeros(); n_joints],
            near: 0.0,
        }
    }

    pub fn add_all(&mut self, other: &Self) {
        for (block, more) in self.parts.iter_mut().zip(&other.parts) {
            block.0 += more.0;
            block.1 += more.1;
        }
        for (block, more) in self.pairs.iter_mut().zip(&other.pairs) {
            *block += more;
        }
        self.near += other.near;
    }

    /// Adds `weight * |residual + direction . (change of the moved point)|^2`.
    fn add_along(&mut self, seen: &Seen<'_>, direction: Vec3, residual: f64, weight: f64) {
        let Seen { point, motions, sides } = *seen;
        let row = |part: usize, share: f64| {
            let turn = moved(&motions[part], point.place).cross(&direction);
            Vector6::new(turn.x, turn.y, turn.z, direction.x, direction.y, direction.z) * share
        };
        let mut add = |part: usize, row: &Vector6| {
            self.parts[part].0 += row * row.transpose() * weight;
            self.parts[part].1 -= row * (residual * weight);
        };
        match point.skin {
            None => add(point.part, &row(point.part, 1.0)),
            Some((joint, share)) => {
                let [before, behind] = sides[joint];
                let rows = [row(before, 1.0 - share), row(behind, share)];
                add(before, &rows[0]);
                add(behind, &rows[1]);
                self.pairs[joint] += rows[0] * rows[1].transpose() * weight;
            }
        }
    }

    /// The same along all axes.
    pub fn add_place(&mut self, seen: &Seen<'_>, residual: Vec3, weight: f64) {
        for (axis, direction) in [Vec3::x(), Vec3::y(), Vec3::z()].into_iter().enumerate() {
            self.add_along(seen, direction, residual[axis], weight);
        }
    }
}

/// A point and what moves it.
#[derive(Clone, Copy)]
pub struct Seen<'a> {
    pub point: &'a Point,
    pub motions: &'a [Isometry3<f64>],
    /// Of joints: the part before and the one behind.
    pub sides: &'a [[usize; 2]],
}

/// Distances of points from the surface of a pose.
pub fn surface_terms(
    points: &[Point],
    motions: &[Isometry3<f64>],
    pose: &Pose<'_>,
    sides: &[[usize; 2]],
    weights: &Weights,
) -> Blocks {
    let mut blocks = Blocks::new(motions.len(), sides.len());
    let reach = weights.reach * weights.reach;
    for point in points {
        let (place, own_normal) = point.in_pose(motions, sides);
        let Some(near) = pose.surface.nearest_within(place, 9.0 * reach) else { continue };
        let normal = pose.normals[near.face as usize];
        if !is_same_side(own_normal, normal) {
            continue;
        }
        let away = place - near.point;
        let robust = (reach / (reach + near.square)).powi(2);
        let weight = point.weight * robust;
        let seen = Seen { point, motions, sides };
        blocks.add_along(&seen, normal, normal.dot(&away), weight);
        blocks.add_place(&seen, away, weight * weights.slide);
        blocks.near += weight;
    }
    blocks
}

/// Whether a normal may be that of a place on a surface: surfaces that look another way are another side of
/// the body.
pub fn is_same_side(normal: Vec3, of_surface: Vec3) -> bool {
    const LEAST_COSINE: f64 = 0.5;
    normal.dot(&of_surface) >= LEAST_COSINE * normal.norm()
}
