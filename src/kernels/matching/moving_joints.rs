//! Which joints of a rig move.

use nalgebra::UnitQuaternion;

use super::find_joints::{JointOptions, JointsError, find_joints};
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::rigs::clip::Clip;
use crate::kernels::rigs::skeleton::Skeleton;

/// Joints of a rig that move.
#[derive(Debug, Clone, PartialEq)]
pub struct Moving {
    pub joints: Vec<MovingJoint>,
    /// Where joints may be of which it is not known whether they move.
    pub unknown: Vec<Vec3>,
}

/// A joint of a rig that moves.
#[derive(Debug, Clone, PartialEq)]
pub struct MovingJoint {
    pub name: String,
    pub position: Vec3,
    /// The greatest over the poses, in degrees.
    pub angle: f64,
}

/// Why it is not known which joints move.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MotionError {
    #[error("motion {motion} has {found} joints, but the rig {n_joints}")]
    Joints { motion: usize, found: usize, n_joints: usize },
}

impl Moving {
    /// Joints at which the rig bends by more than `min_angle` degrees against the pose it is in.
    ///
    /// What bends is found as [`find_joints`] does, on single bones: roll about bones does not count, and of ends
    /// of the rig (hooves, heads) places of joints do not tell whether they move.
    ///
    /// # Errors
    /// See [`JointsError`].
    pub fn by_places(
        rig: &Skeleton,
        poses: &[Vec<Vec3>],
        min_angle: f64,
    ) -> Result<Self, JointsError> {
        let moving = JointOptions {
            window: 0.0,
            min_angle,
            at_forks: true,
            is_symmetric: false,
            ..Default::default()
        };
        let joints = find_joints(rig, poses, &moving)?
            .into_iter()
            .map(|it| MovingJoint {
                name: rig.names()[it.at(rig)].clone(),
                position: it.position,
                angle: it.angle,
            })
            .collect();
        let children = rig.children();
        let ends = (0..rig.n_joints()).filter(|&it| children[it].is_empty());
        Ok(Self { joints, unknown: ends.map(|it| rig.positions()[it]).collect() })
    }

    /// Joints that turn against their parent by more than `min_angle` degrees in some frame of the motions, against
    /// the first frame of the first one, which is the pose that the rig is in.
    ///
    /// # Errors
    /// See [`MotionError`].
    pub fn by_turns(
        rig: &Skeleton,
        motions: &[&Clip],
        min_angle: f64,
    ) -> Result<Self, MotionError> {
        let n_joints = rig.n_joints();
        for (motion, clip) in motions.iter().enumerate() {
            let found = clip.n_joints;
            if found != n_joints {
                return Err(MotionError::Joints { motion, found, n_joints });
            }
        }
        let frames: Vec<&[UnitQuaternion<f64>]> =
            motions.iter().flat_map(|it| it.rotations.chunks(n_joints.max(1))).collect();
        let angle = |joint: usize| {
            let Some(first) = frames.first() else { return 0.0 };
            let turn = |it: &&[UnitQuaternion<f64>]| first[joint].angle_to(&it[joint]);
            frames.iter().map(turn).fold(0.0, f64::max).to_degrees()
        };
        let joint = |it: usize| MovingJoint {
            name: rig.names()[it].clone(),
            position: rig.positions()[it],
            angle: angle(it),
        };
        let joints = (0..n_joints).filter(|&it| rig.parents()[it].is_some()).map(joint);
        Ok(Self { joints: joints.filter(|it| it.angle > min_angle).collect(), unknown: Vec::new() })
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub fn rig() -> Skeleton {
        let names = ["hip", "knee", "ankle", "toe"].map(str::to_owned).to_vec();
        let positions = [0.0, 1.0, 2.0, 3.0].map(|it| Vec3::x() * it).to_vec();
        Skeleton::new(names, vec![None, Some(0), Some(1), Some(2)], positions).unwrap()
    }

    /// The knee at 60 degrees, the ankle at 10.
    pub fn bent() -> Vec<Vec3> {
        let at =
            |degrees: f64| Vec3::new(degrees.to_radians().cos(), degrees.to_radians().sin(), 0.0);
        let ankle = Vec3::x() + at(60.0);
        vec![Vec3::zeros(), Vec3::x(), ankle, ankle + at(70.0)]
    }

    #[test]
    fn motions_tell_of_ends_and_of_roll_too() {
        let clip = |turns: [Vec3; 4]| Clip {
            name: "pose".to_owned(),
            frames_per_second: 30.0,
            n_joints: 4,
            rotations: turns.map(|it| UnitQuaternion::new(it.map(f64::to_radians))).to_vec(),
            translations: [0.0, 1.0, 1.0, 1.0].map(|it| Vec3::x() * it).to_vec(),
        };
        let (x, z) = (Vec3::x(), Vec3::z());
        let first = clip([z * 0.0, z * 30.0, z * 0.0, z * 0.0]);
        // The root turns, too, but is no joint; the knee is turned the same way in both poses.
        let second = clip([z * 50.0, z * 40.0, x * 20.0, z * -40.0]);
        let moving = Moving::by_turns(&rig(), &[&first, &second], 15.0).unwrap();
        let found: Vec<_> =
            moving.joints.iter().map(|it| (it.name.as_str(), it.angle.round())).collect();
        assert_eq!(found, [("ankle", 20.0), ("toe", 40.0)]);
        assert!(moving.unknown.is_empty());
        let empty = Clip { rotations: vec![], translations: vec![], ..first.clone() };
        assert_eq!(Moving::by_turns(&rig(), &[&empty], 15.0).unwrap().joints, []);
        let short = Clip { n_joints: 2, ..first.clone() };
        let error = Moving::by_turns(&rig(), &[&first, &short], 15.0).unwrap_err();
        assert_eq!(error, MotionError::Joints { motion: 1, found: 2, n_joints: 4 });
    }

    #[test]
    fn a_branch_node_that_turns_with_its_limbs_is_a_joint_but_its_roll_is_none() {
        let names = ["hip", "neck", "head", "ear_l", "ear_r", "nose"].map(str::to_owned).to_vec();
        let places = [[0.0, 0.0], [0.0, 1.0], [0.0, 2.0], [-1.0, 2.5], [1.0, 2.5], [0.0, 2.5]];
        let mut places: Vec<Vec3> = places.iter().map(|it| Vec3::new(it[0], it[1], 0.0)).collect();
        places[5].z = 0.8;
        let parents = vec![None, Some(0), Some(1), Some(2), Some(2), Some(2)];
        let rig = Skeleton::new(names, parents, places.clone()).unwrap();
        let turned = |axis: Vec3| {
            let turn = nalgebra::UnitQuaternion::new(axis * 40.0_f64.to_radians());
            let moved = |it: &Vec3| places[2] + turn * (it - places[2]);
            [&places[..3], &places[3..].iter().map(moved).collect::<Vec<_>>()].concat()
        };
        let found = |axis: Vec3| {
            let res = Moving::by_places(&rig, &[turned(axis)], 15.0).unwrap();
            res.joints.into_iter().map(|it| (it.name, it.angle)).collect::<Vec<_>>()
        };
        // The neck's direction counts a little for its end, too.
        let nodding = found(Vec3::x());
        assert!(nodding.len() == 1 && nodding[0].0 == "head", "{nodding:?}");
        assert!((nodding[0].1 - 40.0).abs() < 3.0, "{nodding:?}");
        assert_eq!(found(Vec3::y()), []);
    }
}
