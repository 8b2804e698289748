//! Points matched by a functional map.

use faer::Mat;

use super::{
    functional_map::{FunctionalMap, PointMap, WrongSpace},
    nearest::nearest_rows,
};
use crate::kernels::{numerics::tall, spectral::basis::Basis};

/// The matches of a functional map: for every row of `Phi` the nearest row of `Psi C^T`.
///
/// A functional map `C: F(N) -> F(M)` that comes from a map of points `T: M -> N` carries the function
/// that is one at `T(x)` alone, seen from `M`, to the one at `x`; its adjoint places `N` among the
/// coefficients of `M` (Ovsjanikov et al. 2012, Ezuz & Ben-Chen 2017).
///
/// # Panics
/// If a basis has fewer eigenfunctions than the map.
pub fn point_map(source: &Basis, target: &Basis, map: &FunctionalMap) -> PointMap {
    let (queries, points) = embeddings(source, target, map);
    let target_of_source = nearest_rows(queries.as_ref(), points.as_ref());
    PointMap { target_of_source, n_target: target.n_vertices() }
}

/// For every target vertex the source vertex whose row of `Phi` is nearest to its row of `Psi C^T`.
///
/// # Panics
/// If a basis has fewer eigenfunctions than the map.
pub fn inverse_point_map(source: &Basis, target: &Basis, map: &FunctionalMap) -> PointMap {
    let (points, queries) = embeddings(source, target, map);
    let source_of_target = nearest_rows(queries.as_ref(), points.as_ref());
    PointMap { target_of_source: source_of_target, n_target: source.n_vertices() }
}

/// Why there are no matches.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PointMapError {
    #[error("the map is {n_rows} x {n_cols}, but the {side} basis has {available} eigenfunctions")]
    FewPairs { side: &'static str, n_rows: usize, n_cols: usize, available: usize },
    #[error("the map has an entry that is not finite")]
    NotFinite,
    #[error(transparent)]
    WrongSpace(#[from] WrongSpace),
}

/// Refuses what [`point_map`] cannot work with.
///
/// # Errors
/// See [`PointMapError`].
pub fn check(source: &Basis, target: &Basis, map: &FunctionalMap) -> Result<(), PointMapError> {
    map.check_bases(source, target)?;
    let map = &map.source_from_target;
    let (n_rows, n_cols) = (map.nrows(), map.ncols());
    for (side, size, available) in [("source", n_rows, source.k()), ("target", n_cols, target.k())]
    {
        if size > available {
            return Err(PointMapError::FewPairs { side, n_rows, n_cols, available });
        }
    }
    if !map.is_all_finite() {
        return Err(PointMapError::NotFinite);
    }
    Ok(())
}

/// The rows of `Phi` and of `Psi C^T`, at total area one.
fn embeddings(source: &Basis, target: &Basis, map: &FunctionalMap) -> (Mat<f64>, Mat<f64>) {
    let map = map.source_from_target.as_ref();
    // At total area one, eigenfunctions are multiplied by the root of the area.
    let (from, to) = (source.area().sqrt(), target.area().sqrt());
    let scaled = map.transpose() * faer::Scale(to);
    let placed = tall::product(target.truncated(map.ncols()), scaled.as_ref());
    (source.truncated(map.nrows()) * faer::Scale(from), placed)
}
