//! A motion for another skeleton, by a map of its bones.

use nalgebra::UnitQuaternion;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::clip_frames::{empty_clip, push_frame, world_frames};
use crate::kernels::geometry::kabsch::shortest_arc;
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::rigs::clip::Clip;
use crate::kernels::rigs::segment_map::{Segment, SegmentMap};
use crate::kernels::rigs::skeleton::Skeleton;

/// Where the root of the target is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RootPath {
    /// As far from its rest place as the source's root is from its own, in the ratio of the lengths of
    /// the bones.
    #[default]
    FromRest,
    /// The same path from its rest place in the first frame on, raised so that the lowest place that a
    /// joint reaches is that of the lowest joint at rest: for motions whose rest pose does not stand on
    /// the floor, and for other proportions.
    Grounded,
}

/// What [`transfer_animation`] does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TransferAnimationOptions {
    /// Whether bones are first turned to the directions that the source's have at rest, so that the
    /// target takes the source's poses; otherwise bones turn from their own rest directions.
    pub align_rest: bool,
    /// Bones shorter than this share of the mean bone are not turned by themselves: where joints nearly
    /// coincide, the direction from one to the other means nothing.
    pub least_bone: f64,
    /// Bones that end within this share of a branch from the branch node where it begins turn with what is
    /// above them, too: pelvises and shoulder girdles differ by their shapes, not by their poses.
    pub fork_share: f64,
    pub root: RootPath,
}

/// The default of `least_bone`.
pub(in crate::kernels) const LEAST_BONE: f64 = 0.15;

impl Default for TransferAnimationOptions {
    fn default() -> Self {
        Self {
            align_rest: true,
            least_bone: LEAST_BONE,
            fork_share: 0.0,
            root: RootPath::default(),
        }
    }
}

/// A clip of the target, and what was found.
#[derive(Debug, Clone, PartialEq)]
pub struct TransferredAnimation {
    pub clip: Clip,
    /// By how much every target bone is turned at rest after the bones above it, in radians.
    pub rest_angles_rad: Vec<f64>,
    /// The length of the target's bones that follow one over the length of what they follow.
    pub scale: f64,
}

/// Why a motion cannot be transferred.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum TransferAnimationError {
    #[error("the clip moves {clip} joints, but the source skeleton has {skeleton}")]
    Clip { clip: usize, skeleton: usize },
    #[error("the map leads to a source of {map} joints, but the source skeleton has {skeleton}")]
    Source { map: usize, skeleton: usize },
    #[error("the map is for {map} target joints, but the target skeleton has {skeleton}")]
    Target { map: usize, skeleton: usize },
    #[error("the clip has no frames")]
    NoFrames,
    #[error("no bone of the target follows one of the source")]
    NothingFollows,
}

/// Moves a skeleton like another one, bone by bone (Madaras et al. 2014, section 5).
///
/// At rest every bone of the target is turned, from the root on, by the shortest arc to the direction
/// of the bone that it follows (unless either is very short); in every frame it then turns in the world as that bone does, twist
/// included. So mapped bones of some length point exactly where the source's do, whatever the rest
/// poses, and keep their own lengths. A joint turns like the bones that begin at it (their mean, by
/// length, if they differ; the offsets then make every place exact), or like the bone that ends at it
/// if none does. Bones that follow nothing are stiff.
///
/// # Errors
/// See [`TransferAnimationError`].
pub fn transfer_animation(
    source: &Skeleton,
    clip: &Clip,
    target: &Skeleton,
    map: &SegmentMap,
    options: &TransferAnimationOptions,
) -> Result<TransferredAnimation, TransferAnimationError> {
    check(source, clip, target, map)?;
    let segments = map.segments();
    let (alignment, rest_angles_rad) = match options.align_rest {
        true => {
            let is_own = near_forks(target, options.fork_share);
            let segments: Vec<Option<Segment>> =
                segments.iter().zip(&is_own).map(|it| it.0.filter(|_| !it.1)).collect();
            align_rest(source, target, &segments, options.least_bone)
        }
        false => {
            (vec![UnitQuaternion::identity(); target.n_joints()], vec![0.0; target.n_joints()])
        }
    };
    let scale = scale(source, target, segments);
    let transfer = Transfer { source, target, segments, alignment, children: target.children() };
    let first = world_frames(clip, 0, source.parents()).1;
    let start = match options.root {
        RootPath::FromRest => source.positions(),
        RootPath::Grounded => &first,
    };
    let mut res = empty_clip(clip, target.n_joints());
    let mut lowest = f64::INFINITY;
    for frame in 0..clip.n_frames() {
        let (turns, places) = world_frames(clip, frame, source.parents());
        let root = |joint: usize| {
            let from = segments[joint].map_or(0, |it| it.source as usize);
            target.positions()[joint] + (places[from] - start[from]) * scale
        };
        let (turns, places) = transfer.frame(&turns, &places, &root);
        lowest = places.iter().fold(lowest, |low, it| low.min(it.y));
        push_frame(&mut res, target.parents(), &turns, &places);
    }
    if options.root == RootPath::Grounded {
        let floor = target.positions().iter().fold(f64::INFINITY, |low, it| low.min(it.y));
        raise_roots(&mut res, target.parents(), floor - lowest);
    }
    Ok(TransferredAnimation { clip: res, rest_angles_rad, scale })
}

