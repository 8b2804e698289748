//! The body plan of a four-legged animal, between dog and horse.

use super::{
    loft::{Loft, Station},
    plan::{Aim, Joints, Plan, SIDES},
    proportions::Proportions,
    surface::{Limb, Part, Surface},
};
use crate::kernels::geometry::mesh::Vec3;

/// The height at the withers of a quadruped whose factor is 1, in metres.
pub const HEIGHT: f64 = 1.3;

/// The height of the withers of the nominal body, on which all measures below are given.
const NOMINAL_WITHERS: f64 = 1.42;

/// Builds a standing quadruped: 32 joints, feet on the ground, facing +Z, in metres.
pub fn quadruped(proportions: &Proportions) -> Plan {
    let withers = NOMINAL_WITHERS + 0.9 * (proportions.legs - 1.0);
    Frame { p: proportions, scale: HEIGHT * proportions.height / withers }.build()
}

/// The measures of one body.
struct Frame<'a> {
    p: &'a Proportions,
    scale: f64,
}

impl Frame<'_> {
    /// From nominal measures: what is below 1 m belongs to the legs.
    fn at(&self, x: f64, y: f64, z: f64) -> Vec3 {
        let y =
            if y < 0.1 { y } else { 0.1 + (y - 0.1).min(0.9) * self.p.legs + (y - 1.0).max(0.0) };
        self.scale * Vec3::new(x, y, z * self.p.torso)
    }

    fn girth(&self, radius: f64) -> f64 {
        self.scale * self.p.girth * radius
    }

    fn limb_girth(&self, radius: f64) -> f64 {
        // Dogs have sturdier legs for their size.
        self.scale * self.p.limb_girth * radius * (1.15 - 0.2 * self.p.hoofed)
    }

    /// Where the neck begins, its direction, and its length.
    fn neck(&self, along: f64) -> Vec3 {
        let length = 0.60 * self.p.neck * (0.8 + 0.25 * self.p.hoofed);
        let direction = Vec3::new(0.0, 0.78, 0.63).normalize();
        self.at(0.0, 1.30, 0.50) + self.scale * length * along * direction
    }

    fn head_direction(&self) -> Vec3 {
        Vec3::new(0.0, -0.50 - 0.15 * self.p.hoofed, 0.82).normalize()
    }

    /// On the head: along it from the poll to the nose, towards the forehead, to the side.
    fn head(&self, along: f64, up: f64, side: f64) -> Vec3 {
        let direction = self.head_direction();
        let forehead = Vec3::new(0.0, direction.z, -direction.y);
        self.neck(1.0)
            + self.scale * self.p.head * (direction * along * self.p.muzzle.sqrt() + forehead * up)
            + self.scale * self.p.head * Vec3::x() * side
    }

    fn tail(&self, along: f64) -> Vec3 {
        // Leaves the rump backwards and bends down; dogs carry it higher.
        let lift = 0.10 * (1.0 - self.p.hoofed);
        let length = along * self.p.tail;
        self.at(0.0, 1.30, -0.66)
            + self.scale
                * Vec3::new(
                    0.0,
                    -0.55 * length * length.min(1.0) + lift * length - 0.12 * length,
                    -0.30 * length + 0.08 * length * length,
                )
    }

    fn build(&self) -> Plan {
        let mut joints = Joints::default();
        let hips = joints.add("hips", None, self.at(0.0, 1.22, -0.42));
        let spine = joints.chain(
            "",
            hips,
            &[
                ("spine", self.at(0.0, 1.23, -0.16)),
                ("chest", self.at(0.0, 1.22, 0.10)),
                ("upper_chest", self.at(0.0, 1.24, 0.34)),
                ("neck", self.neck(0.10)),
                ("upper_neck", self.neck(0.55)),
                ("head", self.neck(0.98)),
            ],
        );
        let back = [hips, spine[0], spine[1], spine[2]];
        let ears = SIDES.map(|(side, sign)| {
            joints.add(format!("{side}ear"), Some(spine[5]), self.ear(sign, 0.05))
        });
        let tail_joints: Vec<(String, Vec3)> =
            (1..=5).map(|k| (format!("tail_{k}"), self.tail(0.2 * f64::from(k) - 0.15))).collect();
        let tail_joints: Vec<(&str, Vec3)> =
            tail_joints.iter().map(|(name, at)| (name.as_str(), *at)).collect();
        let tail = joints.chain("", hips, &tail_joints);
        let front =
            SIDES.map(|(side, sign)| joints.chain(side, spine[2], &self.front_joints(sign)));
        let hind = SIDES.map(|(side, sign)| joints.chain(side, hips, &self.hind_joints(sign)));
        let mut core = vec![self.barrel(&joints, &back)];
        core.extend(self.neck_and_head(&joints, &spine[2..]));
        let mut limbs = vec![self.tail_limb(&joints, hips, &tail)];
        for (k, (_, sign)) in SIDES.iter().enumerate() {
            core.push(self.ear_part(&joints, *sign, spine[5], ears[k]));
            limbs.push(self.front_leg(&joints, *sign, &front[k]));
            limbs.push(self.hind_leg(&joints, *sign, &hind[k]));
        }
        Plan {
            skeleton: joints.finish(),
            surface: Surface { core, limbs },
            landmarks: self.landmarks(),
        }
    }

    fn landmarks(&self) -> Vec<Aim> {
        let aim = |name, from, direction| Aim { name, from, direction };
        let hoof = |sign: f64, z: f64| self.at(sign * self.leg_x(), 0.04, z);
        vec![
            aim("head_top", self.head(0.02, 0.0, 0.0), Vec3::y()),
            aim("hand_left", hoof(1.0, 0.40), Vec3::z()),
            aim("hand_right", hoof(-1.0, 0.40), Vec3::z()),
            aim("foot_left", hoof(1.0, -0.54), Vec3::z()),
            aim("foot_right", hoof(-1.0, -0.54), Vec3::z()),
            aim("chest_front", self.at(0.0, 1.16, 0.45), Vec3::z()),
            aim("chest_back", self.at(0.0, 1.22, 0.32), Vec3::y()),
            aim("nose", self.head(0.32, -0.006, 0.0), self.head_direction()),
            aim("tail_tip", self.tail(0.95), self.tail(1.0) - self.tail(0.9)),
        ]
    }

    /// From rump to breast, sections upright: along, height, side, up, down.
    fn barrel(&self, joints: &Joints, back: &[usize]) -> Part {
        let (hips, shoulders) = (self.p.hips, self.p.shoulders);
        let belly = self.p.waist;
        let rows = [
            (-0.66, 1.200, 0.120 * hips, 0.115, 0.150),
            (-0.54, 1.200, 0.195 * hips, 0.180, 0.190),
            (-0.38, 1.200, 0.215 * hips, 0.190, 0.215),
            (-0.10, 1.180, 0.215 * belly, 0.175, 0.240 * belly),
            (0.15, 1.170, 0.222, 0.190, 0.265),
            (0.34, 1.180, 0.195 * shoulders, 0.232, 0.260),
            (0.49, 1.185, 0.155 * shoulders, 0.180, 0.215),
            (0.58, 1.180, 0.105 * shoulders, 0.115, 0.150),
        ];
        let station = |&(z, y, side, up, down): &(f64, f64, f64, f64, f64)| Station {
            centre: self.at(0.0, y, z),
            side: self.girth(side),
            front: self.girth(up),
            back: self.girth(down),
        };
        let caps = [self.girth(0.07), self.girth(0.06)];
        let loft = Loft::new(rows.iter().map(station).collect(), Vec3::y(), caps);
        let moved_by: Vec<_> = back.iter().map(|&it| (it, 0.11 * self.scale)).collect();
        joints.part(loft, 0.0, &moved_by)
    }

    fn neck_and_head(&self, joints: &Joints, bones: &[usize]) -> Vec<Part> {
        let r = |radius: f64| self.girth(radius);
        // Along, side, throat, crest.
        let rows = [
            (-0.25, 0.115, 0.190, 0.190),
            (0.10, 0.100, 0.165, 0.160),
            (0.45, 0.078, 0.120, 0.115),
            (0.80, 0.064, 0.090, 0.090),
            (1.00, 0.060, 0.080, 0.080),
        ];
        let station = |&(along, side, throat, crest): &(f64, f64, f64, f64)| Station {
            centre: self.neck(along),
            side: r(side),
            front: r(throat),
            back: r(crest),
        };
        let neck = Loft::new(rows.iter().map(station).collect(), Vec3::z(), [r(0.06), r(0.05)]);
        let size = self.scale * self.p.head;
        // Along, towards the forehead, side, forehead, jaw.
        let rows = [
            (-0.01, 0.000, 0.064, 0.062, 0.085),
            (0.09, 0.002, 0.078, 0.068, 0.115),
            (0.18, 0.000, 0.068, 0.064, 0.100),
            (0.28, -0.004, 0.052, 0.054, 0.066),
            (0.36, -0.008, 0.051, 0.050, 0.056),
            (0.41, -0.010, 0.050, 0.047, 0.054),
        ];
        let station = |&(along, up, side, forehead, jaw): &(f64, f64, f64, f64, f64)| Station {
            centre: self.head(along, up, 0.0),
            side: size * side,
            front: size * forehead,
            back: size * jaw,
        };
        let skull = Loft::new(
            rows.iter().map(station).collect(),
            Vec3::new(0.0, 1.0, 1.0),
            [size * 0.04, size * 0.042],
        );
        let s = self.scale;
        let neck_bones =
            [(bones[0], 0.0), (bones[1], 0.09 * s), (bones[2], 0.09 * s), (bones[3], 0.06 * s)];
        vec![
            joints.part(neck, 0.16 * s, &neck_bones),
            joints.part(skull, 0.05 * s, &[(bones[3], 0.0)]),
        ]
    }

    fn ear(&self, sign: f64, along: f64) -> Vec3 {
        let root = self.head(0.005, 0.045, sign * 0.040);
        let direction = Vec3::new(sign * 0.28, 0.95, 0.05);
        root + direction * (0.15 * along * self.p.ears * self.p.head * self.scale)
    }

    fn ear_part(&self, joints: &Joints, sign: f64, head: usize, ear: usize) -> Part {
        let size = self.scale * self.p.head * self.p.ears.sqrt();
        let rows =
            [(-0.1, 0.026, 0.020), (0.35, 0.030, 0.017), (0.75, 0.020, 0.013), (1.0, 0.010, 0.009)];
        let stations = rows.map(|(along, side, depth)| {
            Station::oval(self.ear(sign, along), size * side, size * depth)
        });
        let loft = Loft::new(stations.to_vec(), Vec3::z(), [size * 0.015, size * 0.012]);
        joints.part(loft, 0.025 * size, &[(head, 0.0), (ear, 0.02 * self.scale)])
    }

    fn tail_limb(&self, joints: &Joints, hips: usize, tail: &[usize]) -> Limb {
        let bushy = 1.3 - 0.3 * self.p.hoofed;
        let rows = [
            (-0.15, 0.045),
            (0.05, 0.040),
            (0.30, 0.034),
            (0.60, 0.036),
            (0.85, 0.028),
            (1.0, 0.016),
        ];
        let stations = rows.map(|(along, radius)| {
            let centre = if along < 0.0 { self.at(0.0, 1.30, -0.60) } else { self.tail(along) };
            Station::round(centre, self.scale * radius * bushy)
        });
        let loft = Loft::new(stations.to_vec(), Vec3::x(), [0.04 * self.scale, 0.016 * self.scale]);
        let mut moved_by = vec![(hips, 0.0)];
        moved_by.extend(tail.iter().map(|&it| (it, 0.05 * self.scale)));
        Limb { parts: vec![joints.part(loft, 0.0, &moved_by)], blend: 0.06 * self.scale }
    }

    /// How far a leg is from the middle; left and right legs never touch.
    fn leg_x(&self) -> f64 {
        (0.095 * self.p.limb_girth * (1.15 - 0.2 * self.p.hoofed)).max(0.128)
    }

    fn front_joints(&self, sign: f64) -> [(&'static str, Vec3); 5] {
        let x = sign * self.leg_x();
        [
            ("shoulder", self.at(0.75 * x, 1.30, 0.32)),
            ("arm", self.at(x, 1.06, 0.48)),
            ("forearm", self.at(x, 0.87, 0.355)),
            ("hand", self.at(x, 0.47, 0.385)),
            ("fingers", self.at(x, 0.145, 0.375)),
        ]
    }

    fn front_leg(&self, joints: &Joints, sign: f64, bones: &[usize]) -> Limb {
        let x = self.leg_x();
        // Across, height, along, side, front, back.
        let rows = [
            (0.80 * x, 1.240, 0.375, 0.070, 0.100, 0.110),
            (1.00 * x, 1.060, 0.430, 0.074, 0.105, 0.115),
            (1.02 * x, 0.890, 0.385, 0.062, 0.078, 0.085),
            (1.00 * x, 0.730, 0.382, 0.048, 0.056, 0.056),
            (1.00 * x, 0.560, 0.385, 0.037, 0.042, 0.042),
            (1.00 * x, 0.475, 0.387, 0.038, 0.042, 0.041),
            (1.00 * x, 0.400, 0.383, 0.031, 0.034, 0.035),
            (1.00 * x, 0.270, 0.378, 0.027, 0.029, 0.031),
            (1.00 * x, 0.150, 0.374, 0.033, 0.034, 0.036),
            (1.00 * x, 0.085, 0.394, 0.033, 0.034, 0.034),
        ];
        let softness = [0.0, 0.09, 0.08, 0.05, 0.03];
        let parts = vec![
            self.leg_part(joints, sign, &rows, bones, &softness),
            self.hoof(joints, sign, 0.394, bones[4]),
        ];
        Limb { parts, blend: 0.10 * self.scale }
    }

    fn hind_joints(&self, sign: f64) -> [(&'static str, Vec3); 4] {
        let x = sign * self.leg_x();
        [
            ("up_leg", self.at(x, 1.14, -0.50)),
            ("leg", self.at(1.1 * x, 0.87, -0.36)),
            ("foot", self.at(x, 0.545, -0.59)),
            ("toe", self.at(x, 0.145, -0.565)),
        ]
    }

    fn hind_leg(&self, joints: &Joints, sign: f64, bones: &[usize]) -> Limb {
        let x = self.leg_x();
        let rows = [
            (0.90 * x, 1.160, -0.470, 0.085, 0.150, 0.140),
            (1.10 * x, 1.000, -0.430, 0.086, 0.125, 0.150),
            (1.12 * x, 0.860, -0.430, 0.070, 0.100, 0.115),
            (1.05 * x, 0.710, -0.500, 0.049, 0.062, 0.064),
            (1.00 * x, 0.600, -0.565, 0.038, 0.045, 0.048),
            (1.00 * x, 0.540, -0.592, 0.038, 0.043, 0.048),
            (1.00 * x, 0.450, -0.588, 0.033, 0.037, 0.040),
            (1.00 * x, 0.290, -0.575, 0.029, 0.032, 0.033),
            (1.00 * x, 0.150, -0.566, 0.034, 0.035, 0.037),
            (1.00 * x, 0.085, -0.546, 0.034, 0.035, 0.035),
        ];
        let softness = [0.0, 0.10, 0.06, 0.03];
        let parts = vec![
            self.leg_part(joints, sign, &rows, bones, &softness),
            self.hoof(joints, sign, -0.546, bones[3]),
        ];
        Limb { parts, blend: 0.09 * self.scale }
    }

    fn leg_part(
        &self,
        joints: &Joints,
        sign: f64,
        rows: &[(f64, f64, f64, f64, f64, f64)],
        bones: &[usize],
        softness: &[f64],
    ) -> Part {
        let station = |&(x, y, z, side, front, back): &(f64, f64, f64, f64, f64, f64)| Station {
            centre: self.at(sign * x, y, z),
            side: self.limb_girth(side),
            front: self.limb_girth(front),
            back: self.limb_girth(back),
        };
        let caps = [self.limb_girth(0.07), self.limb_girth(0.02)];
        let loft = Loft::new(rows.iter().map(station).collect(), Vec3::z(), caps);
        let moved_by: Vec<_> =
            bones.iter().zip(softness).map(|(&joint, &it)| (joint, it * self.scale)).collect();
        joints.part(loft, 0.0, &moved_by)
    }

    /// A hoof, or a paw that reaches farther forward.
    fn hoof(&self, joints: &Joints, sign: f64, z: f64, joint: usize) -> Part {
        let x = sign * self.leg_x();
        let paw = 0.05 * (1.0 - self.p.hoofed);
        let stations = vec![
            Station::oval(self.at(x, 0.085, z), self.limb_girth(0.036), self.limb_girth(0.038)),
            Station {
                centre: self.at(x, 0.010, z + 0.02),
                side: self.limb_girth(0.048),
                front: self.limb_girth(0.050 + paw),
                back: self.limb_girth(0.048),
            },
        ];
        let loft = Loft::new(stations, Vec3::z(), [0.02 * self.scale, 0.05 * self.scale]);
        joints.part(loft, 0.02 * self.scale, &[(joint, 0.0)])
    }
}
