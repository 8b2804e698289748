//! Points in the middle of the torso, by distances from hands, feet and head.

use super::FindError;
use super::limb::Limb;
use super::roles::Roles;
use super::surface::Surface;
use crate::kernels::geometry::mesh::Vec3;

/// How much levels between head and hands count.
const CROWN_WEIGHT: f64 = 0.4;

/// How many levels towards the feet the spine is looked for.
const SPINE_STEP: f64 = 0.06;

/// The share of the torso's area that shows where its inside is at a level.
const BAND: f64 = 0.15;

/// A place on the torso.
#[derive(Debug, Clone, Copy)]
pub struct Wanted {
    /// Where it lies between hands (0) and feet (1), by the distances along the surface.
    pub level: f64,
    /// Where it lies between head (0) and hands (1).
    pub crown: Option<f64>,
    /// Over the reach of the head: where the torso begins, seen from the tip of the head.
    pub neck: f64,
}

/// The torso's vertices by how far they are from tips.
pub struct Chest<'a> {
    surface: &'a Surface,
    places: Vec<Place>,
}

/// A vertex that belongs to neither limbs nor head.
struct Place {
    vertex: usize,
    /// See [`Wanted`].
    level: f64,
    crown: f64,
    from_head: f64,
    /// How far it is from the middle between left and right, in the unit of levels.
    aside: f64,
}

impl<'a> Chest<'a> {
    pub fn of(surface: &'a Surface, limbs: &[Limb], roles: Roles) -> Self {
        let mut is_torso = vec![true; surface.len()];
        for limb in limbs {
            limb.within(0.0, 1.0).for_each(|it| is_torso[it] = false);
        }
        let head = &limbs[roles.head];
        let place = |vertex: usize| {
            let d = |it: usize| limbs[it].distances[vertex];
            let [arms, legs] = [roles.arms, roles.legs].map(|[a, b]| d(a) + d(b));
            let [apart, legs_apart] = [roles.arms, roles.legs].map(|[a, b]| d(a) - d(b));
            let from_head = head.distances[vertex];
            Place {
                vertex,
                level: arms / (arms + legs),
                crown: from_head / (from_head + 0.5 * arms),
                from_head: from_head / head.reach,
                // A step to the side changes both distances of a pair.
                aside: apart.hypot(0.5 * legs_apart) / (arms + legs),
            }
        };
        Self { surface, places: (0..surface.len()).filter(|&it| is_torso[it]).map(place).collect() }
    }

    /// The vertex nearest to a place, on one side of the torso.
    ///
    /// The side is relative to the torso's inside at that level, and across its spine there, which may
    /// be bent; the surface must face that side.
    ///
    /// # Errors
    /// [`FindError::NoChest`].
    pub fn nearest(
        &self,
        wanted: &Wanted,
        side: Vec3,
        name: &'static str,
    ) -> Result<usize, FindError> {
        let fail = || FindError::NoChest { place: name };
        let torso: Vec<&Place> =
            self.places.iter().filter(|it| it.from_head > wanted.neck).collect();
        let center = self.center_near(&torso, wanted.level).ok_or_else(fail)?;
        let below = self.center_near(&torso, wanted.level + SPINE_STEP).ok_or_else(fail)?;
        let spine = (center - below).try_normalize(0.0).unwrap_or_default();
        let side = side - spine * side.dot(&spine);
        let cost = |it: &Place| {
            let away = wanted.crown.map_or(0.0, |crown| CROWN_WEIGHT * (it.crown - crown));
            (it.level - wanted.level).hypot(it.aside).hypot(away)
        };
        let is_there = |it: &&&Place| {
            (self.surface.positions[it.vertex] - center).dot(&side) > 0.0
                && self.surface.normals[it.vertex].dot(&side) >= 0.0
        };
        let candidates = torso.iter().filter(is_there);
        let best = candidates.min_by(|a, b| cost(a).total_cmp(&cost(b)));
        best.map(|it| it.vertex).ok_or_else(fail)
    }

    /// The middle of the part of the torso whose levels are nearest to one.
    fn center_near(&self, torso: &[&Place], level: f64) -> Option<Vec3> {
        let mut nearest = torso.to_vec();
        let off = |it: &Place| (it.level - level).abs();
        nearest.sort_by(|a, b| off(a).total_cmp(&off(b)).then(a.vertex.cmp(&b.vertex)));
        let (total, _) = self.surface.area_and_center(torso.iter().map(|it| it.vertex));
        let mut area = 0.0;
        let band = nearest.iter().map(|it| it.vertex).take_while(|&it| {
            let is_needed = area < BAND * total;
            area += self.surface.areas[it];
            is_needed
        });
        let (found, center) = self.surface.area_and_center(band);
        (found > 0.0).then_some(center)
    }
}
