//! The Laplace-Beltrami operator in weak form.

use crate::kernels::numerics::sparse::CsrMatrix;

/// A discrete Laplace-Beltrami operator: `stiffness * phi = lambda * mass * phi`.
#[derive(Debug, Clone, PartialEq)]
pub struct Operator {
    /// `V x V`, symmetric, positive semi-definite, rows sum to zero; without unit.
    pub stiffness: CsrMatrix,
    /// `V` lumped areas, positive, in squared mesh units.
    pub mass: Vec<f64>,
}
