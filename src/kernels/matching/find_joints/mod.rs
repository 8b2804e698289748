//! The joints of a figure, from its skeleton in several poses.

mod bends;
mod centers;
mod chains;
mod reduced;
mod symmetry;
#[cfg(test)]
mod tests;
mod within;

use nalgebra::DMatrix;

use self::bends::{Bend, bends};
use self::centers::centers;
use self::chains::{Chain, chains};
pub use self::reduced::joint_skeleton;
use self::symmetry::images;
pub use self::within::trim_to_surface;
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::rigs::skeleton::Skeleton;

/// What counts as a joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointOptions {
    /// Directions are those of chords of this share of the skeleton's greatest extent; 0 for single bones.
    pub window: f64,
    /// Joints are at least so many windows away from the ends of limbs, whose directions are uncertain.
    pub tip: f64,
    /// Joints on branches are at least so many windows away from branch nodes.
    pub fork: f64,
    /// Whether branch nodes may be joints.
    pub at_forks: bool,
    /// Put joints around a part that does not bend where the axes of its limbs meet over the poses, not on
    /// the curve.
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
            window: 0.08,
            tip: 2.5,
            fork: 0.5,
            at_forks: false,
            is_centered: true,
            min_angle: 25.0,
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

    /// The place on its bone.
    pub fn on_curve(&self, skeleton: &Skeleton) -> Vec3 {
        let end = skeleton.positions()[self.bone];
        let start = skeleton.parents()[self.bone].map_or(end, |it| skeleton.positions()[it]);
        start.lerp(&end, self.share)
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
        chosen.iter().map(|it| joint(skeleton, &chains, it, options)).collect();
    if options.is_centered && window > 0.0 {
        for (joint, position) in joints.iter_mut().zip(centers(&chains, &chosen, window)) {
            joint.position = position;
        }
    }
    if options.is_symmetric {
        add_images(skeleton, &mut joints, options);
    }
    joints.sort_by(|a, b| a.bone.cmp(&b.bone).then(a.share.total_cmp(&b.share)));
    Ok(joints)
}

/// Adds the images of joints on limbs that are like their own, where no joint is known yet; sorted by bones.
pub fn add_images(skeleton: &Skeleton, joints: &mut Vec<Joint>, options: &JointOptions) {
    if joints.is_empty() {
        return;
    }
    let extent = extent(skeleton.positions());
    let least = (options.separation * options.window * extent).max(1e-9 * extent);
    let is_new = |known: &[Joint], it: &Joint| {
        known.iter().all(|own| (own.position - it.position).norm() > least)
    };
    for image in images(skeleton, joints, options.symmetry_rating) {
        if is_new(joints, &image) {
            joints.push(image);
        }
    }
    joints.sort_by(|a, b| a.bone.cmp(&b.bone).then(a.share.total_cmp(&b.share)));
}

fn extent(points: &[Vec3]) -> f64 {
    let (low, high) =
        points.iter().fold((points[0], points[0]), |(l, h), it| (l.inf(it), h.sup(it)));
    (high - low).max()
}

/// Whether a bend is far enough from the ends of its chain.
fn is_clear(chains: &[Chain], bend: &Bend, window: f64, options: &JointOptions) -> bool {
    let chain = &chains[bend.chain];
    let is_first = |it: &&Chain| it.before == chain.before && it.joints[0] == chain.joints[0];
    let starts_at_fork = chain.before.is_some() || chains.iter().filter(is_first).count() > 1;
    let ends_at_fork = chains.iter().any(|it| it.before == Some(bend.chain));
    let least = |is_fork: bool| window * if is_fork { options.fork } else { options.tip };
    let way = chain.ways[bend.sample];
    let is_clear_of_start = match bend.sample {
        0 => starts_at_fork && options.at_forks,
        _ => way >= least(starts_at_fork),
    };
    let is_clear_of_end = match bend.sample + 1 == chain.ways.len() {
        true => ends_at_fork && options.at_forks,
        false => chain.length() - way >= least(ends_at_fork),
    };
    is_clear_of_start && is_clear_of_end
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
    order.retain(|it| is_clear(chains, it.1, window, options));
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
        let is_slope = seen.iter().any(is_beside);
        seen.push(bend);
        if !is_slope && !chosen.iter().any(is_near) {
            chosen.push(bend);
        }
    }
    chosen
}

fn joint(skeleton: &Skeleton, chains: &[Chain], bend: &Bend, options: &JointOptions) -> Joint {
    let chain = &chains[bend.chain];
    let place = chain.ways[bend.sample];
    let (bone, share) = bone_at(skeleton, chain, place);
    let mut joint = Joint {
        bone,
        share,
        position: chain.rest[bend.sample],
        angle: 0.0,
        n_freedoms: 0,
        axis: Vec3::zeros(),
        spreads: [0.0; 3],
        is_mirrored: false,
    };
    swing_of(&mut joint, &bend.turns, [options.min_spread, options.spread_share]);
    joint
}

/// Tells of a joint how it turns: rotation vectors in radians, one a pose. A freedom turns by more than an
/// angle in degrees and than a share of the first one.
pub fn swing_of(joint: &mut Joint, turns: &[Vec3], [min_spread, spread_share]: [f64; 2]) {
    let (spreads, axis) = freedoms(turns);
    let least = min_spread.max(spread_share * spreads[0]);
    joint.angle = turns.iter().map(|it| it.norm()).fold(0.0, f64::max).to_degrees();
    joint.n_freedoms = spreads.iter().filter(|it| **it > least).count();
    (joint.spreads, joint.axis) = (spreads, axis);
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
    if turns.is_empty() {
        return ([0.0; 3], Vec3::zeros());
    }
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
