//! Joint regressors of a rigged mesh, in closed form.

use nalgebra::{Matrix3, Matrix4, Vector4};

use super::{
    mesh::{TriMesh, Vec3},
    regressor::Regressor,
    skeleton::Skeleton,
    sparse::CsrMatrix,
    weights::SkinWeights,
};

/// Options of [`exact_regressor`].
#[derive(Debug, Clone, PartialEq)]
pub struct RegressorOptions {
    /// A vertex belongs to a joint's mask if its weights of the joint and of the joint's parent both
    /// exceed this.
    pub threshold: f64,
    /// Vertices of a mask that is made of the nearest ones.
    pub n_nearest: usize,
    /// The largest `sum_i |r_i|` of a mask that is taken without looking further.
    pub max_amplification: f64,
}

impl Default for RegressorOptions {
    fn default() -> Self {
        Self { threshold: 0.0, n_nearest: 64, max_amplification: 2.0 }
    }
}

/// Which vertices a joint's mask holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MaskRule {
    /// Moved by the joint and its parent (a root: by the joint), with weights above a threshold.
    Parent { threshold: f64 },
    /// Moved by the joint and one of its children.
    Child { child: usize },
    /// The nearest of those moved by the joint or its parent.
    NearestMoved,
    /// The nearest.
    Nearest,
    /// Those around the joint, by the conditions of [`super::pose_regressor`].
    Posed,
}

/// How a joint's row came about.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RowReport {
    pub rule: MaskRule,
    pub n_vertices: usize,
    /// `sum_i |r_i|`, at least one: how much the row may amplify errors of the vertices.
    pub amplification: f64,
    /// `|sum_i r_i x_i - j|`, in mesh units.
    pub residual: f64,
}

/// Why there is no regressor.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RegressorError {
    #[error("the mesh has {mesh} vertices, but the weights belong to {weights}")]
    Vertices { mesh: usize, weights: usize },
    #[error("the skeleton has {skeleton} joints, but the weights belong to {weights}")]
    Joints { skeleton: usize, weights: usize },
}

/// Computes joints as sums of few vertices around them: `J = R X`, rows sum to one.
///
/// Joint `q` is regressed from the vertices that move with both the joint and its parent (a root:
/// with itself), where pose changes the shape least (Musoni et al. 2021, equations 9 to 12). On
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
    if mesh.n_vertices() != weights.n_vertices() {
        let (mesh, weights) = (mesh.n_vertices(), weights.n_vertices());
        return Err(RegressorError::Vertices { mesh, weights });
    }
    if skeleton.n_joints() != weights.n_joints() {
        let (skeleton, weights) = (skeleton.n_joints(), weights.n_joints());
        return Err(RegressorError::Joints { skeleton, weights });
    }
    let rig = Rig::new(mesh, skeleton, weights, options);
    let mut triplets = Vec::new();
    let mut reports = Vec::with_capacity(skeleton.n_joints());
    for joint in 0..skeleton.n_joints() {
        let row = rig.best_row(joint);
        let entries = row.mask.iter().zip(&row.values).filter(|it| *it.1 != 0.0);
        triplets.extend(entries.map(|(&vertex, &value)| (joint as u32, vertex, value)));
        reports.push(row.report(mesh, skeleton.positions()[joint]));
    }
    let regressor = Regressor {
        names: skeleton.names().to_vec(),
        parents: skeleton.parents().to_vec(),
        matrix: CsrMatrix::from_triplets(skeleton.n_joints(), mesh.n_vertices(), &triplets),
    };
    Ok((regressor, reports))
}

/// The nonzero entries of a row of the regressor.
struct Row {
    rule: MaskRule,
    mask: Vec<u32>,
    values: Vec<f64>,
    amplification: f64,
}

impl Row {
    fn report(&self, mesh: &TriMesh, joint: Vec3) -> RowReport {
        let entries = self.mask.iter().zip(&self.values);
        let estimate: Vec3 = entries.map(|(&it, &r)| mesh.vertices()[it as usize] * r).sum();
        RowReport {
            rule: self.rule,
            n_vertices: self.mask.len(),
            amplification: self.amplification,
            residual: (estimate - joint).norm(),
        }
    }
}

