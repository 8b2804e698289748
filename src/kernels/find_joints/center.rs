//! Where the centre of a joint is: where the axis of the limb after it stays.

use nalgebra::{Matrix3, UnitQuaternion};

use super::chains::Chain;
use crate::kernels::mesh::Vec3;

/// How much the place on the curve counts against the limb's axes.
const CURVE_WEIGHT: f64 = 0.02;

/// What is known about how the side before a joint moves.
pub struct Base<'a> {
    /// The rotation of every pose against rest.
    pub frames: &'a [UnitQuaternion<f64>],
    /// Places on that side at rest, and in every pose.
    pub rest: Vec<Vec3>,
    pub poses: Vec<Vec<Vec3>>,
}

/// The point, at rest, that is nearest to the axis of the limb after a joint in all poses, seen from the
/// side before it.
///
/// A centre curve cuts corners and passes beside hips and shoulders, but a limb turns about a point of
/// its axis. Along an axis that does not turn nothing is known; there the place on the curve counts.
pub fn center(chain: &Chain, way: f64, window: f64, base: &Base<'_>) -> Vec3 {
    let place = chain.place(None, way);
    let [from, to] = [0.75, 2.0].map(|it| (way + it * window).min(chain.length()));
    let axis = |pose: Option<usize>| {
        let [a, b] = [from, to].map(|it| chain.place(pose, it));
        (b - a).try_normalize(1e-12).map(|direction| (a, direction))
    };
    if to - from < 0.25 * window {
        return place;
    }
    let mean = |points: &[Vec3]| points.iter().sum::<Vec3>() / points.len() as f64;
    let mut lines: Vec<(Vec3, Vec3)> = axis(None).into_iter().collect();
    for (pose, frame) in base.frames.iter().enumerate() {
        let Some((point, direction)) = axis(Some(pose)) else { continue };
        let point = frame.inverse() * (point - mean(&base.poses[pose])) + mean(&base.rest);
        lines.push((point, frame.inverse() * direction));
    }
    let mut matrix = Matrix3::identity() * (CURVE_WEIGHT * lines.len() as f64);
    let mut right = place * (CURVE_WEIGHT * lines.len() as f64);
    for (point, direction) in &lines {
        let across = Matrix3::identity() - direction * direction.transpose();
        matrix += across;
        right += across * point;
    }
    let center = matrix.cholesky().map_or(place, |it| it.solve(&right));
    if (center - place).norm() <= window { center } else { place }
}
