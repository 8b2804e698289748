//! Limbs that were lost in a pose are looked for all around their joints.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use rayon::prelude::*;

use super::parts::{Parts, moved};
use super::solve::{Point, Pose, State};
use crate::kernels::geometry::mesh::Vec3;

/// How many turns are tried.
const TRIED: usize = 600;

/// How many points of a part are looked at while turns are tried.
const LOOKED_AT: usize = 120;

/// A part of which more than this share does not lie on the surface is lost.
pub const LOST: f64 = 0.3;

/// A part whose side of a joint is farther from the other side than this, in parts of the extent, is lost, too:
/// curves of legs may be taken for each other in a pose, and one leg lies well where the other is.
const TORN: f64 = 0.04;

/// The share of a part that does not lie on the surface of a pose, from 0 to 1: a point counts 1 from
/// `reach` on, or where the surface looks another way.
pub fn misfit(points: &[&Point], motion: &Isometry3<f64>, pose: &Pose<'_>, reach: f64) -> f64 {
    const LEAST_COSINE: f64 = 0.5;
    let total: f64 = points.iter().map(|it| it.weight).sum();
    if !(total > 0.0) {
        return 0.0;
    }
    let off = |point: &&Point| {
        let near = pose.surface.nearest_within(moved(motion, point.place), reach * reach);
        let fits = |face: u32| {
            let cosine = (motion.rotation * point.normal).dot(&pose.normals[face as usize]);
            cosine >= LEAST_COSINE
        };
        let share = near.filter(|it| fits(it.face)).map_or(1.0, |it| it.square / (reach * reach));
        point.weight * share
    };
    points.iter().map(off).sum::<f64>() / total
}

/// The points of every part, at most about `most` of each.
pub fn points_of_parts(points: &[Point], n_parts: usize, most: usize) -> Vec<Vec<&Point>> {
    let mut all: Vec<Vec<&Point>> = vec![Vec::new(); n_parts];
    points.iter().for_each(|it| all[it.part].push(it));
    for list in &mut all {
        let stride = list.len().div_ceil(most.max(1)).max(1);
        *list = list.iter().step_by(stride).copied().collect();
    }
    all
}

/// Looks for parts that are lost in a pose, from the root on: at all turns about the joint that they hang
/// on. Parts behind a part that was found move with it first. Returns whether anything was found.
pub fn find_lost(
    state: &mut State,
    points: &[Point],
    poses: &[Pose<'_>],
    parts: &Parts,
    reach: f64,
) -> bool {
    let few = points_of_parts(points, parts.n_parts(), LOOKED_AT);
    let joints = &state.joints;
    let in_pose = |(motions, pose): (&mut Vec<Isometry3<f64>>, &Pose<'_>)| {
        let mut is_found = false;
        let mut is_moved = vec![false; motions.len()];
        for part in 0..motions.len() {
            let Some(joint) = parts.joint_of_part[part] else { continue };
            let above = parts.sides[joint][0];
            if is_moved[above] {
                is_moved[part] = true;
            }
            let before = misfit(&few[part], &motions[part], pose, reach);
            let center = moved(&motions[above], joints[joint]);
            let is_torn = (moved(&motions[part], joints[joint]) - center).norm() > TORN;
            if before <= LOST && !is_torn {
                continue;
            }
            let (found, after) =
                best_turn(&few[part], &motions[above], joints[joint], center, pose, reach);
            if after < 0.8 * before || is_torn && after <= LOST {
                let step = found * motions[part].inverse();
                carry(parts, part, &step, motions);
                (is_moved[part], is_found) = (true, true);
            }
        }
        is_found
    };
    let found: Vec<bool> = state.motions.par_iter_mut().zip(poses).map(in_pose).collect();
    found.contains(&true)
}

/// Moves a part and all that hangs on it.
fn carry(parts: &Parts, part: usize, step: &Isometry3<f64>, motions: &mut [Isometry3<f64>]) {
    let mut is_carried = vec![false; motions.len()];
    for index in part..motions.len() {
        let hangs = parts.parent(index).is_some_and(|it| is_carried[it]);
        if index == part || hangs {
            is_carried[index] = true;
            motions[index] = step * motions[index];
        }
    }
}

/// The turn about a joint in which a part lies best on the surface, first among all, then around the best
/// few.
fn best_turn(
    points: &[&Point],
    above: &Isometry3<f64>,
    joint: Vec3,
    center: Vec3,
    pose: &Pose<'_>,
    reach: f64,
) -> (Isometry3<f64>, f64) {
    /// Wide at first, so that turns need not be dense.
    const WIDE: f64 = 4.0;
    const KEPT: usize = 6;
    const ROUNDS: usize = 4;
    let about = |turn: UnitQuaternion<f64>| {
        Isometry3::from_parts(Translation3::from(center - turn * joint), turn)
    };
    let mut all: Vec<(f64, usize)> = (0..TRIED)
        .into_par_iter()
        .map(|index| {
            let turn = spiral(index) * above.rotation;
            (misfit(points, &about(turn), pose, WIDE * reach), index)
        })
        .collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut best = (*above, f64::INFINITY);
    for &(_, index) in all.iter().take(KEPT) {
        let mut turn = spiral(index) * above.rotation;
        let mut least = misfit(points, &about(turn), pose, 2.0 * reach);
        for round in 0..ROUNDS {
            let size = 0.3 * 0.5_f64.powi(round as i32);
            for axis in [Vec3::x(), -Vec3::x(), Vec3::y(), -Vec3::y(), Vec3::z(), -Vec3::z()] {
                let next = UnitQuaternion::new(axis * size) * turn;
                let value = misfit(points, &about(next), pose, 2.0 * reach);
                if value < least {
                    (turn, least) = (next, value);
                }
            }
        }
        let value = misfit(points, &about(turn), pose, reach);
        if value < best.1 {
            best = (about(turn), value);
        }
    }
    best
}

/// Rotations that are spread evenly: a spiral on the sphere of quaternions (Alexa, "Super-Fibonacci
/// spirals", 2022).
fn spiral(index: usize) -> UnitQuaternion<f64> {
    const PSI: f64 = 1.533_751_168_755_204_3;
    let s = index as f64 + 0.5;
    let (t, d) = (s / TRIED as f64, std::f64::consts::TAU * s);
    let (r, big_r) = (t.sqrt(), (1.0 - t).sqrt());
    let (alpha, beta) = (d / std::f64::consts::SQRT_2, d / PSI);
    UnitQuaternion::from_quaternion(Quaternion::new(
        big_r * beta.cos(),
        r * alpha.sin(),
        r * alpha.cos(),
        big_r * beta.sin(),
    ))
}
