//! Feet on a treadmill, and legs that follow them.
//!
//! Legs swing in planes of constant x: a turn about X keeps it, so two bones reach a point in such a
//! plane exactly.

use std::f64::consts::PI;

use nalgebra::{UnitQuaternion, Vector2};

use super::skin::smooth_step;
use crate::kernels::geometry::mesh::Vec3;

/// A point or direction in the plane of a leg: (y, z).
pub type Plane = Vector2<f64>;

pub fn plane(point: Vec3) -> Plane {
    Plane::new(point.y, point.z)
}

/// A turn about X. Positive angles lead what hangs down backwards and press toes down.
pub fn turn_x(angle_rad: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::new(Vec3::x() * angle_rad)
}

fn rotate(angle_rad: f64, it: Plane) -> Plane {
    let (sin, cos) = angle_rad.sin_cos();
    Plane::new(it.x * cos - it.y * sin, it.x * sin + it.y * cos)
}

/// The angle from straight down towards the front.
fn forward_angle(it: Plane) -> f64 {
    it.y.atan2(-it.x)
}

/// How one foot moves through a cycle, relative to the body.
#[derive(Debug, Clone)]
pub struct Step {
    /// The ankle at rest.
    pub ankle: Plane,
    /// From the ankle to where the heel and the ball of the foot touch the ground, at rest.
    pub heel: Plane,
    pub ball: Plane,
    /// The part of the cycle in which the foot is on the ground.
    pub stance: f64,
    /// How far the ground moves backwards in that time.
    pub travel: f64,
    /// How much higher the ankle goes in the middle of the swing.
    pub lift: f64,
    /// (phase, angle about X) of the foot, through which it moves smoothly.
    pub pitches: &'static [(f64, f64)],
}

impl Step {
    /// The foot's angle about X at a phase.
    pub fn pitch(&self, phase: f64) -> f64 {
        let phase = phase.rem_euclid(1.0);
        let after = self.pitches.partition_point(|it| it.0 <= phase).min(self.pitches.len() - 1);
        let ((start, from), (end, to)) = (self.pitches[after - 1], self.pitches[after]);
        from + (to - from) * smooth_step((phase - start) / (end - start))
    }

    /// How far through the swing a phase is, from 0 to 1; 0 while the foot is on the ground.
    pub fn swing(&self, phase: f64) -> f64 {
        ((phase.rem_euclid(1.0) - self.stance) / (1.0 - self.stance)).max(0.0)
    }

    /// Where the ankle is at a phase; phase 0 is when the foot touches the ground in front.
    pub fn ankle_at(&self, phase: f64) -> Plane {
        let swing = self.swing(phase);
        if swing == 0.0 {
            return self.ankle_on_ground(phase.rem_euclid(1.0), self.pitch(phase));
        }
        let from = self.ankle_on_ground(self.stance, self.pitch(self.stance));
        let to = self.ankle_on_ground(0.0, self.pitch(0.0));
        // The foot leaves and meets the ground at the speed of the ground.
        let speed = Plane::new(0.0, -self.travel / self.stance * (1.0 - self.stance));
        let w = swing;
        let middle = (1.0 + 2.0 * w) * (1.0 - w).powi(2) * from + w * w * (3.0 - 2.0 * w) * to;
        let slopes = (w * (1.0 - w).powi(2) + w * w * (w - 1.0)) * speed;
        middle + slopes + Plane::new(self.lift * (PI * w).sin().powi(2), 0.0)
    }

    /// The foot rolls over its heel while its toes are up, over its ball while they are down.
    fn ankle_on_ground(&self, phase: f64, pitch: f64) -> Plane {
        let pivot = if pitch < 0.0 { self.heel } else { self.ball };
        let moved = self.travel * (0.5 - phase / self.stance);
        let contact = self.ankle + pivot + Plane::new(0.0, moved);
        contact - rotate(pitch, pivot)
    }
}

/// The angles about X at which two bones, given at rest, lead from `from` to `to`; the joint between
/// them bends forward. Targets out of reach are approached as far as possible.
pub fn reach(from: Plane, to: Plane, upper: Plane, lower: Plane) -> [f64; 2] {
    let (a, b) = (upper.norm(), lower.norm());
    let way = to - from;
    let distance = way.norm().clamp((a - b).abs() * 1.001, (a + b) * 0.9999);
    let opening = ((a * a + distance * distance - b * b) / (2.0 * a * distance)).acos();
    let upper_angle = forward_angle(way) + opening;
    let knee = from + a * Plane::new(-upper_angle.cos(), upper_angle.sin());
    let end = from + way.normalize() * distance;
    [forward_angle(upper) - upper_angle, forward_angle(lower) - forward_angle(end - knee)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_bones_reach_their_target() {
        let (from, upper, lower) =
            (Plane::new(1.0, 0.1), Plane::new(-0.4, 0.05), Plane::new(-0.5, -0.1));
        for to in [Plane::new(0.2, 0.3), Plane::new(0.4, -0.2)] {
            let [first, second] = reach(from, to, upper, lower);
            let knee = from + rotate(first, upper);
            let end = knee + rotate(second, lower);
            assert!((end - to).norm() < 1e-12);
            assert!(knee.y > from.lerp(&to, 0.5).y, "the knee is in front");
        }
    }

    #[test]
    fn a_foot_on_the_ground_moves_with_the_ground() {
        let step = Step {
            ankle: Plane::new(0.1, 0.0),
            heel: Plane::new(-0.1, -0.05),
            ball: Plane::new(-0.1, 0.12),
            stance: 0.6,
            travel: 0.6,
            lift: 0.1,
            pitches: &[(0.0, 0.0), (1.0, 0.0)],
        };
        let moved = step.ankle_at(0.5) - step.ankle_at(0.1);
        assert!((moved - Plane::new(0.0, -0.4)).norm() < 1e-12);
        let (before, after) = (step.ankle_at(0.6 - 1e-6), step.ankle_at(0.6 + 1e-6));
        assert!((before - after).norm() < 1e-4);
        assert!(step.ankle_at(0.8).x > 0.19);
    }
}
