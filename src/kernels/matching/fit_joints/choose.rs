//! Which joint the surfaces can do without.

use super::parts::Parts;
use super::search::{LOST, misfit, points_of_parts};
use super::solve::{Point, Pose, State};
use super::{Drop, FitOptions};
use crate::kernels::matching::find_joints::Joint;

/// How many points of a part are looked at.
const LOOKED_AT: usize = 300;

/// The least share of the surface that a part beside a joint has.
pub const LEAST_AREA: f64 = 0.003;

/// The joint whose two parts could best be one: they have little surface, turn little against each
/// other, or lie as well on the surfaces if both move as one of them. `None` if all joints are needed.
pub fn least_needed(
    joints: &[Joint],
    parts: &Parts,
    state: &State,
    points: &[Point],
    poses: &[Pose<'_>],
    options: &FitOptions,
) -> Option<Drop> {
    let few = points_of_parts(points, parts.n_parts(), LOOKED_AT);
    let mut areas = vec![0.0; parts.n_parts()];
    points.iter().for_each(|it| areas[it.part] += it.weight);
    let needed = |index: usize| {
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
        // Each of the three as a share of what is wanted.
        let score = (small / LEAST_AREA)
            .min(joints[index].angle / options.min_angle)
            .min(gain / options.min_gain);
        (score, Drop { joint: index, stays })
    };
    let all = (0..joints.len()).map(needed);
    let least = all.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.joint.cmp(&b.1.joint)))?;
    (least.0 < 1.0).then_some(least.1)
}
