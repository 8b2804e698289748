//! How well detected joints agree with those that really move.

use super::moving_joints::{Moving, MovingJoint};
use crate::kernels::geometry::mesh::Vec3;

/// What counts as found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DetectionOptions {
    /// A detected joint is a true one if it is as near as this, in percent of the height.
    pub tolerance: f64,
    /// In the unit of positions.
    pub height: f64,
}

/// A true joint.
#[derive(Debug, Clone, PartialEq)]
pub struct TrueJoint {
    pub joint: MovingJoint,
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
    /// Without those that are not judged.
    pub n_detected: usize,
    /// Detected joints that are none.
    pub wrong: Vec<usize>,
    /// Detected joints where it is not known whether there is one that moves.
    pub unknown: Vec<usize>,
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

/// Holds detected joints against the joints of a rig that move, in the pose of the detected positions.
///
/// Pairs are made from the nearest on, each joint is in one at most. What is detected where nothing is known is
/// neither right nor wrong.
pub fn joint_detection(detected: &[Vec3], moving: Moving, options: &DetectionOptions) -> Detection {
    let percent = 100.0 / options.height;
    let mut truth: Vec<TrueJoint> = moving
        .joints
        .into_iter()
        .map(|joint| TrueJoint { joint, found: None, distance: f64::INFINITY })
        .collect();
    let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
    for (index, it) in truth.iter().enumerate() {
        for (other, place) in detected.iter().enumerate() {
            pairs.push(((it.joint.position - place).norm() * percent, index, other));
        }
    }
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let mut is_taken = vec![false; detected.len()];
    for &(distance, index, other) in &pairs {
        let joint = &mut truth[index];
        let is_free = joint.found.is_none() && !is_taken[other];
        if is_free && distance <= options.tolerance {
            is_taken[other] = true;
            (joint.found, joint.distance) = (Some(other), distance);
        }
    }
    for &(distance, index, _) in &pairs {
        let joint = &mut truth[index];
        if joint.found.is_none() {
            joint.distance = joint.distance.min(distance);
        }
    }
    let is_unknown = |&it: &usize| {
        let near = |place: &Vec3| (place - detected[it]).norm() * percent <= options.tolerance;
        moving.unknown.iter().any(near)
    };
    let (unknown, wrong): (Vec<usize>, Vec<usize>) =
        (0..detected.len()).filter(|&it| !is_taken[it]).partition(is_unknown);
    Detection { truth, n_detected: detected.len() - unknown.len(), wrong, unknown }
}

#[cfg(test)]
mod tests {
    use super::super::moving_joints::tests::{bent, rig};
    use super::*;

    #[test]
    fn only_what_moves_counts() {
        let options = DetectionOptions { tolerance: 2.0, height: 10.0 };
        let moving = |min_angle| Moving::by_places(&rig(), &[bent()], min_angle).unwrap();
        let check =
            |detected: &[f64], found: &[Option<usize>], wrong: &[usize], scores: [f64; 2]| {
                let places: Vec<Vec3> = detected.iter().map(|&it| Vec3::x() * it).collect();
                let res = joint_detection(&places, moving(15.0), &options);
                let names: Vec<&str> = res.truth.iter().map(|it| it.joint.name.as_str()).collect();
                assert_eq!(names, ["knee"]);
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
        let angles: Vec<f64> = moving(5.0).joints.iter().map(|it| it.angle.round()).collect();
        assert_eq!(angles, [60.0, 10.0]);
    }
}
