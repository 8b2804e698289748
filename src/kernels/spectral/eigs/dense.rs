//! The dense solver, for small operators and for nearly all of the eigenpairs.

use super::{EigsError, Pairs};
use crate::kernels::numerics::tall;
use crate::kernels::spectral::operator::Operator;
use faer::Mat;

/// The `k` smallest eigenpairs of `M^-1/2 L M^-1/2`; masses are divided by their sum.
pub(super) fn solve(operator: &Operator, k: usize) -> Result<Pairs, EigsError> {
    let n = operator.mass.len();
    let total_mass: f64 = operator.mass.iter().sum();
    let root_mass: Vec<f64> = operator.mass.iter().map(|it| (it / total_mass).sqrt()).collect();
    let mut matrix = Mat::<f64>::zeros(n, n);
    for row in 0..n {
        for (col, value) in operator.stiffness.row(row) {
            matrix[(row, col)] = value / (root_mass[row] * root_mass[col]);
        }
    }
    let (values, vectors) = tall::symmetric_eigen(matrix.as_ref())
        .ok_or(EigsError::NotConverged { k, n_vertices: n })?;
    let scale = total_mass.sqrt();
    Ok(Pairs {
        eigenvalues: values[..k].iter().map(|it| it / total_mass).collect(),
        eigenvectors: Mat::from_fn(n, k, |row, col| vectors[(row, col)] / (root_mass[row] * scale)),
        n_solves: 0,
    })
}
