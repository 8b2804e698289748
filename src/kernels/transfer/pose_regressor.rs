//! Joint regressors that hold while the joints move.

use nalgebra::{DMatrix, DVector};

use super::{
    exact_regressor::best_row,
    regressor::Regressor,
    regressor_masks::{
        Mask, MaskRule, RegressorError, RegressorOptions, RiggedMesh, Row, RowReport,
    },
};
use crate::kernels::{
    geometry::mesh::{TriMesh, Vec3},
    rigs::{skeleton::Skeleton, weights::SkinWeights},
};

/// Options of [`pose_regressor`].
#[derive(Debug, Clone, PartialEq)]
pub struct PoseRegressorOptions {
    /// How much errors in other poses count against noise of the vertices: about how far (in
    /// radians, over the relative error of vertices) joints turn.
    pub stiffness: f64,
    /// The share of the mesh's area around a joint from which it is regressed.
    pub area_share: f64,
    /// The largest `sum_i |r_i|`; rows above are made less stiff.
    pub max_amplification: f64,
}

impl Default for PoseRegressorOptions {
    fn default() -> Self {
        Self { stiffness: 10.0, area_share: 0.06, max_amplification: 2.0 }
    }
}

/// Computes joints as sums of vertices that stay right when the rig is posed: `J = R X`.
///
/// Under linear blend skinning with transforms `G_g`, a row gives
/// `sum_i r_i sum_g w_ig G_g v_i`. It follows the joint `j`, the pivot of its own transform and of its
/// parent's, in every pose if `sum_i r_i w_ig (v_i - j) = 0` for these two, and
/// `sum_i r_i w_ig = 0` and the same for all others; at rest, if `sum_i r_i = 1` and
/// `sum_i r_i v_i = j`. The minimum-norm row of Musoni et al. 2021 (see [`exact_regressor`]) meets the
/// conditions at rest only. Here those at rest are met, and the others weighed against the row's norm:
/// with lengths in units of a sixteenth of the root of the area, and `a_i` the vertices' areas over
/// `|v_i - j|^2 + 0.09` (what is near to a joint tells more of it), scaled to the sum one,
///
/// `sum_i r_i^2 / a_i + s^2 sum_own |..|^2 + (s/3)^2 sum_others |..|^2 -> min`
///
/// has a closed form of the size of the conditions.
///
/// Vertices are the nearest to the joint of those that it or its parent moves. Where these are too few
/// or flat, the row of [`exact_regressor`] is taken.
///
/// # Errors
/// See [`RegressorError`].
pub fn pose_regressor(
    mesh: &TriMesh,
    skeleton: &Skeleton,
    weights: &SkinWeights,
    options: &PoseRegressorOptions,
) -> Result<(Regressor, Vec<RowReport>), RegressorError> {
    let fallback = RegressorOptions {
        max_amplification: options.max_amplification,
        ..RegressorOptions::default()
    };
    let rigged = RiggedMesh::new(mesh, skeleton, weights, &fallback)?;
    let rig = Rig { mesh, skeleton, weights, areas: vertex_areas(mesh), options };
    let row = |joint| {
        rig.row(joint).unwrap_or_else(|| best_row(&rigged, joint, options.max_amplification))
    };
    let rows: Vec<Row> = (0..skeleton.n_joints()).map(row).collect();
    Ok(rigged.assemble(&rows))
}

struct Rig<'a> {
    mesh: &'a TriMesh,
    skeleton: &'a Skeleton,
    weights: &'a SkinWeights,
    /// A third of the faces around each vertex.
    areas: Vec<f64>,
    options: &'a PoseRegressorOptions,
}

/// A condition on a row: its coefficients, what they should sum up to, and how much that counts.
struct Condition {
    coefficients: Vec<f64>,
    value: f64,
    weight: f64,
}

/// Conditions that are met to rounding.
const STRICT: f64 = 1e6;

/// Row sums of the weights below this do not move anything.
const NEGLIGIBLE: f64 = 1e-9;

