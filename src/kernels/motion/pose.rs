//! Poses by angles: a clip of one frame from turns of joints.

use std::collections::BTreeMap;

use nalgebra::UnitQuaternion;

use crate::kernels::{
    geometry::mesh::Vec3,
    numerics::random::Random,
    rigs::{clip::Clip, skeleton::Skeleton},
};

/// Turns of a joint about the world's X, Y and Z, in degrees.
pub type Turn = [f64; 3];

/// The least and the greatest turn of a joint about X, Y and Z, in degrees.
pub type TurnRange = [[f64; 2]; 3];

/// Why there is no pose.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PoseError {
    #[error("the skeleton has no joint `{name}`; it has {known}")]
    UnknownJoint { name: String, known: String },
    #[error("joint `{name}`: the range {low} to {high} is empty")]
    EmptyRange { name: String, low: f64, high: f64 },
    #[error("joint `{name}` is turned by {angle}")]
    NotFinite { name: String, angle: f64 },
}

/// Draws a turn within every range, for all times that the same seed is given.
///
/// Every joint draws from a stream of its own: another joint more changes no other.
///
/// # Errors
/// [`PoseError::EmptyRange`].
pub fn random_turns(
    ranges: &BTreeMap<String, TurnRange>,
    seed: u64,
) -> Result<BTreeMap<String, Turn>, PoseError> {
    let draw = |(name, range): (&String, &TurnRange)| {
        let mut random = Random::stream(seed, name);
        let mut turn = [0.0; 3];
        for (angle, &[low, high]) in turn.iter_mut().zip(range) {
            if !(low <= high) {
                return Err(PoseError::EmptyRange { name: name.clone(), low, high });
            }
            *angle = random.between(low, high);
        }
        Ok((name.clone(), turn))
    };
    ranges.iter().map(draw).collect()
}

/// A clip of one frame in which joints are turned against their parents.
///
/// A joint turns about the world's Z, then Y, then X axis through its place at rest. With a `base` (a
/// frame of a clip of this skeleton) the turns come on top of its rotations.
///
/// # Errors
/// [`PoseError::UnknownJoint`], [`PoseError::NotFinite`].
pub fn pose(
    skeleton: &Skeleton,
    turns: &BTreeMap<String, Turn>,
    base: Option<(&Clip, usize)>,
) -> Result<Clip, PoseError> {
    let n_joints = skeleton.n_joints();
    let (mut rotations, translations) = match base {
        Some((clip, frame)) => {
            let range = frame * n_joints..(frame + 1) * n_joints;
            (clip.rotations[range.clone()].to_vec(), clip.translations[range].to_vec())
        }
        None => (vec![UnitQuaternion::identity(); n_joints], rest_offsets(skeleton)),
    };
    for (name, turn) in turns {
        let joint = skeleton.joint(name).ok_or_else(|| PoseError::UnknownJoint {
            name: name.clone(),
            known: skeleton.names().join(", "),
        })?;
        if let Some(&angle) = turn.iter().find(|it| !it.is_finite()) {
            return Err(PoseError::NotFinite { name: name.clone(), angle });
        }
        let about = |axis: usize| {
            let axis_vector = Vec3::ith(axis, turn[axis].to_radians());
            UnitQuaternion::new(axis_vector)
        };
        rotations[joint] = about(0) * about(1) * about(2) * rotations[joint];
    }
    let frames_per_second = base.map_or(30.0, |it| it.0.frames_per_second);
    Ok(Clip { name: "pose".to_owned(), frames_per_second, n_joints, rotations, translations })
}

/// Every joint's offset from its parent at rest; a root's position.
fn rest_offsets(skeleton: &Skeleton) -> Vec<Vec3> {
    let positions = skeleton.positions();
    let offset = |(joint, parent): (usize, &Option<usize>)| {
        parent.map_or(positions[joint], |it| positions[joint] - positions[it])
    };
    skeleton.parents().iter().enumerate().map(offset).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::motion::fit_clip::world_positions;

    fn arm() -> Skeleton {
        let names = ["shoulder", "elbow", "wrist"].map(str::to_owned).to_vec();
        let positions = vec![Vec3::zeros(), Vec3::x(), 2.0 * Vec3::x()];
        Skeleton::new(names, vec![None, Some(0), Some(1)], positions).unwrap()
    }

    fn turns(name: &str, turn: Turn) -> BTreeMap<String, Turn> {
        BTreeMap::from([(name.to_owned(), turn)])
    }

    #[test]
    fn turns_add_up_along_the_chain_and_on_top_of_a_base() {
        let skeleton = arm();
        let at = |clip: &Clip| world_positions(clip, 0, skeleton.parents());
        let bent = pose(&skeleton, &turns("elbow", [0.0, 0.0, 90.0]), None).unwrap();
        assert!((at(&bent)[2] - Vec3::new(1.0, 1.0, 0.0)).norm() < 1e-12);
        let more = pose(&skeleton, &turns("shoulder", [0.0, 0.0, 90.0]), Some((&bent, 0))).unwrap();
        assert!((at(&more)[1] - Vec3::y()).norm() < 1e-12);
        assert!((at(&more)[2] - Vec3::new(-1.0, 1.0, 0.0)).norm() < 1e-12);
        // Z first, then X: from +X to +Y to +Z.
        let both = pose(&skeleton, &turns("shoulder", [90.0, 0.0, 90.0]), None).unwrap();
        assert!((at(&both)[1] - Vec3::z()).norm() < 1e-12);
    }

    #[test]
    fn a_joint_draws_its_own_numbers() {
        let range = [[-10.0, 10.0], [0.0, 0.0], [5.0, 6.0]];
        let one = BTreeMap::from([("b".to_owned(), range)]);
        let two = BTreeMap::from([("a".to_owned(), range), ("b".to_owned(), range)]);
        let first = random_turns(&one, 3).unwrap();
        let second = random_turns(&two, 3).unwrap();
        assert_eq!(first["b"], second["b"]);
        assert_ne!(second["a"], second["b"]);
        assert_ne!(first["b"], random_turns(&one, 4).unwrap()["b"]);
        assert!(first["b"][1] == 0.0 && (5.0..=6.0).contains(&first["b"][2]));
    }

    #[test]
    fn mistakes_are_named() {
        let error = pose(&arm(), &turns("knee", [0.0; 3]), None).unwrap_err();
        let expected = "the skeleton has no joint `knee`; it has shoulder, elbow, wrist";
        assert_eq!(error.to_string(), expected);
        let range = BTreeMap::from([("elbow".to_owned(), [[2.0, 1.0], [0.0; 2], [0.0; 2]])]);
        let error = random_turns(&range, 0).unwrap_err();
        assert_eq!(error.to_string(), "joint `elbow`: the range 2 to 1 is empty");
    }
}
