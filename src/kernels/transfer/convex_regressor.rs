//! Joint regressors without negative entries: joints that stay inside of their vertices' hull.

use nalgebra::{Matrix4, Vector4};

use super::{
    regressor::Regressor,
    regressor_masks::{RegressorError, RegressorOptions, RiggedMesh, Row, RowReport},
};
use crate::kernels::{
    geometry::mesh::{TriMesh, Vec3},
    rigs::{skeleton::Skeleton, weights::SkinWeights},
};

/// Computes joints as weighted means of few vertices: rows without negative entries that sum to one.
///
/// On the mask, least squares `|X^T r - j|^2` under `r >= 0`, `1^T r = 1`; of many solutions the one of
/// least norm. A joint inside of the hull of its vertices is met, one outside gives the nearest point
/// of the hull, at a distance that the report holds. The mask is the first that is usable (see
/// [`super::exact_regressor`]) and whose hull holds the joint; if there is none, the one that
/// comes nearest.
///
/// # Errors
/// See [`RegressorError`].
pub fn convex_regressor(
    mesh: &TriMesh,
    skeleton: &Skeleton,
    weights: &SkinWeights,
    options: &RegressorOptions,
) -> Result<(Regressor, Vec<RowReport>), RegressorError> {
    let rig = RiggedMesh::new(mesh, skeleton, weights, options)?;
    let rows: Vec<Row> = (0..skeleton.n_joints()).map(|it| best_row(&rig, it)).collect();
    Ok(rig.assemble(&rows))
}

/// How far from a joint the hull counts as holding it, as a part of the mesh's extent.
const INSIDE: f64 = 1e-6;

fn best_row(rig: &RiggedMesh<'_>, joint: usize) -> Row {
    let position = rig.skeleton.positions()[joint];
    let mut best: Option<(f64, Row)> = None;
    for mask in rig.masks(joint) {
        if !rig.is_usable(&mask) {
            continue;
        }
        let offsets = offsets(rig, &mask.vertices, position);
        let values = convex_combination(&offsets);
        let gap = combine(&offsets, &values).norm();
        if best.as_ref().is_none_or(|it| gap < it.0) {
            best = Some((gap, Row::new(mask, values)));
        }
        if gap <= INSIDE {
            break;
        }
    }
    best.map_or_else(
        || {
            let mask = rig.nearest_mask(joint);
            let values = convex_combination(&offsets(rig, &mask.vertices, position));
            Row::new(mask, values)
        },
        |it| it.1,
    )
}

/// Vertices seen from a joint, in extents of the mesh.
fn offsets(rig: &RiggedMesh<'_>, vertices: &[u32], joint: Vec3) -> Vec<Vec3> {
    vertices.iter().map(|&it| (rig.mesh.vertices()[it as usize] - joint) / rig.extent).collect()
}

fn combine(offsets: &[Vec3], values: &[f64]) -> Vec3 {
    offsets.iter().zip(values).map(|(offset, value)| offset * *value).sum()
}

/// The weights of the weighted mean of points that comes nearest to the origin.
///
/// The minimum of `|Y^T r|^2 + eps |r|^2` under `r >= 0`, `1^T r = 1` has the form
/// `r_i = max(0, a + b . y_i)`, where `(a, b)` minimizes the convex, piecewise quadratic
/// `1/2 sum_i max(0, a + b . y_i)^2 + eps/2 |b|^2 - a`: four unknowns for any number of points, found by
/// Newton's method while `eps` falls to 1e-8: below, the sum is lost in rounding errors.
fn convex_combination(offsets: &[Vec3]) -> Vec<f64> {
    let mut dual = Vector4::new(0.0, 0.0, 0.0, 1.0 / offsets.len() as f64);
    for exponent in 0..=8 {
        newton(offsets, &mut dual, 10f64.powi(-exponent));
    }
    let values: Vec<f64> = offsets.iter().map(|it| it.push(1.0).dot(&dual).max(0.0)).collect();
    let sum: f64 = values.iter().sum();
    values.iter().map(|it| it / sum).collect()
}

const MAX_STEPS: usize = 100;

