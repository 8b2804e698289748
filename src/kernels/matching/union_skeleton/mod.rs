//! One skeleton for many poses of a figure.

mod hubs;
mod merge;
#[cfg(test)]
mod tests;
mod tree;

use nalgebra::Matrix3;

use self::hubs::with_hubs;
use self::merge::merge;
use self::tree::UnionTree;
use super::skeleton_match::{
    MatchError, MatchOptions, Partial, SecondRating, SkeletonGraph, SkeletonMatch, match_skeletons,
};
use crate::kernels::geometry::kabsch::{best_rotation, shortest_arc};
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::rigs::clip::Clip;
use crate::kernels::rigs::skeleton::Skeleton;

pub use self::tree::point_at;

/// How skeletons are united.
#[derive(Debug, Clone, PartialEq)]
pub struct UnionOptions {
    /// How skeletons are matched.
    pub matching: MatchOptions,
    /// Nodes are the same that are closer than this share of a bone.
    pub threshold: f64,
    /// Branch nodes are one whose way to each other is shorter than this share of the longest way through
    /// the skeleton.
    pub hub: f64,
    /// The pose of the union's rest; the straightest one without.
    pub reference: Option<usize>,
}

impl Default for UnionOptions {
    fn default() -> Self {
        // One figure: how limbs leave the trunk tells them apart better than lengths, which are alike left and
        // right, and than places, which poses change.
        let matching = MatchOptions {
            partial: Partial::Always,
            second_rating: SecondRating::Directions,
            tolerance: 0.1,
            n_kept: 10,
            ..Default::default()
        };
        Self { matching, threshold: 0.25, hub: 0.08, reference: None }
    }
}

/// A skeleton with the places of its joints in many poses.
#[derive(Debug, Clone, PartialEq)]
pub struct Union {
    /// In the reference pose.
    pub skeleton: Skeleton,
    pub reference: usize,
    /// Poses x joints.
    pub places: Vec<Vec<Vec3>>,
    /// Poses x joints: whether the skeleton of the pose has the branch that the joint lies on.
    pub is_observed: Vec<Vec<bool>>,
    /// In how many poses the skeleton has a joint at the joint's place.
    pub counts: Vec<usize>,
    /// How every pose matched the union when it was merged, and where it stood nearest; nothing for the
    /// first one.
    pub ratings: Vec<Option<([f64; 2], usize)>>,
}

/// Why skeletons cannot be united.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum UnionError {
    #[error("there are no skeletons")]
    Nothing,
    #[error("the reference is pose {reference}, but there are {n_poses}, from 0")]
    Reference { reference: usize, n_poses: usize },
    #[error("pose {pose} cannot be matched: {why}")]
    Match { pose: usize, why: MatchError },
    #[error("pose {pose} does not match the others")]
    Unmatched { pose: usize },
}

/// How many poses a skeleton is compared with before it is merged.
const MOST_COMPARED: usize = 8;

/// Unites skeletons of one figure in several poses (Madaras et al. 2014, section 4.2, corrected).
///
/// From the skeleton of the fewest joints on, each is matched with the union in the pose that suits it
/// best and merged: joints at like shares of matched branches are one, others are new, unmatched limbs
/// are grafted on. Then every joint gets a place in every pose, at the same share of the branch's line
/// there; limbs that a pose does not show are brought from another.
///
/// # Errors
/// See [`UnionError`].
pub fn union_skeleton(poses: &[&Skeleton], options: &UnionOptions) -> Result<Union, UnionError> {
    let n_poses = poses.len();
    if let Some(reference) = options.reference.filter(|&it| it >= n_poses) {
        return Err(UnionError::Reference { reference, n_poses });
    }
    let poses: Vec<Skeleton> = poses.iter().map(|it| with_hubs(it, options.hub)).collect();
    let mut order: Vec<usize> = (0..n_poses).collect();
    order.sort_by_key(|&it| poses[it].n_joints());
    let Some((&first, rest)) = order.split_first() else { return Err(UnionError::Nothing) };
    let mut tree = UnionTree::new(&poses[first], first);
    let mut ratings = vec![None; n_poses];
    for &pose in rest {
        let (matched, near) = best_match(&tree, &poses[pose], pose, &options.matching)?;
        ratings[pose] = Some((matched.ratings(), near));
        merge(&mut tree, &poses[pose], pose, &matched, options.threshold);
    }
    Ok(finish(&tree, ratings, options.reference))
}

/// The best match of the union, in any of its poses, with a skeleton, and that pose.
fn best_match(
    tree: &UnionTree,
    skeleton: &Skeleton,
    pose: usize,
    options: &MatchOptions,
) -> Result<(SkeletonMatch, usize), UnionError> {
    let mut graph = SkeletonGraph::from(skeleton);
    graph.roots.clear();
    let mut best: Option<(SkeletonMatch, usize)> = None;
    let n_tried = tree.pose_indices().count().min(MOST_COMPARED);
    for (order, index) in tree.pose_indices().enumerate().take(n_tried) {
        let own = tree.graph(tree.places(order).places);
        let ranking = match_skeletons(&own, &graph, options)
            .map_err(|why| UnionError::Match { pose, why })?;
        let Some(found) = ranking.matches.into_iter().next() else { continue };
        let sum = |it: &SkeletonMatch| it.ratings()[0] + it.ratings()[1];
        if best.as_ref().is_none_or(|it| sum(&found) < sum(&it.0)) {
            best = Some((found, index));
        }
    }
    best.ok_or(UnionError::Unmatched { pose })
}

