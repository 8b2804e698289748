//! Which bones of a skeleton follow which of another one that it is matched with.

mod stretch;
#[cfg(test)]
mod tests;

use std::collections::VecDeque;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use self::stretch::places_along;
use self::stretch::{Stretch, insert};
use super::skeleton_match::SkeletonMatch;
use crate::kernels::curve_skeletons::growing_skeleton::GrowingSkeleton;
use crate::kernels::rigs::segment_map::{Segment, SegmentMap};
use crate::kernels::rigs::skeleton::Skeleton;

/// How bones are mapped.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapSegmentsOptions {
    pub insertion: Insertion,
    pub assignment: Assignment,
    /// Places along a branch of length 1 that are closer than this are the same.
    pub threshold: f64,
    /// Give the target its root where the source has it.
    pub move_root: bool,
}

/// Where the target gets new joints.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Insertion {
    /// At every joint of the source that the target has none at: bones bend where the source's do.
    #[default]
    Joints,
    /// Only at the end of a source's bone that no bone of the target would follow.
    Empty,
    /// In the middle of all bones of a branch, again and again until a bone follows each of the source's.
    Midpoints,
    /// Nowhere.
    Never,
}

/// Which bone of the source is followed by a bone of the target that follows parts of several.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Assignment {
    /// The one its end lies on.
    #[default]
    End,
    /// The one whose end is nearest to its own.
    Nearest,
}

impl Default for MapSegmentsOptions {
    fn default() -> Self {
        Self {
            insertion: Insertion::default(),
            assignment: Assignment::default(),
            threshold: 1e-6,
            move_root: true,
        }
    }
}

/// A map of bones with the skeleton it belongs to.
#[derive(Debug, Clone, PartialEq)]
pub struct MappedSegments {
    pub map: SegmentMap,
    /// The target with its new joints; joints that it had keep their names.
    pub target: Skeleton,
    pub n_inserted: usize,
    /// Bones of the source on matched branches that no bone of the target follows.
    pub n_empty: usize,
    /// Whether a root of the target has moved.
    pub is_root_moved: bool,
}