fn newton(offsets: &[Vec3], dual: &mut Vector4<f64>, ridge: f64) {
    let ridges = Vector4::new(ridge, ridge, ridge, 0.0);
    let value = |dual: &Vector4<f64>| {
        let squares = offsets.iter().map(|it| it.push(1.0).dot(dual).max(0.0).powi(2));
        0.5 * squares.sum::<f64>() + 0.5 * ridges.dot(&dual.component_mul(dual)) - dual.w
    };
    let mut current = value(dual);
    for _ in 0..MAX_STEPS {
        let mut gradient = ridges.component_mul(dual) - Vector4::w();
        let mut curvature = Matrix4::from_diagonal(&ridges);
        for point in offsets.iter().map(|it| it.push(1.0)) {
            let entry = point.dot(dual);
            if entry > 0.0 {
                gradient += point * entry;
                curvature += point * point.transpose();
            }
        }
        let Some(factor) = curvature.cholesky() else { return };
        let step = factor.solve(&gradient);
        let mut length = 1.0;
        // The function is convex: only rounding errors leave every step without use.
        let next = loop {
            let next = *dual - step * length;
            let reached = value(&next);
            if reached < current {
                break Some((next, reached));
            }
            length /= 2.0;
            if length < 1e-6 {
                break None;
            }
        };
        let Some((next, reached)) = next else { return };
        (*dual, current) = (next, reached);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes::icosphere;
    use crate::kernels::numerics::random::Random;
    use crate::kernels::transfer::regressor_masks::MaskRule;

    fn cloud(seed: u64, count: usize, center: Vec3) -> Vec<Vec3> {
        let mut random = Random::new(seed);
        let mut unit = || random.uniform() - 0.5;
        (0..count).map(|_| Vec3::new(unit(), unit(), unit()) + center).collect()
    }

    /// The nearest point `p` of a hull to the origin has the hull on the far side of its plane.
    fn check_nearest(points: &[Vec3], tolerance: f64) {
        let values = convex_combination(points);
        assert!(values.iter().all(|&it| it >= 0.0));
        assert!((values.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        let nearest = combine(points, &values);
        let least = points.iter().map(|it| it.dot(&nearest)).fold(f64::INFINITY, f64::min);
        assert!(nearest.norm_squared() - least < tolerance, "{nearest}: {least}");
    }

    #[test]
    fn the_nearest_point_of_the_hull_is_found() {
        for seed in 0..20 {
            for distance in [0.0, 0.3, 0.7, 2.0] {
                check_nearest(&cloud(seed, 40, Vec3::new(distance, 0.1, 0.0)), 1e-6);
            }
        }
        check_nearest(&[Vec3::x()], 1e-12);
        check_nearest(&[Vec3::new(1.0, 1.0, 0.0), Vec3::new(1.0, -2.0, 0.0)], 1e-6);
    }

    #[test]
    fn of_many_solutions_the_one_of_least_norm_is_taken() {
        // The origin is the center of an octahedron.
        let points: Vec<Vec3> =
            (0..3).flat_map(|it| [Vec3::ith(it, 1.0), Vec3::ith(it, -1.0)]).collect();
        for value in convex_combination(&points) {
            assert!((value - 1.0 / 6.0).abs() < 1e-7, "{value}");
        }
    }

    #[test]
    fn a_joint_outside_of_the_body_goes_to_its_surface() {
        let mesh = icosphere(2);
        let names = vec!["in".to_owned(), "out".to_owned()];
        let positions = vec![Vec3::new(0.2, 0.1, 0.0), Vec3::new(0.0, 1.5, 0.0)];
        let skeleton = Skeleton::new(names, vec![None, Some(0)], positions).unwrap();
        let rows = vec![vec![(0, 0.5), (1, 0.5)]; mesh.n_vertices()];
        let weights = SkinWeights::from_rows(2, &rows).unwrap();
        let options = RegressorOptions::default();
        let (regressor, reports) = convex_regressor(&mesh, &skeleton, &weights, &options).unwrap();
        assert!(regressor.matrix.values.iter().all(|&it| it > 0.0));
        assert_eq!(reports[0].rule, MaskRule::Root { threshold: 0.0 });
        assert!(reports[0].residual < 1e-6, "{:?}", reports[0]);
        assert!((reports[1].residual - 0.5).abs() < 0.02, "{:?}", reports[1]);
    }
}
