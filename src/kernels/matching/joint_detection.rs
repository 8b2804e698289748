//! How well detected joints agree with those that really move.

use super::find_joints::{JointOptions, JointsError, find_joints};
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::rigs::skeleton::Skeleton;

/// What counts as found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DetectionOptions {
    /// A joint moves if it bends by more than this against the first pose, in degrees.
    pub min_angle: f64,
    /// A detected joint is a true one if it is as near as this, in percent of the height.
    pub tolerance: f64,
    /// In the unit of positions.
    pub height: f64,
}

/// A true joint that moves.
#[derive(Debug, Clone, PartialEq)]
pub struct TrueJoint {
    pub name: String,
    pub position: Vec3,
    /// In degrees.
    pub angle: f64,
    /// The detected joint that it was found as.
    pub found: Option<usize>,
    /// To that joint, or else to the nearest detected one, in percent of the height; infinite if nothing
    /// was detected.
    pub distance: f64,
}

/// Detected joints held against true ones.
#[derive(Debug, Clone, PartialEq)]
pub struct Detection {
    pub truth: Vec<TrueJoint>,
    /// Without those at ends.
    pub n_detected: usize,
    /// Detected joints that are none.
    pub wrong: Vec<usize>,
    /// Detected joints at ends of the rig (hooves, heads): whether those turn, places of joints do not tell.
    pub at_ends: Vec<usize>,
}

impl Detection {
    pub fn n_found(&self) -> usize {
        self.truth.iter().filter(|it| it.found.is_some()).count()
    }

    /// The share of detected joints that are true; 1 if none was detected.
    pub fn precision(&self) -> f64 {
        if self.n_detected == 0 { 1.0 } else { self.n_found() as f64 / self.n_detected as f64 }
    }

    /// The share of true joints that were found; 1 if none moves.
    pub fn recall(&self) -> f64 {
        let n_true = self.truth.len();
        if n_true == 0 { 1.0 } else { self.n_found() as f64 / n_true as f64 }
    }

    /// Of found joints, in percent of the height.
    pub fn distances(&self) -> Vec<f64> {
        self.truth.iter().filter(|it| it.found.is_some()).map(|it| it.distance).collect()
    }
}

