//! Joint regressors of a rigged mesh, in closed form.

use super::{
    regressor::Regressor,
    regressor_masks::{Mask, RiggedMesh, Row, RowReport},
};
use crate::kernels::{
    geometry::mesh::TriMesh,
    rigs::{skeleton::Skeleton, weights::SkinWeights},
};

pub use super::regressor_masks::{MaskRule, RegressorError, RegressorOptions};

/// Computes joints as sums of few vertices around them: `J = R X`, rows sum to one.
///
/// Joint `q` is regressed from the vertices that move with both the joint and its parent (a root:
/// with itself, or with a child), where pose changes the shape least (Musoni et al. 2021, equations 9 to 12). On
/// such a mask the energy has many minima of value zero; the one of least norm is, with the mask's
/// mean `x` and covariance `S`,
///
/// `r_i = (1 + (x_i - x)^T S^-1 (j - x)) / m`.
///
/// A mask is usable if it has four vertices that do not lie in a plane (smallest eigenvalue of `S`
/// at least `1e-8` of the squared extent), and good if its row does not amplify errors by more than
/// `max_amplification`. The first good one is taken of: threshold as given, 0.01, 0; each child in
/// place of the parent; the nearest vertices among those moved by joint or parent; the nearest.
/// If none is good, the usable one of least amplification; if none is usable, the nearest vertices
/// with a pseudo-inverse, whose residual is then reported.
///
/// # Errors
/// See [`RegressorError`].
pub fn exact_regressor(
    mesh: &TriMesh,
    skeleton: &Skeleton,
    weights: &SkinWeights,
    options: &RegressorOptions,
) -> Result<(Regressor, Vec<RowReport>), RegressorError> {
    let rig = RiggedMesh::new(mesh, skeleton, weights, options)?;
    let best = |joint| best_row(&rig, joint, options.max_amplification);
    let rows: Vec<Row> = (0..skeleton.n_joints()).map(best).collect();
    Ok(rig.assemble(&rows))
}

/// The first good row of the chain, or the best usable one.
pub fn best_row(rig: &RiggedMesh<'_>, joint: usize, max_amplification: f64) -> Row {
    let mut best: Option<Row> = None;
    for mask in rig.masks(joint) {
        if !rig.is_usable(&mask) {
            continue;
        }
        let row = affine_row(rig, joint, mask);
        let amplification = row.amplification();
        if best.as_ref().is_none_or(|it| amplification < it.amplification()) {
            best = Some(row);
        }
        if amplification <= max_amplification {
            break;
        }
    }
    best.unwrap_or_else(|| affine_row(rig, joint, rig.nearest_mask(joint)))
}

