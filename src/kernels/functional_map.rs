//! Maps between two shapes: of functions, and of points.

use faer::Mat;

/// A linear map of functions on a target shape to functions on a source shape.
///
/// Pulling back: a map of points source -> target carries functions the other way. With `F(N)` the
/// functions on the target and `F(M)` those on the source, `C: F(N) -> F(M)` takes coefficients in the
/// target's basis to coefficients in the source's.
/// Both bases are those of the shapes at total area one, so that no scale enters the map.
#[derive(Debug, Clone)]
pub struct FunctionalMap {
    /// `k_source x k_target`.
    pub source_from_target: Mat<f64>,
}

/// For every vertex of a source shape, a vertex of a target shape.
#[derive(Debug, Clone, PartialEq)]
pub struct PointMap {
    /// `n_source` vertex indices of the target.
    pub target_of_source: Vec<u32>,
    pub n_target: usize,
}