/// Why bones cannot be mapped.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum MapSegmentsError {
    #[error("the match is of a {whose} with {matched} joints, but the {whose} has {found}")]
    Counts { whose: &'static str, matched: usize, found: usize },
    #[error("the match goes along `{from}` and `{to}` of the {whose}, which no bone joins")]
    NoBone { whose: &'static str, from: String, to: String },
}

/// Gives every bone of a matched branch of the target the bone of the source at the same share of the
/// branch's length (Madaras et al. 2014, algorithm 6, corrected: no bone is left out).
///
/// What is not matched follows its parent. The target gets its root where the source has its own, so
/// that both lead the same way, and new joints as `options.insertion` says.
///
/// # Errors
/// See [`MapSegmentsError`].
pub fn map_segments(
    source: &Skeleton,
    target: &Skeleton,
    matched: &SkeletonMatch,
    options: &MapSegmentsOptions,
) -> Result<MappedSegments, MapSegmentsError> {
    check(source, target, matched)?;
    let mut grown = GrowingSkeleton::new(target);
    let (mut stretches, tops) = stretches(source, matched, &mut grown, options.threshold);
    let mut n_empty = 0;
    for stretch in &mut stretches {
        insert(stretch, &mut grown, options);
        n_empty += stretch.empty(options).len();
    }
    // For every node of the target what it follows, and the node before it on its stretch.
    let mut followed: Vec<Option<(Segment, Option<u32>)>> = vec![None; grown.n_nodes()];
    for stretch in &stretches {
        stretch.follow(options, &mut followed);
    }
    let mut roots: Vec<u32> = Vec::new();
    for root in (0..source.n_joints() as u32).filter(|&it| source.parents()[it as usize].is_none())
    {
        let Some(place) = place_of_root(source, root, matched, &tops) else { continue };
        if options.move_root {
            roots.push(place);
        }
        let whole = Segment { source: root, from: 0.0, to: 1.0 };
        followed[place as usize].get_or_insert((whole, None));
    }
    let built = grown.build(&roots);
    // A bone that leads against the source's cannot follow it.
    let segment = |(&node, parent): (&u32, &Option<usize>)| {
        let parent = parent.map(|it| built.node_of_joint[it]);
        followed[node as usize].filter(|it| it.1 == parent).map(|it| it.0)
    };
    let joints = built.node_of_joint.iter().zip(built.skeleton.parents());
    let segments = joints.map(segment).collect();
    let map = SegmentMap::new(source.n_joints(), segments).expect("spans are cut to 0..=1");
    let n_inserted = built.skeleton.n_joints() - target.n_joints();
    let own_roots = |it: &Skeleton| -> Vec<String> {
        let names = it.names().iter().zip(it.parents());
        let mut roots: Vec<String> =
            names.filter(|it| it.1.is_none()).map(|it| it.0.clone()).collect();
        roots.sort();
        roots
    };
    let is_root_moved = own_roots(target) != own_roots(&built.skeleton);
    Ok(MappedSegments { map, target: built.skeleton, n_inserted, n_empty, is_root_moved })
}

fn check(
    source: &Skeleton,
    target: &Skeleton,
    matched: &SkeletonMatch,
) -> Result<(), MapSegmentsError> {
    let sides = [(source, "source", matched.n_source()), (target, "target", matched.n_target())];
    for (side, (skeleton, whose, n_matched)) in sides.into_iter().enumerate() {
        let found = skeleton.n_joints();
        if found != n_matched {
            return Err(MapSegmentsError::Counts { whose, matched: n_matched, found });
        }
        let parents = skeleton.parents();
        for branch in matched.branches() {
            let nodes = if side == 0 { &branch.source } else { &branch.target };
            for pair in nodes.windows(2) {
                let [a, b] = [pair[0] as usize, pair[1] as usize];
                if parents[a] != Some(b) && parents[b] != Some(a) {
                    let name = |it: usize| skeleton.names()[it].clone();
                    return Err(MapSegmentsError::NoBone { whose, from: name(a), to: name(b) });
                }
            }
        }
    }
    Ok(())
}

/// Cuts matched branches where the source's lead away to both sides: at its root, or where a way from
/// the root meets them. Returns the places of the cuts, too: source and target.
fn stretches(
    source: &Skeleton,
    matched: &SkeletonMatch,
    grown: &mut GrowingSkeleton,
    threshold: f64,
) -> (Vec<Stretch>, Vec<[u32; 2]>) {
    let (mut stretches, mut tops) = (Vec::new(), Vec::new());
    for branch in matched.branches() {
        let (joints, nodes) = (&branch.source, &branch.target);
        let mut whole = Stretch::new(source, joints.clone(), nodes.clone(), grown);
        let is_top = |it: &usize| {
            let parent = source.parents()[joints[*it] as usize].map(|it| it as u32);
            parent != Some(joints[it - 1]) && parent != Some(joints[it + 1])
        };
        let Some(cut) = (1..joints.len() - 1).find(is_top) else {
            stretches.push(whole);
            continue;
        };
        let at = whole.insert_at(whole.source_places[cut], grown, threshold);
        tops.push([joints[cut], whole.target[at]]);
        let back = |nodes: &[u32]| -> Vec<u32> { nodes.iter().rev().copied().collect() };
        for (joints, nodes) in [
            (back(&joints[..=cut]), back(&whole.target[..=at])),
            (joints[cut..].to_vec(), whole.target[at..].to_vec()),
        ] {
            stretches.push(Stretch::new(source, joints, nodes, grown));
        }
    }
    (stretches, tops)
}

/// The target's node that belongs to a root of the source, or to the first matched joint below it.
fn place_of_root(
    source: &Skeleton,
    root: u32,
    matched: &SkeletonMatch,
    tops: &[[u32; 2]],
) -> Option<u32> {
    let children = source.children();
    let mut queue = VecDeque::from([root]);
    while let Some(joint) = queue.pop_front() {
        let top = tops.iter().find(|it| it[0] == joint).map(|it| it[1]);
        if let Some(node) = matched.target_of(joint).or(top) {
            return Some(node);
        }
        queue.extend(children[joint as usize].iter().map(|&it| it as u32));
    }
    None
}
