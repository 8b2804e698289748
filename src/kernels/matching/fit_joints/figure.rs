//! A figure in several poses, and fits of its parts.

use nalgebra::Isometry3;

use super::blocks::Point;
use super::choose::{Need, by_need};
use super::fitted::Fitted;
use super::misfit::{misfit, points_of_parts};
use super::parts::on_bone;
use super::samples::{Sample, samples};
use super::seeds::unknown;
use super::solve::{Pose, State};
use super::split::{View, best_split};
use super::{FitError, FitOptions};
use crate::kernels::geometry::distance_field::DistanceField;
use crate::kernels::geometry::kabsch::shortest_arc;
use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::geometry::triangle_tree::TriangleTree;
use crate::kernels::matching::find_joints::{Joint, swing_of};
use crate::kernels::rigs::skeleton::Skeleton;

/// What stays the same while joints come and go; lengths in parts of the extent.
pub struct Figure {
    pub extent: f64,
    pub rest: usize,
    pub skeleton: Skeleton,
    /// Without the pose at rest.
    pub poses: Vec<Vec<Vec3>>,
    surfaces: Vec<TriangleTree>,
    /// Of the faces of these surfaces.
    normals: Vec<Vec<Vec3>>,
    pub samples: Vec<Sample>,
    /// At rest.
    pub body: DistanceField,
}

impl Figure {
    /// Checks what belongs together and prepares it.
    pub fn new(
        skeleton: &Skeleton,
        poses: &[Vec<Vec3>],
        surfaces: &[&TriMesh],
        options: &FitOptions,
    ) -> Result<Self, FitError> {
        let (n_surfaces, n_poses, n_joints) = (surfaces.len(), poses.len(), skeleton.n_joints());
        if n_surfaces != n_poses {
            return Err(FitError::Counts { n_surfaces, n_poses });
        }
        if let Some(pose) = poses.iter().position(|it| it.len() != n_joints) {
            return Err(FitError::Joints { pose, found: poses[pose].len(), n_joints });
        }
        if let Some(surface) = surfaces.iter().position(|it| it.n_faces() == 0) {
            return Err(FitError::NoFaces { surface });
        }
        let extent = extent(skeleton.positions());
        if !(extent > 0.0 && (1.0 / extent).is_finite()) {
            return Err(FitError::Extent { extent });
        }
        let rest = rest_pose(skeleton, poses, extent)?;
        let scaled = |it: &[Vec3]| it.iter().map(|it| it / extent).collect::<Vec<Vec3>>();
        let finite = "finite places stay finite";
        let skeleton = skeleton.with_positions(scaled(skeleton.positions())).expect(finite);
        let mesh =
            |it: usize| surfaces[it].with_vertices(scaled(surfaces[it].vertices())).expect(finite);
        let at_rest = mesh(rest);
        let body = DistanceField::new(&at_rest);
        let samples = samples(&at_rest, body.tree(), &skeleton, options.n_samples);
        let others: Vec<usize> = (0..n_poses).filter(|&it| it != rest).collect();
        let meshes: Vec<TriMesh> = others.iter().map(|&it| mesh(it)).collect();
        let normal = |mesh: &TriMesh, it: usize| {
            mesh.area_vector(it).try_normalize(0.0).unwrap_or_else(Vec3::zeros)
        };
        let normals = |it: &TriMesh| (0..it.n_faces()).map(|face| normal(it, face)).collect();
        Ok(Self {
            extent,
            rest,
            skeleton,
            poses: others.iter().map(|&it| scaled(&poses[it])).collect(),
            surfaces: meshes.iter().map(TriangleTree::new).collect(),
            normals: meshes.iter().map(normals).collect(),
            samples,
            body,
        })
    }

    /// Tells of joints how the part behind them swings against the part before; its roll is left out.
    pub fn describe(&self, joints: &mut [Joint], fitted: &Fitted, options: &FitOptions) {
        let Fitted { parts, state, .. } = fitted;
        let mut directions = vec![Vec3::zeros(); parts.n_parts()];
        for piece in &parts.pieces {
            let [from, to] = piece
                .shares
                .map(|it| on_bone(&self.skeleton, self.skeleton.positions(), piece.bone, it));
            directions[piece.part] += to - from;
        }
        for (joint, &[before, behind]) in joints.iter_mut().zip(&parts.sides) {
            let swing = |motions: &Vec<Isometry3<f64>>| {
                let turn = motions[before].rotation.inverse() * motions[behind].rotation;
                shortest_arc(directions[behind], turn * directions[behind]).scaled_axis()
            };
            let turns: Vec<Vec3> = state.motions.iter().map(swing).collect();
            swing_of(joint, &turns, options.freedoms);
        }
    }

