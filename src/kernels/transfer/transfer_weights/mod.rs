//! Skin weights carried from one shape to another by a functional map.

mod precise;
pub(in crate::kernels) mod smooth;

use faer::Mat;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::kernels::{
    geometry::mesh::TriMesh,
    maps::functional_map::{FunctionalMap, WrongSpace},
    numerics::tall,
    rigs::weights::{SkinWeights, WeightsError},
    spectral::basis::Basis,
};
use precise::{Place, nearest_places};
use smooth::{Neighbours, diffuse, remove_islands};

/// Options of [`transfer_weights`]. The defaults are what measures best on people and animals;
/// [`TransferWeightsOptions::PAPER`] is the paper's suggestion.
#[derive(Debug, Clone, PartialEq)]
pub struct TransferWeightsOptions {
    pub matching: Matching,
    /// Compare with the target's own positions instead of their smooth part.
    pub raw_positions: bool,
    /// Look for places inside of the source's faces, not only for its vertices.
    pub interpolate: bool,
    /// Pieces of a joint's influence with less than this part of the largest piece go; 0 for none.
    pub islands: f64,
    /// Steps of diffusion over the target's edges.
    pub smoothing: usize,
    /// The joints kept a vertex, the heaviest; 0 for all.
    pub max_influences: usize,
}

/// In which space a target vertex looks for its place on the source.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Matching {
    /// Among positions in space: the map places the source's vertices on the target (the paper).
    Positions,
    /// Among values of eigenfunctions.
    Functions,
    /// In both together: functions tell parts apart that touch in space, positions those that the map
    /// confuses.
    #[default]
    Both,
}

impl TransferWeightsOptions {
    /// Copies of the nearest vertices, as the paper suggests.
    pub const PAPER: Self = Self {
        matching: Matching::Positions,
        raw_positions: false,
        interpolate: false,
        islands: 0.0,
        smoothing: 0,
        max_influences: 4,
    };
}

impl Default for TransferWeightsOptions {
    fn default() -> Self {
        Self { matching: Matching::Both, interpolate: true, smoothing: 1, ..Self::PAPER }
    }
}

/// How much positions (at total area one) count beside eigenfunctions (whose mean square is one).
///
/// At 30, places that the map confuses are confused between wolf and fox; at 1000, parts that touch in
/// space mix again.
const POSITION_WEIGHT: f64 = 300.0;

