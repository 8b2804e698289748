//! The body plan of a human being.

use super::{
    loft::{Loft, Station},
    plan::{Aim, Joints, Plan, SIDES, blob},
    proportions::Proportions,
    surface::{Limb, Part, Surface},
};
use crate::kernels::geometry::mesh::Vec3;

/// The height of a biped whose factor is 1, in metres.
pub const HEIGHT: f64 = 1.75;

/// How far arms hang below the horizontal at rest (an A-pose).
const ARM_SLOPE_RAD: f64 = 0.80;

/// The height of the hip joints of the nominal body, on which all measures below are given.
const NOMINAL_HIP: f64 = 0.92;

/// Builds a biped in A-pose: 22 joints, feet on the ground, facing +Z, in metres.
pub fn biped(proportions: &Proportions) -> Plan {
    let nominal = Frame::new(proportions, 1.0);
    // The head's top follows from all other measures; scaling them by it makes the height exact.
    Frame::new(proportions, HEIGHT * proportions.height / nominal.head_top()).build()
}

/// The measures of one body.
struct Frame<'a> {
    p: &'a Proportions,
    scale: f64,
}

impl<'a> Frame<'a> {
    fn new(p: &'a Proportions, scale: f64) -> Self {
        Self { p, scale }
    }

    /// The height of the hip joints before scaling.
    fn hip(&self) -> f64 {
        0.08 + (NOMINAL_HIP - 0.08) * self.p.legs
    }

    /// From nominal measures on the torso.
    fn torso(&self, x: f64, y: f64, z: f64) -> Vec3 {
        self.scale * Vec3::new(x, self.hip() + (y - NOMINAL_HIP) * self.p.torso, z)
    }

    /// From nominal measures on the legs.
    fn leg(&self, x: f64, y: f64, z: f64) -> Vec3 {
        let y = if y > 0.08 { 0.08 + (y - 0.08) * self.p.legs } else { y };
        self.scale * Vec3::new(x, y, z)
    }

    /// From nominal measures on the head, which turns around the end of the neck.
    fn head(&self, x: f64, y: f64, z: f64) -> Vec3 {
        let offset = Vec3::new(x, y, z) - Vec3::new(0.0, 1.56, 0.012);
        self.torso(0.0, 1.56, 0.012) + self.scale * self.p.head * offset
    }

    fn head_top(&self) -> f64 {
        self.head(0.0, 1.75, 0.0).y
    }

    fn build(&self) -> Plan {
        let mut joints = Joints::default();
        let hips = joints.add("hips", None, self.torso(0.0, 0.96, -0.005));
        let spine = joints.chain(
            "",
            hips,
            &[
                ("spine", self.torso(0.0, 1.06, -0.01)),
                ("chest", self.torso(0.0, 1.18, -0.015)),
                ("upper_chest", self.torso(0.0, 1.31, -0.02)),
                ("neck", self.torso(0.0, 1.46, -0.018)),
                ("head", self.torso(0.0, 1.56, 0.005)),
            ],
        );
        let sides = SIDES.map(|(prefix, sign)| {
            let arm = joints.chain(prefix, spine[2], &self.arm_joints(sign));
            let leg = joints.chain(prefix, hips, &self.leg_joints(sign));
            (sign, arm, leg)
        });
        let mut core = self.trunk(&joints, &[&[hips], &spine[..]].concat());
        core.extend(self.face(&joints, spine[4]));
        let mut limbs = Vec::new();
        let mut hands = Vec::new();
        let mut feet = Vec::new();
        for (sign, arm, leg) in &sides {
            limbs.push(self.arm(&joints, *sign, arm));
            limbs.push(self.leg_limb(&joints, *sign, leg));
            hands.push((joints.position(arm[3]), self.arm_direction(*sign)));
            feet.push(joints.position(leg[3]));
        }
        let aim = |name, from, direction| Aim { name, from, direction };
        let chest = self.torso(0.0, 1.31, -0.01);
        let landmarks = vec![
            aim("head_top", self.head(0.0, 1.66, -0.005), Vec3::y()),
            aim("hand_left", hands[0].0, hands[0].1),
            aim("hand_right", hands[1].0, hands[1].1),
            aim("foot_left", feet[0], Vec3::new(0.05, -0.1, 1.0)),
            aim("foot_right", feet[1], Vec3::new(-0.05, -0.1, 1.0)),
            aim("chest_front", chest, Vec3::z()),
            aim("chest_back", chest, -Vec3::z()),
        ];
        Plan { skeleton: joints.finish(), surface: Surface { core, limbs }, landmarks }
    }

