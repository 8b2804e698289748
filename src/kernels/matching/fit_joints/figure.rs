//! A figure in several poses, and fits of its parts.

use nalgebra::Isometry3;

use super::choose::least_needed;
use super::parts::{Parts, curve_pairs, motions_of_curves, on_bone};
use super::samples::{Sample, labels, samples};
use super::search::{find_lost, misfit, points_of_parts};
use super::seeds::unknown;
use super::solve::{Point, Pose, Problem, State, Weights, step};
use super::split::{View, best_split};
use super::{Drop, FitError, FitOptions, Fitted, Start};
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
    poses: Vec<Vec<Vec3>>,
    surfaces: Vec<TriangleTree>,
    /// Of the faces of these surfaces.
    normals: Vec<Vec<Vec3>>,
    samples: Vec<Sample>,
    /// At rest.
    body: DistanceField,
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

    /// Moves the parts between joints onto the surfaces.
    pub fn fit(
        &self,
        joints: &[Joint],
        start: Start,
        finds_lost: bool,
        options: &FitOptions,
    ) -> Fitted {
        let parts = Parts::new(&self.skeleton, joints);
        let place =
            |it: &Joint| on_bone(&self.skeleton, self.skeleton.positions(), it.bone, it.share);
        let cuts: Vec<Vec3> = joints.iter().map(place).collect();
        let labels = labels(&self.samples, &self.skeleton, &parts, &cuts, options.ramp);
        let point = |(it, &(part, weight)): (&Sample, &(usize, f64))| Point {
            place: it.point,
            normal: it.normal,
            part,
            weight,
        };
        let points: Vec<Point> = self.samples.iter().zip(&labels).map(point).collect();
        let curves: Vec<Vec<Vec<(Vec3, Vec3)>>> =
            self.poses.iter().map(|it| curve_pairs(&self.skeleton, &parts, it, 0.01)).collect();
        let poses = self.poses(&curves);
        let (is_first, is_new) = match &start {
            Start::Curves => (true, true),
            Start::Recut(_) => (false, true),
            Start::Merged(_) => (false, false),
        };
        let mut state = match start {
            Start::Recut(state) | Start::Merged(state) => state,
            Start::Curves => State {
                motions: curves.iter().map(|it| motions_of_curves(&parts, it)).collect(),
                joints: cuts.clone(),
            },
        };
        let mut is_held = vec![false; joints.len()];
        let move_all = |state: &mut State, is_held: &[bool], is_first: bool| {
            let sides = &parts.sides;
            let problem = Problem { points: &points, poses: &poses, sides, cuts: &cuts, is_held };
            descend(state, &problem, is_first, options.reach)
        };
        let mut fits = move_all(&mut state, &is_held, is_first);
        if is_new && finds_lost && find_lost(&mut state, &points, &poses, &parts, options.reach) {
            fits = move_all(&mut state, &is_held, false);
        }
        if self.hold_outer(&mut state, &cuts, &mut is_held) {
            fits = move_all(&mut state, &is_held, false);
        }
        Fitted { parts, state, points, fits }
    }

    /// Brings joints that are outside of the body at rest back to where they began, to be held there: the parts
    /// beside them do not say where they meet. Returns whether there are any.
    fn hold_outer(&self, state: &mut State, cuts: &[Vec3], is_held: &mut [bool]) -> bool {
        for ((place, cut), is_held) in state.joints.iter_mut().zip(cuts).zip(&mut *is_held) {
            let is_outer = self.body.nearest(*place).square > OUTSIDE * OUTSIDE
                && !self.body.is_inside(*place);
            if is_outer {
                (*place, *is_held) = (*cut, true);
            }
        }
        is_held.contains(&true)
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

    /// The joint that is none, if there is one.
    pub fn weakest(&self, joints: &[Joint], fitted: &Fitted, options: &FitOptions) -> Option<Drop> {
        let Fitted { parts, state, points, .. } = fitted;
        least_needed(joints, parts, state, points, &self.poses(&[]), options)
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
    fn poses<'a>(&'a self, curves: &'a [Vec<Vec<(Vec3, Vec3)>>]) -> Vec<Pose<'a>> {
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

/// Joints may be outside of the surface by this share of the extent, which is that of thin limbs.
const OUTSIDE: f64 = 0.005;

/// Steps from a wide reach to that of a fit; fewer of them where much is known. Returns what `step` does.
fn descend(state: &mut State, problem: &Problem<'_>, is_first: bool, reach: f64) -> Vec<f64> {
    const DECAY: f64 = 0.8;
    let (wide, n_steps) = if is_first { (4.0, 20) } else { (2.0, 12) };
    let mut fits = Vec::new();
    for round in 0..n_steps {
        let reach = reach * f64::max(wide * DECAY.powi(round), 1.0);
        // Joints and priors are weak: what holds parts together by force also holds them off their places, and
        // a prior on the curve is felt where parts turn little.
        let weights =
            Weights { slide: 0.05, curve: 1e-3, joint: 0.02, prior: 1e-4, held: 1.0, reach };
        fits = step(state, problem, &weights);
    }
    fits
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
