//! A motion for another skeleton, from where joints are.

use std::collections::HashMap;

use nalgebra::{Matrix3, UnitQuaternion};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::clip_frames::{empty_clip, push_frame};
use super::fit_clip::world_positions;
use crate::kernels::geometry::kabsch::{best_rotation, shortest_arc};
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::rigs::clip::Clip;
use crate::kernels::rigs::skeleton::Skeleton;

/// How bones are turned.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum BoneMotion {
    /// As the source's bones turn from their rest directions: the target keeps its own rest pose.
    #[default]
    Relative,
    /// To the directions of the source's bones (Maheshwari et al. 2023, equation 5): in every frame the
    /// target stands exactly like the source, also where their rest poses differ.
    Absolute,
}

/// How the root moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RootMotion {
    /// From its own rest place along the source's path since the first frame, scaled by the ratio of
    /// the bones' lengths.
    #[default]
    Scaled,
    /// To where the source's root is.
    Copied,
    /// Not at all.
    Fixed,
}

/// What [`retarget_bones`] does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RetargetOptions {
    pub bones: BoneMotion,
    pub root: RootMotion,
}

/// A clip of the target, and what was found.
#[derive(Debug, Clone, PartialEq)]
pub struct Retargeted {
    pub clip: Clip,
    /// Joints of the target that the source does not have: they follow their parents stiffly.
    pub without_source: Vec<String>,
    /// The length of the target's bones over that of the source's.
    pub scale: f64,
}

/// Why a motion cannot be retargeted.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RetargetError {
    #[error("the clip moves {clip} joints, but the source skeleton has {skeleton}")]
    Joints { clip: usize, skeleton: usize },
    #[error("the clip has no frames")]
    NoFrames,
    #[error(
        "no bone of the target (`{target}`, … {n_target} joints) joins two joints of the source \
         (`{source_joint}`, … {n_source} joints): bones are matched by the names of their ends"
    )]
    NothingShared { target: String, n_target: usize, source_joint: String, n_source: usize },
    #[error("joint `{name}` has the coordinate {value} in frame {frame}")]
    NotFinite { name: String, value: f64, frame: usize },
}

/// Moves a skeleton like another one (Maheshwari et al. 2023, section 3.4).
///
/// Only the positions of the source's joints matter. Bones are matched by the names of their ends;
/// each turns by the smallest rotation that its motion needs, so its length stays and twist about it
/// is lost. Joints with several children turn as fits all of them best; the children's own offsets
/// then make every joint's place exact.
///
/// # Errors
/// See [`RetargetError`].
pub fn retarget_bones(
    source: &Skeleton,
    clip: &Clip,
    target: &Skeleton,
    options: &RetargetOptions,
) -> Result<Retargeted, RetargetError> {
    if clip.n_joints != source.n_joints() {
        return Err(RetargetError::Joints { clip: clip.n_joints, skeleton: source.n_joints() });
    }
    let matched = Matched::new(source, target)?;
    let n_frames = clip.n_frames();
    if n_frames == 0 {
        return Err(RetargetError::NoFrames);
    }
    let motion: Vec<Vec<Vec3>> =
        (0..n_frames).map(|it| world_positions(clip, it, source.parents())).collect();
    check_finite(source, &motion)?;
    let scale = matched.scale();
    let mut res = empty_clip(clip, target.n_joints());
    for places in &motion {
        let root = |joint: usize| {
            let rest = target.positions()[joint];
            let Some(from) = matched.source_of[joint] else { return rest };
            match options.root {
                RootMotion::Scaled => rest + (places[from] - motion[0][from]) * scale,
                RootMotion::Copied => places[from],
                RootMotion::Fixed => rest,
            }
        };
        matched.add_frame(places, &root, options.bones, &mut res);
    }
    let names = target.names().iter().zip(&matched.source_of);
    let without_source = names.filter(|it| it.1.is_none()).map(|it| it.0.clone()).collect();
    Ok(Retargeted { clip: res, without_source, scale })
}

fn check_finite(source: &Skeleton, motion: &[Vec<Vec3>]) -> Result<(), RetargetError> {
    for (frame, places) in motion.iter().enumerate() {
        for (name, place) in source.names().iter().zip(places) {
            if let Some(&value) = place.iter().find(|it| !it.is_finite()) {
                return Err(RetargetError::NotFinite { name: name.clone(), value, frame });
            }
        }
    }
    Ok(())
}

