//! Eigenbases of the Laplace-Beltrami operator.

use faer::{Mat, MatRef};

/// The `k` smallest eigenpairs of an operator.
#[derive(Debug, Clone)]
pub struct Basis {
    /// `k` eigenvalues, ascending; the first is zero. Unit: one over squared mesh units.
    pub eigenvalues: Vec<f64>,
    /// `V x k` eigenvectors by columns, orthonormal with respect to `mass`.
    pub eigenvectors: Mat<f64>,
    /// `V` lumped areas of the operator that the basis comes from.
    pub mass: Vec<f64>,
}

impl Basis {
    pub fn n_vertices(&self) -> usize {
        self.eigenvectors.nrows()
    }

    /// The number of eigenpairs.
    pub fn k(&self) -> usize {
        self.eigenvalues.len()
    }

    /// The first `k` eigenvectors, `V x k`.
    pub fn truncated(&self, k: usize) -> MatRef<'_, f64> {
        self.eigenvectors.as_ref().subcols(0, k)
    }

    /// The total area.
    pub fn area(&self) -> f64 {
        self.mass.iter().sum()
    }
}
