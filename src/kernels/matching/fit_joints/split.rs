//! Where a part does not move as one.

use super::choose::LEAST_AREA;
use super::fitted::Fitted;
use super::misfit::{LOST, misfit};
use super::parts::{Parts, on_bone};
use super::samples::Sample;
use super::solve::Pose;
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::rigs::skeleton::Skeleton;

/// Cuts are tried at these distances, and no nearer to other joints.
const STEP: f64 = 0.02;

/// Less of the surface is not worth a joint.
const LEAST_LOST: f64 = 0.01;

/// A place on a bone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cut {
    pub bone: usize,
    pub share: f64,
    pub place: Vec3,
    /// The share of the surface that is off it on the side that is lost.
    pub gain: f64,
}

/// What is looked at.
pub struct View<'a> {
    pub fitted: &'a Fitted,
    pub samples: &'a [Sample],
    pub poses: &'a [Pose<'a>],
}

/// The cut of a part that would leave most of what is off the surface, in some pose, on one side, and what is
/// on it on the other; `None` if no side of any cut is lost while the other is not. Cuts near places that are
/// taken are not tried.
pub fn best_split(skeleton: &Skeleton, view: &View<'_>, taken: &[Vec3], reach: f64) -> Option<Cut> {
    let Fitted { parts, state, points, .. } = view.fitted;
    let cuts = cuts(skeleton, parts, taken);
    let before = preorder(skeleton);
    let mut best: Option<(f64, Cut)> = None;
    for (pose, seen) in view.poses.iter().enumerate() {
        let off: Vec<f64> = points
            .iter()
            .map(|it| misfit(&[it], &state.motions[pose][it.part], seen, reach))
            .collect();
        for &(part, cut) in &cuts {
            // Weight and misfit, behind the cut and before it.
            let mut sums = [[0.0; 2]; 2];
            for (index, sample) in view.samples.iter().enumerate() {
                if points[index].part != part {
                    continue;
                }
                let side = usize::from(!is_behind(&before, sample, &cut));
                sums[side][0] += points[index].weight;
                sums[side][1] += points[index].weight * off[index];
            }
            if sums.iter().any(|it| it[0] < LEAST_AREA) {
                continue;
            }
            let shares = sums.map(|it| it[1] / it[0]);
            let lost = usize::from(shares[1] > shares[0]);
            if shares[lost] <= LOST
                || shares[1 - lost] > 0.5 * shares[lost]
                || sums[lost][1] < LEAST_LOST
            {
                continue;
            }
            // What is off counts for the cut, what is not off counts against it.
            let gain = sums[lost][1] - 0.5 * LOST * sums[lost][0];
            if best.is_none_or(|it| gain > it.0) {
                best = Some((gain, Cut { gain: sums[lost][1], ..cut }));
            }
        }
    }
    best.map(|it| it.1)
}

/// Places for cuts with the parts that they would cut.
fn cuts(skeleton: &Skeleton, parts: &Parts, taken: &[Vec3]) -> Vec<(usize, Cut)> {
    let mut all = Vec::new();
    for piece in &parts.pieces {
        let [from, to] = piece.shares;
        let at = |share: f64| on_bone(skeleton, skeleton.positions(), piece.bone, share);
        let n_steps = ((at(to) - at(from)).norm() / STEP).ceil().clamp(1.0, 100.0);
        for step in 1..=n_steps as usize {
            let share = from + (to - from) * (step as f64 / n_steps);
            let place = at(share);
            if taken.iter().all(|it| (it - place).norm() > STEP) {
                all.push((piece.part, Cut { bone: piece.bone, share, place, gain: 0.0 }));
            }
        }
    }
    all
}

/// For every joint of the skeleton its place in an order of parents first, and the place behind the last
/// one below it.
fn preorder(skeleton: &Skeleton) -> Vec<[usize; 2]> {
    let children = skeleton.children();
    let mut spans = vec![[0; 2]; skeleton.n_joints()];
    let mut next = 0;
    for root in (0..skeleton.n_joints()).filter(|&it| skeleton.parents()[it].is_none()) {
        let mut stack = vec![(root, false)];
        while let Some((joint, is_done)) = stack.pop() {
            if is_done {
                spans[joint][1] = next;
                continue;
            }
            spans[joint][0] = next;
            next += 1;
            stack.push((joint, true));
            stack.extend(children[joint].iter().map(|&it| (it, false)));
        }
    }
    spans
}

fn is_behind(spans: &[[usize; 2]], sample: &Sample, cut: &Cut) -> bool {
    if sample.bone == cut.bone {
        return sample.share > cut.share;
    }
    let [first, end] = spans[cut.bone];
    (first..end).contains(&spans[sample.bone][0])
}
