//! A skeleton of joints, branch nodes and ends only.

use super::Joint;
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::rigs::skeleton::Skeleton;

/// Shares of a bone this near to its ends are at the ends.
const AT_END: f64 = 1e-9;

/// Keeps roots, branch nodes and ends of a skeleton, and puts joints between them; nodes keep their names,
/// joints are called `joint_0` and so on in their order (a free name if that is taken).
pub fn joint_skeleton(skeleton: &Skeleton, joints: &[Joint]) -> Skeleton {
    let children = skeleton.children();
    let n_digits = joints.len().saturating_sub(1).to_string().len();
    let mut names: Vec<String> = Vec::new();
    let mut parents: Vec<Option<usize>> = Vec::new();
    let mut positions: Vec<Vec3> = Vec::new();
    // The new joint that stands for an old one: itself, or the nearest before it.
    let mut last: Vec<usize> = Vec::new();
    for (old, name) in skeleton.names().iter().enumerate() {
        let parent = skeleton.parents()[old];
        let mut before = parent.map(|it| last[it]);
        let mut push = |name: String, position: Vec3, before: Option<usize>| {
            names.push(name);
            parents.push(before);
            positions.push(position);
            names.len() - 1
        };
        let mut at_end = None;
        for (index, joint) in joints.iter().enumerate().filter(|it| it.1.bone == old) {
            let mut title = format!("joint_{index:0n_digits$}");
            while skeleton.joint(&title).is_some() {
                title.push('_');
            }
            if joint.share >= 1.0 - AT_END || parent.is_none() {
                at_end = Some((title, joint.position));
            } else {
                before = Some(push(title, joint.position, before));
            }
        }
        let stays = before.is_none() || children[old].len() != 1;
        let new = match (at_end, before) {
            (Some((title, position)), _) if children[old].len() == 1 => {
                push(title, position, before)
            }
            (_, Some(before)) if !stays => before,
            _ => push(name.clone(), skeleton.positions()[old], before),
        };
        last.push(new);
    }
    Skeleton::new(names, parents, positions).expect("parents come first and names differ")
}