impl Rig<'_> {
    /// A row, as stiff as the amplification allows.
    fn row(&self, joint: usize) -> Option<Row> {
        let vertices = self.around(joint);
        if vertices.len() < 8 {
            return None;
        }
        let mut stiffness = self.options.stiffness;
        for _ in 0..8 {
            let values = self.solve(joint, &vertices, stiffness)?;
            if values.iter().map(|it| it.abs()).sum::<f64>() <= self.options.max_amplification {
                let mask = Mask { rule: MaskRule::Posed, n_fallbacks: 0, vertices };
                return Some(Row::new(mask, values));
            }
            stiffness *= 0.5;
        }
        None
    }

    /// The nearest vertices among those that the joint or its parent moves, ascending.
    fn around(&self, joint: usize) -> Vec<u32> {
        let parent = self.skeleton.parents()[joint].unwrap_or(joint);
        let place = self.skeleton.positions()[joint];
        let mut near: Vec<(f64, u32)> = (0..self.mesh.n_vertices())
            .filter(|&it| {
                self.areas[it] > 0.0
                    && self.weights.get(it, joint) + self.weights.get(it, parent) > NEGLIGIBLE
            })
            .map(|it| ((self.mesh.vertices()[it] - place).norm_squared(), it as u32))
            .collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let wanted = self.options.area_share * self.areas.iter().sum::<f64>();
        let mut sum = 0.0;
        let mut vertices: Vec<u32> = near
            .iter()
            .take_while(|it| {
                let before = sum;
                sum += self.areas[it.1 as usize];
                before < wanted
            })
            .map(|it| it.1)
            .collect();
        vertices.sort_unstable();
        vertices
    }

    fn solve(&self, joint: usize, vertices: &[u32], stiffness: f64) -> Option<Vec<f64>> {
        let conditions = self.conditions(joint, vertices, stiffness);
        let areas = self.shares(joint, vertices);
        let n = conditions.len();
        let scaled = DMatrix::from_fn(n, vertices.len(), |row, column| {
            conditions[row].coefficients[column] * areas[column].sqrt()
        });
        let mut system = &scaled * scaled.transpose();
        for (at, condition) in conditions.iter().enumerate() {
            system[(at, at)] += condition.weight.powi(-2);
        }
        let values = DVector::from_iterator(n, conditions.iter().map(|it| it.value));
        let multipliers = system.cholesky()?.solve(&values);
        let mut row: Vec<f64> = (scaled.transpose() * multipliers)
            .iter()
            .zip(&areas)
            .map(|(it, area)| it * area.sqrt())
            .collect();
        let sum: f64 = row.iter().sum();
        row.iter_mut().for_each(|it| *it /= sum);
        let fits = self.residual(joint, vertices, &row) <= 1e-6 * self.unit();
        (fits && row.iter().all(|it| it.is_finite())).then_some(row)
    }

    /// How much of a row each vertex should have: by its area and nearness, with the sum one.
    fn shares(&self, joint: usize, vertices: &[u32]) -> Vec<f64> {
        let place = self.skeleton.positions()[joint];
        let share = |&it: &u32| {
            let offset = (self.mesh.vertices()[it as usize] - place) / self.unit();
            self.areas[it as usize] / (offset.norm_squared() + 0.09)
        };
        let mut shares: Vec<f64> = vertices.iter().map(share).collect();
        let total: f64 = shares.iter().sum();
        shares.iter_mut().for_each(|it| *it /= total);
        shares
    }

    /// What a row should fulfil, in units of [`Rig::unit`].
    fn conditions(&self, joint: usize, vertices: &[u32], stiffness: f64) -> Vec<Condition> {
        let parent = self.skeleton.parents()[joint].unwrap_or(joint);
        let place = self.skeleton.positions()[joint];
        let offsets: Vec<Vec3> = vertices
            .iter()
            .map(|&it| (self.mesh.vertices()[it as usize] - place) / self.unit())
            .collect();
        let ones = vec![1.0; vertices.len()];
        let mut res = vec![Condition { coefficients: ones.clone(), value: 1.0, weight: STRICT }];
        res.extend(moments(&offsets, &ones, STRICT));
        for mover in 0..self.skeleton.n_joints() {
            let shares: Vec<f64> =
                vertices.iter().map(|&it| self.weights.get(it as usize, mover)).collect();
            if shares.iter().sum::<f64>() < NEGLIGIBLE {
                continue;
            }
            if mover == joint || mover == parent {
                res.extend(moments(&offsets, &shares, stiffness));
            } else {
                let weight = stiffness / 3.0;
                res.extend(moments(&offsets, &shares, weight));
                res.push(Condition { coefficients: shares, value: 0.0, weight });
            }
        }
        res
    }

    /// A sixteenth of the root of the area: about the radius of a limb.
    fn unit(&self) -> f64 {
        self.areas.iter().sum::<f64>().sqrt() / 16.0
    }

    fn residual(&self, joint: usize, vertices: &[u32], row: &[f64]) -> f64 {
        let at = |vertex: &u32| self.mesh.vertices()[*vertex as usize];
        let estimate: Vec3 = vertices.iter().zip(row).map(|(it, r)| at(it) * *r).sum();
        (estimate - self.skeleton.positions()[joint]).norm()
    }
}

