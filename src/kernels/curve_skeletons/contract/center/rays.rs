//! The middle of a closed surface, by rays across a curve.

use rayon::prelude::*;

use super::super::super::curve_skeleton::CurveSkeleton;
use super::super::super::skeleton_cleanup::moved_inside;
use super::{Look, Surroundings, View};
use crate::kernels::geometry::distance_field::DistanceField;
use crate::kernels::geometry::mesh::Vec3;

/// Rays across a curve, of which every other half looks the opposite way.
const RAYS: usize = 16;

/// Rays that go farther than so many median ones look into another limb.
const REACH: f64 = 3.0;

/// Beside the surface half of the rays are short. The median counts as this part of the radius there.
const LEAST_MEDIAN: f64 = 0.7;

/// A closed surface that rays are sent to.
pub struct Rays<'a> {
    field: &'a DistanceField,
}

impl<'a> Rays<'a> {
    pub fn new(field: &'a DistanceField) -> Self {
        Self { field }
    }
}

impl Surroundings for Rays<'_> {
    /// The step is the mean difference of opposite rays: for a round limb half of the way to its middle.
    fn look(&self, view: &View) -> Option<Look> {
        let [side, other] = view.across();
        let directions: [Vec3; RAYS] = std::array::from_fn(|ray| {
            let (sin, cos) = (std::f64::consts::TAU * ray as f64 / RAYS as f64).sin_cos();
            side * cos + other * sin
        });
        let range = [0.0, REACH * view.last_reach];
        let lengths = directions.map(|it| {
            let hit = self.field.tree().first_hit(view.place, it, range);
            hit.map_or(f64::INFINITY, |it| it.along)
        });
        let mut sorted = lengths;
        sorted.sort_unstable_by(f64::total_cmp);
        let median = sorted[RAYS / 2].max(LEAST_MEDIAN * view.radius);
        // Only both rays of a pair may be left out: one of them would pull to its side.
        let (mut sum, mut count) = (Vec3::zeros(), 0);
        for (ray, direction) in directions[..RAYS / 2].iter().enumerate() {
            let pair = [lengths[ray], lengths[ray + RAYS / 2]];
            if pair.iter().all(|it| it.is_finite() && *it <= REACH * median) {
                sum += direction * (pair[0] - pair[1]);
                count += 2;
            }
        }
        (count > 0).then(|| Look { shift: sum / f64::from(count), reach: median })
    }

    fn is_crossed(&self, from: Vec3, to: Vec3) -> bool {
        self.field.tree().is_crossed(from, to)
    }

    fn is_outside(&self, place: Vec3) -> bool {
        !self.field.is_inside(place)
    }
}

/// With the new nodes, those after the old ones, moved into the shape where edges had left it.
pub fn with_new_inside(
    split: &CurveSkeleton,
    n_old: usize,
    field: &DistanceField,
) -> CurveSkeleton {
    let inside = |node: usize| {
        let (place, radius) = (split.positions()[node], split.radii()[node]);
        match node < n_old || field.is_inside(place) {
            true => place,
            false => moved_inside(&place, 0.5 * radius, field).unwrap_or(place),
        }
    };
    let places = (0..split.n_nodes()).into_par_iter().map(inside).collect();
    split.with_positions(places).expect("places beside finite ones")
}
