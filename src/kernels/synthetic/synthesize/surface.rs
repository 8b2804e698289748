//! The implicit surface of a body: lofts that blend where they should and nowhere else.

use super::loft::{Loft, LoftSample};
use crate::kernels::geometry::mesh::Vec3;

/// Limbs that come this close, in metres, are rounded where they meet (the crotch).
const SEAM: f64 = 0.02;

/// How far above the ground soles begin to flatten, in metres.
const SOLE: f64 = 0.008;

/// A stretch of a loft that one joint moves.
#[derive(Debug, Clone, Copy)]
pub struct Stretch {
    pub joint: usize,
    /// Where it starts, as chord length along the loft.
    pub start: f64,
    /// Half the length over which it takes over from the stretch before.
    pub softness: f64,
}

/// A loft of a body and the joints that move it.
#[derive(Debug, Clone)]
pub struct Part {
    pub loft: Loft,
    /// The width of its blend with the parts listed before, in metres.
    pub blend: f64,
    /// In order; the first holds from the beginning.
    pub stretches: Vec<Stretch>,
}

/// Parts that blend with each other and, as a whole, with the core.
#[derive(Debug, Clone)]
pub struct Limb {
    pub parts: Vec<Part>,
    /// The width of the blend with the core, in metres.
    pub blend: f64,
}

/// A body: a core with limbs. Limbs blend with the core only, not with each other, so that a hand
/// next to a thigh or two legs side by side stay apart.
#[derive(Debug, Clone)]
pub struct Surface {
    pub core: Vec<Part>,
    pub limbs: Vec<Limb>,
}

impl Surface {
    /// About the signed distance, negative inside. Nothing reaches below the ground, `y = 0`.
    pub fn value(&self, point: Vec3) -> f64 {
        let core = union(&self.core, point, f64::INFINITY);
        // How much deeper in the body a limb puts the point than the core does.
        let mut depth = 0.0_f64;
        for limb in &self.limbs {
            let limb_value = union(&limb.parts, point, core - depth + limb.blend + SEAM);
            let gain = core - smooth_min(core, limb_value, limb.blend);
            let seam = SEAM.min(depth).min(gain);
            depth = if seam > 0.0 { -smooth_min(-depth, -gain, seam) } else { depth.max(gain) };
        }
        -smooth_min(depth - core, point.y, SOLE)
    }

    /// Value and gradient by differences along the corners of a tetrahedron.
    fn value_and_gradient(&self, point: Vec3) -> (f64, Vec3) {
        const STEP: f64 = 1e-4;
        let corners = [[1.0, -1.0, -1.0], [-1.0, -1.0, 1.0], [-1.0, 1.0, -1.0], [1.0, 1.0, 1.0]];
        let (mut value, mut gradient) = (0.0, Vec3::zeros());
        for corner in corners.map(Vec3::from) {
            let at_corner = self.value(point + STEP * corner);
            value += at_corner / 4.0;
            gradient += corner * (at_corner / (4.0 * STEP));
        }
        (value, gradient)
    }

    /// The radius of the parts at a point on the surface, smoothed over where they meet.
    pub fn thickness(&self, point: Vec3) -> f64 {
        const SMOOTHING: f64 = 0.03;
        // What is farther away weighs nothing beside the part that the point is on.
        let near = self.parts().filter(|it| it.1.loft.distance_bound(point) < 5.0 * SMOOTHING);
        let samples: Vec<LoftSample> = near.map(|it| it.1.sample(point)).collect();
        let nearest = samples.iter().map(|it| it.distance).fold(f64::INFINITY, f64::min);
        let (mut sum, mut total) = (0.0, 0.0);
        for sample in samples {
            let weight = (-(sample.distance - nearest) / SMOOTHING).exp();
            sum += weight * sample.radius;
            total += weight;
        }
        sum / total
    }

    /// A box that holds the body with some room.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        let mut boxes = self.parts().map(|it| it.1.loft.bounds());
        let first = boxes.next().expect("a body has parts");
        let (low, high) = boxes.fold(first, |(low, high), it| (low.inf(&it.0), high.sup(&it.1)));
        (low.add_scalar(-0.15), high.add_scalar(0.15))
    }

    /// Leads a point near the surface closer to it by a step of Newton's method.
    pub fn approach(&self, point: Vec3) -> Vec3 {
        let (value, gradient) = self.value_and_gradient(point);
        point - gradient * (value / gradient.norm_squared().max(0.25))
    }

    /// Where a ray from inside first leaves the body, to a tenth of a micrometre.
    pub fn exit(&self, from: Vec3, direction: Vec3) -> Vec3 {
        let direction = direction.normalize();
        let (mut low, step) = (0.0, 0.004);
        while self.value(from + direction * (low + step)) < 0.0 {
            low += step;
        }
        let mut high = low + step;
        while high - low > 1e-7 {
            let middle = 0.5 * (low + high);
            if self.value(from + direction * middle) < 0.0 {
                low = middle;
            } else {
                high = middle;
            }
        }
        from + direction * high
    }

    /// All parts with the number of their limb; the core's have none.
    pub fn parts(&self) -> impl Iterator<Item = (Option<usize>, &Part)> {
        let limbs = self.limbs.iter().enumerate();
        let limb_parts = limbs.flat_map(|(k, limb)| limb.parts.iter().map(move |it| (Some(k), it)));
        self.core.iter().map(|it| (None, it)).chain(limb_parts)
    }
}

impl Part {
    pub fn sample(&self, point: Vec3) -> LoftSample {
        self.loft.sample(point)
    }
}

/// The smooth union of parts; exact where it is below `needed`.
fn union(parts: &[Part], point: Vec3, needed: f64) -> f64 {
    let mut res = f64::INFINITY;
    for part in parts {
        let value = part.loft.distance_within(point, res.min(needed) + part.blend);
        res = smooth_min(res, value, part.blend);
    }
    res
}

/// The minimum, rounded cubically where the two are closer than `width` (twice differentiable).
fn smooth_min(a: f64, b: f64, width: f64) -> f64 {
    let closeness = ((width - (a - b).abs()) / width).max(0.0);
    a.min(b) - closeness.powi(3) * width / 6.0
}
