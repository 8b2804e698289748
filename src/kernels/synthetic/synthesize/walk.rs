//! Walk cycles, in place (as on a treadmill).

use std::f64::consts::TAU;

use nalgebra::UnitQuaternion;

use super::{
    gait::{Plane, Step, plane, reach, turn_x},
    plan::SIDES,
    pose::Pose,
};
use crate::kernels::{
    geometry::mesh::Vec3,
    rigs::{clip::Clip, skeleton::Skeleton},
};

/// The frames of a cycle; the frame after the last is the first.
pub const N_FRAMES: usize = 30;

const FRAMES_PER_SECOND: f64 = 30.0;

/// Makes the walk cycle of a skeleton at rest.
pub fn walk(skeleton: &Skeleton) -> Clip {
    let biped = skeleton.joint("tail_1").is_none();
    let (mut rotations, mut translations) = (Vec::new(), Vec::new());
    for frame in 0..N_FRAMES {
        let phase = frame as f64 / N_FRAMES as f64;
        let pose =
            if biped { biped_pose(skeleton, phase) } else { quadruped_pose(skeleton, phase) };
        let (frame_rotations, frame_translations) = pose.local();
        rotations.extend(frame_rotations);
        translations.extend(frame_translations);
    }
    Clip {
        name: "walk".to_owned(),
        frames_per_second: FRAMES_PER_SECOND,
        n_joints: skeleton.n_joints(),
        rotations,
        translations,
    }
}

/// Heel first, flat, heel off, toe off, toes up again (radians about X).
const FOOT_PITCHES: [(f64, f64); 7] = [
    (0.0, -0.30),
    (0.10, 0.0),
    (0.36, 0.0),
    (0.60, 0.72),
    (0.74, 0.35),
    (0.90, -0.20),
    (1.0, -0.30),
];

/// A biped at a phase of its walk; the left heel touches the ground at 0, the right one at 0.5.
pub fn biped_pose(skeleton: &Skeleton, phase: f64) -> Pose<'_> {
    let mut pose = Pose::rest(skeleton);
    let at = |name: &str| skeleton.positions()[pose.joint(name)];
    let leg_length = at("left_up_leg").y - at("left_foot").y;
    let wave = (TAU * phase).cos();
    // Lowest while both feet are on the ground, highest in the middle of each step.
    let bob = -0.014 + 0.012 * (2.0 * TAU * (phase - 0.3)).cos();
    pose.shift(Vec3::y() * bob * leg_length);
    let yaw = -0.09 * wave;
    pose.turn("hips", Vec3::y(), yaw);
    for (joint, share) in [("spine", 0.6), ("chest", 0.6), ("upper_chest", 0.5), ("neck", -0.7)] {
        pose.turn(joint, Vec3::y(), -yaw * share);
    }
    pose.turn("spine", Vec3::x(), 0.04);
    pose.turn("head", Vec3::x(), -0.03);
    for (side, sign) in SIDES {
        let side_phase = if sign > 0.0 { phase } else { phase + 0.5 };
        swing_arm(&mut pose, side, sign, side_phase);
        step_biped(&mut pose, skeleton, side, side_phase, leg_length);
    }
    pose
}

/// Arms hang down and swing against the leg of their side.
fn swing_arm(pose: &mut Pose<'_>, side: &str, sign: f64, phase: f64) {
    let wave = (TAU * phase).cos();
    pose.turn(&format!("{side}shoulder"), Vec3::z(), -0.08 * sign);
    pose.turn(&format!("{side}arm"), Vec3::z(), -0.48 * sign);
    pose.turn(&format!("{side}arm"), Vec3::x(), 0.34 * wave + 0.04);
    pose.turn(&format!("{side}forearm"), Vec3::x(), -0.30 + 0.16 * wave);
}

fn step_biped(pose: &mut Pose<'_>, skeleton: &Skeleton, side: &str, phase: f64, leg_length: f64) {
    let joint = |name: &str| format!("{side}{name}");
    let rest = |name: &str| plane(skeleton.positions()[pose.joint(&joint(name))]);
    let (hip, knee, ankle, toe) = (rest("up_leg"), rest("leg"), rest("foot"), rest("toe"));
    let step = Step {
        ankle,
        heel: Plane::new(-ankle.x, -0.35 * (toe.y - ankle.y)),
        ball: Plane::new(-ankle.x, toe.y - ankle.y),
        stance: 0.6,
        travel: 0.66 * leg_length,
        lift: 0.07 * leg_length,
        pitches: &FOOT_PITCHES,
    };
    let hip_now = pose.world_from_joint()[pose.joint(&joint("up_leg"))].translation.vector;
    let angles = reach(plane(hip_now), step.ankle_at(phase), knee - hip, ankle - knee);
    let pitch = step.pitch(phase);
    // Toes stay on the ground while the heel rises, and straighten early in the swing.
    let straightened = (1.0 - 1.6 * step.swing(phase)).max(0.0);
    let toe_pitch = if pitch > 0.0 { pitch * (1.0 - straightened) } else { pitch };
    pose.orient(&joint("up_leg"), turn_x(angles[0]));
    pose.orient(&joint("leg"), turn_x(angles[1]));
    pose.orient(&joint("foot"), turn_x(pitch));
    pose.orient(&joint("toe"), turn_x(toe_pitch));
}

