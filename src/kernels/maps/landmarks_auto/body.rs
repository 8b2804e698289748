//! From roles to landmarks: sides, tips, and points of the torso.

use super::chest::{Chest, Wanted};
use super::front::{ROOT, Torso, Witness, witnesses};
use super::limb::Limb;
use super::roles::Roles;
use super::surface::Surface;
use super::{FindError, Tests};
use crate::kernels::geometry::landmarks::Landmarks;
use crate::kernels::geometry::mesh::Vec3;

/// Least values of the tests; measured bodies are far above, other shapes below.
const LEAST_FRONT: f64 = 0.45;
const LEAST_GIVEN_FRONT: f64 = 0.3;
const LEAST_SIDE_MARGIN: f64 = 0.01;
const LEAST_TWIST: f64 = 0.0;
const LEAST_RISE: f64 = 0.5;
const LEAST_WIDTH: f64 = 0.05;

/// How far from the middle what counts as on it may be, see [`Body::aside`].
const ASIDE: f64 = 0.06;

/// Where landmarks of the torso are, as measured on people and animals, among whom it varies by 0.02.
///
/// The front and the back of a chest; a breast is below the withers.
const CHEST: Wanted = Wanted { level: 0.37, crown: Some(0.38), neck: 1.33 };
const BREAST: Wanted = Wanted { level: 0.325, crown: None, neck: 1.0 };
const WITHERS: Wanted = Wanted { level: 0.425, crown: None, neck: 1.0 };

/// A body whose parts are known.
pub struct Body<'a> {
    pub surface: &'a Surface,
    pub limbs: &'a [Limb],
    /// Maxima that are no limbs, most persistent first.
    pub lesser: &'a [usize],
    /// Decides where the front is.
    pub front: Option<Vec3>,
}