fn check(
    source: &Skeleton,
    clip: &Clip,
    target: &Skeleton,
    map: &SegmentMap,
) -> Result<(), TransferAnimationError> {
    use TransferAnimationError as E;
    let (n_source, n_target) = (source.n_joints(), target.n_joints());
    if clip.n_joints != n_source {
        return Err(E::Clip { clip: clip.n_joints, skeleton: n_source });
    }
    if map.n_source() != n_source {
        return Err(E::Source { map: map.n_source(), skeleton: n_source });
    }
    if map.segments().len() != n_target {
        return Err(E::Target { map: map.segments().len(), skeleton: n_target });
    }
    if clip.n_frames() == 0 {
        return Err(E::NoFrames);
    }
    let follows = map.segments().iter().zip(target.parents());
    if n_target > 1 && !follows.into_iter().any(|(it, parent)| it.is_some() && parent.is_some()) {
        return Err(E::NothingFollows);
    }
    Ok(())
}

/// From its parent to a joint; zero for roots.
fn offset(skeleton: &Skeleton, joint: usize) -> Vec3 {
    let places = skeleton.positions();
    skeleton.parents()[joint].map_or(Vec3::zeros(), |it| places[joint] - places[it])
}

/// Whether every bone ends within a share of its branch from the branch node where that begins.
fn near_forks(skeleton: &Skeleton, share: f64) -> Vec<bool> {
    let (parents, children) = (skeleton.parents(), skeleton.children());
    let is_fork = |it: usize| children[it].len() > 1;
    // The way from the last branch node or root, whether that is a branch node, and the branch's length.
    let mut ways: Vec<(f64, bool)> = Vec::with_capacity(parents.len());
    for (joint, parent) in parents.iter().enumerate() {
        ways.push(match *parent {
            None => (0.0, false),
            Some(it) if is_fork(it) => (offset(skeleton, joint).norm(), true),
            Some(it) => (ways[it].0 + offset(skeleton, joint).norm(), ways[it].1),
        });
    }
    let mut lengths: Vec<f64> = ways.iter().map(|it| it.0).collect();
    for (joint, parent) in parents.iter().enumerate().rev() {
        if let Some(it) = parent.filter(|&it| !is_fork(it)) {
            lengths[it] = lengths[joint];
        }
    }
    let is_near = |(way, length): (&(f64, bool), &f64)| way.1 && way.0 <= share * length;
    ways.iter().zip(&lengths).map(is_near).collect()
}

/// How every bone of the target is turned at rest to point like the bone that it follows, and by how
/// much after the bones above it. Bones shorter than `least_bone` mean ones turn with those above.
pub(in crate::kernels) fn align_rest(
    source: &Skeleton,
    target: &Skeleton,
    segments: &[Option<Segment>],
    least_bone: f64,
) -> (Vec<UnitQuaternion<f64>>, Vec<f64>) {
    let shortest = [source, target].map(|it| least_bone * mean_length(it));
    let mut turns: Vec<UnitQuaternion<f64>> = Vec::with_capacity(segments.len());
    let mut angles = Vec::with_capacity(segments.len());
    for (joint, segment) in segments.iter().enumerate() {
        let above = target.parents()[joint].map_or_else(UnitQuaternion::identity, |it| turns[it]);
        let arc = segment.map_or_else(UnitQuaternion::identity, |it| {
            let (own, foreign) = (offset(target, joint), offset(source, it.source as usize));
            match foreign.norm() >= shortest[0] && own.norm() >= shortest[1] {
                true => shortest_arc(above * own, foreign),
                false => UnitQuaternion::identity(),
            }
        });
        angles.push(arc.angle());
        turns.push(arc * above);
    }
    (turns, angles)
}

/// Of the bones that have a length.
pub(in crate::kernels) fn mean_length(skeleton: &Skeleton) -> f64 {
    let lengths = (0..skeleton.n_joints()).map(|it| offset(skeleton, it).norm());
    let lengths: Vec<f64> = lengths.filter(|&it| it > 0.0).collect();
    lengths.iter().sum::<f64>() / lengths.len().max(1) as f64
}

