//! The solver for large operators: shift, invert, Lanczos.

use super::factor::ShiftedFactor;
use super::lanczos::{BLOCK, Lanczos};
use super::standard::StandardForm;
use super::{EigsError, Observer, Pairs, Phase};
use crate::kernels::numerics::tall;
use crate::kernels::spectral::operator::Operator;
use faer::Mat;
use std::f64::consts::PI;

/// How far the shift lies below zero, in parts of the largest eigenvalue that Weyl's law expects.
///
/// Far enough that the matrix is safely definite and that no eigenvalue of the inverse stands out
/// (which costs orthogonality), near enough that they are well spread.
const SHIFT: f64 = 0.03;
/// Residuals to which pairs converge, in parts of the largest eigenvalue.
const TOLERANCE: f64 = 2e-11;

/// The `k` smallest eigenpairs of an operator, `k` well below its size.
pub(super) fn solve(
    operator: &Operator,
    k: usize,
    observer: &dyn Observer,
) -> Result<Pairs, EigsError> {
    observer.enter(Phase::Ordering);
    let problem = StandardForm::new(operator)?;
    observer.enter(Phase::Factorization);
    let factor = ShiftedFactor::new(&problem, -SHIFT * 4.0 * PI * k as f64)?;
    let mut lanczos = Lanczos::new(&factor, 5 * k / 2 + 8 * BLOCK, observer);
    let pairs = lanczos
        .converge(k, TOLERANCE)
        .ok_or(EigsError::NotConverged { k, n_vertices: problem.n() })?;
    let (eigenvalues, vectors) = lanczos.eigenpairs(&pairs, k);
    let n_solves = lanczos.n_solves();
    drop(lanczos);
    Ok(unscaled(&problem, &eigenvalues, &vectors, n_solves))
}

/// Puts rows back into the order of the vertices and the units of the operator.
fn unscaled(
    problem: &StandardForm,
    eigenvalues: &[f64],
    vectors: &Mat<f64>,
    n_solves: usize,
) -> Pairs {
    let scale = problem.total_mass.sqrt();
    let mut row_of_vertex = vec![0; problem.n()];
    for (row, &vertex) in problem.order.iter().enumerate() {
        row_of_vertex[vertex as usize] = row;
    }
    let factors: Vec<f64> = problem.root_mass.iter().map(|it| 1.0 / (it * scale)).collect();
    let mut eigenvectors = Mat::zeros(problem.n(), eigenvalues.len());
    tall::for_each_chunk(eigenvectors.as_mut(), |first, mut chunk| {
        let rows = &row_of_vertex[first..first + chunk.nrows()];
        for (col, from) in vectors.col_iter().enumerate() {
            for (row, &place) in rows.iter().enumerate() {
                chunk[(row, col)] = from[place] * factors[place];
            }
        }
    });
    let eigenvalues = eigenvalues.iter().map(|it| it / problem.total_mass).collect();
    Pairs { eigenvalues, eigenvectors, n_solves }
}