/// The row of least norm on a mask; where the mask is flat, for the foot of the joint in its plane.
fn affine_row(rig: &RiggedMesh<'_>, joint: usize, mask: Mask) -> Row {
    let (mean, covariance) = rig.moments(&mask.vertices);
    let inverse = covariance.pseudo_inverse(rig.flatness()).expect("the tolerance is not negative");
    let slope = inverse * (rig.skeleton.positions()[joint] - mean);
    let count = mask.vertices.len() as f64;
    let offset = |it: &u32| rig.mesh.vertices()[*it as usize] - mean;
    let values = mask.vertices.iter().map(|it| (1.0 + offset(it).dot(&slope)) / count).collect();
    Row::new(mask, values)
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix4, Vector4};

    use super::*;
    use crate::kernels::geometry::mesh::Vec3;
    use crate::kernels::geometry::shapes::bumpy_sphere;

    /// Two joints on the axis of a bumpy body; weights blend along it.
    fn rig(joint: Vec3) -> (TriMesh, Skeleton, SkinWeights) {
        let mesh = bumpy_sphere(6);
        let names = vec!["hip".to_owned(), "chest".to_owned()];
        let positions = vec![Vec3::new(0.0, 0.0, -0.5), joint];
        let skeleton = Skeleton::new(names, vec![None, Some(0)], positions).unwrap();
        let weight = |z: f64| (0.5 + z).clamp(0.0, 1.0);
        let rows: Vec<_> = mesh
            .vertices()
            .iter()
            .map(|it| vec![(1, weight(it.z)), (0, 1.0 - weight(it.z))])
            .collect();
        let weights = SkinWeights::from_rows(2, &rows).unwrap();
        (mesh, skeleton, weights)
    }

    #[test]
    fn rows_sum_to_one_and_reproduce_the_joints() {
        let (mesh, skeleton, weights) = rig(Vec3::new(0.02, 0.0, 0.1));
        let (regressor, reports) =
            exact_regressor(&mesh, &skeleton, &weights, &RegressorOptions::default()).unwrap();
        let ones = regressor.matrix.mul_vec(&vec![1.0; mesh.n_vertices()]);
        assert!(ones.iter().all(|it| (it - 1.0).abs() < 1e-12), "{ones:?}");
        assert_eq!(reports[0].rule, MaskRule::Root { threshold: 0.0 });
        assert_eq!(reports[1].rule, MaskRule::Parent { threshold: 0.0 });
        assert!(reports.iter().all(|it| it.residual < 1e-12 && it.amplification < 2.0));
        for (vertex, _) in regressor.matrix.row(1) {
            assert!(weights.get(vertex, 0) > 0.0 && weights.get(vertex, 1) > 0.0);
        }
        // The root's parent is the root.
        assert!(regressor.matrix.row(0).all(|(vertex, _)| weights.get(vertex, 0) > 0.0));
    }

    /// Weights of the energy whose minimum [`ridge_row`] is.
    #[derive(Debug, Clone, Copy, PartialEq)]
    struct RowEnergy {
        /// `w_rec`, of the reconstructed joint.
        reconstruction: f64,
        /// `w_con`, of the row's sum.
        sum: f64,
        /// `lambda`, of entries outside of the mask.
        outside: f64,
        /// The ridge on all entries.
        ridge: f64,
    }

    /// Minimizes `w_rec |X^T r - j|^2 + w_con (1^T r - 1)^2 + lambda |r outside|^2 + eps |r|^2`.
    ///
    /// By the push-through identity the `V x V` system becomes `4 x 4`. The paper's own energy is the
    /// limit of no ridge, whose minimum of least norm [`exact_regressor`] returns.
    ///
    /// # Panics
    /// If the ridge is not positive.
    fn ridge_row(
        vertices: &[Vec3],
        joint: Vec3,
        in_mask: impl Fn(usize) -> bool,
        energy: &RowEnergy,
    ) -> Vec<f64> {
        assert!(energy.ridge > 0.0, "a positive ridge");
        let inverse =
            |it: usize| 1.0 / (energy.ridge + if in_mask(it) { 0.0 } else { energy.outside });
        let lift = |it: &Vec3| Vector4::new(it.x, it.y, it.z, 1.0);
        let reconstruction = 1.0 / energy.reconstruction;
        let mut system = Matrix4::from_diagonal(&Vector4::new(
            reconstruction,
            reconstruction,
            reconstruction,
            1.0 / energy.sum,
        ));
        for (vertex, position) in vertices.iter().enumerate() {
            system += lift(position) * lift(position).transpose() * inverse(vertex);
        }
        let right = lift(&joint);
        let solution =
            system.cholesky().expect("a sum of squares and a positive diagonal").solve(&right);
        let entry =
            |(vertex, position): (usize, &Vec3)| lift(position).dot(&solution) * inverse(vertex);
        vertices.iter().enumerate().map(entry).collect()
    }

    #[test]
    fn the_limit_of_the_ridge_is_the_exact_row() {
        let (mesh, skeleton, weights) = rig(Vec3::new(0.02, 0.0, 0.1));
        let (regressor, _) =
            exact_regressor(&mesh, &skeleton, &weights, &RegressorOptions::default()).unwrap();
        let joint = skeleton.positions()[1];
        let energy = RowEnergy { reconstruction: 1.0, sum: 1.0, outside: 10_100.0, ridge: 1e-9 };
        let inside = |it: usize| weights.get(it, 0) > 0.0 && weights.get(it, 1) > 0.0;
        let row = ridge_row(mesh.vertices(), joint, inside, &energy);
        let mut exact = vec![0.0; mesh.n_vertices()];
        regressor.matrix.row(1).for_each(|(vertex, value)| exact[vertex] = value);
        let gap = row.iter().zip(&exact).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(gap < 1e-8, "{gap}");
    }

    fn rule_of(rows: &[Vec<(u32, f64)>], options: &RegressorOptions) -> RowReport {
        let mesh = bumpy_sphere(6);
        let names = ["root", "middle", "end"].map(str::to_owned).to_vec();
        let positions = vec![Vec3::zeros(), Vec3::new(0.0, 0.0, 0.1), Vec3::new(0.0, 0.0, 0.5)];
        let skeleton = Skeleton::new(names, vec![None, Some(0), Some(1)], positions).unwrap();
        let weights = SkinWeights::from_rows(3, rows).unwrap();
        exact_regressor(&mesh, &skeleton, &weights, options).unwrap().1[1]
    }

    #[test]
    fn the_chain_falls_back_step_by_step() {
        let n_vertices = bumpy_sphere(6).n_vertices();
        let only = |joint: u32| vec![vec![(joint, 1.0)]; n_vertices];
        let options = RegressorOptions::default();
        // Nothing but one vertex is shared with the parent: a child helps.
        let mut rows = vec![vec![(1, 0.5), (2, 0.5)]; n_vertices];
        rows[3] = vec![(0, 0.5), (1, 0.5)];
        assert_eq!(rule_of(&rows, &options).rule, MaskRule::Child { child: 2 });
        // Weak weights are found by a lower threshold.
        let weak = vec![vec![(0, 0.05), (1, 0.95)]; n_vertices];
        let options = RegressorOptions { threshold: 0.1, ..options };
        assert_eq!(rule_of(&weak, &options).rule, MaskRule::Parent { threshold: 0.01 });
        assert_eq!(rule_of(&only(0), &options).rule, MaskRule::NearestMoved);
        let report = rule_of(&only(2), &options);
        assert_eq!(report.rule, MaskRule::Nearest);
        assert_eq!(report.n_vertices, 64);
    }

    #[test]
    fn a_far_joint_leaves_its_small_mask() {
        let mesh = bumpy_sphere(6);
        // The mask is a small cap around one pole, the joint is in the middle of the body.
        let rows: Vec<Vec<(u32, f64)>> = mesh
            .vertices()
            .iter()
            .map(|it| if it.z > 1.2 { vec![(0, 0.5), (1, 0.5)] } else { vec![(1, 1.0)] })
            .collect();
        let loose = RegressorOptions { max_amplification: f64::INFINITY, ..Default::default() };
        let (before, after) = (rule_of(&rows, &loose), rule_of(&rows, &Default::default()));
        assert_eq!(before.rule, MaskRule::Parent { threshold: 0.0 });
        assert!(before.amplification > 2.0 && after.amplification < before.amplification);
        assert!(after.rule != before.rule, "{after:?}");
    }

    #[test]
    fn a_flat_mesh_gives_the_foot_of_the_joint() {
        let mesh = crate::kernels::geometry::shapes::rectangle(4, 4, 1.0, 1.0);
        let joint = Vec3::new(0.5, 0.4, 0.2);
        let skeleton = Skeleton::new(vec!["a".to_owned()], vec![None], vec![joint]).unwrap();
        let rows = vec![vec![(0, 1.0)]; mesh.n_vertices()];
        let weights = SkinWeights::from_rows(1, &rows).unwrap();
        let (regressor, reports) =
            exact_regressor(&mesh, &skeleton, &weights, &RegressorOptions::default()).unwrap();
        assert!((reports[0].residual - 0.2).abs() < 1e-12);
        let sum: f64 = regressor.matrix.row(0).map(|it| it.1).sum();
        assert!((sum - 1.0).abs() < 1e-12);
    }

    #[test]
    fn counts_must_agree() {
        let (mesh, skeleton, _) = rig(Vec3::zeros());
        let weights = SkinWeights::from_rows(2, &[vec![(0, 1.0)]]).unwrap();
        let error = exact_regressor(&mesh, &skeleton, &weights, &RegressorOptions::default());
        assert_eq!(
            error.unwrap_err().to_string(),
            "the mesh has 362 vertices, but the weights belong to 1"
        );
    }
}