/// Which joints are the same.
struct Matched<'a> {
    source: &'a Skeleton,
    target: &'a Skeleton,
    children: Vec<Vec<usize>>,
    /// The source's joint of every target joint.
    source_of: Vec<Option<usize>>,
}

impl<'a> Matched<'a> {
    fn new(source: &'a Skeleton, target: &'a Skeleton) -> Result<Self, RetargetError> {
        let index: HashMap<&str, usize> =
            source.names().iter().enumerate().map(|(it, name)| (name.as_str(), it)).collect();
        let source_of: Vec<Option<usize>> =
            target.names().iter().map(|it| index.get(it.as_str()).copied()).collect();
        let res = Self { source, target, children: target.children(), source_of };
        // A joint alone has no bones, and may be moved.
        let is_alone = target.n_joints() == 1 && res.source_of[0].is_some();
        if !is_alone && !target.bones().any(|(_, child)| res.ends(child).is_some()) {
            return Err(RetargetError::NothingShared {
                target: target.names()[0].clone(),
                n_target: target.n_joints(),
                source_joint: source.names()[0].clone(),
                n_source: source.n_joints(),
            });
        }
        Ok(res)
    }

    /// The source's joints at the ends of the bone that leads to a target joint.
    fn ends(&self, joint: usize) -> Option<[usize; 2]> {
        let parent = self.target.parents()[joint]?;
        Some([self.source_of[parent]?, self.source_of[joint]?])
    }

    fn scale(&self) -> f64 {
        let (mut own, mut foreign) = (0.0, 0.0);
        for (parent, child) in self.target.bones() {
            if let Some([from, to]) = self.ends(child) {
                own += (self.target.positions()[child] - self.target.positions()[parent]).norm();
                foreign += (self.source.positions()[to] - self.source.positions()[from]).norm();
            }
        }
        if foreign > 0.0 { own / foreign } else { 1.0 }
    }

    /// Appends a frame: `places` are those of the source's joints.
    fn add_frame(
        &self,
        places: &[Vec3],
        root: &dyn Fn(usize) -> Vec3,
        mode: BoneMotion,
        clip: &mut Clip,
    ) {
        let rest = self.target.positions();
        let n_joints = self.target.n_joints();
        // By joint: the rotation of the bone that leads to it, and where it is.
        let mut turns: Vec<UnitQuaternion<f64>> = Vec::with_capacity(n_joints);
        let mut at: Vec<Vec3> = Vec::with_capacity(n_joints);
        for (joint, parent) in self.target.parents().iter().enumerate() {
            let Some(parent) = *parent else {
                turns.push(UnitQuaternion::identity());
                at.push(root(joint));
                continue;
            };
            let offset = rest[joint] - rest[parent];
            let turn = self.bone_turn(joint, offset, places, mode).unwrap_or(turns[parent]);
            at.push(at[parent] + turn * offset);
            turns.push(turn);
        }
        let frames: Vec<_> = (0..n_joints).map(|it| self.joint_turn(it, &turns, &at)).collect();
        push_frame(clip, self.target.parents(), &frames, &at);
    }

    /// How the bone that leads to a joint turns; `None` if the source does not say.
    fn bone_turn(
        &self,
        joint: usize,
        offset: Vec3,
        places: &[Vec3],
        mode: BoneMotion,
    ) -> Option<UnitQuaternion<f64>> {
        let [from, to] = self.ends(joint)?;
        let moved = places[to] - places[from];
        let rest = match mode {
            BoneMotion::Relative => self.source.positions()[to] - self.source.positions()[from],
            BoneMotion::Absolute => offset,
        };
        let is_long = |it: &Vec3| it.norm() > 0.0;
        (is_long(&moved) && is_long(&rest)).then(|| shortest_arc(rest, moved))
    }

