//! How much chains bend at their samples, pose by pose.

use nalgebra::{Matrix3, UnitQuaternion};

use super::chains::Chain;
use crate::kernels::geometry::kabsch::{best_rotation, shortest_arc};
use crate::kernels::geometry::mesh::Vec3;

/// Directions that differ by less are equally good witnesses of how a branch node turns.
const SURE_RAD: f64 = 0.05;

/// How the outgoing side of a sample turns against its incoming side.
#[derive(Debug, Clone, PartialEq)]
pub struct Bend {
    pub chain: usize,
    pub sample: usize,
    /// A rotation vector a pose, in radians, in the frame of the rest pose.
    pub turns: Vec<Vec3>,
}

impl Bend {
    /// The root of the mean squared turn, in radians: the same shape as the greatest one, and less
    /// dependent on a single pose.
    pub fn spread(&self) -> f64 {
        let sum: f64 = self.turns.iter().map(|it| it.norm_squared()).sum();
        (sum / self.turns.len().max(1) as f64).sqrt()
    }

    /// The greatest turn of all poses, in radians.
    pub fn angle(&self) -> f64 {
        self.turns.iter().map(|it| it.norm()).fold(0.0, f64::max)
    }
}

type Frames = Vec<UnitQuaternion<f64>>;

/// Measures bends at all samples, and of the branch nodes at the ends of chains, where both sides are long enough to have a direction: at least
/// half of `window`. Sides are chords of this length, or shorter at the chain's ends.
///
/// Frames go along the tree from the roots: each sample turns the smallest way against the one before
/// it. A branch node turns as most of the directions around it do. Roll about the chain cannot be seen.
pub fn bends(chains: &[Chain], n_poses: usize, window: f64) -> Vec<Bend> {
    let mut bends = Vec::new();
    let mut ends: Vec<Frames> = Vec::with_capacity(chains.len());
    let mut begun: Vec<Frames> = Vec::with_capacity(chains.len());
    for (index, chain) in chains.iter().enumerate() {
        // Chains that begin at one node begin alike: a star has many.
        let first = chains[..index]
            .iter()
            .position(|it| it.before == chain.before && it.joints[0] == chain.joints[0]);
        let starts = match first {
            Some(it) => begun[it].clone(),
            None => {
                let starts = frames_at_start(chains, index, &ends, n_poses, window);
                bends.extend(chain.before.map(|it| at_end(chains, it, window, &ends[it], &starts)));
                starts
            }
        };
        begun.push(starts.clone());
        let (found, end) = along(chain, index, starts, window);
        bends.extend(found);
        ends.push(end);
    }
    bends
}

/// How the branch node at the end of a chain turns against the chain; its roll about the chain does not count,
/// since that of the chain is not known.
fn at_end(chains: &[Chain], index: usize, window: f64, ends: &Frames, starts: &Frames) -> Bend {
    let sample = chains[index].ways.len() - 1;
    let along = chord(&chains[index], None, sample, -reach(window)).unwrap_or_else(Vec3::zeros);
    let turn = |(end, start): (&UnitQuaternion<f64>, &UnitQuaternion<f64>)| {
        shortest_arc(along, end.inverse() * (start * along)).scaled_axis()
    };
    Bend { chain: index, sample, turns: ends.iter().zip(starts).map(turn).collect() }
}

/// The chord that ends or begins at a sample; none if it is too short.
fn chord(chain: &Chain, pose: Option<usize>, sample: usize, reach: f64) -> Option<Vec3> {
    let at = chain.ways[sample];
    let other = if reach == f64::INFINITY {
        chain.ways.get(sample + 1).copied()?
    } else if reach == f64::NEG_INFINITY {
        chain.ways[sample.checked_sub(1)?]
    } else {
        (at + reach).clamp(0.0, chain.length())
    };
    let is_short = (other - at).abs() < 0.5 * reach.abs() && reach.is_finite();
    // A chain shorter than half a window still has a direction as a whole.
    let is_whole = (other - at).abs() >= chain.length();
    if is_short && !is_whole || other == at {
        return None;
    }
    let chord = chain.place(pose, other) - chain.place(pose, at);
    let chord = if reach < 0.0 { -chord } else { chord };
    chord.try_normalize(1e-12)
}

