//! A motion of one skeleton for another that has joints of the same names.

use super::{
    clip_frames::{empty_clip, push_frame},
    fit_clip::fit_clip,
};
use crate::kernels::rigs::{
    clip::Clip,
    skeleton::Skeleton,
    skinning::{SkinningError, world_from_joint},
};

/// Why a motion cannot be taken over.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum RetargetError {
    #[error(
        "the skeletons share no joint: the clip's has `{clip}` and {n_clip} joints, the mesh's \
         `{own}` and {n_own} joints"
    )]
    NothingShared { clip: String, n_clip: usize, own: String, n_own: usize },
    #[error(transparent)]
    Skinning(#[from] SkinningError),
}

/// A motion on another skeleton, and what did not fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Retargeted {
    pub clip: Clip,
    /// Joints that the clip's skeleton does not have: they move with their parents.
    pub unmoved: Vec<String>,
    /// Joints of the clip's skeleton that the other does not have: their turns go to those below.
    pub unused: Vec<String>,
}

/// Makes a clip of one skeleton one of another, by the joints' names.
///
/// Rest frames are aligned with the world on both, so every joint turns in the world as its namesake
/// does, whatever stands between it and the root. Bones keep the skeleton's own lengths, and the root's
/// path is scaled by the ratio of the heights (see [`fit_clip`]). The rest poses should be alike: a turn
/// is told from rest to pose.
///
/// # Errors
/// See [`RetargetError`].
pub fn retarget(
    clip: &Clip,
    clip_skeleton: &Skeleton,
    skeleton: &Skeleton,
) -> Result<Retargeted, RetargetError> {
    let namesakes: Vec<Option<usize>> =
        skeleton.names().iter().map(|it| clip_skeleton.joint(it)).collect();
    if namesakes.iter().all(Option::is_none) {
        return Err(RetargetError::NothingShared {
            clip: clip_skeleton.names()[0].clone(),
            n_clip: clip_skeleton.n_joints(),
            own: skeleton.names()[0].clone(),
            n_own: skeleton.n_joints(),
        });
    }
    let (n_joints, parents) = (skeleton.n_joints(), skeleton.parents());
    let mut res = empty_clip(clip, n_joints);
    for frame in 0..clip.n_frames() {
        let theirs = world_from_joint(clip_skeleton, clip, frame)?;
        let (mut turns, mut places) = (Vec::with_capacity(n_joints), Vec::with_capacity(n_joints));
        for (joint, parent) in parents.iter().enumerate() {
            let world = namesakes[joint].map(|it| theirs[it]);
            let above = parent.map(|it| (turns[it], places[it]));
            let own = world.map(|it| (it.rotation, it.translation.vector)).or(above);
            let (turn, place) = own.unwrap_or_default();
            turns.push(turn);
            places.push(place);
        }
        push_frame(&mut res, parents, &turns, &places);
    }
    res.rotations.iter_mut().for_each(|it| _ = it.renormalize());
    let missing = |of: &Skeleton, other: &Skeleton| {
        let names = of.names().iter().filter(|it| other.joint(it).is_none());
        names.cloned().collect::<Vec<_>>()
    };
    Ok(Retargeted {
        clip: fit_clip(&res, skeleton),
        unmoved: missing(skeleton, clip_skeleton),
        unused: missing(clip_skeleton, skeleton),
    })
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;

    use super::*;
    use crate::kernels::geometry::mesh::Vec3;
    use crate::kernels::motion::fit_clip::world_positions;

    /// A chain along +Y: root, middle, end.
    fn chain(names: &[&str], scale: f64) -> Skeleton {
        let positions = (0..names.len()).map(|it| Vec3::y() * (scale * it as f64)).collect();
        let parents = (0..names.len()).map(|it| it.checked_sub(1)).collect();
        Skeleton::new(names.iter().map(|&it| it.to_owned()).collect(), parents, positions).unwrap()
    }

    fn wave(n_joints: usize) -> Clip {
        let turn = |it: usize| UnitQuaternion::from_euler_angles(0.2 * it as f64, 0.1, 0.3);
        Clip {
            name: "wave".to_owned(),
            frames_per_second: 25.0,
            n_joints,
            rotations: (0..4 * n_joints).map(turn).collect(),
            translations: (0..4 * n_joints)
                .map(|it| if it % n_joints == 0 { Vec3::x() * it as f64 } else { Vec3::y() })
                .collect(),
        }
    }

    #[test]
    fn the_same_skeleton_gives_what_fitting_gives() {
        let own = chain(&["a", "b", "c", "d"], 1.0);
        let clip = wave(4);
        let found = retarget(&clip, &own, &own).unwrap();
        let fitted = fit_clip(&clip, &own);
        assert!(found.unmoved.is_empty() && found.unused.is_empty());
        for frame in 0..4 {
            let a = world_positions(&found.clip, frame, own.parents());
            let b = world_positions(&fitted, frame, own.parents());
            assert!(a.iter().zip(&b).all(|(a, b)| (a - b).norm() < 1e-12));
        }
    }

    #[test]
    fn joints_turn_in_the_world_as_their_namesakes_do() {
        let (theirs, own) = (chain(&["a", "b", "c", "d"], 1.0), chain(&["a", "x", "c"], 0.5));
        let clip = wave(4);
        let found = retarget(&clip, &theirs, &own).unwrap();
        assert_eq!(found.unmoved, ["x"]);
        assert_eq!(found.unused, ["b", "d"]);
        for frame in 0..4 {
            let before = world_from_joint(&theirs, &clip, frame).unwrap();
            let after = world_from_joint(&own, &found.clip, frame).unwrap();
            for (own, their) in [(0, 0), (1, 0), (2, 2)] {
                assert!(after[own].rotation.angle_to(&before[their].rotation) < 1e-7);
            }
            // Bones keep their lengths.
            let bone = after[2].translation.vector - after[1].translation.vector;
            assert!((bone.norm() - 0.5).abs() < 1e-12);
        }
    }

    #[test]
    fn strangers_are_refused() {
        let error = retarget(&wave(2), &chain(&["a", "b"], 1.0), &chain(&["x"], 1.0)).unwrap_err();
        assert_eq!(
            error.to_string(),
            "the skeletons share no joint: the clip's has `a` and 2 joints, the mesh's `x` and 1 \
             joints"
        );
    }
}
