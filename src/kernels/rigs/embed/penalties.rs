//! How badly a joint fits a ball.
//!
//! The penalties and weights of Baran & Popović (2007, appendix A), as their program computes them.

use super::reduced::{Reduced, along};
use crate::kernels::geometry::medial_graph::MedialGraph;
use crate::kernels::geometry::mesh::Vec3;

/// The weighted penalties of one joint, by kind.
pub type Terms = [f64; 10];

/// The names of [`Terms`].
pub const TERM_NAMES: [&str; 10] = [
    "length",
    "direction",
    "symmetry",
    "shared path",
    "feet",
    "zero chain",
    "bone direction",
    "inner leaf",
    "far",
    "place",
];

const LENGTH: usize = 0;
const DIRECTION: usize = 1;
const SYMMETRY: usize = 2;
const SHARED_PATH: usize = 3;
const FEET: usize = 4;
const ZERO_CHAIN: usize = 5;
const BONE_DIRECTION: usize = 6;
const INNER_LEAF: usize = 7;
const FAR: usize = 8;
const PLACE: usize = 9;

/// That of places is ours, and multiplied by what the user says.
const WEIGHTS: Terms = [0.027, 0.023, 0.007, 0.046, 0.014, 0.012, 0.072, 0.005, 0.033, 0.5];

/// A part of a ball's radius that a chain may reach beyond the ball's centre.
const SLACK: f64 = 0.7;

/// The distance from its place from which on it hardly matters how far a joint is off.
const PLACE_REACH: f64 = 0.3;

/// Balls below this radius carry one chain only.
const NARROW: f64 = 0.02;

/// What is matched with what.
pub struct Problem<'a> {
    pub graph: &'a MedialGraph,
    pub reduced: &'a Reduced,
    /// The upward direction in the frame of the target.
    pub up: Vec3,
    pub is_foot: Vec<bool>,
    /// The earlier joint that mirrors a joint.
    pub mirrored: Vec<Option<usize>>,
    /// How much places matter, and what leads from the skeleton to the target if their bodies stand in
    /// the same place.
    pub places: Option<(f64, Vec3)>,
    pub short: f64,
}

/// Joints matched so far: the first ones, with the balls they are matched to.
pub struct Matched<'a> {
    pub balls: &'a [usize],
    /// For every ball, whether a matched chain passes through it.
    pub is_used: &'a [bool],
    /// Along the matched tree, from the root to every joint.
    pub depths: &'a [f64],
}