/// The three conditions that offsets, weighted by shares, sum up to zero.
fn moments(offsets: &[Vec3], shares: &[f64], weight: f64) -> impl Iterator<Item = Condition> {
    let moment = |axis: usize| offsets.iter().zip(shares).map(|(it, s)| it[axis] * s).collect();
    let moments: [Vec<f64>; 3] = [moment(0), moment(1), moment(2)];
    moments.into_iter().map(move |coefficients| Condition { coefficients, value: 0.0, weight })
}

/// What each vertex stands for; points of a cloud count alike.
fn vertex_areas(mesh: &TriMesh) -> Vec<f64> {
    if mesh.is_point_cloud() {
        let (low, high) = mesh.bounds();
        return vec![(high - low).norm_squared() / mesh.n_vertices() as f64; mesh.n_vertices()];
    }
    mesh.vertex_areas()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::kernels::motion::fit_clip::world_positions;
    use crate::kernels::motion::pose::pose;
    use crate::kernels::rigs::skinning::skin;
    use crate::kernels::synthetic::synthesize::{SynthesizeOptions, synthesize};
    use crate::kernels::transfer::exact_regressor::exact_regressor;

    /// The largest joint error over the body's size after an elbow, a knee and a shoulder have turned.
    fn error_when_posed(regressor: &Regressor, scale: f64) -> f64 {
        let body =
            synthesize(&SynthesizeOptions { n_vertices: 2000, ..Default::default() }).unwrap();
        let turns = BTreeMap::from([
            ("left_forearm".to_owned(), [-60.0, 0.0, 0.0]),
            ("right_leg".to_owned(), [60.0, 0.0, 0.0]),
            ("right_arm".to_owned(), [-40.0, 0.0, 20.0]),
        ]);
        let clip = pose(&body.skeleton, &turns, None).unwrap();
        let posed = skin(&body.mesh, &body.skeleton, &body.weights, &clip, 0).unwrap();
        let truth = world_positions(&clip, 0, body.skeleton.parents());
        let error = |(joint, truth): (usize, &Vec3)| {
            let row = regressor.matrix.row(joint);
            let estimate: Vec3 = row.map(|(vertex, value)| posed[vertex] * value).sum();
            (estimate - truth).norm()
        };
        truth.iter().enumerate().map(error).fold(0.0, f64::max) / scale
    }

    #[test]
    fn joints_stay_right_in_other_poses() {
        let body =
            synthesize(&SynthesizeOptions { n_vertices: 2000, ..Default::default() }).unwrap();
        let (low, high) = body.mesh.bounds();
        let height = (high - low).y;
        let parts = (&body.mesh, &body.skeleton, &body.weights);
        let options = PoseRegressorOptions::default();
        let (regressor, reports) = pose_regressor(parts.0, parts.1, parts.2, &options).unwrap();
        let exact = exact_regressor(parts.0, parts.1, parts.2, &RegressorOptions::default());
        let (ours, papers) =
            (error_when_posed(&regressor, height), error_when_posed(&exact.unwrap().0, height));
        assert!(ours < 0.006 && ours < 0.5 * papers, "{ours} against {papers}");
        let ones = regressor.matrix.mul_vec(&vec![1.0; body.mesh.n_vertices()]);
        assert!(ones.iter().all(|it| (it - 1.0).abs() < 1e-12));
        assert!(reports.iter().all(|it| it.residual < 1e-6 * height && it.amplification <= 2.0));
        // Without limits, the conditions are met exactly.
        let stiff =
            PoseRegressorOptions { stiffness: 1e5, max_amplification: f64::INFINITY, ..options };
        let (regressor, _) = pose_regressor(parts.0, parts.1, parts.2, &stiff).unwrap();
        let ours = error_when_posed(&regressor, height);
        assert!(ours < 1e-4, "{ours}");
    }

    #[test]
    fn scale_and_place_change_no_entry() {
        let body =
            synthesize(&SynthesizeOptions { n_vertices: 1000, ..Default::default() }).unwrap();
        let options = PoseRegressorOptions::default();
        let run = |scale: f64, shift: Vec3| {
            let moved = |it: &Vec3| it * scale + shift;
            let mesh = body.mesh.with_vertices(body.mesh.vertices().iter().map(moved).collect());
            let joints = body.skeleton.positions().iter().map(moved).collect();
            let skeleton = body.skeleton.with_positions(joints).unwrap();
            pose_regressor(&mesh.unwrap(), &skeleton, &body.weights, &options).unwrap().0.matrix
        };
        let first = run(1.0, Vec3::zeros());
        for (scale, shift) in
            [(1e-6, Vec3::zeros()), (1e6, Vec3::zeros()), (3.0, Vec3::repeat(7.0))]
        {
            let other = run(scale, shift);
            assert_eq!(first.columns, other.columns);
            let gap = first.values.iter().zip(&other.values).map(|(a, b)| (a - b).abs());
            assert!(gap.fold(0.0, f64::max) < 1e-7);
        }
    }
}
