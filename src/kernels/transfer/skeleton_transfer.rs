//! Skeletons carried from one shape to another by a map.

use faer::Mat;

use super::regressor::{Regressor, SpectralRegressor};
use crate::kernels::{
    geometry::mesh::Vec3,
    maps::functional_map::{FunctionalMap, PointMap, WrongSpace},
    rigs::skeleton::{Skeleton, SkeletonError},
    spectral::{basis::Basis, function_space::FunctionSpace},
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

/// The target's joints by the coordinates that the map gives the source: `J_N = R (Phi C Psi^+ X_N)`.
///
/// FARM's way (Marin et al. 2020): the target's geometry is put on the source's connectivity, and the
/// source's regressor applied to it. With the same regressor and the same map this is
/// [`transfer_by_functions`] with the brackets set elsewhere, `(R Phi) C Psi^+ X_N`.
///
/// # Errors
/// See [`TransferError`].
pub fn transfer_by_coordinates(
    regressor: &Regressor,
    source: &Basis,
    map: &FunctionalMap,
    target: &Basis,
    target_vertices: &[Vec3],
) -> Result<Skeleton, TransferError> {
    let matrix = &regressor.matrix;
    if matrix.n_cols != source.n_vertices() {
        let (regressor, basis) = (matrix.n_cols, source.n_vertices());
        return Err(TransferError::SourceVertices { regressor, basis });
    }
    map.check_bases(source, target)?;
    let map = &map.source_from_target;
    if map.nrows() > source.k() || map.ncols() > target.k() {
        let (n_rows, n_cols) = (map.nrows(), map.ncols());
        let (source_k, target_k) = (source.k(), target.k());
        return Err(TransferError::MapShape { n_rows, n_cols, source_k, target_k });
    }
    check_target("target basis", target.n_vertices(), target_vertices)?;
    // Positions, and the constant function 1 beside them.
    let functions = Mat::from_fn(target_vertices.len(), 4, |row, column| {
        if column < 3 { target_vertices[row][column] } else { 1.0 }
    });
    let coefficients = target.project(functions.as_ref());
    let units = (source.area() / target.area()).sqrt();
    let carried = (map * coefficients.as_ref().subrows(0, map.ncols())) * faer::Scale(units);
    let on_source = source.reconstruct(carried.as_ref());
    let joints: Vec<Vec<f64>> =
        (0..4).map(|column| matrix.mul_vec(on_source.col_as_slice(column))).collect();
    check_constants(&regressor.names, &joints[3])?;
    let position = |it: usize| Vec3::new(joints[0][it], joints[1][it], joints[2][it]);
    let positions = (0..matrix.n_rows).map(position).collect();
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

/// The target's joints by the source's surface laid onto it (see [`crate::kernels::maps::fit_surface`]): `J_N = R Y`.
///
/// # Errors
/// See [`TransferError`].
pub fn transfer_by_surface(
    regressor: &Regressor,
    fitted_vertices: &[Vec3],
) -> Result<Skeleton, TransferError> {
    let (expected, mesh) = (regressor.matrix.n_cols, fitted_vertices.len());
    if expected != mesh {
        return Err(TransferError::TargetVertices { what: "regressor", expected, mesh });
    }
    let target_of_source = (0..mesh as u32).collect();
    let own = PointMap { target_of_source, n_target: mesh };
    transfer_by_points(regressor, &own, fitted_vertices)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::numerics::sparse::CsrMatrix;
    use crate::kernels::test_shapes::{basis_of, creature};

    fn regressor(n_vertices: usize) -> Regressor {
        // Rows of several hundred entries of either sign that sum to one.
        let entry = |joint: usize, vertex: usize| ((vertex * (joint + 3)) % 7) as f64 - 2.5;
        let mut triplets = Vec::new();
        for joint in 0..3 {
            let sum: f64 = (0..n_vertices).map(|it| entry(joint, it)).sum();
            triplets.extend(
                (0..n_vertices).map(|it| (joint as u32, it as u32, entry(joint, it) / sum)),
            );
        }
        Regressor {
            names: ["a", "b", "c"].map(str::to_owned).to_vec(),
            parents: vec![None, Some(0), Some(1)],
            matrix: CsrMatrix::from_triplets(3, n_vertices, &triplets),
        }
    }

    /// Section 0.9 of the specification: with one regressor and one map, FARM's way is the functional.
    #[test]
    fn brackets_do_not_matter() {
        let (mesh, other) = (creature(0.0), creature(0.3));
        let (source, target) = (basis_of(&mesh, 50), basis_of(&other, 50));
        let mut map = Mat::from_fn(50, 30, |i, j| ((i * 5 + j * 3) % 11) as f64 / 11.0 - 0.4);
        for i in 0..50 {
            let sign = source.eigenvectors[(0, 0)].signum() * target.eigenvectors[(0, 0)].signum();
            map[(i, 0)] = if i == 0 { sign } else { 0.0 };
        }
        let map = FunctionalMap::without_spaces(map);
        let regressor = regressor(mesh.n_vertices());
        let spectral = spectral_regressor(&regressor, &source, 50).unwrap();
        for scale in [1.0, 1e-6, 1e6] {
            let vertices: Vec<Vec3> = other.vertices().iter().map(|it| it * scale).collect();
            let functional = transfer_by_functions(&spectral, &map, &target, &vertices).unwrap();
            let farm =
                transfer_by_coordinates(&regressor, &source, &map, &target, &vertices).unwrap();
            for (a, b) in functional.positions().iter().zip(farm.positions()) {
                assert!((a - b).norm() < 1e-10 * scale, "{a} {b}");
            }
        }
    }

    #[test]
    fn joints_follow_the_surface_that_they_belong_to() {
        let mesh = creature(0.0);
        let n = mesh.n_vertices();
        let regressor = regressor(n);
        let here = transfer_by_surface(&regressor, mesh.vertices()).unwrap();
        let carry = |it: &Vec3| Vec3::new(-it.y, it.x, it.z) * 2.0 + Vec3::x();
        let carried: Vec<Vec3> = mesh.vertices().iter().map(carry).collect();
        let there = transfer_by_surface(&regressor, &carried).unwrap();
        for (a, b) in here.positions().iter().zip(there.positions()) {
            assert!((carry(a) - b).norm() < 1e-10);
        }
        let error = transfer_by_surface(&regressor, &carried[1..]).unwrap_err();
        let expected =
            TransferError::TargetVertices { what: "regressor", expected: n, mesh: n - 1 };
        assert_eq!(error, expected);
    }

    /// One surface at 92 and at 1442 vertices, with the map of their nearest vertices.
    #[test]
    fn a_target_of_fifteen_times_more_or_fewer_vertices_gets_the_same_joints() {
        use crate::kernels::{
            geometry::shapes::bumpy_sphere,
            maps::nearest::nearest_rows,
            numerics::tall,
            rigs::weights::SkinWeights,
            transfer::exact_regressor::{RegressorOptions, exact_regressor},
        };
        const K: usize = 20;
        let (coarse, fine) = (bumpy_sphere(3), bumpy_sphere(12));
        let joint = Vec3::new(0.05, 0.1, 0.2);
        let skeleton = Skeleton::new(vec!["a".to_owned()], vec![None], vec![joint]).unwrap();
        for (from, to) in [(&coarse, &fine), (&fine, &coarse)] {
            let rows = vec![vec![(0, 1.0)]; from.n_vertices()];
            let weights = SkinWeights::from_rows(1, &rows).unwrap();
            let options = RegressorOptions::default();
            let (regressor, _) = exact_regressor(from, &skeleton, &weights, &options).unwrap();
            let (source, target) = (basis_of(from, K), basis_of(to, K));
            let points = |mesh: &crate::kernels::geometry::mesh::TriMesh| {
                Mat::from_fn(mesh.n_vertices(), 3, |row, axis| mesh.vertices()[row][axis])
            };
            let matches = nearest_rows(points(from).as_ref(), points(to).as_ref());
            let psi = Mat::from_fn(matches.len(), K, |row, column| {
                target.area().sqrt() * target.eigenvectors[(matches[row] as usize, column)]
            });
            let mut map = tall::mass_products(source.truncated(K), &source.mass, psi.as_ref())
                * faer::Scale(1.0 / source.area().sqrt());
            (1..K).for_each(|row| map[(row, 0)] = 0.0);
            let map = FunctionalMap::without_spaces(map);
            let spectral = spectral_regressor(&regressor, &source, K).unwrap();
            let found = transfer_by_functions(&spectral, &map, &target, to.vertices()).unwrap();
            let error = (found.positions()[0] - joint).norm();
            assert!(error < 0.05, "{error} of a body of 3");
            let matches = PointMap { target_of_source: matches, n_target: to.n_vertices() };
            let found = transfer_by_points(&regressor, &matches, to.vertices()).unwrap();
            let error = (found.positions()[0] - joint).norm();
            assert!(error < 0.1, "{error} of a body of 3");
        }
    }
}
