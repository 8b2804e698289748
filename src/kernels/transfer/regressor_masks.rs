//! The vertices that joints are regressed from.

use nalgebra::Matrix3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::regressor::Regressor;
use crate::kernels::{
    geometry::mesh::{TriMesh, Vec3},
    numerics::sparse::CsrMatrix,
    rigs::{skeleton::Skeleton, weights::SkinWeights},
};

/// Which vertices take part in a joint's row.
#[derive(Debug, Clone, PartialEq)]
pub struct RegressorOptions {
    /// A vertex belongs to a joint's mask if its weights of the joint and of the joint's parent both
    /// exceed this.
    pub threshold: f64,
    /// What stands for the parent of a root.
    pub root: RootRule,
    /// Vertices of a mask that is made of the nearest ones.
    pub n_nearest: usize,
    /// The largest `sum_i |r_i|` of a mask that is taken without looking further.
    pub max_amplification: f64,
}

impl Default for RegressorOptions {
    fn default() -> Self {
        Self { threshold: 0.0, root: RootRule::Own, n_nearest: 64, max_amplification: 2.0 }
    }
}

/// What stands for the parent of a root.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RootRule {
    /// The root itself: all vertices that it moves, as in the paper's demo.
    #[default]
    Own,
    /// Its children: the vertices that it moves together with one of them.
    Children,
}

/// Which vertices a joint's mask holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MaskRule {
    /// Moved by the joint and its parent, with weights above a threshold.
    Parent { threshold: f64 },
    /// Moved by a root, with weights above a threshold.
    Root { threshold: f64 },
    /// Moved by a root and one of its children, with weights above a threshold.
    RootAndChildren { threshold: f64 },
    /// Moved by the joint and one of its children.
    Child { child: usize },
    /// Moved by the joint.
    Moved { threshold: f64 },
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
    /// How many rules were tried before this one: zero where nothing fell back.
    pub n_fallbacks: usize,
    pub n_vertices: usize,
    /// The sum of the row as the method found it, before it was made one.
    pub sum: f64,
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
    #[error("the mesh has no vertices")]
    NoVertices,
    #[error("all {n_vertices} vertices of the mesh lie at one point")]
    NoExtent { n_vertices: usize },
}

/// A joint's vertices, and the rule that chose them.
#[derive(Debug, Clone)]
pub struct Mask {
    pub rule: MaskRule,
    pub n_fallbacks: usize,
    /// Ascending.
    pub vertices: Vec<u32>,
}

/// The nonzero entries of a row of a regressor.
#[derive(Debug, Clone)]
pub struct Row {
    pub rule: MaskRule,
    pub n_fallbacks: usize,
    /// Ascending.
    pub vertices: Vec<u32>,
    pub values: Vec<f64>,
    /// As the method found it.
    pub sum: f64,
}

impl Row {
    /// A row on a mask whose entries sum to one by construction.
    pub fn new(mask: Mask, values: Vec<f64>) -> Self {
        let Mask { rule, n_fallbacks, vertices } = mask;
        Self { rule, n_fallbacks, vertices, values, sum: 1.0 }
    }

    /// `sum_i |r_i|`.
    pub fn amplification(&self) -> f64 {
        self.values.iter().map(|it| it.abs()).sum()
    }

    fn report(&self, mesh: &TriMesh, joint: Vec3) -> RowReport {
        let entries = self.vertices.iter().zip(&self.values);
        // Rows sum to one, so the joint is the origin: less is lost far away from it.
        let offset = |it: u32| mesh.vertices()[it as usize] - joint;
        let residual: Vec3 = entries.map(|(&it, &r)| offset(it) * r).sum();
        RowReport {
            rule: self.rule,
            n_fallbacks: self.n_fallbacks,
            n_vertices: self.vertices.len(),
            sum: self.sum,
            amplification: self.amplification(),
            residual: residual.norm(),
        }
    }
}

/// A rigged mesh as regressors see it.
pub struct RiggedMesh<'a> {
    pub mesh: &'a TriMesh,
    pub skeleton: &'a Skeleton,
    /// The largest side of the mesh's box.
    pub extent: f64,
    /// By joint: (vertex, weight), ascending.
    moved: Vec<Vec<(u32, f64)>>,
    children: Vec<Vec<usize>>,
    options: &'a RegressorOptions,
}