fn scale(source: &Skeleton, target: &Skeleton, segments: &[Option<Segment>]) -> f64 {
    let (mut own, mut foreign) = (0.0, 0.0);
    for (joint, segment) in segments.iter().enumerate() {
        let Some(it) = segment else { continue };
        own += offset(target, joint).norm();
        foreign += offset(source, it.source as usize).norm() * (it.to - it.from);
    }
    if own > 0.0 && foreign > 0.0 { own / foreign } else { 1.0 }
}

fn raise_roots(clip: &mut Clip, parents: &[Option<usize>], by: f64) {
    for (index, translation) in clip.translations.iter_mut().enumerate() {
        if parents[index % clip.n_joints].is_none() {
            translation.y += by;
        }
    }
}

struct Transfer<'a> {
    source: &'a Skeleton,
    target: &'a Skeleton,
    segments: &'a [Option<Segment>],
    /// Of the target's bones at rest.
    alignment: Vec<UnitQuaternion<f64>>,
    children: Vec<Vec<usize>>,
}

impl Transfer<'_> {
    /// How the target's joints are turned and where they are, from the same of the source's.
    fn frame(
        &self,
        turns: &[UnitQuaternion<f64>],
        places: &[Vec3],
        root: &dyn Fn(usize) -> Vec3,
    ) -> (Vec<UnitQuaternion<f64>>, Vec<Vec3>) {
        let bones: Vec<Option<UnitQuaternion<f64>>> =
            (0..self.segments.len()).map(|it| self.bone_turn(it, turns, places)).collect();
        let mut own: Vec<UnitQuaternion<f64>> = Vec::with_capacity(bones.len());
        let mut at: Vec<Vec3> = Vec::with_capacity(bones.len());
        for (joint, parent) in self.target.parents().iter().enumerate() {
            at.push(match *parent {
                Some(parent) => {
                    at[parent] + bones[joint].unwrap_or(own[parent]) * offset(self.target, joint)
                }
                None => root(joint),
            });
            let above = parent.map_or_else(UnitQuaternion::identity, |it| own[it]);
            own.push(
                (self.mean_of_children(joint, &bones))
                    .or_else(|| self.end_turn(joint, turns, bones[joint]))
                    .unwrap_or(above),
            );
        }
        (own, at)
    }

    /// How the bone that ends at a target joint is turned, if it follows one.
    ///
    /// Clips may move joints by their offsets, too: what the turn of the source's joint does not
    /// explain is one more arc.
    fn bone_turn(
        &self,
        joint: usize,
        turns: &[UnitQuaternion<f64>],
        places: &[Vec3],
    ) -> Option<UnitQuaternion<f64>> {
        self.target.parents()[joint]?;
        let bone = self.segments[joint]?.source as usize;
        let turn = match self.source.parents()[bone] {
            Some(parent) => {
                let turned = turns[parent] * offset(self.source, bone);
                shortest_arc(turned, places[bone] - places[parent]) * turns[parent]
            }
            None => turns[bone],
        };
        Some(turn * self.alignment[joint])
    }

    fn mean_of_children(
        &self,
        joint: usize,
        bones: &[Option<UnitQuaternion<f64>>],
    ) -> Option<UnitQuaternion<f64>> {
        let of = |&it: &usize| Some((bones[it]?, offset(self.target, it).norm()));
        let turns: Vec<_> = self.children[joint].iter().filter_map(of).collect();
        let has_length = turns.iter().any(|it| it.1 > 0.0);
        let first = turns.iter().find(|it| it.1 > 0.0 || !has_length)?.0;
        let mut sum = nalgebra::Quaternion::identity() * 0.0;
        for (turn, length) in &turns {
            let weight = if has_length { *length } else { 1.0 };
            sum += turn.into_inner() * weight * first.dot(turn).signum();
        }
        Some(UnitQuaternion::try_new(sum, 1e-12).unwrap_or(first))
    }

    /// How the last joint of a chain is turned: like the source's joint if its bone ends there.
    fn end_turn(
        &self,
        joint: usize,
        turns: &[UnitQuaternion<f64>],
        bone: Option<UnitQuaternion<f64>>,
    ) -> Option<UnitQuaternion<f64>> {
        let segment = self.segments[joint]?;
        match bone {
            Some(turn) if segment.to < 1.0 => Some(turn),
            _ => Some(turns[segment.source as usize] * self.alignment[joint]),
        }
    }
}

#[cfg(test)]
mod tests;