/// Why weights cannot be transferred.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TransferWeightsError {
    #[error("the {side} basis belongs to {basis} vertices, but there are {found} {what}")]
    Vertices { side: &'static str, basis: usize, found: usize, what: &'static str },
    #[error(
        "the map is {n_rows} x {n_cols}, but the source basis has {source_k} eigenfunctions and \
         the target basis {target_k}"
    )]
    MapShape { n_rows: usize, n_cols: usize, source_k: usize, target_k: usize },
    #[error(transparent)]
    WrongSpace(#[from] WrongSpace),
    #[error(transparent)]
    Weights(#[from] WeightsError),
}

/// Gives every target vertex the weights of a place on the source.
///
/// `Y = Phi C Psi^+ X_N` places the source's vertices on the target's geometry; target vertices look
/// for the nearest row of `Y` from their own smooth positions `Psi Psi^+ X_N`
/// (Musoni et al. 2021, section 4). Copied weights change in steps, and parts that touch in space mix:
/// so the defaults look among eigenfunctions too (rows of `Psi C^T` among rows of `Phi`), find
/// places inside of faces, and smooth a little.
///
/// The source's mesh is needed to interpolate; without it, vertices are copied.
///
/// # Errors
/// See [`TransferWeightsError`].
pub fn transfer_weights(
    source: (&Basis, &SkinWeights, Option<&TriMesh>),
    target: (&Basis, &TriMesh),
    map: &FunctionalMap,
    options: &TransferWeightsOptions,
) -> Result<SkinWeights, TransferWeightsError> {
    let (source, weights, source_mesh) = source;
    let (target, mesh) = target;
    map.check_bases(source, target)?;
    let map = &map.source_from_target;
    let source_count = source_mesh.map_or(source.n_vertices(), TriMesh::n_vertices);
    for (side, basis, found, what) in [
        ("source", source.n_vertices(), weights.n_vertices(), "rows of weights"),
        ("source", source.n_vertices(), source_count, "vertices"),
        ("target", target.n_vertices(), mesh.n_vertices(), "vertices"),
    ] {
        if basis != found {
            return Err(TransferWeightsError::Vertices { side, basis, found, what });
        }
    }
    if map.nrows() > source.k() || map.ncols() > target.k() {
        return Err(TransferWeightsError::MapShape {
            n_rows: map.nrows(),
            n_cols: map.ncols(),
            source_k: source.k(),
            target_k: target.k(),
        });
    }
    let (points, queries) = match options.matching {
        Matching::Positions => positions((source, target), mesh, map, options.raw_positions),
        Matching::Functions => functions((source, target), map),
        Matching::Both => {
            let positions = positions((source, target), mesh, map, options.raw_positions);
            let functions = functions((source, target), map);
            (beside(&functions.0, &positions.0), beside(&functions.1, &positions.1))
        }
    };
    let faces = source_mesh.filter(|_| options.interpolate).map_or(&[][..], TriMesh::faces);
    let places = nearest_places(queries.as_ref(), points.as_ref(), faces);
    let mut columns = columns_at(&places, weights);
    let neighbours = Neighbours::of(mesh);
    if options.islands > 0.0 {
        remove_islands(&neighbours, &mut columns, options.islands);
    }
    diffuse(&neighbours, &mut columns, options.smoothing);
    let rows: Vec<Vec<(u32, f64)>> = (0..mesh.n_vertices())
        .map(|vertex| {
            let entries = columns.iter().zip(0..).map(|(column, joint)| (joint, column[vertex]));
            let row = entries.filter(|it| it.1 > SMALLEST_WEIGHT).collect();
            heaviest(row, options.max_influences)
        })
        .collect();
    Ok(SkinWeights::from_rows(weights.n_joints(), &rows)?)
}

/// Weights below are left out: diffusion leaves traces of every joint far away.
const SMALLEST_WEIGHT: f64 = 1e-4;

/// The source's vertices placed on the target, and the target's own: at the target's total area one,
/// around the target's centroid.
fn positions(
    (source, target): (&Basis, &Basis),
    mesh: &TriMesh,
    map: &Mat<f64>,
    raw: bool,
) -> (Mat<f64>, Mat<f64>) {
    let area = target.area();
    let mass = target.mass.iter().zip(mesh.vertices());
    let centroid =
        mass.map(|(mass, position)| position * *mass).sum::<crate::kernels::geometry::mesh::Vec3>()
            / area;
    let scale = 1.0 / area.sqrt();
    let vertices: Vec<_> = mesh.vertices().iter().map(|it| (it - centroid) * scale).collect();
    let coefficients = target.project_vertices(&vertices);
    let coefficients = coefficients.as_ref().subrows(0, map.ncols());
    // From the target's to the source's units of eigenfunctions: both at total area one.
    let units = (source.area() / area).sqrt();
    let carried = (map * coefficients) * faer::Scale(units);
    let placed = tall::product(source.truncated(map.nrows()), carried.as_ref());
    let own = if raw {
        Mat::from_fn(vertices.len(), 3, |row, axis| vertices[row][axis])
    } else {
        target.reconstruct(coefficients)
    };
    (placed, own)
}

/// The rows of `Phi` and of `Psi C^T` at total area one.
fn functions((source, target): (&Basis, &Basis), map: &Mat<f64>) -> (Mat<f64>, Mat<f64>) {
    let points = source.truncated(map.nrows()) * faer::Scale(source.area().sqrt());
    let scaled = map.transpose() * faer::Scale(target.area().sqrt());
    (points, tall::product(target.truncated(map.ncols()), scaled.as_ref()))
}

fn beside(functions: &Mat<f64>, positions: &Mat<f64>) -> Mat<f64> {
    let k = functions.ncols();
    Mat::from_fn(functions.nrows(), k + 3, |row, column| {
        if column < k {
            functions[(row, column)]
        } else {
            POSITION_WEIGHT * positions[(row, column - k)]
        }
    })
}

/// The weights at places of the source: a column a joint.
fn columns_at(places: &[Place], weights: &SkinWeights) -> Vec<Vec<f64>> {
    let mut columns = vec![vec![0.0; places.len()]; weights.n_joints()];
    for (row, place) in places.iter().enumerate() {
        for &(vertex, share) in place.iter().filter(|it| it.1 > 0.0) {
            for (joint, weight) in weights.row(vertex as usize) {
                columns[joint as usize][row] += share * weight;
            }
        }
    }
    columns
}

/// The heaviest entries; of equal ones those of smaller joints.
fn heaviest(mut row: Vec<(u32, f64)>, count: usize) -> Vec<(u32, f64)> {
    if count > 0 && row.len() > count {
        row.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        row.truncate(count);
    }
    row
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes::signed_volume;
    use crate::kernels::test_shapes::{basis_of, creature, permuted};

    fn blended(mesh: &TriMesh) -> SkinWeights {
        let row = |p: &crate::kernels::geometry::mesh::Vec3| {
            let side = (0.5 + p.z).clamp(0.0, 1.0);
            vec![(0, 1.0 - side), (1, side)]
        };
        SkinWeights::from_rows(2, &mesh.vertices().iter().map(row).collect::<Vec<_>>()).unwrap()
    }

    fn gap(a: &SkinWeights, b: &SkinWeights) -> f64 {
        let gaps = (0..a.n_vertices()).map(|it| (a.get(it, 0) - b.get(it, 0)).abs());
        gaps.fold(0.0, f64::max)
    }

    #[test]
    fn the_identity_keeps_the_weights() {
        let mesh = creature(0.0);
        assert!(signed_volume(&mesh) > 0.0);
        let basis = basis_of(&mesh, 80);
        let weights = blended(&mesh);
        let map = FunctionalMap::without_spaces(Mat::identity(80, 80));
        let source = (&basis, &weights, Some(&mesh));
        let run = |target: &TriMesh, options: &TransferWeightsOptions| {
            transfer_weights(source, (&basis, target), &map, options)
        };
        assert_eq!(run(&mesh, &TransferWeightsOptions::PAPER).unwrap(), weights);
        let sharp = TransferWeightsOptions { smoothing: 0, ..Default::default() };
        assert!(gap(&run(&mesh, &sharp).unwrap(), &weights) < 1e-9);
        for scale in [1e-6, 1e6] {
            let scaled: Vec<_> = mesh.vertices().iter().map(|it| it * scale).collect();
            let scaled = mesh.with_vertices(scaled).unwrap();
            assert!(gap(&run(&scaled, &sharp).unwrap(), &weights) < 1e-6);
        }
        let smooth = run(&mesh, &TransferWeightsOptions::default()).unwrap();
        assert!(gap(&smooth, &weights) < 0.2, "{}", gap(&smooth, &weights));
        let other = crate::kernels::geometry::shapes::geodesic_sphere(2);
        assert_eq!(
            run(&other, &sharp).unwrap_err().to_string(),
            "the target basis belongs to 362 vertices, but there are 42 vertices"
        );
    }

    #[test]
    fn all_ways_of_matching_find_a_renumbered_shape() {
        let mesh = creature(0.0);
        let (renumbered, order) = permuted(&mesh);
        let (source, target) = (basis_of(&mesh, 60), basis_of(&renumbered, 60));
        // Both bases are exact: the map has the signs in which they differ.
        let sign = |it: usize| {
            let at = |vertex: usize| (source.eigenvectors[(vertex, it)], vertex);
            let (value, vertex) =
                (0..362).map(at).max_by(|a, b| a.0.abs().total_cmp(&b.0.abs())).unwrap();
            (value * target.eigenvectors[(order[vertex] as usize, it)]).signum()
        };
        let signs = Mat::from_fn(60, 60, |i, j| if i == j { sign(i) } else { 0.0 });
        let map = FunctionalMap::without_spaces(signs);
        let weights = blended(&mesh);
        for matching in [Matching::Positions, Matching::Functions, Matching::Both] {
            let options = TransferWeightsOptions { matching, smoothing: 0, ..Default::default() };
            let from = (&source, &weights, Some(&mesh));
            let found = transfer_weights(from, (&target, &renumbered), &map, &options).unwrap();
            for (old, &new) in order.iter().enumerate() {
                assert!((found.get(new as usize, 1) - weights.get(old, 1)).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn the_heaviest_joints_are_kept() {
        let row = vec![(0, 0.1), (1, 0.3), (2, 0.1), (3, 0.2), (4, 0.3)];
        let mut kept: Vec<u32> = heaviest(row, 4).into_iter().map(|it| it.0).collect();
        kept.sort();
        assert_eq!(kept, [0, 1, 3, 4]);
    }
}
