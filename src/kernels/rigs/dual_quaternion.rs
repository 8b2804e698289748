//! Dual quaternion skinning: rigid motions blended as such, so that twists keep their volume.

use nalgebra::{Isometry3, Quaternion, Translation3};
use rayon::prelude::*;

use super::{skeleton::Skeleton, weights::SkinWeights};
use crate::kernels::geometry::mesh::Vec3;

/// A rigid motion as `rotation + epsilon dual`.
#[derive(Debug, Clone, Copy)]
struct DualQuaternion {
    rotation: Quaternion<f64>,
    /// Half of the translation times the rotation.
    dual: Quaternion<f64>,
}

impl DualQuaternion {
    fn new(motion: &Isometry3<f64>) -> Self {
        let rotation = motion.rotation.into_inner();
        let dual = Quaternion::from_imag(motion.translation.vector) * rotation * 0.5;
        Self { rotation, dual }
    }

    /// Moves a point by the motion along the way: the dual quaternion divided by its length.
    fn apply(&self, point: Vec3) -> Vec3 {
        let length = self.rotation.norm();
        let (rotation, dual) = (self.rotation / length, self.dual / length);
        let (u, w) = (rotation.imag(), rotation.w);
        let turned = point + 2.0 * u.cross(&(u.cross(&point) + w * point));
        turned + 2.0 * (w * dual.imag() - dual.w * u + u.cross(&dual.imag()))
    }
}

/// Moves points by the weighted dual quaternions of the joints (Kavan et al. 2007).
///
/// A rotation has two quaternions; each is taken with the sign that is nearer to the heaviest joint's
/// (of equal ones the first). Where all weights are on one joint this is linear blending.
pub fn blend_dual_quaternions(
    points: &[Vec3],
    skeleton: &Skeleton,
    weights: &SkinWeights,
    world_from_joint: &[Isometry3<f64>],
) -> Vec<Vec3> {
    let motions: Vec<DualQuaternion> = world_from_joint
        .iter()
        .zip(skeleton.positions())
        .map(|(it, rest)| DualQuaternion::new(&(it * Translation3::from(-rest))))
        .collect();
    let moved = |vertex: usize| {
        let heaviest = weights.row(vertex).fold((0, 0.0), |a, b| if b.1 > a.1 { b } else { a }).0;
        let pivot = motions[heaviest as usize].rotation;
        let mut sum = DualQuaternion {
            rotation: Quaternion::from_real(0.0),
            dual: Quaternion::from_real(0.0),
        };
        for (joint, weight) in weights.row(vertex) {
            let motion = motions[joint as usize];
            let signed = if motion.rotation.dot(&pivot) < 0.0 { -weight } else { weight };
            sum.rotation += motion.rotation * signed;
            sum.dual += motion.dual * signed;
        }
        sum.apply(points[vertex])
    };
    (0..points.len()).into_par_iter().map(moved).collect()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use nalgebra::UnitQuaternion;

    use super::*;
    use crate::kernels::rigs::skinning::blend;

    /// Two joints on the y axis, one turned about it; a ring of points between them.
    fn twist(angle_rad: f64) -> (Vec<Vec3>, Skeleton, SkinWeights, Vec<Isometry3<f64>>) {
        let names = vec!["upper".to_owned(), "lower".to_owned()];
        let positions = vec![Vec3::zeros(), Vec3::y()];
        let skeleton = Skeleton::new(names, vec![None, Some(0)], positions.clone()).unwrap();
        let ring = (0..8).map(|it| f64::from(it) * PI / 4.0);
        let points: Vec<Vec3> = ring.map(|it| Vec3::new(it.cos(), 0.5, it.sin())).collect();
        let weights = SkinWeights::from_rows(2, &vec![vec![(0, 0.5), (1, 0.5)]; 8]).unwrap();
        let turn = UnitQuaternion::from_axis_angle(&Vec3::y_axis(), angle_rad);
        let motions = vec![
            Isometry3::identity(),
            Isometry3::from_parts(Translation3::from(positions[1]), turn),
        ];
        (points, skeleton, weights, motions)
    }

    #[test]
    fn a_single_joint_moves_points_rigidly() {
        let (points, skeleton, _, mut motions) = twist(2.0);
        motions[1].translation = Translation3::new(3.0, -1.0, 0.5);
        let weights = SkinWeights::from_rows(2, &vec![vec![(1, 1.0)]; 8]).unwrap();
        let linear = blend(&points, &skeleton, &weights, &motions);
        let dual = blend_dual_quaternions(&points, &skeleton, &weights, &motions);
        for (a, b) in linear.iter().zip(&dual) {
            assert!((a - b).norm() < 1e-14, "{a} {b}");
        }
    }

    #[test]
    fn a_twist_keeps_its_girth() {
        for angle_rad in [0.0, 1.0, 2.5, 3.1] {
            let (points, skeleton, weights, motions) = twist(angle_rad);
            let linear = blend(&points, &skeleton, &weights, &motions);
            let dual = blend_dual_quaternions(&points, &skeleton, &weights, &motions);
            for (linear, dual) in linear.iter().zip(&dual) {
                let radius = |it: &Vec3| it.x.hypot(it.z);
                assert!((radius(dual) - 1.0).abs() < 1e-14, "{dual}");
                // The candy wrapper: points of opposite motions meet in the middle.
                assert!((radius(linear) - (angle_rad / 2.0).cos()).abs() < 1e-14, "{linear}");
            }
        }
    }

    #[test]
    fn the_shorter_way_is_taken() {
        // 350 degrees are 10 degrees back: half of it is 5 degrees back.
        let (points, skeleton, weights, motions) = twist(350f64.to_radians());
        let dual = blend_dual_quaternions(&points, &skeleton, &weights, &motions);
        let angle = 5f64.to_radians();
        assert!((dual[0] - Vec3::new(angle.cos(), 0.5, angle.sin())).norm() < 1e-12, "{}", dual[0]);
    }
}
