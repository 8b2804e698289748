//! The joints of a figure, from its skeleton in several poses.

mod bends;
mod center;
mod chains;
mod reduced;
mod symmetry;
#[cfg(test)]
mod tests;

use nalgebra::DMatrix;

use self::bends::{Bend, bends};
use self::center::{Base, center};
use self::chains::{Chain, chains};
pub use self::reduced::joint_skeleton;
use self::symmetry::images;
use super::mesh::Vec3;
use super::skeleton::Skeleton;

/// What counts as a joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointOptions {
    /// Directions are those of chords of this share of the skeleton's greatest extent; 0 for single bones.
    pub window: f64,
    /// Joints are at least so many windows away from the ends of limbs, whose directions are uncertain.
    pub tip: f64,
    /// Joints are at least so many windows away from branch nodes, or at them; 0 for everywhere.
    pub fork: f64,
    /// Whether branch nodes may be joints.
    pub at_forks: bool,
    /// Put joints where the axes of limbs meet over the poses, not on the curve.
    pub is_centered: bool,
    /// A joint bends by more than this, in degrees.
    pub min_angle: f64,
    /// Joints of one branch are at least so many windows apart.
    pub separation: f64,
    /// A degree of freedom has a spread of more than this, in degrees…
    pub min_spread: f64,
    /// … and of more than this share of the first one's.
    pub spread_share: f64,
    /// Give each joint an image on the limb that is like its own.
    pub is_symmetric: bool,
    /// The greatest first rating of the skeleton's match with itself that counts as a symmetry.
    pub symmetry_rating: f64,
}

impl Default for JointOptions {
    fn default() -> Self {
        Self {
            window: 0.05,
            tip: 0.0,
            fork: 0.0,
            at_forks: true,
            is_centered: true,
            min_angle: 15.0,
            separation: 1.0,
            min_spread: 5.0,
            spread_share: 0.2,
            is_symmetric: true,
            symmetry_rating: 0.05,
        }
    }
}

/// A place where a skeleton bends.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// The bone it lies on: the joint of the skeleton at its end…
    pub bone: usize,
    /// … and where on it, from 0 at its parent to 1.
    pub share: f64,
    /// At rest.
    pub position: Vec3,
    /// The greatest angle against the rest pose, in degrees.
    pub angle: f64,
    /// 1 or 2: roll about the bone cannot be seen.
    pub n_freedoms: usize,
    /// The axis of the largest spread, at rest.
    pub axis: Vec3,
    /// The spreads along the three axes, in degrees, the largest first.
    pub spreads: [f64; 3],
    /// Whether it is here because its image on a like limb bends.
    pub is_mirrored: bool,
}

impl Joint {
    /// The joint of the skeleton that it is nearest to along its bone.
    pub fn at(&self, skeleton: &Skeleton) -> usize {
        skeleton.parents()[self.bone].filter(|_| self.share < 0.5).unwrap_or(self.bone)
    }
}

/// Why there are no joints to be found.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum JointsError {
    #[error("pose {pose} has {found} joints, but the skeleton {n_joints}")]
    Counts { pose: usize, found: usize, n_joints: usize },
}

/// Finds the joints of a skeleton of many nodes from its poses (Madaras et al. 2014, section 5).
///
/// Along every branch, the direction after a node is held against the direction before it; a joint is
/// where the angle between them changes most against the rest pose. `poses` are places of all of the
/// skeleton's joints. Sorted by the bones that the joints lie on.
///
/// # Errors
/// See [`JointsError`].
pub fn find_joints(
    skeleton: &Skeleton,
    poses: &[Vec<Vec3>],
    options: &JointOptions,
) -> Result<Vec<Joint>, JointsError> {
    let n_joints = skeleton.n_joints();
    if let Some(pose) = poses.iter().position(|it| it.len() != n_joints) {
        return Err(JointsError::Counts { pose, found: poses[pose].len(), n_joints });
    }
    let extent = extent(skeleton.positions());
    let window = options.window * extent;
    let chains = chains(skeleton, poses, window / 4.0);
    let bends = bends(&chains, poses.len(), window);
    let chosen = greatest(&chains, &bends, window, options, options.separation * window);
    let mut joints: Vec<Joint> =
        chosen.into_iter().map(|it| joint(skeleton, &chains, it, window, options)).collect();
    if options.is_symmetric {
        let found = images(skeleton, &joints, options.symmetry_rating);
        let least = (options.separation * window).max(1e-9 * extent);
        let is_new = |known: &[Joint], it: &Joint| {
            known.iter().all(|own| (own.position - it.position).norm() > least)
        };
        for image in found {
            if is_new(&joints, &image) {
                joints.push(image);
            }
        }
    }
    joints.sort_by(|a, b| a.bone.cmp(&b.bone).then(a.share.total_cmp(&b.share)));
    Ok(joints)
}