impl<'a> RiggedMesh<'a> {
    /// Checks that the parts belong together.
    ///
    /// # Errors
    /// See [`RegressorError`].
    pub fn new(
        mesh: &'a TriMesh,
        skeleton: &'a Skeleton,
        weights: &SkinWeights,
        options: &'a RegressorOptions,
    ) -> Result<Self, RegressorError> {
        if mesh.n_vertices() != weights.n_vertices() {
            let (mesh, weights) = (mesh.n_vertices(), weights.n_vertices());
            return Err(RegressorError::Vertices { mesh, weights });
        }
        if skeleton.n_joints() != weights.n_joints() {
            let (skeleton, weights) = (skeleton.n_joints(), weights.n_joints());
            return Err(RegressorError::Joints { skeleton, weights });
        }
        if mesh.n_vertices() == 0 {
            return Err(RegressorError::NoVertices);
        }
        let (low, high) = mesh.bounds();
        let extent = (high - low).max();
        if !(extent > 0.0) {
            return Err(RegressorError::NoExtent { n_vertices: mesh.n_vertices() });
        }
        let mut moved = vec![Vec::new(); skeleton.n_joints()];
        for vertex in 0..weights.n_vertices() {
            for (joint, weight) in weights.row(vertex) {
                moved[joint as usize].push((vertex as u32, weight));
            }
        }
        Ok(Self { mesh, skeleton, extent, moved, children: skeleton.children(), options })
    }

    /// The masks of a joint in the order in which they are tried, made when they are asked for.
    pub fn masks(&self, joint: usize) -> impl Iterator<Item = Mask> + '_ {
        let given = self.options.threshold;
        let thresholds =
            std::iter::once(given).chain([0.01, 0.0].into_iter().filter(move |&it| it < given));
        let wanted = thresholds.map(move |threshold| self.wanted(joint, threshold));
        let by_child = self.children[joint]
            .iter()
            .map(move |&child| (MaskRule::Child { child }, self.common(joint, &[child], 0.0)));
        let rest = self.nearest_masks(joint);
        number(wanted.chain(by_child).chain(rest))
    }

    /// As [`Self::masks`], of all vertices that the joint moves.
    pub fn moved_masks(&self, joint: usize) -> impl Iterator<Item = Mask> + '_ {
        let threshold = self.options.threshold;
        let own = std::iter::once_with(move || {
            (MaskRule::Moved { threshold }, self.common(joint, &[joint], threshold))
        });
        number(own.chain(self.nearest_masks(joint)))
    }

    /// The first mask that has four vertices which do not lie in a plane, or else the last.
    pub fn usable_mask(&self, masks: impl Iterator<Item = Mask>) -> Mask {
        let mut last = None;
        for mask in masks {
            if self.is_usable(&mask) {
                return mask;
            }
            last = Some(mask);
        }
        last.expect("there are always the nearest vertices")
    }

    /// Whether a mask has four vertices that do not lie in a plane: the smallest eigenvalue of their
    /// covariance is at least `1e-8` of the squared extent.
    pub fn is_usable(&self, mask: &Mask) -> bool {
        let smallest = || self.moments(&mask.vertices).1.symmetric_eigenvalues().min();
        mask.vertices.len() >= 4 && smallest() >= self.flatness()
    }

    /// The eigenvalue of a covariance below which points are flat.
    pub fn flatness(&self) -> f64 {
        1e-8 * self.extent.powi(2)
    }

    /// Mean and covariance of vertices.
    pub fn moments(&self, vertices: &[u32]) -> (Vec3, Matrix3<f64>) {
        let count = vertices.len() as f64;
        let at = |vertex: &u32| self.mesh.vertices()[*vertex as usize];
        let mean = vertices.iter().map(at).sum::<Vec3>() / count;
        let outer = |vertex: &u32| (at(vertex) - mean) * (at(vertex) - mean).transpose();
        (mean, vertices.iter().map(outer).sum::<Matrix3<f64>>() / count)
    }

    /// The vertices nearest to a joint.
    pub fn nearest_mask(&self, joint: usize) -> Mask {
        let all = self.nearest(joint, (0..self.mesh.n_vertices() as u32).collect());
        let n_fallbacks = self.masks(joint).count() - 1;
        Mask { rule: MaskRule::Nearest, n_fallbacks, vertices: all }
    }

    /// Puts rows together, one a joint, in the joints' order.
    pub fn assemble(&self, rows: &[Row]) -> (Regressor, Vec<RowReport>) {
        let mut triplets = Vec::new();
        let mut reports = Vec::with_capacity(rows.len());
        for (joint, row) in rows.iter().enumerate() {
            let entries = row.vertices.iter().zip(&row.values).filter(|it| *it.1 != 0.0);
            triplets.extend(entries.map(|(&vertex, &value)| (joint as u32, vertex, value)));
            reports.push(row.report(self.mesh, self.skeleton.positions()[joint]));
        }
        let n_vertices = self.mesh.n_vertices();
        let regressor = Regressor {
            names: self.skeleton.names().to_vec(),
            parents: self.skeleton.parents().to_vec(),
            matrix: CsrMatrix::from_triplets(rows.len(), n_vertices, &triplets),
        };
        (regressor, reports)
    }

    /// The mask that the paper asks for.
    fn wanted(&self, joint: usize, threshold: f64) -> (MaskRule, Vec<u32>) {
        match (self.skeleton.parents()[joint], self.options.root) {
            (Some(parent), _) => {
                (MaskRule::Parent { threshold }, self.common(joint, &[parent], threshold))
            }
            (None, RootRule::Own) => {
                (MaskRule::Root { threshold }, self.common(joint, &[joint], threshold))
            }
            (None, RootRule::Children) => {
                let children = &self.children[joint];
                let rule = MaskRule::RootAndChildren { threshold };
                (rule, self.common(joint, children, threshold))
            }
        }
    }

    fn nearest_masks(&self, joint: usize) -> impl Iterator<Item = (MaskRule, Vec<u32>)> + '_ {
        let parent = self.skeleton.parents()[joint].unwrap_or(joint);
        let nearest_moved = std::iter::once_with(move || {
            let moved = union(&self.moved[joint], &self.moved[parent]);
            (MaskRule::NearestMoved, self.nearest(joint, moved))
        });
        let all = 0..self.mesh.n_vertices() as u32;
        let nearest =
            std::iter::once_with(move || (MaskRule::Nearest, self.nearest(joint, all.collect())));
        nearest_moved.chain(nearest)
    }

    /// The vertices that a joint and one of others move with weights above a threshold.
    fn common(&self, joint: usize, others: &[usize], threshold: f64) -> Vec<u32> {
        let above = |joint: usize| {
            self.moved[joint].iter().filter(move |it| it.1 > threshold).map(|it| it.0)
        };
        let mut moved: Vec<u32> = others.iter().flat_map(|&it| above(it)).collect();
        moved.sort_unstable();
        above(joint).filter(|it| moved.binary_search(it).is_ok()).collect()
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
}