/// Hooves roll off over their tips and fold back in the swing.
const HOOF_PITCHES: [(f64, f64); 6] =
    [(0.0, 0.0), (0.45, 0.0), (0.64, 0.55), (0.76, 0.9), (0.94, -0.05), (1.0, 0.0)];

/// A quadruped at a phase of its walk: left hind, left front, right hind, right front, a quarter
/// of the cycle apart (a lateral sequence).
pub fn quadruped_pose(skeleton: &Skeleton, phase: f64) -> Pose<'_> {
    let mut pose = Pose::rest(skeleton);
    let height = skeleton.positions()[pose.joint("left_up_leg")].y;
    pose.shift(Vec3::y() * height * (-0.03 + 0.006 * (2.0 * TAU * phase).cos()));
    let wave = (TAU * phase).cos();
    let nod = (2.0 * TAU * (phase - 0.1)).cos();
    pose.turn("hips", Vec3::y(), -0.03 * wave);
    pose.turn("chest", Vec3::y(), 0.04 * wave);
    pose.turn("neck", Vec3::x(), 0.05 * nod + 0.06);
    pose.turn("upper_neck", Vec3::x(), 0.04 * nod + 0.04);
    pose.turn("head", Vec3::x(), -0.07 * nod - 0.04);
    for (joint, delay) in [("tail_1", 0.0), ("tail_2", 0.12), ("tail_3", 0.24), ("tail_4", 0.36)] {
        pose.turn(joint, Vec3::y(), 0.09 * (TAU * (phase - delay)).sin());
    }
    for (side, sign) in SIDES {
        let hind = if sign > 0.0 { phase } else { phase + 0.5 };
        step_hind(&mut pose, skeleton, side, hind, height);
        step_front(&mut pose, skeleton, side, hind - 0.25, height);
    }
    pose
}

/// A hoof's step: the fetlock plays the ankle, heel and ball are the middle of the hoof.
fn hoof_step(fetlock: Plane, height: f64) -> Step {
    let contact = Plane::new(-fetlock.x, 0.3 * fetlock.x);
    Step {
        ankle: fetlock,
        heel: contact,
        ball: contact,
        stance: 0.64,
        travel: 0.44 * height,
        lift: 0.045 * height,
        pitches: &HOOF_PITCHES,
    }
}

fn step_hind(pose: &mut Pose<'_>, skeleton: &Skeleton, side: &str, phase: f64, height: f64) {
    let joint = |name: &str| format!("{side}{name}");
    let rest = |name: &str| plane(skeleton.positions()[pose.joint(&joint(name))]);
    let [hip, stifle, hock, fetlock] = ["up_leg", "leg", "foot", "toe"].map(rest);
    let step = hoof_step(fetlock, height);
    let target = step.ankle_at(phase);
    let forward = (target.y - fetlock.y) / (0.5 * step.travel);
    let fold = (std::f64::consts::PI * step.swing(phase)).sin().powi(2);
    let cannon_angle = -0.26 * forward + 0.30 * fold;
    let cannon = turn_x(cannon_angle) * Vec3::new(0.0, fetlock.x - hock.x, fetlock.y - hock.y);
    let hip_now = pose.world_from_joint()[pose.joint(&joint("up_leg"))].translation.vector;
    let angles = reach(plane(hip_now), target - plane(cannon), stifle - hip, hock - stifle);
    pose.orient(&joint("up_leg"), turn_x(angles[0]));
    pose.orient(&joint("leg"), turn_x(angles[1]));
    pose.orient(&joint("foot"), turn_x(cannon_angle));
    pose.orient(&joint("toe"), turn_x(step.pitch(phase)));
}

fn step_front(pose: &mut Pose<'_>, skeleton: &Skeleton, side: &str, phase: f64, height: f64) {
    let joint = |name: &str| format!("{side}{name}");
    let rest = |name: &str| plane(skeleton.positions()[pose.joint(&joint(name))]);
    let [elbow, carpus, fetlock] = ["forearm", "hand", "fingers"].map(rest);
    let step = hoof_step(fetlock, height);
    let target = step.ankle_at(phase);
    let forward = (target.y - fetlock.y) / (0.5 * step.travel);
    let fold = (std::f64::consts::PI * step.swing(phase)).sin().powi(2);
    let body: UnitQuaternion<f64> = pose.world_from_joint()[pose.joint("upper_chest")].rotation;
    pose.orient(&joint("shoulder"), body * turn_x(-0.10 * forward));
    pose.orient(&joint("arm"), body * turn_x(-0.24 * forward - 0.10 * fold));
    let elbow_now = pose.world_from_joint()[pose.joint(&joint("forearm"))].translation.vector;
    let angles = reach(plane(elbow_now), target, carpus - elbow, fetlock - carpus);
    pose.orient(&joint("forearm"), turn_x(angles[0]));
    pose.orient(&joint("hand"), turn_x(angles[1]));
    pose.orient(&joint("fingers"), turn_x(step.pitch(phase)));
}
