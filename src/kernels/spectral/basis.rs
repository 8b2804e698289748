//! Eigenbases of the Laplace-Beltrami operator.

use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::numerics::tall;
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

    /// The coefficients `Phi^T A f` of functions: `V x p` values to `k x p` coefficients.
    ///
    /// # Panics
    /// If `functions` has another number of rows than the basis.
    pub fn project(&self, functions: MatRef<'_, f64>) -> Mat<f64> {
        tall::mass_products(self.eigenvectors.as_ref(), &self.mass, functions)
    }

    /// The coefficients `Phi^T A X` of the coordinates: `V` positions to `k x 3` coefficients.
    ///
    /// # Panics
    /// If there are not as many positions as the basis has vertices.
    pub fn project_vertices(&self, vertices: &[Vec3]) -> Mat<f64> {
        self.project(Mat::from_fn(vertices.len(), 3, |row, axis| vertices[row][axis]).as_ref())
    }

    /// The functions `Phi c` that coefficients stand for: `r x p`, `r <= k`, to `V x p` values.
    ///
    /// # Panics
    /// If there are more coefficients than eigenvectors.
    pub fn reconstruct(&self, coefficients: MatRef<'_, f64>) -> Mat<f64> {
        tall::product(self.truncated(coefficients.nrows()), coefficients)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The cosines of a path whose two ends weigh half: orthonormal with respect to these masses.
    fn cosines(n_vertices: usize, k: usize) -> Basis {
        let steps = (n_vertices - 1) as f64;
        let mut mass = vec![1.0 / steps; n_vertices];
        mass[0] /= 2.0;
        mass[n_vertices - 1] /= 2.0;
        let wave = |vertex: usize, mode: usize| {
            let scale = if mode == 0 { 1.0 } else { std::f64::consts::SQRT_2 };
            scale * (std::f64::consts::PI * (mode * vertex) as f64 / steps).cos()
        };
        let eigenvalues = (0..k).map(|mode| (std::f64::consts::PI * mode as f64).powi(2)).collect();
        Basis { eigenvalues, eigenvectors: Mat::from_fn(n_vertices, k, wave), mass }
    }

    #[test]
    fn functions_in_the_span_are_their_own_reconstruction() {
        let basis = cosines(50, 6);
        let coefficients = Mat::from_fn(6, 2, |row, col| row as f64 - 3.0 * col as f64);
        let functions = basis.reconstruct(coefficients.as_ref());
        let error = &basis.project(functions.as_ref()) - &coefficients;
        assert!(error.norm_max() < 1e-13, "{error:?}");
        let few = basis.reconstruct(coefficients.as_ref().subrows(0, 2));
        assert_eq!((few.nrows(), few.ncols()), (50, 2));
    }

    #[test]
    fn the_first_coefficient_of_the_coordinates_is_the_centroid() {
        let basis = cosines(50, 6);
        let vertices: Vec<Vec3> = (0..50).map(|it| Vec3::new(it as f64 / 49.0, 2.0, 0.0)).collect();
        let coefficients = basis.project_vertices(&vertices);
        assert_eq!((coefficients.nrows(), coefficients.ncols()), (6, 3));
        assert!((coefficients[(0, 0)] - 0.5).abs() < 1e-14);
        assert!((coefficients[(0, 1)] - 2.0).abs() < 1e-14);
    }
}
