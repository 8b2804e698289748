//! Skin weights carried from one shape to another by a functional map.

use faer::Mat;

use super::{
    basis::Basis,
    functional_map::{FunctionalMap, WrongSpace},
    mesh::Vec3,
    nearest::nearest_rows,
    tall,
    weights::{SkinWeights, WeightsError},
};

/// Options of [`transfer_weights`].
#[derive(Debug, Clone, PartialEq)]
pub struct TransferWeightsOptions {
    /// Compare with the target's own positions instead of their smooth part.
    pub raw_positions: bool,
    /// The joints kept a vertex, the heaviest; 0 for all.
    pub max_influences: usize,
}

impl Default for TransferWeightsOptions {
    fn default() -> Self {
        Self { raw_positions: false, max_influences: 4 }
    }
}

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

/// Gives every target vertex the weights of the nearest source vertex.
///
/// `Y = Phi C Psi^+ X_N` places the source's vertices on the target's geometry; target vertices look
/// for the nearest row of `Y` from their own smooth positions `Psi Psi^+ X_N`
/// (Musoni et al. 2021, section 4).
///
/// # Errors
/// See [`TransferWeightsError`].
pub fn transfer_weights(
    source: (&Basis, &SkinWeights),
    target: (&Basis, &[Vec3]),
    map: &FunctionalMap,
    options: &TransferWeightsOptions,
) -> Result<SkinWeights, TransferWeightsError> {
    let (source, weights) = source;
    let (target, vertices) = target;
    map.check_bases(source, target)?;
    let map = &map.source_from_target;
    for (side, basis, found, what) in [
        ("source", source.n_vertices(), weights.n_vertices(), "rows of weights"),
        ("target", target.n_vertices(), vertices.len(), "vertices"),
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
    // Rotations and translations of both sides do not change who is nearest.
    let coefficients = target.project_vertices(vertices);
    let coefficients = coefficients.as_ref().subrows(0, map.ncols());
    // From the target's to the source's units of eigenfunctions: both at total area one.
    let units = (source.area() / target.area()).sqrt();
    let carried = (map * coefficients) * faer::Scale(units);
    let placed = tall::product(source.truncated(map.nrows()), carried.as_ref());
    let queries = if options.raw_positions {
        Mat::from_fn(vertices.len(), 3, |row, axis| vertices[row][axis])
    } else {
        target.reconstruct(coefficients)
    };
    let rows: Vec<Vec<(u32, f64)>> = nearest_rows(queries.as_ref(), placed.as_ref())
        .into_iter()
        .map(|it| heaviest(weights.row(it as usize).collect(), options.max_influences))
        .collect();
    Ok(SkinWeights::from_rows(weights.n_joints(), &rows)?)
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
    use crate::kernels::test_shapes::{basis_of, creature};

    #[test]
    fn the_identity_keeps_the_weights() {
        let mesh = creature(0.0);
        let basis = basis_of(&mesh, 80);
        let rows: Vec<_> = mesh
            .vertices()
            .iter()
            .map(|p| {
                let side = (0.5 + p.z).clamp(0.0, 1.0);
                vec![(0, 1.0 - side), (1, side)]
            })
            .collect();
        let weights = SkinWeights::from_rows(2, &rows).unwrap();
        let map = FunctionalMap::without_spaces(Mat::identity(80, 80));
        let run = |vertices: &[Vec3]| {
            let options = TransferWeightsOptions::default();
            transfer_weights((&basis, &weights), (&basis, vertices), &map, &options)
        };
        assert_eq!(run(mesh.vertices()).unwrap(), weights);
        let error = run(&mesh.vertices()[1..]).unwrap_err();
        assert_eq!(
            error.to_string(),
            "the target basis belongs to 362 vertices, but there are 361 vertices"
        );
    }

    #[test]
    fn the_heaviest_joints_are_kept() {
        let row = vec![(0, 0.1), (1, 0.3), (2, 0.1), (3, 0.2), (4, 0.3)];
        let mut kept: Vec<u32> = heaviest(row, 4).into_iter().map(|it| it.0).collect();
        kept.sort();
        assert_eq!(kept, [0, 1, 3, 4]);
    }
}