    /// The joints from the one that is needed least.
    pub fn needs(&self, joints: &[Joint], fitted: &Fitted, options: &FitOptions) -> Vec<Need> {
        let Fitted { parts, state, points, .. } = fitted;
        by_need(joints, parts, state, points, &self.poses(&[]), options)
    }

    /// A joint where a part does not move as one, and how much of the surface it may bring back.
    pub fn split(
        &self,
        fitted: &Fitted,
        taken: &[Vec3],
        options: &FitOptions,
    ) -> Option<(Joint, f64)> {
        let view = View { fitted, samples: &self.samples, poses: &self.poses(&[]) };
        let cut = best_split(&self.skeleton, &view, taken, options.reach)?;
        let joint = unknown(cut.bone, cut.share, cut.place * self.extent);
        Some((joint, cut.gain))
    }

    /// The share of the surface at rest that is off the surfaces, summed over the poses.
    pub fn lost(&self, fitted: &Fitted, options: &FitOptions) -> f64 {
        let Fitted { parts, state, points, .. } = fitted;
        let all = points_of_parts(points, parts.n_parts(), usize::MAX);
        let in_pose = |(motions, pose): (&Vec<Isometry3<f64>>, &Pose<'_>)| {
            let part = |(points, motion): (&Vec<&Point>, &Isometry3<f64>)| {
                let area: f64 = points.iter().map(|it| it.weight).sum();
                area * misfit(points, motion, pose, options.reach)
            };
            all.iter().zip(motions).map(part).sum::<f64>()
        };
        state.motions.iter().zip(&self.poses(&[])).map(in_pose).sum()
    }

    /// What is looked at in every pose, with curves by pose and part or none.
    pub fn poses<'a>(&'a self, curves: &'a [Vec<Vec<(Vec3, Vec3)>>]) -> Vec<Pose<'a>> {
        (0..self.poses.len())
            .map(|it| Pose {
                surface: &self.surfaces[it],
                normals: &self.normals[it],
                curve: curves.get(it).map_or(&[], Vec::as_slice),
            })
            .collect()
    }

    /// Motions of all poses in the skeleton's unit.
    pub fn all_motions(&self, state: &State, n_parts: usize) -> Vec<Vec<Isometry3<f64>>> {
        let large = |it: &Isometry3<f64>| {
            let mut it = *it;
            it.translation.vector *= self.extent;
            it
        };
        let mut all: Vec<Vec<Isometry3<f64>>> =
            state.motions.iter().map(|it| it.iter().map(large).collect()).collect();
        all.insert(self.rest, vec![Isometry3::identity(); n_parts]);
        all
    }
}

fn extent(points: &[Vec3]) -> f64 {
    let first = points.first().copied().unwrap_or_else(Vec3::zeros);
    let (low, high) = points.iter().fold((first, first), |(l, h), it| (l.inf(it), h.sup(it)));
    (high - low).max()
}

/// The pose that the skeleton is in.
fn rest_pose(skeleton: &Skeleton, poses: &[Vec<Vec3>], extent: f64) -> Result<usize, FitError> {
    /// Places go through turns and back.
    const ROUNDING: f64 = 1e-6;
    let off = |pose: &Vec<Vec3>| {
        let pairs = pose.iter().zip(skeleton.positions());
        pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
    };
    let offs: Vec<f64> = poses.iter().map(off).collect();
    let nearest = (0..offs.len()).min_by(|&a, &b| offs[a].total_cmp(&offs[b]));
    match nearest {
        Some(pose) if offs[pose] <= ROUNDING * extent => Ok(pose),
        Some(pose) => Err(FitError::NoRest { pose, off: offs[pose] }),
        None => Err(FitError::NoRest { pose: 0, off: f64::INFINITY }),
    }
}