impl Problem<'_> {
    /// The penalties that depend on a joint, its ball and its parent's ball only; `None` if the joint
    /// cannot be there.
    pub fn pair_terms(&self, joint: usize, parent_ball: usize, ball: usize) -> Option<Terms> {
        let mut terms = [0.0; 10];
        let (a, b) = (&self.graph.balls[parent_ball], &self.graph.balls[ball]);
        let chain = &self.reduced.chains[joint];
        let distance = self.graph.distance(parent_ball, ball);
        let reach = distance + SLACK * (a.radius + b.radius);
        if !(reach >= chain.length / 2.0) || !distance.is_finite() {
            return None;
        }
        terms[LENGTH] = (2.0 * chain.length / reach - 1.0).clamp(0.0, 3.0).powi(3);
        let parent = self.reduced.parents[joint]?;
        let wanted = direction(self.reduced.positions[parent], self.reduced.positions[joint]);
        let found = direction(a.center, b.center);
        let dot = wanted.dot(&found);
        let share = self.directed(chain.length);
        if dot < 0.0 && share == 1.0 {
            return None;
        }
        terms[DIRECTION] = share * 0.5 * ((4.0 * (1.0 - dot)).powi(2) - 0.1).max(0.0);
        if parent_ball == ball {
            terms[ZERO_CHAIN] = 1.0;
        }
        terms[FEET] = self.foot_height(joint, ball);
        terms[PLACE] = self.displacement(joint, ball);
        if self.reduced.is_leaf(joint) && self.is_inner(ball, &found, &wanted) {
            terms[INNER_LEAF] = 1.0;
        }
        // The costliest comes last, and only if nothing else forbids the joint.
        weighted(terms)?;
        terms[BONE_DIRECTION] = self.bone_directions(joint, parent_ball, ball);
        weighted(terms)
    }

    /// The penalties of the root.
    pub fn root_terms(&self, ball: usize) -> Option<Terms> {
        let mut terms = [0.0; 10];
        terms[FEET] = self.foot_height(0, ball);
        terms[PLACE] = self.displacement(0, ball);
        weighted(terms)
    }

    /// The penalties that depend on what is matched already.
    pub fn context_terms(&self, matched: &Matched<'_>, joint: usize, ball: usize) -> Option<Terms> {
        let mut terms = [0.0; 10];
        let parent = self.reduced.parents[joint]?;
        let parent_ball = matched.balls[parent];
        for &sibling in self.reduced.children[parent].iter().filter(|&&it| it < joint) {
            terms[DIRECTION] += self.sibling_direction(matched, sibling, joint, ball)?;
        }
        if let Some(mirror) = self.mirrored[joint] {
            terms[SYMMETRY] = self.asymmetry(matched, (mirror, joint), ball)?;
        }
        terms[SHARED_PATH] = self.shared_path(matched, parent_ball, ball)?;
        terms[FAR] = self.far(matched, joint, ball);
        weighted(terms)
    }

    fn sibling_direction(
        &self,
        matched: &Matched<'_>,
        sibling: usize,
        joint: usize,
        ball: usize,
    ) -> Option<f64> {
        let center = |it: usize| self.graph.balls[it].center;
        let wanted = direction(self.reduced.positions[sibling], self.reduced.positions[joint]);
        let found = direction(center(matched.balls[sibling]), center(ball));
        let dot = wanted.dot(&found);
        let places = [sibling, joint].map(|it| self.reduced.positions[it]);
        let share = self.directed((places[1] - places[0]).norm());
        let is_possible = dot >= -0.5 || share < 1.0;
        is_possible.then(|| share * 0.5 * ((2.0 * (1.0 - dot)).powi(2) - 0.5).max(0.0))
    }

    /// How much a direction over some length says. Where joints have places, short ones say little: the
    /// skeleton of a surface seen from one side lies beside the middle of the body.
    fn directed(&self, length: f64) -> f64 {
        match self.places {
            Some(_) => (length / self.short).min(1.0),
            None => 1.0,
        }
    }

    /// Compares the chains of two joints that mirror each other, along the body and straight.
    fn asymmetry(
        &self,
        matched: &Matched<'_>,
        (mirror, joint): (usize, usize),
        ball: usize,
    ) -> Option<f64> {
        let measures = |joint: usize, ball: usize| {
            let parent_ball = matched.balls[self.reduced.parents[joint]?];
            let (a, b) = (&self.graph.balls[parent_ball], &self.graph.balls[ball]);
            let length = self.graph.distance(parent_ball, ball);
            Some((length, length + SLACK * (a.radius + b.radius)))
        };
        let (length, reach) = measures(joint, ball)?;
        let (other_length, other_reach) = measures(mirror, matched.balls[mirror])?;
        let ratio = |a: f64, b: f64| if a == b { 1.0 } else { (a / b).max(b / a) };
        let mixed = 0.2 * ratio(length, other_length).min(2.0) + 0.8 * ratio(reach, other_reach);
        Some((mixed.powi(3) - 1.2).max(0.0))
    }

    fn shared_path(&self, matched: &Matched<'_>, from: usize, to: usize) -> Option<f64> {
        let mut sum = 0.0;
        let path = self.graph.path_back(from, to).take_while(|&it| it != from);
        for (step, ball) in path.enumerate().filter(|it| matched.is_used[it.1]) {
            if self.graph.balls[ball].radius < NARROW {
                return None;
            }
            sum += 0.5 / ((step + 1) as f64).powi(2);
        }
        Some(if sum > 0.0 { sum + 0.5 } else { 0.0 })
    }

    /// How many matched joints are far away along the tree but near along the body.
    fn far(&self, matched: &Matched<'_>, joint: usize, ball: usize) -> f64 {
        let Some(parent) = self.reduced.parents[joint] else { return 0.0 };
        let parent_ball = matched.balls[parent];
        let radius = |it: usize| self.graph.balls[it].radius;
        let own = matched.depths[parent] + self.graph.distance(parent_ball, ball);
        let is_far = |&(other, &other_ball): &(usize, &usize)| {
            let common = self.reduced.common_ancestor(parent, other);
            let tree = own + matched.depths[other] - 2.0 * matched.depths[common];
            let radii = radius(ball) + radius(other_ball);
            tree + radii > 2.0 * (self.graph.distance(ball, other_ball) + radii)
        };
        matched.balls.iter().enumerate().filter(is_far).count() as f64
    }

    /// How far a ball is from where the joint is in its own body: squared, but bounded.
    fn displacement(&self, joint: usize, ball: usize) -> f64 {
        let Some((weight, shift)) = self.places else { return 0.0 };
        let place = self.reduced.positions[joint] + shift;
        let square = (self.graph.balls[ball].center - place).norm_squared();
        weight * square / (1.0 + square / (PLACE_REACH * PLACE_REACH))
    }

    fn foot_height(&self, joint: usize, ball: usize) -> f64 {
        if !self.is_foot[joint] {
            return 0.0;
        }
        let heights = self.graph.balls.iter().map(|it| it.center.dot(&self.up));
        self.graph.balls[ball].center.dot(&self.up) - heights.fold(f64::INFINITY, f64::min)
    }

    /// Whether the body goes on beyond a ball, so that a chain should not end there.
    fn is_inner(&self, ball: usize, found: &Vec3, wanted: &Vec3) -> bool {
        let here = &self.graph.balls[ball];
        self.graph.neighbours[ball].iter().map(|&it| &self.graph.balls[it as usize]).any(|next| {
            let further = direction(here.center, next.center);
            2.0 * next.radius >= here.radius
                && further.dot(found) > 0.95
                && further.dot(wanted) > 0.8
        })
    }

    /// Compares every bone of a chain with where it comes to lie along the path.
    fn bone_directions(&self, joint: usize, parent_ball: usize, ball: usize) -> f64 {
        let chain = &self.reduced.chains[joint];
        let mut polyline: Vec<Vec3> =
            self.graph.path_back(parent_ball, ball).map(|it| self.graph.balls[it].center).collect();
        polyline.reverse();
        let mut previous = polyline[0];
        let ends = along(&polyline, &chain.fractions);
        chain
            .bones
            .iter()
            .zip(ends)
            .map(|(bone, end)| {
                let found = direction(previous, end);
                previous = end;
                if found == Vec3::zeros() {
                    return 0.0;
                }
                let dot = bone.normalize().dot(&found);
                let factor = 1.0 + 10.0 * (-dot).clamp(0.0, 0.5);
                50.0 * bone.norm_squared() * ((1.0 - dot) * factor).powi(2)
            })
            .sum()
    }

    /// The balls that a joint may be matched to: for a leaf, those at the ends of the body; for a
    /// joint that is wanted in the thick of the body, the largest. Where joints have places, those that
    /// are nearest.
    pub fn candidates(&self, joint: usize, is_fat: bool) -> Vec<usize> {
        let mut balls = self.all_candidates(joint, is_fat);
        if self.places.is_some() && balls.len() > N_NEAR {
            let off = |it: &usize| self.displacement(joint, *it);
            balls.sort_by(|a, b| off(a).total_cmp(&off(b)).then(a.cmp(b)));
            balls.truncate(N_NEAR);
            balls.sort_unstable();
        }
        balls
    }

    fn all_candidates(&self, joint: usize, is_fat: bool) -> Vec<usize> {
        let n = self.graph.n();
        if is_fat {
            return (0..n.min(N_FAT)).collect();
        }
        // A skeleton of one joint has no ends.
        if self.reduced.is_leaf(joint) && self.reduced.n() > 1 {
            return (0..n).filter(|&it| self.is_end(it)).collect();
        }
        (0..n).collect()
    }

    /// Whether some edge into the ball is not continued by another.
    fn is_end(&self, ball: usize) -> bool {
        let here = &self.graph.balls[ball];
        let neighbours = &self.graph.neighbours[ball];
        let balls = || neighbours.iter().map(|&it| &self.graph.balls[it as usize]);
        balls().any(|before| {
            let incoming = direction(before.center, here.center);
            !balls().any(|next| {
                2.0 * next.radius >= here.radius
                    && direction(here.center, next.center).dot(&incoming) > 0.8
            })
        })
    }
}

/// How many balls near its place a joint may be matched to.
const N_NEAR: usize = 250;

/// How many of the largest balls a joint in the thick of the body may be matched to.
const N_FAT: usize = 50;

fn direction(from: Vec3, to: Vec3) -> Vec3 {
    (to - from).try_normalize(0.0).unwrap_or_default()
}

/// Multiplies by the weights; `None` if a product exceeds one.
fn weighted(mut terms: Terms) -> Option<Terms> {
    for (term, weight) in terms.iter_mut().zip(WEIGHTS) {
        *term *= weight;
    }
    terms.iter().all(|&it| it <= 1.0).then_some(terms)
}