/// Infinite reaches stand for the neighbouring sample.
fn reach(window: f64) -> f64 {
    if window > 0.0 { window } else { f64::INFINITY }
}

/// How the start of a chain is turned in every pose.
fn frames_at_start(
    chains: &[Chain],
    index: usize,
    ends: &[Frames],
    n_poses: usize,
    window: f64,
) -> Frames {
    let chain = &chains[index];
    let is_sibling = |it: &&Chain| it.before == chain.before && it.joints[0] == chain.joints[0];
    let siblings: Vec<&Chain> = chains.iter().filter(is_sibling).collect();
    let frame = |pose: usize| {
        let mut pairs: Vec<(Vec3, Vec3)> = Vec::new();
        let mut start = None;
        if let Some(before) = chain.before {
            let last = chains[before].ways.len() - 1;
            let of = |pose| chord(&chains[before], pose, last, -reach(window));
            pairs.extend(of(None).zip(of(Some(pose))));
            start = Some(ends[before][pose]);
        }
        for it in &siblings {
            pairs.extend(chord(it, None, 0, reach(window)).zip(chord(
                it,
                Some(pose),
                0,
                reach(window),
            )));
        }
        most_agreed(&pairs, start)
    };
    (0..n_poses).map(frame).collect()
}

/// The rotation that most pairs of directions agree on: the sum of the angles that are left over is
/// least.
fn most_agreed(pairs: &[(Vec3, Vec3)], start: Option<UnitQuaternion<f64>>) -> UnitQuaternion<f64> {
    const ROUNDS: usize = 30;
    if let (Some(start), true) = (start, pairs.len() < 3) {
        return start;
    }
    if let [(a, b)] = pairs {
        return shortest_arc(*a, *b);
    }
    let fit = |turn: Option<UnitQuaternion<f64>>| {
        let weight = |(a, b): &(Vec3, Vec3)| match turn {
            Some(turn) => 1.0 / (turn * a).angle(b).max(SURE_RAD),
            None => 1.0,
        };
        let covariance: Matrix3<f64> =
            pairs.iter().map(|it| it.1 * it.0.transpose() * weight(it)).sum();
        best_rotation(&covariance)
    };
    let cost = |turn: &UnitQuaternion<f64>| -> f64 {
        pairs.iter().map(|(a, b)| (turn * a).angle(b).max(SURE_RAD)).sum()
    };
    // From all of them, and from each two: the sum has several minima.
    let mut best: Option<(f64, UnitQuaternion<f64>)> = None;
    let mut try_from = |mut turn: UnitQuaternion<f64>| {
        for _ in 0..ROUNDS {
            turn = fit(Some(turn));
        }
        let cost = cost(&turn);
        if best.as_ref().is_none_or(|it| cost < it.0 - 1e-9) {
            best = Some((cost, turn));
        }
    };
    try_from(fit(None));
    for (index, a) in pairs.iter().enumerate().take(6) {
        for b in pairs[index + 1..].iter().take(6) {
            let two = [a, b].iter().map(|it| it.1 * it.0.transpose()).sum::<Matrix3<f64>>();
            try_from(best_rotation(&two));
        }
    }
    best.map_or_else(UnitQuaternion::identity, |it| it.1)
}

/// The bends of a chain, and the frames at its end.
fn along(chain: &Chain, index: usize, mut frames: Frames, window: f64) -> (Vec<Bend>, Frames) {
    let mut bends = Vec::new();
    for sample in 0..chain.ways.len() {
        if let Some(rest) = chord(chain, None, sample, -reach(window)) {
            for (pose, frame) in frames.iter_mut().enumerate() {
                let Some(now) = chord(chain, Some(pose), sample, -reach(window)) else { continue };
                *frame = shortest_arc(*frame * rest, now) * *frame;
            }
        } else if sample > 0 {
            continue;
        }
        // At a root only its own frame is known, which its bones have made.
        let Some(rest) = chord(chain, None, sample, reach(window)) else { continue };
        let turn = |(pose, frame): (usize, &UnitQuaternion<f64>)| {
            let now = chord(chain, Some(pose), sample, reach(window)).unwrap_or(*frame * rest);
            shortest_arc(rest, frame.inverse() * now).scaled_axis()
        };
        let turns = frames.iter().enumerate().map(turn).collect();
        bends.push(Bend { chain: index, sample, turns });
    }
    (bends, frames)
}
