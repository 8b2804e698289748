//! The joints of a figure from its surface in several poses.

mod choose;
mod parts;
mod recut;
mod samples;
mod search;
mod solve;
mod split;
#[cfg(test)]
mod tests;

use nalgebra::Isometry3;

use self::choose::least_needed;
use self::parts::{Parts, curve_pairs, motions_of_curves, on_bone};
use self::recut::recut;
use self::samples::{Sample, labels, samples};
use self::search::{find_lost, misfit, points_of_parts};
use self::solve::{Point, Pose, State, Weights, step};
use self::split::{View, best_split};
use super::find_joints::{Joint, JointOptions, swing_of};
use super::kabsch::shortest_arc;
use super::mesh::{TriMesh, Vec3};
use super::skeleton::Skeleton;
use super::triangle_tree::TriangleTree;

/// How joints are fitted. Lengths are shares of the skeleton's greatest extent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FitOptions {
    /// About so many points of the surface at rest are looked at.
    pub n_samples: usize,
    /// Skin counts little within this distance along the curve from a joint, where it bends.
    pub ramp: f64,
    /// The surface of a pose is this near where a part lies on it.
    pub reach: f64,
    /// A joint turns by more than this in some pose, in degrees.
    pub min_angle: f64,
    /// Without a joint, more of the smaller part beside it would be off the surface than this share, in some
    /// pose.
    pub min_gain: f64,
    /// How often joints are cut anew where they were found.
    pub n_recuts: usize,
    /// At most so many joints are added where a part does not move as one.
    pub max_splits: usize,
    /// A degree of freedom has a spread of more than this angle in degrees, and than this share of the
    /// first one's.
    pub freedoms: [f64; 2],
}

impl Default for FitOptions {
    fn default() -> Self {
        let joints = JointOptions::default();
        Self {
            n_samples: 3000,
            ramp: 0.04,
            reach: 0.01,
            min_angle: 20.0,
            min_gain: 0.25,
            n_recuts: 2,
            max_splits: 8,
            freedoms: [joints.min_spread, joints.spread_share],
        }
    }
}

/// Joints that agree with the surfaces, and how well the parts between them do.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// Those that remain, in their order.
    pub joints: Vec<Joint>,
    /// Poses x parts, in the skeleton's unit; the pose at rest is the identity.
    pub motions: Vec<Vec<Isometry3<f64>>>,
    /// For every joint the part before and the one behind it.
    pub sides: Vec<[usize; 2]>,
    /// The share of the surface at rest that lies on the surface of each pose; 1 in its own.
    pub fits: Vec<f64>,
}

/// Why joints cannot be fitted.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FitError {
    #[error("there are {n_surfaces} surfaces, but the skeleton is in {n_poses} poses")]
    Counts { n_surfaces: usize, n_poses: usize },
    #[error("surface {surface} has no faces")]
    NoFaces { surface: usize },
    #[error("pose {pose} has {found} joints, but the skeleton {n_joints}")]
    Joints { pose: usize, found: usize, n_joints: usize },
    #[error("the skeleton is in none of the poses: it is off by {off} in the nearest one, {pose}")]
    NoRest { pose: usize, off: f64 },
    #[error("a skeleton of the extent {extent} cannot be fitted")]
    Extent { extent: f64 },
}

