//! Moves matched joints to where bones lie well inside the body.

use super::reduced::Working;
use crate::kernels::geometry::distance_field::SampledDistance;
use crate::kernels::geometry::medial_balls::Ball;
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::geometry::point_tree::PointTree;

/// What joints are refined in.
pub struct Body<'a> {
    pub field: &'a SampledDistance,
    /// The centres of all medial balls.
    centers: Vec<Vec3>,
    medial: PointTree,
}

impl<'a> Body<'a> {
    pub fn new(field: &'a SampledDistance, balls: &[Ball]) -> Self {
        let centers: Vec<Vec3> = balls.iter().map(|it| it.center).collect();
        Self { field, medial: PointTree::new(&centers), centers }
    }
}

/// Places along a bone at which it is held inside, both ends with them: those of a root and of a leaf belong to
/// one bone only.
const SAMPLES: usize = 10;
const INSIDE: f64 = 15_000.0;
const LENGTH: f64 = 0.25;
const ANGLE: f64 = 2.0;
/// Distances up to this from the medial axis cost nothing.
const NEAR: f64 = 0.003;
/// A bone that is this deep may be off the medial axis.
const DEEP: f64 = 0.05;

/// Improves an embedding (Baran & Popović 2007, section 3.3, as their program does it).
///
/// The energy of a bone asks it to lie on the medial axis or deep inside, not to be shorter than in
/// the skeleton along its direction there, to keep this direction, and to be as long as the bone that
/// mirrors it. In every round all joints move along the gradient twice, then the ends of every bone
/// by themselves.
pub fn refine(
    body: &Body<'_>,
    working: &Working,
    mirrored: &[Option<usize>],
    positions: &mut [Vec3],
    n_rounds: usize,
) {
    let mut energy = Energy::new(body, working, mirrored);
    let all: Vec<usize> = (0..working.n()).collect();
    for _ in 0..n_rounds {
        for _ in 0..2 {
            energy.descend(positions, &all);
        }
        for bone in 1..working.n() {
            let parent = working.parents[bone].expect("only the first joint is a root");
            energy.descend(positions, &[parent, bone]);
        }
    }
}

struct Energy<'a> {
    body: &'a Body<'a>,
    working: &'a Working,
    /// The vector of every bone in the skeleton; bones are named by their ends.
    wanted: Vec<Vec3>,
    /// Pairs of bones that mirror each other.
    mirrored: Vec<(usize, usize)>,
    /// Bones at every joint, and pairs with such a bone.
    bones_at: Vec<Vec<usize>>,
    found: Vec<(f64, u32)>,
}

impl<'a> Energy<'a> {
    fn new(body: &'a Body<'a>, working: &'a Working, mirrored: &[Option<usize>]) -> Self {
        let mut bones_at = vec![Vec::new(); working.n()];
        let mut wanted = vec![Vec3::zeros(); working.n()];
        for (bone, parent) in working.parents.iter().enumerate() {
            if let Some(parent) = *parent {
                wanted[bone] = working.positions[bone] - working.positions[parent];
                bones_at[bone].push(bone);
                bones_at[parent].push(bone);
            }
        }
        let pairs = mirrored.iter().enumerate().filter_map(|(bone, it)| Some(((*it)?, bone)));
        Self { body, working, wanted, mirrored: pairs.collect(), bones_at, found: vec![] }
    }

    /// Moves some joints along the gradient: a small step, doubled as long as the energy falls.
    fn descend(&mut self, positions: &mut [Vec3], moving: &[usize]) {
        let mut bones: Vec<usize> =
            moving.iter().flat_map(|&it| self.bones_at[it].iter().copied()).collect();
        bones.sort_unstable();
        bones.dedup();
        let mut gradient = vec![Vec3::zeros(); positions.len()];
        let start = self.value(positions, &bones, Some(&mut gradient));
        let square: f64 = moving.iter().map(|&it| gradient[it].norm_squared()).sum();
        let mut step = 0.0005 / (0.001 + square).sqrt();
        let mut best = start;
        let mut moved = positions.to_vec();
        while step.is_finite() {
            for &joint in moving {
                moved[joint] = positions[joint] - gradient[joint] * step;
            }
            let value = self.value(&moved, &bones, None);
            if !(value < best) {
                step /= 2.0;
                break;
            }
            best = value;
            step *= 2.0;
        }
        if best < start {
            for &joint in moving {
                positions[joint] -= gradient[joint] * step;
            }
        }
    }

    /// The energy of some bones, and its gradient if it is wanted.
    fn value(
        &mut self,
        positions: &[Vec3],
        bones: &[usize],
        mut gradient: Option<&mut Vec<Vec3>>,
    ) -> f64 {
        let mut sum = 0.0;
        for &bone in bones {
            let parent = self.working.parents[bone].expect("a bone has a parent");
            let ends = [positions[parent], positions[bone]];
            let (value, slopes) = self.bone(ends, self.wanted[bone]);
            sum += value;
            if let Some(gradient) = &mut gradient {
                gradient[parent] += slopes[0];
                gradient[bone] += slopes[1];
            }
        }
        for index in 0..self.mirrored.len() {
            let (first, second) = self.mirrored[index];
            if bones.binary_search(&first).is_ok() || bones.binary_search(&second).is_ok() {
                sum += self.asymmetry(positions, [first, second], &mut gradient);
            }
        }
        sum
    }

