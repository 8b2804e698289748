//! Cuts moved along the curve to where joints were found.

use super::parts::on_bone;
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::matching::find_joints::Joint;
use crate::kernels::rigs::skeleton::Skeleton;

/// Moves every joint to the place on its branch that is nearest to where it was found; joints of one branch
/// that would change their order, or meet, stay.
pub fn recut(skeleton: &Skeleton, joints: &mut [Joint], found: &[Vec3]) {
    let branches = branches(skeleton);
    // Where a joint is on its branch: the index of its bone, and the share of it.
    let place = |joint: &Joint| {
        let index = branches[joint.bone].iter().position(|&it| it == joint.bone);
        index.expect("a bone is on its own branch") as f64 + joint.share
    };
    let moved: Vec<Joint> = joints
        .iter()
        .zip(found)
        .map(|(joint, found)| {
            let (bone, share) = nearest(skeleton, &branches[joint.bone], *found);
            Joint { bone, share, ..joint.clone() }
        })
        .collect();
    let is_same_branch =
        |a: &Joint, b: &Joint| branches[a.bone].first() == branches[b.bone].first();
    let stays = |index: usize| {
        (0..joints.len()).any(|other| {
            other != index
                && is_same_branch(&joints[index], &joints[other])
                && (place(&joints[index]) < place(&joints[other]))
                    != (place(&moved[index]) + 1e-6 < place(&moved[other]))
        })
    };
    let kept: Vec<bool> = (0..joints.len()).map(stays).collect();
    for ((joint, moved), stays) in joints.iter_mut().zip(moved).zip(kept) {
        if !stays {
            *joint = moved;
        }
    }
}

/// For every bone the bones of its branch, from the root on.
fn branches(skeleton: &Skeleton) -> Vec<Vec<usize>> {
    let (parents, children) = (skeleton.parents(), skeleton.children());
    let first = |bone: usize| {
        let mut bone = bone;
        while let Some(parent) =
            parents[bone].filter(|&it| children[it].len() == 1 && parents[it].is_some())
        {
            bone = parent;
        }
        bone
    };
    let branch = |bone: usize| {
        let mut bones = vec![first(bone)];
        while let [next] = children[bones[bones.len() - 1]][..] {
            bones.push(next);
        }
        bones
    };
    (0..skeleton.n_joints()).map(branch).collect()
}

fn nearest(skeleton: &Skeleton, bones: &[usize], place: Vec3) -> (usize, f64) {
    let mut best = (f64::INFINITY, bones[0], 1.0);
    for &bone in bones {
        let [start, end] = [0.0, 1.0].map(|it| on_bone(skeleton, skeleton.positions(), bone, it));
        let along = end - start;
        let square = along.norm_squared();
        let share =
            if square > 0.0 { ((place - start).dot(&along) / square).clamp(0.0, 1.0) } else { 0.0 };
        let distance = (start + along * share - place).norm();
        if distance < best.0 {
            best = (distance, bone, share);
        }
    }
    (best.1, best.2)
}