    fn girth(&self, radius: f64) -> f64 {
        self.scale * self.p.girth * radius
    }

    fn limb_girth(&self, radius: f64) -> f64 {
        self.scale * self.p.limb_girth * radius
    }

    /// Torso and neck are given from the crotch to the throat: height, middle, side, front, back.
    fn trunk(&self, joints: &Joints, spine: &[usize]) -> Vec<Part> {
        let (hips, shoulders, waist) = (self.p.hips, self.p.shoulders, self.p.waist);
        let bust = self.p.bust;
        let rows = [
            (0.845, -0.010, 0.105 * hips, 0.075, 0.085),
            (0.900, -0.008, 0.158 * hips, 0.095, 0.112),
            (0.970, -0.004, 0.162 * hips, 0.102, 0.108),
            (1.060, 0.002, 0.136 * waist, 0.100 * waist, 0.086),
            (1.110, 0.000, 0.128 * waist, 0.096 * waist, 0.080),
            (1.190, -0.004, 0.142, 0.106, 0.092),
            (1.280, -0.008, 0.160 * shoulders, 0.112 + 0.02 * bust, 0.108),
            (1.350, -0.014, 0.160 * shoulders, 0.098, 0.108),
            (1.410, -0.018, 0.120 * shoulders, 0.068, 0.084),
            (1.450, -0.018, 0.078 * shoulders, 0.050, 0.060),
        ];
        let station = |&(y, z, side, front, back): &(f64, f64, f64, f64, f64)| Station {
            centre: self.torso(0.0, y, z),
            side: self.girth(side),
            front: self.girth(front),
            back: self.girth(back),
        };
        let caps = [self.girth(0.05), self.girth(0.03)];
        let torso = Loft::new(rows.iter().map(station).collect(), Vec3::z(), caps);
        let neck_radius = |it: f64| self.scale * it * (0.5 + 0.5 * self.p.girth);
        let neck = Loft::new(
            vec![
                Station::round(self.torso(0.0, 1.430, -0.022), neck_radius(0.064)),
                Station::round(self.torso(0.0, 1.490, -0.014), neck_radius(0.054)),
                Station::round(self.torso(0.0, 1.540, -0.004), neck_radius(0.053)),
                Station::round(self.torso(0.0, 1.600, 0.006), neck_radius(0.055)),
            ],
            Vec3::z(),
            [self.scale * 0.04; 2],
        );
        let softness = 0.06 * self.scale;
        let moved_by: Vec<_> = spine[..4].iter().map(|&it| (it, softness)).collect();
        let neck_moved_by: Vec<_> = spine[3..].iter().map(|&it| (it, 0.7 * softness)).collect();
        let mut parts = vec![
            joints.part(torso, 0.0, &moved_by),
            joints.part(neck, 0.05 * self.scale, &neck_moved_by),
        ];
        for (_, sign) in SIDES {
            let centre = self.torso(sign * 0.075 * hips, 0.895, -0.062);
            let seat = blob(centre, Vec3::y(), self.girth(0.068), self.scale * 0.05);
            parts.push(joints.part(seat, 0.05 * self.scale, &[(spine[0], softness)]));
            let centre = self.torso(sign * 0.072, 1.290, 0.048 + 0.012 * bust);
            let breast =
                blob(centre, Vec3::x(), self.girth(0.046 + 0.012 * bust), 0.03 * self.scale);
            parts.push(joints.part(breast, 0.05 * self.scale, &[(spine[2], softness)]));
        }
        parts
    }

    /// The skull with jaw, nose and ears: height, middle, side, front, back.
    fn face(&self, joints: &Joints, head: usize) -> Vec<Part> {
        let size = self.scale * self.p.head;
        let rows = [
            (1.552, 0.030, 0.042, 0.052, 0.050),
            (1.585, 0.018, 0.058, 0.078, 0.066),
            (1.625, 0.010, 0.068, 0.088, 0.084),
            (1.665, 0.004, 0.075, 0.090, 0.098),
            (1.695, 0.000, 0.072, 0.082, 0.094),
        ];
        let station = |&(y, z, side, front, back): &(f64, f64, f64, f64, f64)| Station {
            centre: self.head(0.0, y, z),
            side: size * side,
            front: size * front,
            back: size * back,
        };
        let skull =
            Loft::new(rows.iter().map(station).collect(), Vec3::z(), [size * 0.022, size * 0.055]);
        let nose = Loft::new(
            vec![
                Station::round(self.head(0.0, 1.655, 0.086), size * 0.009),
                Station::round(self.head(0.0, 1.618, 0.104), size * 0.012),
            ],
            Vec3::z(),
            [size * 0.008, size * 0.010],
        );
        let moved_by = [(head, 0.01)];
        let mut parts = vec![
            joints.part(skull, 0.03 * size, &moved_by),
            joints.part(nose, 0.018 * size, &moved_by),
        ];
        for (_, sign) in SIDES {
            let ear = Loft::new(
                vec![
                    Station::oval(
                        self.head(sign * 0.074, 1.605, -0.004),
                        size * 0.008,
                        size * 0.012,
                    ),
                    Station::oval(
                        self.head(sign * 0.081, 1.645, -0.012),
                        size * 0.009,
                        size * 0.020,
                    ),
                ],
                Vec3::z(),
                [size * 0.010; 2],
            );
            parts.push(joints.part(ear, 0.012 * size, &moved_by));
        }
        parts
    }

