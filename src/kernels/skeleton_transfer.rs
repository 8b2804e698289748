//! Skeletons carried from one shape to another by a map.

use faer::Mat;

use super::{
    basis::Basis,
    functional_map::{FunctionSpace, FunctionalMap, PointMap, WrongSpace},
    mesh::Vec3,
    regressor::{Regressor, SpectralRegressor},
    skeleton::{Skeleton, SkeletonError},
};

/// Why a skeleton cannot be transferred.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TransferError {
    #[error("the regressor belongs to {regressor} vertices, but the source basis to {basis}")]
    SourceVertices { regressor: usize, basis: usize },
    #[error("the regressor belongs to {regressor} vertices, but {matches} are matched")]
    Matches { regressor: usize, matches: usize },
    #[error("the {what} belongs to {expected} vertices, but the target mesh has {mesh}")]
    TargetVertices { what: &'static str, expected: usize, mesh: usize },
    #[error(
        "the map is {n_rows} x {n_cols}, but the regressor has {source_k} coefficients and the \
         target basis {target_k}"
    )]
    MapShape { n_rows: usize, n_cols: usize, source_k: usize, target_k: usize },
    #[error("{k} eigenfunctions are wanted, but the source basis has {available}")]
    FewPairs { k: usize, available: usize },
    #[error(
        "joint `{joint}` moves by {factor} when the target moves by 1: the regressor's row does \
         not sum to one, or the map does not carry constants to constants"
    )]
    NotEquivariant { joint: String, factor: f64 },
    #[error(transparent)]
    WrongSpace(#[from] WrongSpace),
    #[error(transparent)]
    Skeleton(#[from] SkeletonError),
}

/// How far a row's sum may be from one.
const CONSTANT_TOLERANCE: f64 = 1e-6;

/// Converts a regressor to spectral coordinates: `R^ = R Phi_k`, at total area one.
///
/// (Musoni et al. 2021, equation 4.) The first column holds plus or minus ones.
///
/// # Errors
/// [`TransferError::SourceVertices`], [`TransferError::FewPairs`].
pub fn spectral_regressor(
    regressor: &Regressor,
    source: &Basis,
    k: usize,
) -> Result<SpectralRegressor, TransferError> {
    let matrix = &regressor.matrix;
    if matrix.n_cols != source.n_vertices() {
        let (regressor, basis) = (matrix.n_cols, source.n_vertices());
        return Err(TransferError::SourceVertices { regressor, basis });
    }
    if k > source.k() {
        return Err(TransferError::FewPairs { k, available: source.k() });
    }
    let factor = source.area().sqrt();
    let mut spectral = Mat::zeros(matrix.n_rows, k);
    for column in 0..k {
        let values = matrix.mul_vec(source.eigenvectors.col_as_slice(column));
        for (joint, value) in values.into_iter().enumerate() {
            spectral[(joint, column)] = factor * value;
        }
    }
    Ok(SpectralRegressor {
        names: regressor.names.clone(),
        parents: regressor.parents.clone(),
        matrix: spectral,
        space: Some(FunctionSpace::of(source)),
    })
}

/// The target's joints by functions: `J_N = R^ C Psi^+ X_N` (Musoni et al. 2021, equation 14).
///
/// `X_N` may be scaled and moved against the shape of which the basis was computed: the joints
/// follow, because constants are carried to constants.
///
/// # Errors
/// See [`TransferError`].
pub fn transfer_by_functions(
    regressor: &SpectralRegressor,
    map: &FunctionalMap,
    target: &Basis,
    target_vertices: &[Vec3],
) -> Result<Skeleton, TransferError> {
    map.check_target(target)?;
    if let (Some(spaces), Some(space)) = (&map.spaces, regressor.space) {
        spaces.check_source(space)?;
    }
    let map = &map.source_from_target;
    let source_k = regressor.matrix.ncols();
    if map.nrows() > source_k || map.ncols() > target.k() {
        let (n_rows, n_cols, target_k) = (map.nrows(), map.ncols(), target.k());
        return Err(TransferError::MapShape { n_rows, n_cols, source_k, target_k });
    }
    check_target("target basis", target.n_vertices(), target_vertices)?;
    let spectral = regressor.matrix.as_ref().subcols(0, map.nrows());
    let joints_from_target = spectral * map;
    let area_root = target.area().sqrt();
    // Coefficients at total area one of the positions, and of the constant function 1.
    let coefficients = target.project_vertices(target_vertices) * faer::Scale(1.0 / area_root);
    let ones = Mat::from_fn(target.n_vertices(), 1, |_, _| 1.0);
    let ones = target.project(ones.as_ref()) * faer::Scale(1.0 / area_root);
    let joints = &joints_from_target * coefficients.as_ref().subrows(0, map.ncols());
    let sums = &joints_from_target * ones.as_ref().subrows(0, map.ncols());
    let positions = (0..joints.nrows())
        .map(|it| Vec3::new(joints[(it, 0)], joints[(it, 1)], joints[(it, 2)]))
        .collect();
    check_constants(&regressor.names, sums.col_as_slice(0))?;
    Ok(Skeleton::new(regressor.names.clone(), regressor.parents.clone(), positions)?)
}

/// The target's joints by matched points: `J_N = R X_N[m]`.
///
/// # Errors
/// See [`TransferError`].
pub fn transfer_by_points(
    regressor: &Regressor,
    matches: &PointMap,
    target_vertices: &[Vec3],
) -> Result<Skeleton, TransferError> {
    let matrix = &regressor.matrix;
    if matrix.n_cols != matches.target_of_source.len() {
        let (regressor, matches) = (matrix.n_cols, matches.target_of_source.len());
        return Err(TransferError::Matches { regressor, matches });
    }
    check_target("point map", matches.n_target, target_vertices)?;
    let at = |vertex: usize| target_vertices[matches.target_of_source[vertex] as usize];
    let joint = |row: usize| matrix.row(row).map(|(vertex, value)| at(vertex) * value).sum();
    let sums: Vec<f64> =
        (0..matrix.n_rows).map(|row| matrix.row(row).map(|it| it.1).sum()).collect();
    check_constants(&regressor.names, &sums)?;
    let positions = (0..matrix.n_rows).map(joint).collect();
    Ok(Skeleton::new(regressor.names.clone(), regressor.parents.clone(), positions)?)
}

fn check_target(
    what: &'static str,
    expected: usize,
    vertices: &[Vec3],
) -> Result<(), TransferError> {
    if vertices.len() == expected {
        return Ok(());
    }
    Err(TransferError::TargetVertices { what, expected, mesh: vertices.len() })
}

fn check_constants(names: &[String], sums: &[f64]) -> Result<(), TransferError> {
    match sums.iter().position(|it| !((it - 1.0).abs() < CONSTANT_TOLERANCE)) {
        Some(it) => {
            Err(TransferError::NotEquivariant { joint: names[it].clone(), factor: sums[it] })
        }
        None => Ok(()),
    }
}
