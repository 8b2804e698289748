//! The stiff parts that joints cut a skeleton into.

use nalgebra::{Isometry3, Matrix3, Point3, Translation3};

use crate::kernels::geometry::kabsch::{best_rotation, shortest_arc};
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::matching::find_joints::Joint;
use crate::kernels::rigs::skeleton::Skeleton;

/// A piece of a bone that belongs to one part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    /// The joint of the skeleton at the bone's end.
    pub bone: usize,
    /// From where to where, in shares of the bone.
    pub shares: [f64; 2],
    pub part: usize,
}

/// A skeleton cut at joints.
#[derive(Debug, Clone, PartialEq)]
pub struct Parts {
    /// For every part the joint that it hangs on; parents come first.
    pub joint_of_part: Vec<Option<usize>>,
    /// For every joint the part before and the one behind it.
    pub sides: Vec<[usize; 2]>,
    pub pieces: Vec<Piece>,
}

impl Parts {
    /// Cuts a skeleton at the places of joints on its bones.
    pub fn new(skeleton: &Skeleton, joints: &[Joint]) -> Self {
        let mut parts =
            Self { joint_of_part: vec![], sides: vec![[0; 2]; joints.len()], pieces: vec![] };
        let mut part_of_node: Vec<usize> = Vec::with_capacity(skeleton.n_joints());
        for (bone, parent) in skeleton.parents().iter().enumerate() {
            let Some(parent) = *parent else {
                part_of_node.push(parts.add(None));
                continue;
            };
            let mut cuts: Vec<usize> =
                (0..joints.len()).filter(|&it| joints[it].bone == bone).collect();
            cuts.sort_by(|&a, &b| joints[a].share.total_cmp(&joints[b].share));
            let (mut part, mut from) = (part_of_node[parent], 0.0);
            for cut in cuts {
                let share = joints[cut].share;
                parts.pieces.push(Piece { bone, shares: [from, share], part });
                let behind = parts.add(Some(cut));
                parts.sides[cut] = [part, behind];
                (part, from) = (behind, share);
            }
            parts.pieces.push(Piece { bone, shares: [from, 1.0], part });
            part_of_node.push(part);
        }
        parts
    }

    fn add(&mut self, joint: Option<usize>) -> usize {
        self.joint_of_part.push(joint);
        self.n_parts() - 1
    }

    pub fn n_parts(&self) -> usize {
        self.joint_of_part.len()
    }

    /// The part that a part hangs on.
    pub fn parent(&self, part: usize) -> Option<usize> {
        self.joint_of_part[part].map(|it| self.sides[it][0])
    }
}

/// The place at a share of a bone.
pub fn on_bone(skeleton: &Skeleton, places: &[Vec3], bone: usize, share: f64) -> Vec3 {
    let end = places[bone];
    let start = skeleton.parents()[bone].map_or(end, |it| places[it]);
    start + (end - start) * share
}

/// Pairs of places on the curve of a part, at rest and in a pose, at most a step apart.
pub fn curve_pairs(
    skeleton: &Skeleton,
    parts: &Parts,
    pose: &[Vec3],
    step: f64,
) -> Vec<Vec<(Vec3, Vec3)>> {
    const MOST: f64 = 1000.0;
    let mut pairs = vec![Vec::new(); parts.n_parts()];
    for piece in &parts.pieces {
        let [from, to] = piece.shares;
        let at = |share: f64| {
            [skeleton.positions(), pose].map(|it| on_bone(skeleton, it, piece.bone, share))
        };
        let length = (at(to)[0] - at(from)[0]).norm();
        let n_steps = (length / step).ceil().clamp(1.0, MOST);
        for index in 0..n_steps as usize {
            let [rest, now] = at(from + (to - from) * (index as f64 + 0.5) / n_steps);
            pairs[piece.part].push((rest, now));
        }
    }
    pairs
}

/// Rigid motions of all parts from their curves, parents first.
///
/// How a straight limb rolls is not in its curve; it rolls as its parent does.
pub fn motions_of_curves(parts: &Parts, pairs: &[Vec<(Vec3, Vec3)>]) -> Vec<Isometry3<f64>> {
    /// What the parent's roll counts against the curve's own.
    const ROLL: f64 = 0.05;
    let mut motions: Vec<Isometry3<f64>> = Vec::with_capacity(parts.n_parts());
    for (part, pairs) in pairs.iter().enumerate() {
        let above = parts.parent(part).map_or_else(Isometry3::identity, |it| motions[it]);
        let Some((first, last)) = pairs.first().zip(pairs.last()) else {
            motions.push(above);
            continue;
        };
        let mean =
            |of: fn(&(Vec3, Vec3)) -> Vec3| pairs.iter().map(of).sum::<Vec3>() / pairs.len() as f64;
        let (from, to) = (mean(|it| it.0), mean(|it| it.1));
        let guess = match parts.parent(part) {
            Some(_) => {
                shortest_arc(above.rotation * (last.0 - first.0), last.1 - first.1) * above.rotation
            }
            None => Default::default(),
        };
        let outer = |a: Vec3, b: Vec3| b * a.transpose();
        let own: Matrix3<f64> = pairs.iter().map(|it| outer(it.0 - from, it.1 - to)).sum();
        let turn = guess.to_rotation_matrix().into_inner() * (own.norm().max(1e-30) * ROLL);
        let turn = best_rotation(&(own + turn));
        motions.push(Isometry3::from_parts(Translation3::from(to - turn * from), turn));
    }
    motions
}

/// A motion applied to a place.
pub fn moved(motion: &Isometry3<f64>, place: Vec3) -> Vec3 {
    (motion * Point3::from(place)).coords
}