    fn arm_direction(&self, sign: f64) -> Vec3 {
        Vec3::new(sign * ARM_SLOPE_RAD.cos(), -ARM_SLOPE_RAD.sin(), 0.0)
    }

    fn shoulder(&self, sign: f64) -> Vec3 {
        self.torso(sign * 0.172 * self.p.shoulders, 1.405, -0.018)
    }

    /// A point at a nominal distance from the shoulder down the arm; elbows point back a little.
    fn on_arm(&self, sign: f64, distance: f64, forward: f64) -> Vec3 {
        let bend = if distance > 0.285 { 0.10 * (distance - 0.285) } else { 0.0 };
        self.shoulder(sign)
            + self.scale * self.p.arms * distance * self.arm_direction(sign)
            + self.scale * Vec3::z() * (forward + bend)
    }

    fn arm_joints(&self, sign: f64) -> [(&'static str, Vec3); 4] {
        [
            ("shoulder", self.torso(sign * 0.035, 1.405, -0.010)),
            ("arm", self.shoulder(sign)),
            ("forearm", self.on_arm(sign, 0.285, 0.0)),
            ("hand", self.on_arm(sign, 0.535, 0.0)),
        ]
    }

    fn arm(&self, joints: &Joints, sign: f64, arm: &[usize]) -> Limb {
        let r = |radius: f64| self.limb_girth(radius);
        let muscle = 1.0 + 0.12 * self.p.muscle;
        let mut stations = vec![
            Station::oval(self.torso(sign * 0.075, 1.408, -0.022), r(0.048), r(0.052)),
            Station::oval(self.shoulder(sign), r(0.057) * muscle, r(0.060) * muscle),
        ];
        let rows = [
            (0.060, 0.052 * muscle, 0.056 * muscle),
            (0.140, 0.047 * muscle, 0.051 * muscle),
            (0.230, 0.041, 0.043),
            (0.285, 0.039, 0.040),
            (0.345, 0.041 * muscle, 0.044 * muscle),
            (0.430, 0.034, 0.036),
            (0.500, 0.026, 0.030),
            (0.540, 0.022, 0.028),
        ];
        stations.extend(rows.map(|(distance, side, depth)| {
            Station::oval(self.on_arm(sign, distance, 0.0), r(side), r(depth))
        }));
        let arm_loft = Loft::new(stations, Vec3::z(), [r(0.04), r(0.02)]);
        let s = self.scale;
        let parts = vec![
            joints.part(
                arm_loft,
                0.0,
                &[(arm[0], 0.0), (arm[1], 0.055 * s), (arm[2], 0.05 * s), (arm[3], 0.03 * s)],
            ),
            joints.part(self.palm(sign), 0.02 * s, &[(arm[2], 0.0), (arm[3], 0.03 * s)]),
            joints.part(self.thumb(sign), 0.03 * s, &[(arm[3], 0.0)]),
        ];
        Limb { parts, blend: 0.06 * s }
    }

    /// A mitten: flat, the palm facing the body.
    fn palm(&self, sign: f64) -> Loft {
        let size = |it: f64| self.scale * it * (0.5 + 0.5 * self.p.limb_girth);
        let rows = [
            (0.515, 0.021, 0.026),
            (0.560, 0.019, 0.034),
            (0.605, 0.018, 0.042),
            (0.650, 0.015, 0.041),
            (0.695, 0.012, 0.034),
            (0.715, 0.010, 0.026),
        ];
        let stations = rows.map(|(distance, thickness, width)| {
            Station::oval(self.on_arm(sign, distance, 0.002), size(thickness), size(width))
        });
        Loft::new(stations.to_vec(), Vec3::z(), [size(0.02), size(0.016)])
    }

    fn thumb(&self, sign: f64) -> Loft {
        let size = |it: f64| self.scale * it * (0.5 + 0.5 * self.p.limb_girth);
        let rows = [(0.565, 0.018, 0.018), (0.600, 0.042, 0.015), (0.640, 0.060, 0.012)];
        let stations = rows.map(|(distance, forward, radius)| {
            Station::round(self.on_arm(sign, distance, forward), size(radius))
        });
        Loft::new(stations.to_vec(), self.arm_direction(sign).cross(&Vec3::z()), [size(0.012); 2])
    }

    /// How far a leg is from the middle; thighs never touch, so that legs stay apart.
    fn leg_x(&self, y: f64) -> f64 {
        let thigh = 0.082 * self.p.limb_girth;
        (0.092 * self.p.hips).max(thigh + 0.010) + 0.035 * (NOMINAL_HIP - y)
    }

    fn leg_joints(&self, sign: f64) -> [(&'static str, Vec3); 4] {
        let at = |y: f64, z: f64| self.leg(sign * self.leg_x(y), y, z);
        [
            ("up_leg", at(0.92, -0.005)),
            ("leg", at(0.50, 0.004)),
            ("foot", at(0.085, -0.022)),
            ("toe", at(0.028, 0.105 * self.p.feet)),
        ]
    }

    fn leg_limb(&self, joints: &Joints, sign: f64, leg: &[usize]) -> Limb {
        let muscle = 1.0 + 0.10 * self.p.muscle;
        // Height, middle, side, front, back.
        let rows = [
            (0.900, -0.008, 0.076, 0.078, 0.090),
            (0.830, -0.006, 0.080, 0.086, 0.088),
            (0.720, -0.002, 0.074, 0.084, 0.078),
            (0.600, 0.002, 0.059, 0.066, 0.062),
            (0.530, 0.004, 0.053, 0.059, 0.054),
            (0.490, 0.003, 0.050, 0.056, 0.050),
            (0.440, -0.003, 0.050, 0.048, 0.056),
            (0.360, -0.010, 0.053 * muscle, 0.046, 0.062 * muscle),
            (0.250, -0.016, 0.042, 0.038, 0.046),
            (0.150, -0.020, 0.032, 0.032, 0.034),
            (0.085, -0.020, 0.031, 0.033, 0.034),
            (0.055, -0.020, 0.031, 0.035, 0.034),
        ];
        let station = |&(y, z, side, front, back): &(f64, f64, f64, f64, f64)| Station {
            centre: self.leg(sign * self.leg_x(y), y, z),
            side: self.limb_girth(side),
            front: self.limb_girth(front),
            back: self.limb_girth(back),
        };
        let caps = [self.limb_girth(0.05), self.limb_girth(0.02)];
        let loft = Loft::new(rows.iter().map(station).collect(), Vec3::z(), caps);
        let s = self.scale;
        let parts = vec![
            joints.part(loft, 0.0, &[(leg[0], 0.0), (leg[1], 0.06 * s), (leg[2], 0.03 * s)]),
            joints.part(self.foot(sign), 0.035 * s, &[(leg[2], 0.0), (leg[3], 0.03 * s)]),
        ];
        Limb { parts, blend: 0.05 * s }
    }

    /// A foot from heel to toes, its sections upright: `front` is up.
    fn foot(&self, sign: f64) -> Loft {
        // Middle along the foot, height of the axis, outward shift, side, up, down.
        let rows = [
            (-0.058, 0.034, 0.000, 0.026, 0.030, 0.044),
            (-0.030, 0.036, 0.000, 0.032, 0.042, 0.048),
            (0.020, 0.034, 0.000, 0.033, 0.044, 0.046),
            (0.075, 0.028, 0.003, 0.040, 0.032, 0.042),
            (0.125, 0.022, 0.006, 0.045, 0.022, 0.036),
            (0.165, 0.017, 0.003, 0.038, 0.015, 0.030),
            (0.185, 0.014, 0.000, 0.028, 0.011, 0.026),
        ];
        let size = |it: f64| self.scale * it * (0.5 + 0.5 * self.p.limb_girth);
        let station = |&(z, y, out, side, up, down): &(f64, f64, f64, f64, f64, f64)| Station {
            centre: self.leg(
                sign * (self.leg_x(0.085) + out + 0.1 * z.max(0.0)),
                y,
                z * self.p.feet,
            ),
            side: size(side),
            front: size(up),
            back: self.scale * down,
        };
        let caps = [size(0.024), size(0.022)];
        Loft::new(rows.iter().map(station).collect(), Vec3::y(), caps)
    }
}