/// Moves joints that were found on curves to where the surface turns about them, and drops those that it
/// does not turn about.
///
/// Joints cut the skeleton, and with it the surface at rest, into stiff parts. All parts are moved onto the
/// surfaces of all poses together with the joints, which are where both parts beside them take them to the same place
/// (articulated ICP: Pekelny & Gotsman 2008; centres of rotation: O'Brien et al. 2000): Gauss-Newton
/// steps of distances along the surface's normals. The
/// surfaces need no vertices in common. Parts that are lost in a pose are looked for all around their joint. Then the joint whose parts could be one with
/// the least harm goes, as long as that is little, and cuts move to where joints were found.
///
/// `surfaces` are one a pose; `skeleton` is in one of the `poses`.
///
/// # Errors
/// See [`FitError`].
pub fn fit_joints(
    skeleton: &Skeleton,
    poses: &[Vec<Vec3>],
    surfaces: &[&TriMesh],
    joints: &[Joint],
    options: &FitOptions,
) -> Result<Fit, FitError> {
    let figure = Figure::new(skeleton, poses, surfaces, options)?;
    let mut joints = joints.to_vec();
    let (mut n_recuts, mut n_splits) = (0, 0);
    // Where joints are or were, which are not tried again.
    let mut taken: Vec<Vec3> = joints.iter().map(|it| it.position / figure.extent).collect();
    let mut current = figure.fit(&joints, Start::Curves, options);
    loop {
        figure.describe(&mut joints, &current, options);
        if let Some(drop) = figure.weakest(&joints, &current, options) {
            joints.remove(drop.joint);
            current = figure.fit(&joints, Start::Merged(without(&current, drop)), options);
            continue;
        }
        if n_recuts < options.n_recuts && !joints.is_empty() {
            n_recuts += 1;
            recut(&figure.skeleton, &mut joints, &current.state.joints);
            let moved = Parts::new(&figure.skeleton, &joints);
            let start = reordered(&current.parts, &moved, current.state);
            current = figure.fit(&joints, Start::Recut(start), options);
            continue;
        }
        if n_splits == options.max_splits {
            break;
        }
        let Some((joint, gain)) = figure.split(&current, &taken, options) else { break };
        n_splits += 1;
        let place = joint.position / figure.extent;
        taken.push(place);
        let more = [&joints[..], &[joint]].concat();
        let parts = Parts::new(&figure.skeleton, &more);
        let start = grown(&current.parts, &parts, current.state.clone(), place);
        let tried = figure.fit(&more, Start::Recut(start), options);
        let lost = |it: &Fitted| figure.lost(it, options);
        if lost(&tried) < lost(&current) - SPLIT_GAIN * gain {
            (joints, current) = (more, tried);
            // The new joint is only about where the part bends.
            n_recuts = n_recuts.saturating_sub(1);
        }
    }
    let Fitted { parts, state, mut fits, .. } = current;
    fits.insert(figure.rest, 1.0);
    let extent = figure.extent;
    for (joint, place) in joints.iter_mut().zip(&state.joints) {
        joint.position = place * extent;
    }
    Ok(Fit { joints, motions: figure.all_motions(&state, parts.n_parts()), sides: parts.sides, fits })
}

/// A joint that is added has to bring so much of what is lost to the surface.
const SPLIT_GAIN: f64 = 0.3;

/// A joint to be dropped, and the part whose motion both parts take.
#[derive(Debug, Clone, Copy)]
struct Drop {
    joint: usize,
    stays: usize,
}

/// What a fit begins with.
enum Start {
    Curves,
    /// Cuts are new, so that parts that were lost may be found.
    Recut(State),
    /// A joint is gone.
    Merged(State),
}

struct Fitted {
    parts: Parts,
    state: State,
    points: Vec<Point>,
    fits: Vec<f64>,
}

/// What stays the same while joints come and go; lengths in parts of the extent.
struct Figure {
    extent: f64,
    rest: usize,
    skeleton: Skeleton,
    /// Without the pose at rest.
    poses: Vec<Vec<Vec3>>,
    surfaces: Vec<TriangleTree>,
    /// Of the faces of these surfaces.
    normals: Vec<Vec<Vec3>>,
    samples: Vec<Sample>,
}

