//! Joint regressors: joints as linear functions of the vertices.

use faer::Mat;

use crate::kernels::{numerics::sparse::CsrMatrix, spectral::function_space::FunctionSpace};

/// Joints as weighted sums of vertices: `J = R X`, with rows that sum to one.
#[derive(Debug, Clone, PartialEq)]
pub struct Regressor {
    pub names: Vec<String>,
    /// As in [`crate::kernels::rigs::skeleton::Skeleton::parents`].
    pub parents: Vec<Option<usize>>,
    /// `Q x V`.
    pub matrix: CsrMatrix,
}

/// A regressor on spectral coefficients: `R^ = R Phi`, so that `J = R^ Phi^+ X`, for the basis `Phi`
/// of the shape at total area one (eigenfunctions times the root of the area).
#[derive(Debug, Clone)]
pub struct SpectralRegressor {
    pub names: Vec<String>,
    pub parents: Vec<Option<usize>>,
    /// `Q x k`.
    pub matrix: Mat<f64>,
    /// The basis of the coefficients; unknown for regressors of other programs.
    pub space: Option<FunctionSpace>,
}
