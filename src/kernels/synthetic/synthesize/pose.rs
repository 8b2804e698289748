//! Poses: rotations of joints, and what they do to positions.

use nalgebra::{Isometry3, Translation3, UnitQuaternion};

use crate::kernels::{geometry::mesh::Vec3, numerics::random::Random, rigs::skeleton::Skeleton};

/// A pose under construction: each joint keeps its parent's orientation unless told otherwise.
#[derive(Debug, Clone)]
pub struct Pose<'a> {
    skeleton: &'a Skeleton,
    local: Vec<UnitQuaternion<f64>>,
    /// How far the root is from its place at rest.
    shift: Vec3,
}

impl<'a> Pose<'a> {
    pub fn rest(skeleton: &'a Skeleton) -> Self {
        let local = vec![UnitQuaternion::identity(); skeleton.n_joints()];
        Self { skeleton, local, shift: Vec3::zeros() }
    }

    /// A joint of the plan.
    ///
    /// # Panics
    /// If there is none of that name: a bug of ours.
    pub fn joint(&self, name: &str) -> usize {
        self.skeleton.joint(name).unwrap_or_else(|| panic!("the plan has no joint `{name}`"))
    }

    /// Turns a joint against its parent, before what it was turned so far.
    pub fn turn(&mut self, name: &str, axis: Vec3, angle_rad: f64) {
        let joint = self.joint(name);
        self.local[joint] = UnitQuaternion::new(axis * angle_rad) * self.local[joint];
    }

    /// Gives a joint an orientation in the world, whatever its parents are.
    pub fn orient(&mut self, name: &str, orientation: UnitQuaternion<f64>) {
        let joint = self.joint(name);
        let parent = self.skeleton.parents()[joint];
        let transforms = self.world_from_joint();
        self.local[joint] = match parent {
            Some(parent) => transforms[parent].rotation.inverse() * orientation,
            None => orientation,
        };
    }

    pub fn shift(&mut self, by: Vec3) {
        self.shift += by;
    }

    /// Rotations against the parents and offsets from them, as a clip stores them.
    pub fn local(&self) -> (Vec<UnitQuaternion<f64>>, Vec<Vec3>) {
        let positions = self.skeleton.positions();
        let offset = |(joint, parent): (usize, &Option<usize>)| match parent {
            Some(parent) => positions[joint] - positions[*parent],
            None => positions[joint] + self.shift,
        };
        let offsets = self.skeleton.parents().iter().enumerate().map(offset).collect();
        (self.local.clone(), offsets)
    }

    /// The transforms of all joints.
    pub fn world_from_joint(&self) -> Vec<Isometry3<f64>> {
        let (rotations, offsets) = self.local();
        let mut transforms: Vec<Isometry3<f64>> = Vec::with_capacity(offsets.len());
        for (joint, parent) in self.skeleton.parents().iter().enumerate() {
            let own = Isometry3::from_parts(Translation3::from(offsets[joint]), rotations[joint]);
            transforms.push(parent.map_or(own, |it| transforms[it] * own));
        }
        transforms
    }
}

/// Arms straight out to the sides.
pub fn t_pose(skeleton: &Skeleton) -> Pose<'_> {
    let mut pose = Pose::rest(skeleton);
    for side in ["left_", "right_"] {
        let arm = pose.joint(&format!("{side}arm"));
        let hand = pose.joint(&format!("{side}hand"));
        let along = skeleton.positions()[hand] - skeleton.positions()[arm];
        let level = Vec3::new(along.x.signum(), 0.0, 0.0);
        let flat = Vec3::new(along.x, along.y, 0.0);
        let turn = UnitQuaternion::rotation_between(&flat, &level);
        pose.orient(&format!("{side}arm"), turn.expect("arms do not point backwards"));
    }
    pose
}

