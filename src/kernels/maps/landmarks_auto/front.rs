//! Where the front of a biped is: what its feet and knees say.

use nalgebra::Rotation3;

use super::limb::Limb;
use super::roles::Roles;
use super::surface::Surface;
use crate::kernels::geometry::mesh::Vec3;

/// A witness of the front.
#[derive(Debug, Clone)]
pub struct Witness {
    pub name: &'static str,
    /// A unit vector in the frame of the torso.
    pub direction: Vec3,
    /// From 0 (nothing to be seen) to 1.
    pub weight: f64,
}

/// The frame of the torso, without knowing front from back.
#[derive(Debug, Clone)]
pub struct Torso {
    /// From hips to shoulders, a unit vector.
    pub up: Vec3,
    /// Unit vectors across `up` and the line between both hips, or both shoulders: both to the front,
    /// or both to the back, as arms and legs are paired by side.
    pub hip_normal: Vec3,
    pub shoulder_normal: Vec3,
}

/// Where the middle of a limb counts as its root.
pub const ROOT: f64 = 0.95;

impl Torso {
    pub fn of(limbs: &[Limb], Roles { arms, legs, .. }: Roles) -> Option<Self> {
        let root = |it: usize| limbs[it].center_at(ROOT);
        let hips = (root(legs[0]) + root(legs[1])) * 0.5;
        let shoulders = (root(arms[0]) + root(arms[1])) * 0.5;
        let up = (shoulders - hips).try_normalize(0.0)?;
        let normal =
            |pair: [usize; 2]| (root(pair[0]) - root(pair[1])).cross(&up).try_normalize(0.0);
        let (hip_normal, shoulder_normal) = (normal(legs)?, normal(arms)?);
        Some(Self { up, hip_normal, shoulder_normal })
    }
}

/// What feet and knees of both legs tell.
pub fn witnesses(surface: &Surface, limbs: &[Limb], roles: Roles, torso: &Torso) -> Vec<Witness> {
    let mut res = Vec::new();
    for (leg, names) in roles.legs.iter().zip([["foot", "knee"], ["other foot", "other knee"]]) {
        res.extend(foot(surface, &limbs[*leg], torso, names[0]));
        res.extend(knee(&limbs[*leg], torso, names[1]));
    }
    res
}

/// The foot reaches farther to the front of the shin than to the back.
///
/// Its direction is carried up the leg, from shin to thigh to torso, each time by the least rotation:
/// bent knees and hips do not change what is front, only turning about the own axis does. A leg that
/// ends without a foot shows another direction for every stretch that is taken for its shin, and
/// has no weight.
fn foot(surface: &Surface, leg: &Limb, torso: &Torso, name: &'static str) -> Option<Witness> {
    let thigh = leg.direction(0.68, 0.92)?;
    let (_, foot) = surface.area_and_center(leg.within(0.0, 0.3));
    let mut sum = Vec3::zeros();
    let mut length = 0.0;
    for start in SHIN_STARTS {
        let shin = leg.direction(start, start + 0.2)?;
        let offset = foot - leg.center_at(start + 0.04);
        let across = offset - shin * offset.dot(&shin);
        sum += carry(across, shin, thigh)?.try_normalize(0.0)?;
        length += across.norm() / leg.reach;
    }
    let n_shins = SHIN_STARTS.len() as f64;
    let agreement = ((sum.norm() / n_shins - 0.85) / 0.1).clamp(0.0, 1.0);
    let weight = (length / n_shins / 0.05).min(1.0) * agreement;
    let direction = carry(sum, thigh, torso.up)?.try_normalize(0.0)?;
    Some(Witness { name, direction, weight })
}

/// Where the shin may begin, seen from the tip of the foot, over the reach of the leg.
const SHIN_STARTS: [f64; 3] = [0.26, 0.31, 0.36];

/// A bent knee points to the front.
fn knee(leg: &Limb, torso: &Torso, name: &'static str) -> Option<Witness> {
    let (ankle, root) = (leg.center_at(0.36), leg.center_at(0.92));
    let chord = (root - ankle).try_normalize(0.0)?;
    let offset = leg.center_at(0.62) - ankle;
    let across = offset - chord * offset.dot(&chord);
    let weight = 0.5 * (across.norm() / leg.reach / 0.1).min(1.0);
    let direction = carry(across, chord, torso.up)?.try_normalize(0.0)?;
    Some(Witness { name, direction, weight })
}

/// Turns a vector by the least rotation from one unit vector to another; none if they are opposite.
fn carry(vector: Vec3, from: Vec3, to: Vec3) -> Option<Vec3> {
    Some(Rotation3::rotation_between(&from, &to)? * vector)
}
