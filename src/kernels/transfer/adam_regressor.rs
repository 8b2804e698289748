//! Joint regressors as the paper computes them: by Adam, from zero.

use nalgebra::Vector4;
use rayon::prelude::*;

use super::{
    regressor::Regressor,
    regressor_masks::{Mask, RegressorError, RegressorOptions, RiggedMesh, Row, RowReport},
};
use crate::kernels::{
    geometry::mesh::{TriMesh, Vec3},
    numerics::adam::{AdamOptions, minimize},
    rigs::{skeleton::Skeleton, weights::SkinWeights},
};

/// The weights of the paper's energy, one row of the regressor at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RegressorEnergy {
    /// `w_rec`, of the reconstructed joint.
    pub reconstruction: f64,
    /// `w_con`, of the row's sum.
    pub sum: f64,
    /// `w_loc + w_spa`, of entries outside of the mask: the paper's two terms are one function.
    pub outside: f64,
}

impl RegressorEnergy {
    /// As printed: 1, 10^4 and 100, 1.
    pub const PAPER: Self = Self { reconstruction: 1.0, sum: 1.0, outside: 10_100.0 };
    /// As in the demo: 1, 1000 and 100, 10.
    pub const DEMO: Self = Self { reconstruction: 1.0, sum: 10.0, outside: 1_100.0 };

    /// The energy of a row, and its gradient added to `gradient`.
    ///
    /// `w_rec |X^T r - j|^2 + w_con (1^T r - 1)^2 + lambda |r outside|^2`
    fn evaluate(
        &self,
        vertices: &[Vec3],
        joint: Vec3,
        in_mask: &[bool],
        row: &[f64],
        gradient: &mut [f64],
    ) -> f64 {
        let mut sums = Vector4::zeros();
        let mut outside = 0.0;
        for ((position, &value), &inside) in vertices.iter().zip(row).zip(in_mask) {
            sums += position.push(1.0) * value;
            outside += if inside { 0.0 } else { value * value };
        }
        let missing = sums - joint.push(1.0);
        let weights = Vector4::from_fn(|it, _| if it < 3 { self.reconstruction } else { self.sum });
        let pull = missing.component_mul(&weights) * 2.0;
        for (((slope, position), &value), &inside) in
            gradient.iter_mut().zip(vertices).zip(row).zip(in_mask)
        {
            *slope += position.push(1.0).dot(&pull);
            *slope += if inside { 0.0 } else { 2.0 * self.outside * value };
        }
        missing.component_mul(&missing).dot(&weights) + self.outside * outside
    }
}

/// The largest side of the bodies that the paper's weights are made for, in metres.
const BODY_EXTENT: f64 = 1.7;

/// Computes joints as sums of vertices with the paper's optimizer: 1000 steps of Adam from zero.
///
/// All entries take part, those outside of the mask at a cost (Musoni et al. 2021, equations 9 to 12),
/// so rows are dense. The mesh is scaled to the size of a person and moved to the origin, for the
/// energy depends on both. Rows end near the sum of one; what is missing is spread evenly over the
/// mask, since only rows that sum to one follow a shape that is moved. The report holds the sum before.
///
/// # Errors
/// See [`RegressorError`].
pub fn adam_regressor(
    mesh: &TriMesh,
    skeleton: &Skeleton,
    weights: &SkinWeights,
    options: &RegressorOptions,
    energy: &RegressorEnergy,
) -> Result<(Regressor, Vec<RowReport>), RegressorError> {
    let rig = RiggedMesh::new(mesh, skeleton, weights, options)?;
    let (low, high) = mesh.bounds();
    let (center, scale) = ((low + high) / 2.0, BODY_EXTENT / rig.extent);
    let normalized = |it: &Vec3| (it - center) * scale;
    let vertices: Vec<Vec3> = mesh.vertices().iter().map(normalized).collect();
    let rows: Vec<Row> = (0..skeleton.n_joints())
        .into_par_iter()
        .map(|joint| {
            let mask = rig.usable_mask(rig.masks(joint));
            adam_row(&vertices, normalized(&skeleton.positions()[joint]), mask, energy)
        })
        .collect();
    Ok(rig.assemble(&rows))
}