fn number(masks: impl Iterator<Item = (MaskRule, Vec<u32>)>) -> impl Iterator<Item = Mask> {
    let mask = |(n_fallbacks, (rule, vertices)): (usize, (MaskRule, Vec<u32>))| Mask {
        rule,
        n_fallbacks,
        vertices,
    };
    masks.enumerate().map(mask)
}

fn union(a: &[(u32, f64)], b: &[(u32, f64)]) -> Vec<u32> {
    let mut res: Vec<u32> = a.iter().chain(b).map(|it| it.0).collect();
    res.sort_unstable();
    res.dedup();
    res
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::{
        geometry::shapes::{bumpy_sphere, rectangle},
        transfer::{
            adam_regressor::{RegressorEnergy, adam_regressor},
            avril_regressor::avril_regressor,
            convex_regressor::convex_regressor,
            exact_regressor::exact_regressor,
        },
    };

    type Found = Result<(Regressor, Vec<RowReport>), RegressorError>;

    fn all_methods(
        mesh: &TriMesh,
        skeleton: &Skeleton,
        weights: &SkinWeights,
        options: &RegressorOptions,
    ) -> [(&'static str, Found); 4] {
        let energy = RegressorEnergy::PAPER;
        [
            ("exact", exact_regressor(mesh, skeleton, weights, options)),
            ("convex", convex_regressor(mesh, skeleton, weights, options)),
            ("avril", avril_regressor(mesh, skeleton, weights, options, 1e-3)),
            ("adam", adam_regressor(mesh, skeleton, weights, options, &energy)),
        ]
    }

    /// A root, a chest, and a joint that moves nothing.
    fn rig(mesh: &TriMesh, place: impl Fn(Vec3) -> Vec3) -> (Skeleton, SkinWeights) {
        let names = ["root", "chest", "idle"].map(str::to_owned).to_vec();
        let positions = [[0.0, 0.0, -0.3], [0.02, 0.05, 0.1], [0.1, 0.0, 0.4]];
        let positions = positions.map(|it| place(Vec3::from(it))).to_vec();
        let skeleton = Skeleton::new(names, vec![None, Some(0), Some(1)], positions).unwrap();
        let row = |it: &Vec3| {
            let chest = (0.5 + it.z).clamp(0.0, 1.0);
            vec![(1, chest), (0, 1.0 - chest)]
        };
        let rows: Vec<_> = mesh.vertices().iter().map(row).collect();
        (skeleton, SkinWeights::from_rows(3, &rows).unwrap())
    }

    /// Everything is measured against the mesh: its size and its place do not matter, not even a
    /// million times its size or a thousand times away.
    #[test]
    fn size_and_place_do_not_matter_and_a_joint_without_weights_gets_the_nearest_vertices() {
        let mesh = bumpy_sphere(5);
        let (_, weights) = rig(&mesh, |it| it);
        for (scale, offset) in [(1.0, 0.0), (1e-6, 0.0), (1e6, 0.0), (1.0, 1e3)] {
            let place = |it: Vec3| it * scale + Vec3::new(offset, offset, -offset);
            let moved: Vec<Vec3> = mesh.vertices().iter().map(|it| place(*it)).collect();
            let moved = mesh.with_vertices(moved).unwrap();
            let (skeleton, _) = rig(&mesh, place);
            let options = RegressorOptions::default();
            for (method, found) in all_methods(&moved, &skeleton, &weights, &options) {
                let (regressor, reports) = found.unwrap();
                let sums = regressor.matrix.mul_vec(&vec![1.0; moved.n_vertices()]);
                assert!(sums.iter().all(|it| (it - 1.0).abs() < 1e-9), "{method}: {sums:?}");
                for report in &reports {
                    assert!(report.residual < 0.02 * scale, "{method}, {scale}: {report:?}");
                }
                assert!(reports[2].n_fallbacks > 0, "{method}: {:?}", reports[2]);
            }
        }
    }

    #[test]
    fn a_root_may_take_the_vertices_that_it_shares_with_its_children() {
        let mesh = bumpy_sphere(5);
        let (skeleton, weights) = rig(&mesh, |it| it);
        let options = RegressorOptions { root: RootRule::Children, ..Default::default() };
        let (regressor, reports) = exact_regressor(&mesh, &skeleton, &weights, &options).unwrap();
        assert_eq!(reports[0].rule, MaskRule::RootAndChildren { threshold: 0.0 });
        for (vertex, _) in regressor.matrix.row(0) {
            assert!(weights.get(vertex, 0) > 0.0 && weights.get(vertex, 1) > 0.0);
        }
        // A root without children falls back to the nearest.
        let alone = Skeleton::new(vec!["a".to_owned()], vec![None], vec![Vec3::zeros()]).unwrap();
        let rows = vec![vec![(0, 1.0)]; mesh.n_vertices()];
        let weights = SkinWeights::from_rows(1, &rows).unwrap();
        let (_, reports) = exact_regressor(&mesh, &alone, &weights, &options).unwrap();
        assert_eq!(reports[0].rule, MaskRule::NearestMoved);
    }

    #[test]
    fn flat_and_tiny_meshes_give_the_nearest_point_and_a_single_point_is_refused() {
        let skeleton =
            Skeleton::new(vec!["a".to_owned()], vec![None], vec![Vec3::new(0.4, 0.5, 0.2)])
                .unwrap();
        let options = RegressorOptions::default();
        let weights = |n| SkinWeights::from_rows(1, &vec![vec![(0, 1.0)]; n]).unwrap();
        let flat = rectangle(4, 4, 1.0, 1.0);
        for (method, found) in all_methods(&flat, &skeleton, &weights(25), &options) {
            let residual = found.unwrap().1[0].residual;
            assert!((residual - 0.2).abs() < 0.02, "{method}: {residual}");
        }
        let triangle = TriMesh::new(vec![Vec3::zeros(), Vec3::x(), Vec3::y()], vec![[0, 1, 2]]);
        for (method, found) in all_methods(&triangle.unwrap(), &skeleton, &weights(3), &options) {
            let residual = found.unwrap().1[0].residual;
            assert!((residual - 0.2).abs() < 0.02, "{method}: {residual}");
        }
        let point = TriMesh::from_points(vec![Vec3::x(); 5]).unwrap();
        for (_, found) in all_methods(&point, &skeleton, &weights(5), &options) {
            let message = found.unwrap_err().to_string();
            assert_eq!(message, "all 5 vertices of the mesh lie at one point");
        }
    }
}