/// Holds detected joints against the joints of a rig that bend between its poses.
///
/// `truth` is the rig in the pose of the detected positions. What bends is found as [`find_joints`] does, on
/// single bones: roll about bones does not count, and of ends of the rig it is not known, so that what is detected
/// there is neither right nor wrong. Pairs are made from the nearest on, each joint is in one at most.
///
/// # Errors
/// See [`JointsError`].
pub fn joint_detection(
    detected: &[Vec3],
    truth: &Skeleton,
    poses: &[Vec<Vec3>],
    options: &DetectionOptions,
) -> Result<Detection, JointsError> {
    let moving = JointOptions {
        window: 0.0,
        min_angle: options.min_angle,
        at_forks: true,
        is_symmetric: false,
        ..Default::default()
    };
    let percent = 100.0 / options.height;
    let mut true_joints: Vec<TrueJoint> = find_joints(truth, poses, &moving)?
        .into_iter()
        .map(|it| TrueJoint {
            name: truth.names()[it.at(truth)].clone(),
            position: it.position,
            angle: it.angle,
            found: None,
            distance: f64::INFINITY,
        })
        .collect();
    let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
    for (index, joint) in true_joints.iter().enumerate() {
        for (other, place) in detected.iter().enumerate() {
            pairs.push(((joint.position - place).norm() * percent, index, other));
        }
    }
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let mut is_taken = vec![false; detected.len()];
    for &(distance, index, other) in &pairs {
        let joint = &mut true_joints[index];
        let is_free = joint.found.is_none() && !is_taken[other];
        if is_free && distance <= options.tolerance {
            is_taken[other] = true;
            (joint.found, joint.distance) = (Some(other), distance);
        }
    }
    for &(distance, index, _) in &pairs {
        let joint = &mut true_joints[index];
        if joint.found.is_none() {
            joint.distance = joint.distance.min(distance);
        }
    }
    let children = truth.children();
    let ends: Vec<Vec3> = (0..truth.n_joints())
        .filter(|&it| children[it].is_empty())
        .map(|it| truth.positions()[it])
        .collect();
    let is_at_end = |&it: &usize| {
        ends.iter().any(|end| (end - detected[it]).norm() * percent <= options.tolerance)
    };
    let (at_ends, wrong): (Vec<usize>, Vec<usize>) =
        (0..detected.len()).filter(|&it| !is_taken[it]).partition(is_at_end);
    let n_detected = detected.len() - at_ends.len();
    Ok(Detection { truth: true_joints, n_detected, wrong, at_ends })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rig() -> Skeleton {
        let names = ["hip", "knee", "ankle", "toe"].map(str::to_owned).to_vec();
        let positions = [0.0, 1.0, 2.0, 3.0].map(|it| Vec3::x() * it).to_vec();
        Skeleton::new(names, vec![None, Some(0), Some(1), Some(2)], positions).unwrap()
    }

    /// The knee at 60 degrees, the ankle at 10.
    fn bent() -> Vec<Vec3> {
        let at =
            |degrees: f64| Vec3::new(degrees.to_radians().cos(), degrees.to_radians().sin(), 0.0);
        let ankle = Vec3::x() + at(60.0);
        vec![Vec3::zeros(), Vec3::x(), ankle, ankle + at(70.0)]
    }

    #[test]
    fn only_what_moves_counts() {
        let options = DetectionOptions { min_angle: 15.0, tolerance: 2.0, height: 10.0 };
        let check = |detected: &[f64],
                     found: &[Option<usize>],
                     wrong: &[usize],
                     scores: [f64; 2]| {
            let places: Vec<Vec3> = detected.iter().map(|&it| Vec3::x() * it).collect();
            let res = joint_detection(&places, &rig(), &[bent()], &options).unwrap();
            assert_eq!(res.truth.iter().map(|it| it.name.as_str()).collect::<Vec<_>>(), ["knee"]);
            assert_eq!(res.truth.iter().map(|it| it.found).collect::<Vec<_>>(), found);
            assert_eq!((&res.wrong[..], [res.precision(), res.recall()]), (wrong, scores));
        };
        check(&[1.1], &[Some(0)], &[], [1.0, 1.0]);
        // The nearer of two; the other is wrong, as is one at a joint that does not move.
        check(&[1.15, 0.9, 2.0], &[Some(1)], &[0, 2], [1.0 / 3.0, 1.0]);
        check(&[1.3], &[None], &[0], [0.0, 0.0]);
        check(&[], &[None], &[], [1.0, 0.0]);
        // Nothing is known of the toe, at 3.
        check(&[1.0, 3.1], &[Some(0)], &[], [1.0, 1.0]);
        check(&[1.0, 3.3], &[Some(0)], &[1], [0.5, 1.0]);
        let lax = DetectionOptions { min_angle: 5.0, ..options };
        let both = joint_detection(&[], &rig(), &[bent()], &lax).unwrap();
        assert_eq!(both.truth.iter().map(|it| it.angle.round()).collect::<Vec<_>>(), [60.0, 10.0]);
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
        let options = DetectionOptions { min_angle: 15.0, tolerance: 2.0, height: 10.0 };
        let found = |axis: Vec3| {
            let res = joint_detection(&[], &rig, &[turned(axis)], &options).unwrap();
            res.truth.iter().map(|it| (it.name.clone(), it.angle)).collect::<Vec<_>>()
        };
        // The neck's direction counts a little for its end, too.
        let nodding = found(Vec3::x());
        assert!(nodding.len() == 1 && nodding[0].0 == "head", "{nodding:?}");
        assert!((nodding[0].1 - 40.0).abs() < 3.0, "{nodding:?}");
        assert_eq!(found(Vec3::y()), []);
    }
}