fn adam_row(vertices: &[Vec3], joint: Vec3, mask: Mask, energy: &RegressorEnergy) -> Row {
    let mut in_mask = vec![false; vertices.len()];
    mask.vertices.iter().for_each(|&it| in_mask[it as usize] = true);
    let mut values = vec![0.0; vertices.len()];
    minimize(&mut values, &AdamOptions::default(), |row, gradient| {
        energy.evaluate(vertices, joint, &in_mask, row, gradient)
    });
    let sum: f64 = values.iter().sum();
    let share = (1.0 - sum) / mask.vertices.len() as f64;
    mask.vertices.iter().for_each(|&it| values[it as usize] += share);
    let all = (0..vertices.len() as u32).collect();
    Row { rule: mask.rule, n_fallbacks: mask.n_fallbacks, vertices: all, values, sum }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes::bumpy_sphere;
    use crate::kernels::transfer::exact_regressor::exact_regressor;

    fn rig() -> (TriMesh, Skeleton, SkinWeights) {
        let mesh = bumpy_sphere(6);
        let names = vec!["hip".to_owned(), "chest".to_owned()];
        let positions = vec![Vec3::new(0.0, 0.0, -0.3), Vec3::new(0.02, 0.05, 0.1)];
        let skeleton = Skeleton::new(names, vec![None, Some(0)], positions).unwrap();
        let weight = |z: f64| (0.5 + 2.0 * z).clamp(0.0, 1.0);
        let row = |it: &Vec3| vec![(1, weight(it.z)), (0, 1.0 - weight(it.z))];
        let rows: Vec<_> = mesh.vertices().iter().map(row).collect();
        (mesh, skeleton, SkinWeights::from_rows(2, &rows).unwrap())
    }

    #[test]
    fn the_gradient_is_that_of_the_energy() {
        let (mesh, skeleton, _) = rig();
        let (vertices, joint) = (&mesh.vertices()[..9], skeleton.positions()[1]);
        let in_mask: Vec<bool> = (0..9).map(|it| it % 2 == 0).collect();
        let row: Vec<f64> = (0..9).map(|it| 0.3 - 0.1 * f64::from(it)).collect();
        let mut slopes = vec![0.0; 9];
        let at = |row: &[f64], slopes: &mut [f64]| {
            RegressorEnergy::DEMO.evaluate(vertices, joint, &in_mask, row, slopes)
        };
        at(&row, &mut slopes);
        for (entry, slope) in slopes.iter().enumerate() {
            let moved = |by: f64| {
                let mut row = row.clone();
                row[entry] += by;
                at(&row, &mut [0.0; 9])
            };
            let expected = (moved(1e-4) - moved(-1e-4)) / 2e-4;
            assert!((slope - expected).abs() < 1e-6 * expected.abs().max(1.0), "{slope}");
        }
    }

    /// The optimum is not unique, so the two are compared by their energies: that of the exact row is
    /// zero, and Adam comes near with the paper's weights.
    #[test]
    fn adam_approaches_the_energy_of_the_exact_regressor() {
        let (mesh, skeleton, weights) = rig();
        let options = RegressorOptions::default();
        let (exact, _) = exact_regressor(&mesh, &skeleton, &weights, &options).unwrap();
        for energy in [RegressorEnergy::PAPER, RegressorEnergy::DEMO] {
            let (adam, reports) =
                adam_regressor(&mesh, &skeleton, &weights, &options, &energy).unwrap();
            for joint in 0..2 {
                let parent = skeleton.parents()[joint].unwrap_or(joint);
                let moves = |vertex, joint| weights.get(vertex, joint) > 0.0;
                let in_mask: Vec<bool> = (0..mesh.n_vertices())
                    .map(|it| moves(it, joint) && moves(it, parent))
                    .collect();
                let of = |regressor: &Regressor| {
                    let mut row = vec![0.0; mesh.n_vertices()];
                    regressor.matrix.row(joint).for_each(|(vertex, value)| row[vertex] = value);
                    let mut slopes = vec![0.0; row.len()];
                    let at = skeleton.positions()[joint];
                    energy.evaluate(mesh.vertices(), at, &in_mask, &row, &mut slopes)
                };
                assert!(of(&exact) < 1e-20, "{}", of(&exact));
                // The demo's weights leave a centimetre after a thousand steps.
                let bound = if energy == RegressorEnergy::PAPER { 1e-6 } else { 1e-2 };
                assert!(of(&adam) < bound, "{}", of(&adam));
                assert!(reports[joint].residual < 0.1, "{:?}", reports[joint]);
                assert!((reports[joint].sum - 1.0).abs() < 0.05, "{:?}", reports[joint]);
            }
            let sums = adam.matrix.mul_vec(&vec![1.0; mesh.n_vertices()]);
            assert!(sums.iter().all(|it| (it - 1.0).abs() < 1e-12), "{sums:?}");
        }
    }
}