/// Turns every joint of a table by random angles within its ranges, in degrees.
///
/// `amount` scales all angles. The sides draw different numbers, so the pose is asymmetric.
pub fn random_pose<'a>(skeleton: &'a Skeleton, seed: u64, amount: f64) -> Pose<'a> {
    let mut random = Random::stream(seed, "pose");
    let mut pose = Pose::rest(skeleton);
    let biped = skeleton.joint("tail_1").is_none();
    let table: &[Range] = if biped { &BIPED_RANGES } else { &QUADRUPED_RANGES };
    for (name, x, y, z) in table {
        let sides: &[(&str, f64)] =
            if skeleton.joint(name).is_some() { &[("", 1.0)] } else { &super::plan::SIDES };
        for (side, sign) in sides {
            let mut draw =
                |range: &(f64, f64)| amount * random.between(range.0, range.1).to_radians();
            let (x, y, z) = (draw(x), draw(y), draw(z));
            let name = format!("{side}{name}");
            pose.turn(&name, Vec3::z(), z * sign);
            pose.turn(&name, Vec3::y(), y * sign);
            pose.turn(&name, Vec3::x(), x);
        }
    }
    pose
}

/// A joint with the ranges of its turns about X, Y and Z, in degrees, given for the left side. About
/// X, positive angles lead what hangs down backwards; about Z, they lift the left arm.
type Range = (&'static str, (f64, f64), (f64, f64), (f64, f64));

const BIPED_RANGES: [Range; 13] = [
    ("spine", (-6.0, 12.0), (-10.0, 10.0), (-6.0, 6.0)),
    ("chest", (-6.0, 10.0), (-10.0, 10.0), (-6.0, 6.0)),
    ("upper_chest", (-4.0, 8.0), (-8.0, 8.0), (-4.0, 4.0)),
    ("neck", (-10.0, 10.0), (-15.0, 15.0), (-6.0, 6.0)),
    ("head", (-15.0, 15.0), (-25.0, 25.0), (-8.0, 8.0)),
    ("shoulder", (0.0, 0.0), (-6.0, 6.0), (-3.0, 8.0)),
    ("arm", (-50.0, 25.0), (-30.0, 15.0), (-25.0, 40.0)),
    ("forearm", (-60.0, -5.0), (-45.0, 0.0), (0.0, 10.0)),
    ("hand", (-15.0, 15.0), (-10.0, 10.0), (-20.0, 20.0)),
    ("up_leg", (-50.0, 20.0), (-6.0, 10.0), (0.0, 16.0)),
    ("leg", (3.0, 60.0), (0.0, 0.0), (0.0, 0.0)),
    ("foot", (-10.0, 20.0), (-8.0, 8.0), (0.0, 0.0)),
    ("toe", (-15.0, 0.0), (0.0, 0.0), (0.0, 0.0)),
];

const QUADRUPED_RANGES: [Range; 17] = [
    ("spine", (-4.0, 4.0), (-6.0, 6.0), (-3.0, 3.0)),
    ("chest", (-4.0, 4.0), (-6.0, 6.0), (-3.0, 3.0)),
    ("upper_chest", (-3.0, 3.0), (-4.0, 4.0), (-2.0, 2.0)),
    ("neck", (-8.0, 28.0), (-16.0, 16.0), (-4.0, 4.0)),
    ("upper_neck", (-8.0, 22.0), (-16.0, 16.0), (-4.0, 4.0)),
    ("head", (-18.0, 12.0), (-16.0, 16.0), (-6.0, 6.0)),
    ("tail_1", (-10.0, 30.0), (-20.0, 20.0), (0.0, 0.0)),
    ("tail_2", (-10.0, 20.0), (-20.0, 20.0), (0.0, 0.0)),
    ("tail_3", (-15.0, 20.0), (-20.0, 20.0), (0.0, 0.0)),
    ("ear", (-12.0, 12.0), (-25.0, 25.0), (-6.0, 6.0)),
    ("arm", (-18.0, 14.0), (0.0, 0.0), (-2.0, 5.0)),
    ("forearm", (-25.0, 8.0), (0.0, 0.0), (0.0, 0.0)),
    ("hand", (2.0, 45.0), (0.0, 0.0), (0.0, 0.0)),
    ("fingers", (0.0, 30.0), (0.0, 0.0), (0.0, 0.0)),
    ("up_leg", (-22.0, 20.0), (0.0, 0.0), (-1.0, 5.0)),
    ("leg", (-8.0, 25.0), (0.0, 0.0), (0.0, 0.0)),
    ("foot", (-25.0, 5.0), (0.0, 0.0), (0.0, 0.0)),
];