fn extent(points: &[Vec3]) -> f64 {
    let (low, high) =
        points.iter().fold((points[0], points[0]), |(l, h), it| (l.inf(it), h.sup(it)));
    (high - low).max()
}

/// Bends that are greater than the others near them.
fn greatest<'a>(
    chains: &[Chain],
    bends: &'a [Bend],
    window: f64,
    options: &JointOptions,
    separation: f64,
) -> Vec<&'a Bend> {
    let is_bent = |it: &&Bend| it.angle() > options.min_angle.to_radians();
    let mut order: Vec<(f64, &Bend)> =
        bends.iter().filter(is_bent).map(|it| (it.spread(), it)).collect();
    let is_parent: Vec<bool> =
        (0..chains.len()).map(|it| chains.iter().any(|c| c.before == Some(it))).collect();
    order.retain(|(_, bend)| {
        let chain = &chains[bend.chain];
        let way = chain.ways[bend.sample];
        let after = chain.length() - way;
        let (tip, fork) = (options.tip * window, options.fork * window);
        let is_fork = bend.sample == 0;
        let starts = chain.before.is_some()
            || chains
                .iter()
                .filter(|c| c.before.is_none() && c.joints[0] == chain.joints[0])
                .count()
                > 1;
        let start_ok =
            if is_fork { options.at_forks } else { way >= if starts { fork } else { tip } };
        start_ok && after >= if is_parent[bend.chain] { fork } else { tip }
    });
    order.sort_by(|a, b| b.0.total_cmp(&a.0));
    // A slope beside a greater bend is no joint, so that lesser bends fall, too.
    let mut seen: Vec<&Bend> = Vec::new();
    let mut chosen: Vec<&Bend> = Vec::new();
    for (_, bend) in order {
        let way = |it: &Bend| chains[it.chain].ways[it.sample];
        let place = |it: &Bend| chains[it.chain].rest[it.sample];
        let is_beside = |it: &&Bend| {
            separation > 0.0 && it.chain == bend.chain && it.sample.abs_diff(bend.sample) <= 1
        };
        let is_near = |it: &&Bend| match it.chain == bend.chain {
            true => (way(it) - way(bend)).abs() < separation,
            false => (place(it) - place(bend)).norm() <= 1e-9 * chains[it.chain].length(),
        };
        let is_slope = seen.iter().any(|it| is_beside(it));
        seen.push(bend);
        if !is_slope && !chosen.iter().any(is_near) {
            chosen.push(bend);
        }
    }
    chosen
}

fn joint(
    skeleton: &Skeleton,
    chains: &[Chain],
    bend: &Bend,
    window: f64,
    options: &JointOptions,
) -> Joint {
    let chain = &chains[bend.chain];
    let place = chain.ways[bend.sample];
    let (bone, share) = bone_at(skeleton, chain, place);
    let position = match options.is_centered && window > 0.0 {
        true => center(chain, place, window, &base(chains, bend, window)),
        false => chain.rest[bend.sample],
    };
    let (spreads, axis) = freedoms(&bend.turns);
    let least = options.min_spread.max(options.spread_share * spreads[0]);
    Joint {
        bone,
        share,
        position,
        angle: bend.angle().to_degrees(),
        n_freedoms: spreads.iter().filter(|it| **it > least).count(),
        axis,
        spreads,
        is_mirrored: false,
    }
}

