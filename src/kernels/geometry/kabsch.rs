//! The rotation that fits pairs of vectors best.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion};

use super::mesh::Vec3;

/// A singular value below this share of the largest is zero.
const RANK: f64 = 1e-12;

/// The rotation `R` that minimizes `sum |b - R a|^2`, from `H = sum b a^T` (Kabsch 1976).
///
/// If all vectors are parallel, the smallest of the many best rotations; the identity if all are zero,
/// or if `H` is not finite.
pub fn best_rotation(covariance: &Matrix3<f64>) -> UnitQuaternion<f64> {
    if !covariance.iter().all(|it| it.is_finite()) {
        return UnitQuaternion::identity();
    }
    let svd = covariance.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return UnitQuaternion::identity() };
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| svd.singular_values[b].total_cmp(&svd.singular_values[a]));
    let [first, second, third] = order;
    let largest = svd.singular_values[first];
    if !(largest > 0.0 && largest.is_finite()) {
        return UnitQuaternion::identity();
    }
    if svd.singular_values[second] <= RANK * largest {
        return shortest_arc(v_t.row(first).transpose(), u.column(first).into_owned());
    }
    let mut signs = Vec3::repeat(1.0);
    signs[third] = (u * v_t).determinant().signum();
    let matrix = u * Matrix3::from_diagonal(&signs) * v_t;
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix))
}

/// The smallest rotation that turns a direction into another. Between opposite directions it is half a
/// turn about a perpendicular axis; a direction of no length is not turned.
pub fn shortest_arc(from: Vec3, to: Vec3) -> UnitQuaternion<f64> {
    // The largest coordinate first, so that no square overflows or vanishes.
    let unit = |it: Vec3| (it / it.amax()).try_normalize(0.0).filter(|it| it.norm() > 0.5);
    let (Some(from), Some(to)) = (unit(from), unit(to)) else {
        return UnitQuaternion::identity();
    };
    // Half-way between the two, which is accurate near both ends.
    let half = from + to;
    if half.norm() < 1e-9 {
        let mut axis = Vec3::zeros();
        axis[from.iamin()] = 1.0;
        let axis = nalgebra::Unit::new_normalize(from.cross(&axis));
        return UnitQuaternion::from_axis_angle(&axis, std::f64::consts::PI);
    }
    let half = half.normalize();
    let vector = from.cross(&half);
    let quaternion = nalgebra::Quaternion::new(from.dot(&half), vector.x, vector.y, vector.z);
    UnitQuaternion::new_normalize(quaternion)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::numerics::random::Random;

    #[test]
    fn the_rotation_of_turned_vectors_is_found() {
        let mut random = Random::new(1);
        let mut vector = || Vec3::from_fn(|_, _| random.normal());
        for n_vectors in [2, 3, 20] {
            for _ in 0..50 {
                let turn = UnitQuaternion::from_scaled_axis(vector());
                let vectors: Vec<Vec3> = (0..n_vectors).map(|_| vector()).collect();
                let covariance = vectors.iter().map(|it| (turn * it) * it.transpose()).sum();
                assert!(best_rotation(&covariance).angle_to(&turn) < 1e-6);
            }
        }
    }

    #[test]
    fn parallel_vectors_are_turned_the_shortest_way() {
        let (a, b) = (Vec3::new(1.0, 2.0, 0.5), Vec3::new(-0.3, 1.0, 2.0));
        let found = best_rotation(&(b * a.transpose()));
        assert!(found.angle_to(&shortest_arc(a, b)) < 1e-9);
        assert!((found.angle() - a.angle(&b)).abs() < 1e-9);
        assert_eq!(best_rotation(&Matrix3::zeros()), UnitQuaternion::identity());
    }

    #[test]
    fn arcs_lead_from_one_direction_to_the_other() {
        let mut random = Random::new(2);
        for tilt in [1.0, 1e-4, 1e-8, 1e-12, 0.0] {
            for side in [1.0, -1.0] {
                let from = Vec3::from_fn(|_, _| random.normal());
                let to = from * side + Vec3::from_fn(|_, _| random.normal()) * tilt;
                let turned = shortest_arc(from, to) * from.normalize();
                assert!((turned - to.normalize()).norm() < 1e-7, "{tilt} {side}");
            }
        }
        assert_eq!(shortest_arc(Vec3::zeros(), Vec3::x()), UnitQuaternion::identity());
        let far = shortest_arc(Vec3::x() * 1e300, Vec3::y() * 1e-300);
        assert!((far * Vec3::x() - Vec3::y()).norm() < 1e-12);
        assert_eq!(shortest_arc(Vec3::x() * f64::INFINITY, Vec3::y()), UnitQuaternion::identity());
    }
}