    /// The energy of a bone by itself, and its gradient at both ends.
    fn bone(&mut self, [from, to]: [Vec3; 2], wanted: Vec3) -> (f64, [Vec3; 2]) {
        let along = to - from;
        let mut value = 0.0;
        let mut slopes = [Vec3::zeros(); 2];
        for sample in 0..SAMPLES {
            let t = sample as f64 / (SAMPLES - 1) as f64;
            let (off, slope) = self.off_axis(from + along * t);
            if off > NEAR {
                let share = INSIDE / SAMPLES as f64;
                value += share * off * off;
                slopes[0] += slope * (2.0 * share * off * (1.0 - t));
                slopes[1] += slope * (2.0 * share * off * t);
            }
        }
        let (length, by_along) = length_term(along, wanted);
        let (angle, turn) = angle_term(along, wanted);
        let slope = by_along * LENGTH + turn * ANGLE;
        slopes[0] -= slope;
        slopes[1] += slope;
        (value + LENGTH * length + ANGLE * angle, slopes)
    }

    /// How far a place is from where bones should be, and the gradient of that.
    fn off_axis(&mut self, place: Vec3) -> (f64, Vec3) {
        let (distance, outward) = self.body.field.distance_and_gradient(place);
        let shallow = 0.001 + (DEEP + distance).max(0.0);
        self.body.medial.nearest(place, 1, &mut self.found);
        let (square, nearest) = self.found[0];
        let medial = square.sqrt();
        if medial < shallow {
            let offset = place - self.body.centers[nearest as usize];
            return (medial, offset.try_normalize(0.0).unwrap_or_default());
        }
        (shallow, if DEEP + distance > 0.0 { outward } else { Vec3::zeros() })
    }

    /// How much the longer of two bones is longer than the other.
    fn asymmetry(
        &self,
        positions: &[Vec3],
        bones: [usize; 2],
        gradient: &mut Option<&mut Vec<Vec3>>,
    ) -> f64 {
        const FREE: f64 = 1.05;
        let parents = bones.map(|it| self.working.parents[it].expect("a bone has a parent"));
        let vectors = [0, 1].map(|it| positions[bones[it]] - positions[parents[it]]);
        let lengths = vectors.map(|it| it.norm().max(1e-6));
        let longer = usize::from(lengths[1] > lengths[0]);
        let ratio = lengths[longer] / lengths[1 - longer];
        if ratio <= FREE {
            return FREE;
        }
        if let Some(gradient) = gradient {
            for (it, sign) in [(longer, 1.0), (1 - longer, -1.0)] {
                let slope = vectors[it] * (sign * ratio / (lengths[it] * lengths[it]));
                gradient[bones[it]] += slope;
                gradient[parents[it]] -= slope;
            }
        }
        ratio
    }
}

/// Grows as a bone gets shorter along its direction in the skeleton; with its gradient.
fn length_term(along: Vec3, wanted: Vec3) -> (f64, Vec3) {
    const LEAST: f64 = 0.5;
    const SOFT: f64 = 1e-4;
    let square = wanted.norm_squared();
    let dot = along.dot(&wanted).max(-10.0);
    let denominator = SOFT + dot * dot / square;
    let value = (SOFT + square) / denominator;
    if value <= LEAST {
        return (LEAST, Vec3::zeros());
    }
    (value, wanted * (-value / denominator * 2.0 * dot / square))
}

/// Grows with the angle between a bone and its direction in the skeleton; with its gradient.
fn angle_term(along: Vec3, wanted: Vec3) -> (f64, Vec3) {
    let length = along.norm();
    if length == 0.0 {
        return (0.027, Vec3::zeros());
    }
    let (found, wanted) = (along / length, wanted.normalize());
    let dot = found.dot(&wanted).clamp(-1.0, 1.0);
    let base = 0.3 + 0.5 * dot.acos();
    let factor = if dot < 0.0 { 10.0 } else { 1.0 };
    let sine = (1.0 - dot * dot).sqrt();
    let towards =
        if sine > 1e-9 { (found * dot - wanted) / (sine * length) } else { Vec3::zeros() };
    (factor * base.powi(3), towards * (factor * 1.5 * base * base))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::numerics::random::Random;

    #[test]
    fn gradients_of_length_and_angle_are_their_slopes() {
        let mut random = Random::new(3);
        for _ in 0..200 {
            let mut vector = || Vec3::from_fn(|_, _| random.between(-0.3, 0.3));
            let (along, wanted) = (vector(), vector());
            for term in [length_term, angle_term] {
                let (value, gradient) = term(along, wanted);
                for axis in 0..3 {
                    let step = Vec3::ith(axis, 1e-7);
                    let slope =
                        (term(along + step, wanted).0 - term(along - step, wanted).0) / 2e-7;
                    let scale = 1.0 + value.abs() + gradient.norm();
                    assert!((slope - gradient[axis]).abs() < 1e-4 * scale, "{slope} {gradient}");
                }
            }
        }
    }
}