/// The side before a bend: the chain up to it, and where a branch node is near the chains around that
/// node that turn as it does.
fn base<'a>(chains: &[Chain], bend: &'a Bend, window: f64) -> Base<'a> {
    const REACH: f64 = 3.0;
    const STEPS: usize = 8;
    const STILL_RAD: f64 = 0.2;
    let chain = &chains[bend.chain];
    let way = chain.ways[bend.sample];
    let n_poses = bend.frames.len();
    let mut base =
        Base { frames: &bend.frames, rest: Vec::new(), poses: vec![Vec::new(); n_poses] };
    let mut n_parts = 0;
    let mut add = |it: &Chain, from: f64, to: f64| {
        n_parts += 1;
        for step in 0..=STEPS {
            let at = from + (to - from) * step as f64 / STEPS as f64;
            base.rest.push(it.place(None, at));
            for (pose, places) in base.poses.iter_mut().enumerate() {
                places.push(it.place(Some(pose), at));
            }
        }
    };
    let near = (way - REACH * window).max(0.0);
    if way > 1.5 * window {
        add(chain, near, way - 0.5 * window);
        return base;
    }
    let reach = REACH * window;
    let is_still = |it: &Chain, from: f64, to: f64| {
        let chord = |pose| it.place(pose, to) - it.place(pose, from);
        let is_like = |(pose, frame): (usize, &nalgebra::UnitQuaternion<f64>)| {
            (frame * chord(None)).angle(&chord(Some(pose))) < STILL_RAD
        };
        bend.frames.iter().enumerate().all(is_like)
    };
    for (index, it) in chains.iter().enumerate() {
        if index == bend.chain {
            continue;
        }
        if Some(index) == chain.before {
            let from = (it.length() - reach).max(0.0);
            add(it, from, it.length());
        } else if it.before == chain.before && it.joints[0] == chain.joints[0] {
            let to = reach.min(it.length());
            if is_still(it, 0.0, to) {
                add(it, 0.0, to);
            }
        }
    }
    if n_parts == 0 {
        return Base {
            rest: vec![chain.place(None, way)],
            poses: (0..n_poses).map(|it| vec![chain.place(Some(it), way)]).collect(),
            ..base
        };
    }
    base
}

/// The bone of the skeleton after a way along a chain.
fn bone_at(skeleton: &Skeleton, chain: &Chain, way: f64) -> (usize, f64) {
    let positions = skeleton.positions();
    let mut start = 0.0;
    let last = chain.joints.len() - 2;
    for (index, pair) in chain.joints.windows(2).enumerate() {
        let length = (positions[pair[1]] - positions[pair[0]]).norm();
        if way <= start + length * (1.0 + 1e-12) || index == last {
            let share = if length > 0.0 { ((way - start) / length).clamp(0.0, 1.0) } else { 1.0 };
            // Against the skeleton's own direction where its root has two bones.
            return match skeleton.parents()[pair[1]] == Some(pair[0]) {
                true => (pair[1], share),
                false => (pair[0], 1.0 - share),
            };
        }
        start += length;
    }
    (chain.joints[0], 1.0)
}

/// The spreads of rotation vectors along their main axes in degrees, and the first axis.
fn freedoms(turns: &[Vec3]) -> ([f64; 3], Vec3) {
    let matrix = DMatrix::from_fn(turns.len(), 3, |pose, axis| turns[pose][axis]);
    let square = (matrix.transpose() * matrix) / turns.len() as f64;
    let square = nalgebra::Matrix3::from_fn(|row, column| square[(row, column)]);
    let eigen = square.symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let spreads = order.map(|it| eigen.eigenvalues[it].max(0.0).sqrt().to_degrees());
    let axis: Vec3 = eigen.eigenvectors.column(order[0]).into_owned();
    let sign = if axis[axis.iamax()] < 0.0 { -1.0 } else { 1.0 };
    (spreads, axis * sign)
}
