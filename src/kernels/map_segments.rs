//! Which bones of a skeleton follow which of another one that it is matched with.

use std::collections::VecDeque;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::growing_skeleton::GrowingSkeleton;
use super::mesh::Vec3;
use super::segment_map::{Segment, SegmentMap};
use super::skeleton::Skeleton;
use super::skeleton_match::SkeletonMatch;

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

/// The most rounds of [`Insertion::Midpoints`].
const MOST_ROUNDS: usize = 10;

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

/// A part of a matched branch that leads away from the source's root: joints of the source, and nodes of
/// the target with their places from 0 to 1.
struct Stretch {
    source: Vec<u32>,
    source_places: Vec<f64>,
    target: Vec<u32>,
    target_places: Vec<f64>,
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

impl Stretch {
    fn new(source: &Skeleton, joints: Vec<u32>, target: Vec<u32>, grown: &GrowingSkeleton) -> Self {
        let source_points: Vec<Vec3> =
            joints.iter().map(|&it| source.positions()[it as usize]).collect();
        let target_points: Vec<Vec3> = target.iter().map(|&it| grown.position(it)).collect();
        Self {
            source: joints,
            source_places: places_along(&source_points),
            target,
            target_places: places_along(&target_points),
        }
    }

    /// The index of the target's node at a place; a new one if none is near.
    fn insert_at(&mut self, place: f64, grown: &mut GrowingSkeleton, threshold: f64) -> usize {
        let is_near = |it: &f64| (it - place).abs() <= threshold;
        if let Some(index) = self.target_places.iter().position(is_near) {
            return index;
        }
        let next = self.target_places.partition_point(|&it| it < place);
        let [from, to] = [self.target_places[next - 1], self.target_places[next]];
        let share = (place - from) / (to - from);
        let node = grown.insert(self.target[next - 1], self.target[next], share);
        self.target.insert(next, node);
        self.target_places.insert(next, place);
        next
    }

    /// The bone of the source, from 1, for every bone of the target.
    fn bones(&self, options: &MapSegmentsOptions) -> Vec<usize> {
        let places = &self.source_places;
        let last = places.len() - 1;
        let end = |bone: usize| match options.assignment {
            _ if bone == last => f64::INFINITY,
            Assignment::End => places[bone],
            Assignment::Nearest => (places[bone] + places[bone + 1]) / 2.0,
        };
        let mut bone = 1;
        let mut res = Vec::with_capacity(self.target.len() - 1);
        for &place in &self.target_places[1..] {
            while place > end(bone) + options.threshold {
                bone += 1;
            }
            res.push(bone);
        }
        // The ends belong together, also where several joints are in one place.
        if let Some(it) = res.last_mut() {
            *it = last;
        }
        res
    }

    /// Writes down what the bones follow, and the nodes that they begin at.
    fn follow(
        &self,
        options: &MapSegmentsOptions,
        followed: &mut [Option<(Segment, Option<u32>)>],
    ) {
        for (index, bone) in self.bones(options).into_iter().enumerate() {
            let [from, to] = [self.source_places[bone - 1], self.source_places[bone]];
            let share = |place: f64| match to > from {
                true => ((place - from) / (to - from)).clamp(0.0, 1.0),
                false => 0.0,
            };
            let [from, to] = [index, index + 1].map(|it| share(self.target_places[it]));
            let segment = Segment { source: self.source[bone], from, to };
            followed[self.target[index + 1] as usize] = Some((segment, Some(self.target[index])));
        }
    }