fn finish(
    tree: &UnionTree,
    ratings: Vec<Option<([f64; 2], usize)>>,
    reference: Option<usize>,
) -> Union {
    let order = depth_first(tree);
    let n_poses = ratings.len();
    let mut places = vec![Vec::new(); n_poses];
    let mut is_observed = vec![Vec::new(); n_poses];
    for (merged, pose) in tree.pose_indices().enumerate() {
        let all = tree.places(merged);
        places[pose] = order.iter().map(|it| all.places[it.0 as usize]).collect();
        is_observed[pose] = order.iter().map(|it| all.is_observed[it.0 as usize]).collect();
    }
    let n_digits = order.len().saturating_sub(1).to_string().len();
    let names = (0..order.len()).map(|it| format!("node_{it:0n_digits$}")).collect();
    let parents: Vec<Option<usize>> = order.iter().map(|it| it.1).collect();
    let reference = reference.unwrap_or_else(|| straightest(&parents, &places));
    let skeleton = Skeleton::new(names, parents, places[reference].clone())
        .expect("a forest in depth-first order with finite places");
    let counts = order.iter().map(|it| tree.counts[it.0 as usize]).collect();
    Union { skeleton, reference, places, is_observed, counts, ratings }
}

/// All nodes with the indices of their parents, parents first.
fn depth_first(tree: &UnionTree) -> Vec<(u32, Option<usize>)> {
    let mut order: Vec<(u32, Option<usize>)> = Vec::new();
    let mut is_seen = vec![false; tree.n_nodes()];
    for &root in &tree.roots {
        let mut stack = vec![(root, None)];
        while let Some((node, parent)) = stack.pop() {
            if std::mem::replace(&mut is_seen[node as usize], true) {
                continue;
            }
            let joint = order.len();
            order.push((node, parent));
            let mut next: Vec<u32> = tree.neighbors[node as usize].iter().map(|it| it.0).collect();
            next.retain(|it| !is_seen[*it as usize]);
            next.sort_unstable_by(|a, b| b.cmp(a));
            stack.extend(next.into_iter().map(|it| (it, Some(joint))));
        }
    }
    order
}

/// The pose in which ways from branch nodes to branch nodes and leaves are the most direct.
fn straightest(parents: &[Option<usize>], places: &[Vec<Vec3>]) -> usize {
    let mut n_children = vec![0; parents.len()];
    parents.iter().flatten().for_each(|&it| n_children[it] += 1);
    let directness = |places: &Vec<Vec3>| {
        let (mut direct, mut along) = (0.0, 0.0);
        let mut starts: Vec<usize> = (0..parents.len()).collect();
        for (joint, parent) in parents.iter().enumerate() {
            let Some(parent) = *parent else { continue };
            let is_start = n_children[parent] != 1 || parents[parent].is_none();
            starts[joint] = if is_start { parent } else { starts[parent] };
            along += (places[joint] - places[parent]).norm();
            if n_children[joint] != 1 {
                direct += (places[joint] - places[starts[joint]]).norm();
            }
        }
        if along > 0.0 { direct / along } else { 1.0 }
    };
    let values: Vec<f64> = places.iter().map(directness).collect();
    let better = |best: usize, it: usize| if values[it] > values[best] { it } else { best };
    (0..values.len()).fold(0, better)
}

/// A clip in which a skeleton's joints are at given places, a frame for every list of places.
///
/// Every joint turns from its parent's orientation the smallest way that brings the bones to its
/// children where they have to be (of several children, as they fit best); how bones twist is not in
/// their places.
pub fn clip_of_places(skeleton: &Skeleton, frames: &[Vec<Vec3>], name: &str) -> Clip {
    let (rest, parents, children) = (skeleton.positions(), skeleton.parents(), skeleton.children());
    let (mut rotations, mut translations) = (Vec::new(), Vec::new());
    for places in frames {
        let mut world: Vec<nalgebra::UnitQuaternion<f64>> = Vec::with_capacity(rest.len());
        for joint in 0..rest.len() {
            let above = parents[joint].map_or_else(Default::default, |it| world[it]);
            let pairs = children[joint].iter().map(|&it| {
                let from: Vec3 = above * (rest[it] - rest[joint]);
                (from, places[it] - places[joint])
            });
            let turn = match children[joint].len() {
                1 => pairs
                    .clone()
                    .next()
                    .map_or_else(Default::default, |it| shortest_arc(it.0, it.1)),
                _ => best_rotation(&pairs.map(|(a, b)| b * a.transpose()).sum::<Matrix3<f64>>()),
            };
            let own = turn * above;
            world.push(own);
            rotations.push(above.inverse() * own);
            let offset = parents[joint].map_or(places[joint], |it| places[joint] - places[it]);
            translations.push(above.inverse() * offset);
        }
    }
    let n_joints = rest.len();
    Clip { name: name.to_owned(), frames_per_second: 1.0, n_joints, rotations, translations }
}