struct Rig<'a> {
    mesh: &'a TriMesh,
    skeleton: &'a Skeleton,
    /// By joint: (vertex, weight), ascending.
    moved: Vec<Vec<(u32, f64)>>,
    children: Vec<Vec<usize>>,
    /// The squared extent of the mesh.
    extent_squared: f64,
    options: &'a RegressorOptions,
}

impl<'a> Rig<'a> {
    fn new(
        mesh: &'a TriMesh,
        skeleton: &'a Skeleton,
        weights: &SkinWeights,
        options: &'a RegressorOptions,
    ) -> Self {
        let mut moved = vec![Vec::new(); skeleton.n_joints()];
        for vertex in 0..weights.n_vertices() {
            for (joint, weight) in weights.row(vertex) {
                moved[joint as usize].push((vertex as u32, weight));
            }
        }
        let (low, high) = mesh.bounds();
        let extent_squared = (high - low).max().powi(2);
        Self { mesh, skeleton, moved, children: skeleton.children(), extent_squared, options }
    }

    /// The first good row of the chain, or the best usable one.
    fn best_row(&self, joint: usize) -> Row {
        let mut best: Option<Row> = None;
        for (rule, mask) in self.masks(joint) {
            let Some(row) = self.row(joint, rule, mask) else { continue };
            let good = row.amplification <= self.options.max_amplification;
            if best.as_ref().is_none_or(|it| row.amplification < it.amplification) {
                best = Some(row);
            }
            if good {
                break;
            }
        }
        best.unwrap_or_else(|| self.flat_row(joint))
    }

    /// The masks in the order in which they are tried, made when they are asked for.
    fn masks(&self, joint: usize) -> impl Iterator<Item = (MaskRule, Vec<u32>)> + '_ {
        let parent = self.skeleton.parents()[joint].unwrap_or(joint);
        let given = self.options.threshold;
        let thresholds =
            std::iter::once(given).chain([0.01, 0.0].into_iter().filter(move |&it| it < given));
        let by_parent = thresholds.map(move |threshold| {
            (MaskRule::Parent { threshold }, self.common(joint, parent, threshold))
        });
        let by_child = self.children[joint]
            .iter()
            .map(move |&child| (MaskRule::Child { child }, self.common(joint, child, 0.0)));
        let nearest_moved = std::iter::once_with(move || {
            (MaskRule::NearestMoved, self.nearest(joint, self.either(joint, parent)))
        });
        let nearest = std::iter::once_with(move || (MaskRule::Nearest, self.all_nearest(joint)));
        by_parent.chain(by_child).chain(nearest_moved).chain(nearest)
    }

    /// The vertices that two joints move with weights above a threshold.
    fn common(&self, a: usize, b: usize, threshold: f64) -> Vec<u32> {
        let above = |joint: usize| {
            self.moved[joint].iter().filter(move |it| it.1 > threshold).map(|it| it.0)
        };
        let other: Vec<u32> = above(b).collect();
        above(a).filter(|it| other.binary_search(it).is_ok()).collect()
    }

    /// The vertices that one of two joints moves.
    fn either(&self, a: usize, b: usize) -> Vec<u32> {
        let mut res: Vec<u32> = self.moved[a].iter().chain(&self.moved[b]).map(|it| it.0).collect();
        res.sort_unstable();
        res.dedup();
        res
    }

    fn all_nearest(&self, joint: usize) -> Vec<u32> {
        self.nearest(joint, (0..self.mesh.n_vertices() as u32).collect())
    }

    /// The vertices nearest to a joint, ascending.
    fn nearest(&self, joint: usize, mut vertices: Vec<u32>) -> Vec<u32> {
        let position = self.skeleton.positions()[joint];
        let distance = |it: &u32| (self.mesh.vertices()[*it as usize] - position).norm_squared();
        vertices.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
        vertices.truncate(self.options.n_nearest);
        vertices.sort_unstable();
        vertices
    }

    /// The row of least norm on a mask; `None` if the mask is too small or flat.
    fn row(&self, joint: usize, rule: MaskRule, mask: Vec<u32>) -> Option<Row> {
        if mask.len() < 4 {
            return None;
        }
        let (mean, covariance) = self.moments(&mask);
        let smallest = covariance.symmetric_eigenvalues().min();
        if !(smallest >= 1e-8 * self.extent_squared) {
            return None;
        }
        let slope = covariance.try_inverse()? * (self.skeleton.positions()[joint] - mean);
        Some(self.affine_row(rule, mask, mean, slope))
    }

    /// The nearest vertices of a mesh that is flat around the joint, with a pseudo-inverse.
    fn flat_row(&self, joint: usize) -> Row {
        let mask = self.all_nearest(joint);
        let (mean, covariance) = self.moments(&mask);
        let inverse = covariance
            .pseudo_inverse(1e-8 * self.extent_squared)
            .expect("the tolerance is not negative");
        let slope = inverse * (self.skeleton.positions()[joint] - mean);
        self.affine_row(MaskRule::Nearest, mask, mean, slope)
    }

    fn moments(&self, mask: &[u32]) -> (Vec3, Matrix3<f64>) {
        let count = mask.len() as f64;
        let at = |vertex: &u32| self.mesh.vertices()[*vertex as usize];
        let mean = mask.iter().map(at).sum::<Vec3>() / count;
        let outer = |vertex: &u32| (at(vertex) - mean) * (at(vertex) - mean).transpose();
        (mean, mask.iter().map(outer).sum::<Matrix3<f64>>() / count)
    }

    fn affine_row(&self, rule: MaskRule, mask: Vec<u32>, mean: Vec3, slope: Vec3) -> Row {
        let count = mask.len() as f64;
        let offset = |it: &u32| self.mesh.vertices()[*it as usize] - mean;
        let values: Vec<f64> =
            mask.iter().map(|it| (1.0 + offset(it).dot(&slope)) / count).collect();
        let amplification = values.iter().map(|it| it.abs()).sum();
        Row { rule, mask, values, amplification }
    }
}