    /// Bones of the source that none of the target follows.
    fn empty(&self, options: &MapSegmentsOptions) -> Vec<usize> {
        let bones = self.bones(options);
        (1..self.source.len()).filter(|it| !bones.contains(it)).collect()
    }
}

/// The share of a line's length before each of its points; of its points if it has no length.
pub fn places_along(points: &[Vec3]) -> Vec<f64> {
    let mut places = vec![0.0];
    for pair in points.windows(2) {
        places.push(places[places.len() - 1] + (pair[1] - pair[0]).norm());
    }
    let last = points.len().saturating_sub(1);
    let total = places[last];
    for (index, place) in places.iter_mut().enumerate() {
        *place = match total > 0.0 {
            true => *place / total,
            false => index as f64 / last.max(1) as f64,
        };
    }
    places[last] = if last == 0 { 0.0 } else { 1.0 };
    places
}

fn insert(stretch: &mut Stretch, grown: &mut GrowingSkeleton, options: &MapSegmentsOptions) {
    let last = stretch.source.len() - 1;
    match options.insertion {
        Insertion::Never => {}
        Insertion::Joints => {
            for place in stretch.source_places[1..last].to_vec() {
                stretch.insert_at(place, grown, options.threshold);
            }
        }
        Insertion::Empty => {
            for bone in stretch.empty(options) {
                stretch.insert_at(stretch.source_places[bone], grown, options.threshold);
            }
        }
        Insertion::Midpoints => {
            for _ in 0..MOST_ROUNDS {
                if stretch.empty(options).is_empty() {
                    break;
                }
                for pair in stretch.target_places.clone().windows(2) {
                    stretch.insert_at((pair[0] + pair[1]) / 2.0, grown, 0.0);
                }
            }
        }
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::skeleton_match::{MatchOptions, SkeletonGraph, match_skeletons};

    /// A chain along x with joints at these places; the root is the joint of index `root`.
    fn chain(places: &[f64], root: usize) -> Skeleton {
        let order: Vec<usize> = (root..places.len()).chain((0..root).rev()).collect();
        let joint = |place: usize| order.iter().position(|&it| it == place).unwrap();
        let parent = |&place: &usize| match place.cmp(&root) {
            std::cmp::Ordering::Equal => None,
            std::cmp::Ordering::Less => Some(joint(place + 1)),
            std::cmp::Ordering::Greater => Some(joint(place - 1)),
        };
        let names = order.iter().map(|it| format!("j{it}")).collect();
        let positions = order.iter().map(|&it| Vec3::x() * places[it]).collect();
        Skeleton::new(names, order.iter().map(parent).collect(), positions).unwrap()
    }

    fn even(n_bones: usize) -> Skeleton {
        let places: Vec<f64> = (0..=n_bones).map(|it| it as f64 / n_bones as f64).collect();
        chain(&places, 0)
    }

    fn mapped(
        source: &Skeleton,
        target: &Skeleton,
        options: &MapSegmentsOptions,
    ) -> MappedSegments {
        let graphs = [source, target].map(SkeletonGraph::from);
        let ranking = match_skeletons(&graphs[0], &graphs[1], &MatchOptions::default()).unwrap();
        map_segments(source, target, &ranking.matches[0], options).unwrap()
    }

    /// The names of the source's joints that the target's follow, by the target's names.
    fn followed(source: &Skeleton, it: &MappedSegments) -> Vec<(String, String)> {
        let name = |it: &Option<Segment>| match it {
            Some(it) => source.names()[it.source as usize].clone(),
            None => "-".to_owned(),
        };
        let mut names: Vec<(String, String)> =
            it.target.names().iter().cloned().zip(it.map.segments().iter().map(name)).collect();
        names.sort();
        names
    }

    #[test]
    fn equal_skeletons_follow_themselves() {
        for skeleton in [even(4), chain(&[0.0, 0.1, 0.5, 0.9, 1.0], 2)] {
            for insertion in [Insertion::Joints, Insertion::Empty, Insertion::Midpoints] {
                let options = MapSegmentsOptions { insertion, ..Default::default() };
                let res = mapped(&skeleton, &skeleton, &options);
                assert_eq!((&res.target, res.n_inserted, res.n_empty), (&skeleton, 0, 0));
                for (joint, it) in res.map.segments().iter().enumerate() {
                    let whole = Segment { source: joint as u32, from: 0.0, to: 1.0 };
                    let it = it.unwrap();
                    assert_eq!(it.source, whole.source);
                    assert!(it.from < 1e-9 && it.to > 1.0 - 1e-9);
                }
            }
        }
    }

    #[test]
    fn two_bones_are_followed_by_three_each_of_six() {
        for assignment in [Assignment::End, Assignment::Nearest] {
            let options = MapSegmentsOptions { assignment, ..Default::default() };
            let res = mapped(&even(2), &even(6), &options);
            let found: Vec<String> = followed(&even(2), &res).into_iter().map(|it| it.1).collect();
            let expected = match assignment {
                Assignment::End => ["j0", "j1", "j1", "j1", "j2", "j2", "j2"],
                // The place 4/6 is nearer to the middle than to the end.
                Assignment::Nearest => ["j0", "j1", "j1", "j1", "j1", "j2", "j2"],
            };
            assert_eq!((res.n_inserted, found), (0, expected.map(str::to_owned).to_vec()));
        }
        let spans = mapped(&even(2), &even(6), &MapSegmentsOptions::default());
        let it = spans.map.segments()[2].unwrap();
        assert!((it.from - 1.0 / 3.0).abs() < 1e-9 && (it.to - 2.0 / 3.0).abs() < 1e-9);
    }

    #[test]
    fn one_bone_is_parted_twice_to_follow_four() {
        for insertion in [Insertion::Midpoints, Insertion::Empty, Insertion::Joints] {
            let options = MapSegmentsOptions { insertion, ..Default::default() };
            let res = mapped(&even(4), &even(1), &options);
            assert_eq!((res.n_inserted, res.n_empty), (3, 0));
            let places: Vec<f64> = res.target.positions().iter().map(|it| it.x).collect();
            assert_eq!(places, [0.0, 0.25, 0.5, 0.75, 1.0]);
            let source: Vec<u32> = res.map.segments().iter().map(|it| it.unwrap().source).collect();
            assert_eq!(source, [0, 1, 2, 3, 4]);
            assert_eq!(res.target.names()[4], "j1", "old joints keep their names");
        }
        let options = MapSegmentsOptions { insertion: Insertion::Never, ..Default::default() };
        assert_eq!(mapped(&even(4), &even(1), &options).n_empty, 3);
    }

    #[test]
    fn the_target_gets_the_roots_place() {
        let source = chain(&[0.0, 0.3, 0.6, 1.0], 1);
        let target = chain(&[0.0, 0.5, 1.0], 0);
        let res = mapped(&source, &target, &MapSegmentsOptions::default());
        let root = res.target.parents().iter().position(Option::is_none).unwrap();
        assert!((res.target.positions()[root].x - 0.3).abs() < 1e-9 && res.is_root_moved);
        assert!(res.map.segments().iter().all(Option::is_some));
        assert_eq!(res.target.n_joints(), 5);
        // Where the target keeps its root, the bones between the roots follow nothing.
        let options = MapSegmentsOptions { move_root: false, ..Default::default() };
        let kept = mapped(&source, &target, &options);
        let found = followed(&source, &kept);
        assert_eq!(kept.target.names()[0], "j0");
        let nothing: Vec<&str> =
            found.iter().filter(|it| it.1 == "-").map(|it| it.0.as_str()).collect();
        assert_eq!(nothing, ["j0", "j1.1"]);
    }

    #[test]
    fn what_is_not_matched_follows_nothing() {
        let names = |n: usize| (0..n).map(|it| format!("j{it}")).collect::<Vec<_>>();
        let points = [[0.0, 0.0], [0.0, 2.0], [2.0, 0.0], [-2.0, 0.0], [0.0, -0.5]];
        let points: Vec<Vec3> = points.iter().map(|it| Vec3::new(it[0], it[1], 0.0)).collect();
        let star = |n: usize| {
            let parents = (0..n).map(|it| (it > 0).then_some(0)).collect();
            Skeleton::new(names(n), parents, points[..n].to_vec()).unwrap()
        };
        let (source, target) = (star(4), star(5));
        let res = mapped(&source, &target, &MapSegmentsOptions::default());
        assert_eq!(res.map.segments()[4], None);
        assert_eq!(res.map.segments().iter().flatten().count(), 4);
        let graphs = [&source, &target].map(SkeletonGraph::from);
        let ranking = match_skeletons(&graphs[0], &graphs[1], &MatchOptions::default()).unwrap();
        let error = map_segments(&target, &target, &ranking.matches[0], &Default::default());
        let expected = "the match is of a source with 4 joints, but the source has 5";
        assert_eq!(error.unwrap_err().to_string(), expected);
    }
}
