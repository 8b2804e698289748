//! Which joints the surfaces can do without.

use super::blocks::Point;
use super::misfit::{LOST, misfit, points_of_parts};
use super::parts::Parts;
use super::solve::{Pose, State};
use super::{Drop, FitOptions};
use crate::kernels::matching::find_joints::Joint;

/// How many points of a part are looked at.
const LOOKED_AT: usize = 300;

/// The least share of the surface that a part beside a joint has.
pub const LEAST_AREA: f64 = 0.003;

/// A joint that may be dropped.
#[derive(Debug, Clone, Copy)]
pub struct Need {
    pub drop: Drop,
    /// How much it is needed; below 1 it may well be none.
    pub score: f64,
    /// Whether it is none in any case: it hardly turns, or there is no surface on one of its sides.
    pub is_none: bool,
}

/// All joints from the one that is needed least: its two parts have little surface, turn little against each
/// other, or lie as well on the surfaces if both move as one of them.
pub fn by_need(
    joints: &[Joint],
    parts: &Parts,
    state: &State,
    points: &[Point],
    poses: &[Pose<'_>],
    options: &FitOptions,
) -> Vec<Need> {
    let few = points_of_parts(points, parts.n_parts(), LOOKED_AT);
    let mut areas = vec![0.0; parts.n_parts()];
    points.iter().for_each(|it| areas[it.part] += it.weight);
    let need = |index: usize| {
        let [a, b] = parts.sides[index];
        let stays = if areas[a] >= areas[b] { a } else { b };
        let (small, goes) = (areas[a].min(areas[b]), a + b - stays);
        let gain = |(pose, view): (usize, &Pose<'_>)| {
            let motions = &state.motions[pose];
            let off = |part: usize, as_part: usize| {
                misfit(&few[part], &motions[as_part], view, options.reach)
            };
            let own = off(goes, goes);
            // Where a part is lost, nothing is known about it.
            if own > LOST { 0.0 } else { off(goes, stays) - own }
        };
        let gain = poses.iter().enumerate().map(gain).fold(0.0, f64::max);
        // Each as a share of what is wanted.
        let at_all = (small / LEAST_AREA).min(joints[index].angle / options.min_angle);
        let score = at_all.min(gain / options.min_gain);
        Need { drop: Drop { joint: index, stays }, score, is_none: at_all < 1.0 }
    };
    let mut all: Vec<Need> = (0..joints.len()).map(need).collect();
    all.sort_by(|a, b| a.score.total_cmp(&b.score).then(a.drop.joint.cmp(&b.drop.joint)));
    all
}