    /// How a joint turns: like its bones, or like the bone that leads to it where it has none.
    fn joint_turn(
        &self,
        joint: usize,
        turns: &[UnitQuaternion<f64>],
        at: &[Vec3],
    ) -> UnitQuaternion<f64> {
        let rest = self.target.positions();
        let moving = self.children[joint].iter().filter(|&&it| rest[it] != rest[joint]);
        let moving: Vec<usize> = moving.copied().collect();
        match moving[..] {
            [] => turns[joint],
            [only] => turns[only],
            _ => {
                let covariance: Matrix3<f64> = moving
                    .iter()
                    .map(|&it| (at[it] - at[joint]) * (rest[it] - rest[joint]).transpose())
                    .sum();
                best_rotation(&covariance)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, PI};

    use super::*;
    use crate::kernels::numerics::random::Random;
    use crate::kernels::rigs::skinning::world_from_joint;
    use crate::kernels::synthetic::synthesize::{Body, SynthesizeOptions, synthesize};

    /// Writes places of joints as a clip without rotations: every frame's offsets are the differences of
    /// the places (`T x Q`).
    ///
    /// # Panics
    /// If a frame has not as many places as the skeleton has joints.
    fn clip_of_positions(
        skeleton: &Skeleton,
        name: &str,
        frames_per_second: f64,
        frames: &[Vec<Vec3>],
    ) -> Clip {
        let n_joints = skeleton.n_joints();
        let mut translations = Vec::with_capacity(frames.len() * n_joints);
        for places in frames {
            assert_eq!(places.len(), n_joints, "one place for every joint");
            let offsets = places.iter().zip(skeleton.parents());
            translations.extend(
                offsets.map(|(at, parent)| at - parent.map_or(Vec3::zeros(), |it| places[it])),
            );
        }
        let rotations = vec![UnitQuaternion::identity(); translations.len()];
        Clip { name: name.to_owned(), frames_per_second, n_joints, rotations, translations }
    }

    fn places(clip: &Clip, skeleton: &Skeleton, frame: usize) -> Vec<Vec3> {
        let transforms = world_from_joint(skeleton, clip, frame).unwrap();
        transforms.iter().map(|it| it.translation.vector).collect()
    }

    fn body() -> (Skeleton, Clip) {
        let options =
            SynthesizeOptions { body: Body::Quadruped, n_vertices: 1000, ..Default::default() };
        let it = synthesize(&options).unwrap();
        (it.skeleton, it.clip)
    }

    fn scaled(skeleton: &Skeleton, factor: f64) -> Skeleton {
        skeleton
            .with_positions(skeleton.positions().iter().map(|it| it * factor).collect())
            .unwrap()
    }

    fn bar(names: [&str; 3], end: Vec3) -> Skeleton {
        let parents = vec![None, Some(0), Some(1)];
        let positions = vec![Vec3::zeros(), Vec3::x(), Vec3::x() + end];
        Skeleton::new(names.map(str::to_owned).to_vec(), parents, positions).unwrap()
    }

    #[test]
    fn the_same_skeleton_moves_the_same_way() {
        let (skeleton, clip) = body();
        for bones in [BoneMotion::Relative, BoneMotion::Absolute] {
            let options = RetargetOptions { bones, root: RootMotion::Copied };
            let res = retarget_bones(&skeleton, &clip, &skeleton, &options).unwrap();
            assert!((res.scale - 1.0).abs() < 1e-12 && res.without_source.is_empty());
            for frame in 0..clip.n_frames() {
                let expected = places(&clip, &skeleton, frame);
                for (a, b) in places(&res.clip, &skeleton, frame).iter().zip(expected) {
                    assert!((a - b).norm() < 1e-12, "{a} {b}");
                }
            }
        }
    }

    #[test]
    fn bones_keep_their_lengths_and_roots_walk_in_scale() {
        let (source, clip) = body();
        let mut random = Random::new(4);
        let target = scaled(&source, 2.5);
        let jitter = |it: &Vec3| it + Vec3::from_fn(|_, _| random.between(-0.05, 0.05));
        let target =
            target.with_positions(target.positions().iter().map(jitter).collect()).unwrap();
        for bones in [BoneMotion::Relative, BoneMotion::Absolute] {
            let options = RetargetOptions { bones, root: RootMotion::Scaled };
            let res = retarget_bones(&source, &clip, &target, &options).unwrap();
            let start = places(&clip, &source, 0)[0];
            for frame in 0..clip.n_frames() {
                let at = places(&res.clip, &target, frame);
                for (parent, child) in target.bones() {
                    let rest = target.positions()[child] - target.positions()[parent];
                    let length = (at[child] - at[parent]).norm();
                    assert!((length - rest.norm()).abs() < 1e-12);
                    let from = places(&clip, &source, frame);
                    if bones == BoneMotion::Absolute {
                        let wanted = (from[child] - from[parent]).normalize();
                        assert!(((at[child] - at[parent]) / length - wanted).norm() < 1e-9);
                    }
                }
                let walked = places(&clip, &source, frame)[0] - start;
                let expected = target.positions()[0] + walked * res.scale;
                assert!((at[0] - expected).norm() < 1e-12);
            }
        }
    }

    #[test]
    fn one_bone_turns_by_itself() {
        let source = bar(["a", "b", "c"], Vec3::x());
        let frames = [vec![Vec3::zeros(), Vec3::x(), Vec3::x() + Vec3::y()]];
        let clip = clip_of_positions(&source, "bend", 30.0, &frames);
        // At rest the target's last bone points to z.
        let target = bar(["a", "b", "c"], Vec3::z() * 3.0);
        let run = |bones| {
            let options = RetargetOptions { bones, root: RootMotion::Fixed };
            retarget_bones(&source, &clip, &target, &options).unwrap().clip
        };
        let absolute = run(BoneMotion::Absolute);
        assert!((places(&absolute, &target, 0)[2] - Vec3::new(1.0, 3.0, 0.0)).norm() < 1e-12);
        assert!((absolute.rotations[1].angle() - FRAC_PI_2).abs() < 1e-12);
        assert!(absolute.rotations[0].angle() < 1e-12 && absolute.rotations[2].angle() < 1e-12);
        // A quarter turn about z leaves z.
        let relative = run(BoneMotion::Relative);
        assert!((places(&relative, &target, 0)[2] - Vec3::new(1.0, 0.0, 3.0)).norm() < 1e-12);
    }

    #[test]
    fn a_bone_may_turn_around() {
        let source = bar(["a", "b", "c"], Vec3::x());
        let clip = clip_of_positions(
            &source,
            "around",
            30.0,
            &[vec![Vec3::zeros(), -Vec3::x(), -Vec3::x() * 2.0]],
        );
        let res = retarget_bones(&source, &clip, &source, &RetargetOptions::default()).unwrap();
        assert!((res.clip.rotations[0].angle() - PI).abs() < 1e-9);
        assert!((places(&res.clip, &source, 0)[2] + Vec3::x() * 2.0).norm() < 1e-9);
    }

    #[test]
    fn joints_without_source_follow_and_bones_without_length_too() {
        let source = bar(["a", "b", "c"], Vec3::x());
        let target = bar(["a", "b", "tip"], Vec3::x());
        let frames = [vec![Vec3::zeros(), Vec3::y(), Vec3::y()]];
        let clip = clip_of_positions(&source, "up", 30.0, &frames);
        let res = retarget_bones(&source, &clip, &target, &RetargetOptions::default()).unwrap();
        assert_eq!(res.without_source, ["tip"]);
        assert!((places(&res.clip, &target, 0)[2] - Vec3::y() * 2.0).norm() < 1e-12);
        let same = retarget_bones(&source, &clip, &source, &RetargetOptions::default()).unwrap();
        assert!((places(&same.clip, &source, 0)[2] - Vec3::y() * 2.0).norm() < 1e-12);
    }

    #[test]
    fn what_does_not_fit_is_told() {
        let source = bar(["a", "b", "c"], Vec3::x());
        let other = bar(["x", "y", "z"], Vec3::x());
        let frames = [source.positions().to_vec()];
        let clip = clip_of_positions(&source, "rest", 30.0, &frames);
        let options = RetargetOptions::default();
        let message = |clip: &Clip, target| {
            retarget_bones(&source, clip, target, &options).unwrap_err().to_string()
        };
        assert!(message(&clip, &other).starts_with("no bone of the target (`x`, … 3 joints)"));
        let short = Clip { n_joints: 2, ..clip.clone() };
        assert_eq!(
            message(&short, &source),
            "the clip moves 2 joints, but the source skeleton has 3"
        );
        let mut nan = clip.clone();
        nan.translations[2].y = f64::NAN;
        assert_eq!(message(&nan, &source), "joint `c` has the coordinate NaN in frame 0");
        let empty = Clip { rotations: vec![], translations: vec![], ..clip };
        assert_eq!(message(&empty, &source), "the clip has no frames");
    }
}