/// Weights of the energy whose minimum [`ridge_row`] is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RowEnergy {
    /// `w_rec`, of the reconstructed joint.
    pub reconstruction: f64,
    /// `w_con`, of the row's sum.
    pub sum: f64,
    /// `lambda`, of entries outside of the mask.
    pub outside: f64,
    /// The ridge on all entries.
    pub ridge: f64,
}

/// Minimizes `w_rec |X^T r - j|^2 + w_con (1^T r - 1)^2 + lambda |r outside|^2 + eps |r|^2`.
///
/// By the push-through identity the `V x V` system becomes `4 x 4`. The paper's own energy is the
/// limit of no ridge, whose minimum of least norm [`exact_regressor`] returns.
///
/// # Panics
/// If the ridge is not positive.
pub fn ridge_row(
    vertices: &[Vec3],
    joint: Vec3,
    in_mask: impl Fn(usize) -> bool,
    energy: &RowEnergy,
) -> Vec<f64> {
    assert!(energy.ridge > 0.0, "a positive ridge");
    let inverse = |it: usize| 1.0 / (energy.ridge + if in_mask(it) { 0.0 } else { energy.outside });
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::shapes::bumpy_sphere;

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
        assert_eq!(reports[1].rule, MaskRule::Parent { threshold: 0.0 });
        assert!(reports.iter().all(|it| it.residual < 1e-12 && it.amplification < 2.0));
        for (vertex, _) in regressor.matrix.row(1) {
            assert!(weights.get(vertex, 0) > 0.0 && weights.get(vertex, 1) > 0.0);
        }
        // The root's parent is the root.
        assert!(regressor.matrix.row(0).all(|(vertex, _)| weights.get(vertex, 0) > 0.0));
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
        let mesh = crate::kernels::shapes::rectangle(4, 4, 1.0, 1.0);
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