impl Figure {
    fn new(
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
        let mesh = |it: usize| {
            surfaces[it].with_vertices(scaled(surfaces[it].vertices())).expect(finite)
        };
        let at_rest = mesh(rest);
        let tree = TriangleTree::new(&at_rest);
        let samples = samples(&at_rest, &tree, &skeleton, options.n_samples);
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
        })
    }

    fn fit(&self, joints: &[Joint], start: Start, options: &FitOptions) -> Fitted {
        let parts = Parts::new(&self.skeleton, joints);
        let place = |it: &Joint| on_bone(&self.skeleton, self.skeleton.positions(), it.bone, it.share);
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
        let mut fits = self.descend(&mut state, &points, &poses, &parts, &cuts, is_first, options);
        if is_new && find_lost(&mut state, &points, &poses, &parts, options.reach) {
            fits = self.descend(&mut state, &points, &poses, &parts, &cuts, false, options);
        }
        Fitted { parts, state, points, fits }
    }

    #[allow(clippy::too_many_arguments)]
    fn descend(
        &self,
        state: &mut State,
        points: &[Point],
        poses: &[Pose<'_>],
        parts: &Parts,
        cuts: &[Vec3],
        is_first: bool,
        options: &FitOptions,
    ) -> Vec<f64> {
        /// The first reach over the last.
        const WIDE: f64 = 4.0;
        const DECAY: f64 = 0.8;
        let n_steps = if is_first { 20 } else { 12 };
        let mut fits = Vec::new();
        for round in 0..n_steps {
            let wide = if is_first { WIDE } else { 0.5 * WIDE };
            let reach = options.reach * (wide * DECAY.powi(round)).max(1.0);
            let weights = Weights { slide: 0.05, curve: 1e-3, joint: 0.02, prior: 1e-4, reach };
            fits = step(state, points, poses, &parts.sides, cuts, &weights);
        }
        fits
    }

    /// Tells of joints how the part behind them swings against the part before; its roll is left out.
    fn describe(&self, joints: &mut [Joint], fitted: &Fitted, options: &FitOptions) {
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
    fn weakest(
        &self,
        joints: &[Joint],
        fitted: &Fitted,
        options: &FitOptions,
    ) -> Option<Drop> {
        let Fitted { parts, state, points, .. } = fitted;
        least_needed(joints, parts, state, points, &self.poses(&[]), options)
    }

    /// A joint where a part does not move as one, and how much of the surface it may bring back.
    fn split(
        &self,
        fitted: &Fitted,
        taken: &[Vec3],
        options: &FitOptions,
    ) -> Option<(Joint, f64)> {
        let view = View { fitted, samples: &self.samples, poses: &self.poses(&[]) };
        let cut = best_split(&self.skeleton, &view, taken, options.reach)?;
        let joint = Joint {
            bone: cut.bone,
            share: cut.share,
            position: cut.place * self.extent,
            angle: 0.0,
            n_freedoms: 0,
            axis: Vec3::zeros(),
            spreads: [0.0; 3],
            is_mirrored: false,
        };
        Some((joint, cut.gain))
    }

    /// The share of the surface at rest that is off the surfaces, summed over the poses.
    fn lost(&self, fitted: &Fitted, options: &FitOptions) -> f64 {
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
    fn all_motions(&self, state: &State, n_parts: usize) -> Vec<Vec<Isometry3<f64>>> {
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

/// The state with the two parts beside a joint made one.
fn without(fitted: &Fitted, drop: Drop) -> State {
    let Fitted { parts, state, .. } = fitted;
    let [before, behind] = parts.sides[drop.joint];
    let merged = |motions: &Vec<Isometry3<f64>>| {
        let mut motions = motions.clone();
        motions[before] = motions[drop.stays];
        // Parts come in the order of the skeleton, with or without this one.
        motions.remove(behind);
        motions
    };
    let mut joints = state.joints.clone();
    joints.remove(drop.joint);
    State { motions: state.motions.iter().map(merged).collect(), joints }
}

/// The state for parts of the same joints, cut elsewhere: they may come in another order.
fn reordered(parts: &Parts, moved: &Parts, state: State) -> State {
    let loose = |parts: &Parts| -> Vec<usize> {
        (0..parts.n_parts()).filter(|&it| parts.joint_of_part[it].is_none()).collect()
    };
    let (roots, moved_roots) = (loose(parts), loose(moved));
    let old = |part: usize| match moved.joint_of_part[part] {
        Some(joint) => parts.sides[joint][1],
        None => {
            let rank = moved_roots.iter().position(|&it| it == part);
            roots[rank.expect("a part without a joint is a root")]
        }
    };
    sorted(&(0..moved.n_parts()).map(old).collect::<Vec<_>>(), state)
}

/// The state with one joint more, the last: both of its parts move as the one did that it cuts.
fn grown(parts: &Parts, split: &Parts, mut state: State, place: Vec3) -> State {
    let last = split.sides.len() - 1;
    let old = |part: usize| match split.joint_of_part[part] {
        Some(joint) if joint == last => None,
        Some(joint) => Some(parts.sides[joint][1]),
        None => {
            let is_root = |it: &usize| parts.joint_of_part[*it].is_none();
            let rank = (0..part).filter(|&it| split.joint_of_part[it].is_none()).count();
            (0..parts.n_parts()).filter(is_root).nth(rank)
        }
    };
    let before = old(split.sides[last][0]).expect("only the last joint is new");
    state.joints.push(place);
    sorted(&(0..split.n_parts()).map(|it| old(it).unwrap_or(before)).collect::<Vec<_>>(), state)
}

/// The motions of parts in another order.
fn sorted(order: &[usize], state: State) -> State {
    let in_pose = |it: &Vec<Isometry3<f64>>| order.iter().map(|&part| it[part]).collect();
    State { motions: state.motions.iter().map(in_pose).collect(), joints: state.joints }
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
