//! What is known of parts when joints come, go or move.

use nalgebra::Isometry3;

use super::Drop;
use super::fitted::Fitted;
use super::parts::Parts;
use super::solve::State;
use crate::kernels::geometry::mesh::Vec3;

/// The state with the two parts beside a joint made one.
pub fn without(fitted: &Fitted, drop: Drop) -> State {
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
pub fn reordered(parts: &Parts, moved: &Parts, state: State) -> State {
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
pub fn grown(parts: &Parts, split: &Parts, mut state: State, place: Vec3) -> State {
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
