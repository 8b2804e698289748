//! Joints all along a skeleton, to begin with where curves do not tell enough of them.

use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::matching::find_joints::Joint;
use crate::kernels::rigs::skeleton::Skeleton;

/// No joint is put nearer to the end of a limb than this share of the extent.
const TIP: f64 = 0.1;

/// Joints nearer to each other than this share of the spacing are one.
const CLEAR: f64 = 0.6;

/// The joints, and others at every `spacing` of the extent along the branches.
pub fn seeded(skeleton: &Skeleton, joints: &[Joint], spacing: f64, extent: f64) -> Vec<Joint> {
    let step = spacing * extent;
    let mut all = joints.to_vec();
    for (joint, far_end) in places(skeleton, step) {
        let is_clear = |it: &Joint| (it.position - joint.position).norm() > CLEAR * step;
        if far_end > TIP * extent && all.iter().all(is_clear) {
            all.push(joint);
        }
    }
    all.sort_by(|a, b| a.bone.cmp(&b.bone).then(a.share.total_cmp(&b.share)));
    all
}

/// Places one step apart along every branch, each with the way to the farthest end behind it. The first is
/// half a step from the branch's start.
fn places(skeleton: &Skeleton, step: f64) -> Vec<(Joint, f64)> {
    let (positions, parents) = (skeleton.positions(), skeleton.parents());
    let children = skeleton.children();
    let length = |joint: usize, parent: usize| (positions[joint] - positions[parent]).norm();
    let mut behind = vec![0.0_f64; positions.len()];
    for joint in (0..positions.len()).rev() {
        if let Some(parent) = parents[joint] {
            behind[parent] = behind[parent].max(behind[joint] + length(joint, parent));
        }
    }
    let mut way = vec![0.0; positions.len()];
    let mut found = Vec::new();
    for (bone, parent) in parents.iter().enumerate() {
        let Some(parent) = *parent else { continue };
        let (start, length) = (positions[parent], length(bone, parent));
        let from = if children[parent].len() == 1 { way[parent] } else { 0.5 * step };
        way[bone] = from + length;
        let first = (from / step).floor() as usize + 1;
        let last = (way[bone] / step).floor() as usize;
        for index in first..=last {
            let share = (index as f64 * step - from) / length;
            let position = start + (positions[bone] - start) * share;
            found.push((unknown(bone, share, position), behind[bone] + length * (1.0 - share)));
        }
    }
    found
}

/// A joint of which nothing but its place is known.
pub fn unknown(bone: usize, share: f64, position: Vec3) -> Joint {
    Joint {
        bone,
        share,
        position,
        angle: 0.0,
        n_freedoms: 0,
        axis: Vec3::zeros(),
        spreads: [0.0; 3],
        is_mirrored: false,
    }
}
