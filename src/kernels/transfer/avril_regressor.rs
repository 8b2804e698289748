//! Joint regressors from all vertices that a joint moves, the way of Avril et al. 2016.

use nalgebra::Matrix3;

use super::{
    regressor::Regressor,
    regressor_masks::{RegressorError, RegressorOptions, RiggedMesh, Row, RowReport},
};
use crate::kernels::{
    geometry::mesh::{TriMesh, Vec3},
    rigs::{skeleton::Skeleton, weights::SkinWeights},
};

/// Computes joints as sums of all vertices that they move, the near ones before the far.
///
/// A reconstruction: the method of Avril et al. 2016 is known from what others say of it. Over the
/// vertices that a joint moves, it minimizes
///
/// `|X^T r - j|^2 + mu sum_i |x_i - j|^2 r_i^2` under `1^T r = 1`,
///
/// in closed form by Lagrange and Woodbury. There is no mask of vertices that keep their place when
/// the pose changes, so the target must stand as the source does. A vertex at the joint is taken to be a
/// millionth of the mesh's extent away.
///
/// # Errors
/// See [`RegressorError`].
pub fn avril_regressor(
    mesh: &TriMesh,
    skeleton: &Skeleton,
    weights: &SkinWeights,
    options: &RegressorOptions,
    mu: f64,
) -> Result<(Regressor, Vec<RowReport>), RegressorError> {
    let rig = RiggedMesh::new(mesh, skeleton, weights, options)?;
    let row = |joint: usize| {
        let mask = rig.usable_mask(rig.moved_masks(joint));
        let position = skeleton.positions()[joint];
        let offset = |&it: &u32| (mesh.vertices()[it as usize] - position) / rig.extent;
        let offsets: Vec<Vec3> = mask.vertices.iter().map(offset).collect();
        Row::new(mask, damped_row(&offsets, mu))
    };
    let rows: Vec<Row> = (0..skeleton.n_joints()).map(row).collect();
    Ok(rig.assemble(&rows))
}

/// `H^-1 1 / (1^T H^-1 1)` for `H = D + Y Y^T`, `D = mu diag(|y_i|^2)`.
fn damped_row(offsets: &[Vec3], mu: f64) -> Vec<f64> {
    let inverse = |y: &Vec3| 1.0 / (mu * y.norm_squared().max(1e-12));
    let mut system = Matrix3::identity();
    let mut right = Vec3::zeros();
    for y in offsets {
        system += y * y.transpose() * inverse(y);
        right += y * inverse(y);
    }
    let pull = system.cholesky().expect("at least the identity").solve(&right);
    let values: Vec<f64> = offsets.iter().map(|y| (1.0 - y.dot(&pull)) * inverse(y)).collect();
    let sum: f64 = values.iter().sum();
    values.iter().map(|it| it / sum).collect()
}

#[cfg(test)]
mod tests {
    use faer::Mat;

    use super::*;
    use crate::kernels::geometry::shapes::bumpy_sphere;
    use crate::kernels::numerics::cholesky::Cholesky;

    #[test]
    fn the_closed_form_is_the_minimum() {
        let mesh = bumpy_sphere(2);
        let joint = Vec3::new(0.3, 0.2, 0.1);
        let offsets: Vec<Vec3> = mesh.vertices().iter().map(|it| it - joint).collect();
        let n = offsets.len();
        let row = damped_row(&offsets, 1e-3);
        assert!((row.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        let system = Mat::from_fn(n, n, |i, j| {
            let damping = if i == j { 1e-3 * offsets[i].norm_squared() } else { 0.0 };
            offsets[i].dot(&offsets[j]) + damping
        });
        let ones = Mat::from_fn(n, 1, |_, _| 1.0);
        let dense = Cholesky::new(system.as_ref()).unwrap().solve(ones.as_ref());
        let sum: f64 = dense.col_as_slice(0).iter().sum();
        for (row, dense) in row.iter().zip(dense.col_as_slice(0)) {
            assert!((row - dense / sum).abs() < 1e-10, "{row} is not {}", dense / sum);
        }
    }

    #[test]
    fn less_damping_comes_nearer_to_the_joint() {
        let mesh = bumpy_sphere(4);
        let positions = vec![Vec3::new(0.3, 0.2, 0.1), Vec3::new(0.0, 0.1, 0.2)];
        let names = vec!["a".to_owned(), "b".to_owned()];
        let skeleton = Skeleton::new(names, vec![None, Some(0)], positions).unwrap();
        let rows = vec![vec![(0, 1.0)]; mesh.n_vertices()];
        let weights = SkinWeights::from_rows(2, &rows).unwrap();
        let options = RegressorOptions::default();
        let residuals = [1e-1, 1e-3, 1e-6].map(|mu| {
            let found = avril_regressor(&mesh, &skeleton, &weights, &options, mu).unwrap();
            let sums = found.0.matrix.mul_vec(&vec![1.0; mesh.n_vertices()]);
            assert!(sums.iter().all(|it| (it - 1.0).abs() < 1e-12), "{sums:?}");
            // The second joint moves nothing.
            assert_eq!(found.1[1].n_fallbacks, 1);
            found.1[0].residual
        });
        assert!(residuals[0] > 10.0 * residuals[1] && residuals[1] > 10.0 * residuals[2]);
    }
}