impl Body<'_> {
    /// Seven landmarks of a biped.
    pub fn biped(
        &self,
        mut roles: Roles,
        side_margin: f64,
        tests: &mut Tests,
    ) -> Result<Landmarks, FindError> {
        let mut torso = Torso::of(self.limbs, roles).ok_or(FindError::NoTorso)?;
        tests.roles("the lead of one side over the other", side_margin, LEAST_SIDE_MARGIN)?;
        let twist = torso.hip_normal.dot(&torso.shoulder_normal);
        tests.roles("agreement of hips and shoulders", twist, LEAST_TWIST)?;
        if self.biped_front(roles, &torso, tests)? < 0.0 {
            // The normals point to the back: since `left = up x front`, the first arm is a right one.
            torso.hip_normal = -torso.hip_normal;
            torso.shoulder_normal = -torso.shoulder_normal;
            roles = swapped(roles);
        }
        let chest = Chest::of(self.surface, self.limbs, roles);
        let ahead = torso.shoulder_normal;
        let chest_front = chest.nearest(&CHEST, ahead, "at the front of the chest")?;
        let chest_back = chest.nearest(&CHEST, -ahead, "at the back of the chest")?;
        Ok(self.landmarks(roles, self.limbs[roles.head].tip, [chest_front, chest_back], &[]))
    }

    /// Positive if the normals of hips and shoulders point to the front.
    fn biped_front(
        &self,
        roles: Roles,
        torso: &Torso,
        tests: &mut Tests,
    ) -> Result<f64, FindError> {
        if let Some(given) = self.front {
            return given_front(given, torso.hip_normal + torso.shoulder_normal, tests);
        }
        let seen = witnesses(self.surface, self.limbs, roles, torso);
        let says = |it: &Witness| it.weight * it.direction.dot(&torso.hip_normal);
        let weight: f64 = seen.iter().map(|it| it.weight).sum();
        let sum: f64 = seen.iter().map(says).sum();
        for it in &seen {
            tests.note(it.name, says(it) * sum.signum());
        }
        // The weight of two clear feet is needed; what shows nothing beside them does not count.
        let value = sum / weight.max(2.0);
        if !tests.pass("evidence of the front", value.abs(), LEAST_FRONT) {
            let told = |it: &Witness| format!("{} {:.2}", it.name, says(it));
            let witnesses = seen.iter().map(told).collect::<Vec<_>>().join(", ");
            return Err(FindError::NoFront { value: value.abs(), least: LEAST_FRONT, witnesses });
        }
        Ok(value)
    }

    /// Nine landmarks of a quadruped.
    pub fn quadruped(&self, mut roles: Roles, tests: &mut Tests) -> Result<Landmarks, FindError> {
        let root = |it: usize| self.limbs[it].center_at(ROOT);
        let tip_at = |it: usize| self.surface.positions[self.limbs[it].tip];
        let middle =
            |pair: [usize; 2], of: &dyn Fn(usize) -> Vec3| (of(pair[0]) + of(pair[1])) * 0.5;
        let (fore, hind) = (middle(roles.arms, &root), middle(roles.legs, &root));
        let ahead = (fore - hind).try_normalize(0.0).ok_or(FindError::NoTorso)?;
        let feet = (middle(roles.arms, &tip_at) + middle(roles.legs, &tip_at)) * 0.5;
        let legs = (fore + hind) * 0.5 - feet;
        let rise = legs - ahead * legs.dot(&ahead);
        let share = rise.norm() / legs.norm().max(0.3 * (fore - hind).norm());
        tests.roles("how much the legs are across the spine", share, LEAST_RISE)?;
        if let Some(given) = self.front
            && given_front(given, ahead, tests)? < 0.0
        {
            return Err(FindError::FrontBehind);
        }
        let up = rise.normalize();
        let left = up.cross(&ahead);
        let apart = |pair: [usize; 2]| (root(pair[0]) - root(pair[1])).dot(&left);
        // Here space tells sides apart better than distances along a narrow belly do.
        for pair in [&mut roles.arms, &mut roles.legs] {
            if apart(*pair) < 0.0 {
                pair.swap(0, 1);
            }
        }
        let width = apart(roles.arms).min(apart(roles.legs)) / (fore - hind).norm();
        tests.roles("width between left and right", width, LEAST_WIDTH)?;
        let chest = Chest::of(self.surface, self.limbs, roles);
        let chest_front = chest.nearest(&BREAST, -up, "at the breast")?;
        let chest_back = chest.nearest(&WITHERS, up, "at the withers")?;
        let head = &self.limbs[roles.head];
        let head_top = farthest_along(self.surface, head.within(0.0, 0.6), up);
        let rear = || farthest_along(self.surface, 0..self.surface.len(), -ahead);
        let tail = roles.tail.map(|it| self.limbs[it].tip).or(self.short_tail(roles));
        let more = [("nose", self.nose(roles)), ("tail_tip", tail.unwrap_or_else(rear))];
        Ok(self.landmarks(roles, head_top, [chest_front, chest_back], &more))
    }

    fn landmarks(
        &self,
        roles: Roles,
        head_top: usize,
        [chest_front, chest_back]: [usize; 2],
        more: &[(&str, usize)],
    ) -> Landmarks {
        let tip = |it: usize| self.limbs[it].tip;
        let mut all = vec![
            ("head_top", head_top),
            ("hand_left", tip(roles.arms[0])),
            ("hand_right", tip(roles.arms[1])),
            ("foot_left", tip(roles.legs[0])),
            ("foot_right", tip(roles.legs[1])),
            ("chest_front", chest_front),
            ("chest_back", chest_back),
        ];
        all.extend_from_slice(more);
        let (names, vertices) = all.iter().map(|it| (it.0.to_owned(), it.1 as u32)).unzip();
        Landmarks { names, vertices }
    }

    /// Of the maxima on the head, the farthest out that is on the middle of the body: ears and horns
    /// are not.
    fn nose(&self, roles: Roles) -> usize {
        let head = &self.limbs[roles.head];
        let is_on_head = |it: &usize| {
            head.distances[*it] < 0.6 * head.reach
                && head.members.binary_search(&(*it as u32)).is_ok()
        };
        let own = self.lesser.iter().copied().filter(is_on_head);
        let all: Vec<usize> = std::iter::once(head.tip).chain(own).collect();
        let aside = |it: &usize| self.aside(roles, *it);
        let middle = all.iter().copied().find(|it| aside(it) < ASIDE);
        middle
            .or_else(|| all.iter().copied().min_by(|a, b| aside(a).total_cmp(&aside(b))))
            .expect("there is the tip")
    }

    /// The most persistent lesser maximum at the hind end, on the middle of the body.
    fn short_tail(&self, roles: Roles) -> Option<usize> {
        let mean = |pair: [usize; 2], at: usize| {
            0.5 * (self.limbs[pair[0]].distances[at] + self.limbs[pair[1]].distances[at])
        };
        let is_tail = |it: &usize| {
            mean(roles.legs, *it) < mean(roles.arms, *it) && self.aside(roles, *it) < ASIDE
        };
        self.lesser.iter().copied().find(is_tail)
    }

    /// How far a vertex is from the middle of the body: the difference of its distances from both
    /// sides, over their sum.
    fn aside(&self, roles: Roles, at: usize) -> f64 {
        let d = |it: usize| self.limbs[it].distances[at];
        let one = |[a, b]: [usize; 2]| (d(a) - d(b)).abs() / (d(a) + d(b));
        one(roles.arms).max(one(roles.legs))
    }
}

fn swapped(mut roles: Roles) -> Roles {
    roles.arms.swap(0, 1);
    roles.legs.swap(0, 1);
    roles
}

/// The part of a given front along an axis; its sign decides.
fn given_front(given: Vec3, axis: Vec3, tests: &mut Tests) -> Result<f64, FindError> {
    let (unit, axis) = (given.try_normalize(0.0), axis.try_normalize(0.0));
    let value = unit.zip(axis).map_or(0.0, |(unit, axis)| unit.dot(&axis));
    match tests.pass("the given front along the found axis", value.abs(), LEAST_GIVEN_FRONT) {
        true => Ok(value),
        false => Err(FindError::FrontAside { value, least: LEAST_GIVEN_FRONT }),
    }
}

/// The vertex that is farthest in a direction; the first of several.
fn farthest_along(
    surface: &Surface,
    vertices: impl Iterator<Item = usize>,
    direction: Vec3,
) -> usize {
    let along = |it: &usize| surface.positions[*it].dot(&direction);
    let farthest = vertices.max_by(|a, b| along(a).total_cmp(&along(b)).then(b.cmp(a)));
    farthest.expect("the caller gives some")
}
