//! Smooth curves of rotations and of points through keys.

use nalgebra::UnitQuaternion;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::kernels::geometry::mesh::Vec3;

/// What keys are to a curve.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Keys {
    /// The curve passes through them.
    #[default]
    Passed,
    /// They attract the curve, as control points; it passes through the first and the last only.
    Approached,
}

/// A cubic curve of rotations, one unit of time from key to key.
///
/// The cumulative B-spline `q(t) = q_0 prod_k exp(B_k(t) log(q_{k-1}^-1 q_k))` (Kim, Kim & Shin 1995)
/// on uniform knots: twice continuously differentiable. At both ends it is continued straight on, so
/// that it begins at the first key and ends at the last.
#[derive(Debug, Clone, PartialEq)]
pub struct QuaternionSpline {
    /// One before the keys and one behind them.
    controls: Vec<UnitQuaternion<f64>>,
}

/// The same for points: an ordinary cubic B-spline.
#[derive(Debug, Clone, PartialEq)]
pub struct PointSpline {
    controls: Vec<Vec3>,
}

/// Angles, or lengths over the largest coordinate, by which a curve may miss its keys.
const TOLERANCE: f64 = 1e-10;
/// The most corrections of the control values.
const MAX_ROUNDS: usize = 500;
/// How much of a miss is corrected at once: the values of a cubic B-spline are (1, 4, 1) / 6 of the
/// controls, whose eigenvalues lie in 1/3 to 1, so that every round at least halves the misses of
/// points.
const GAIN: f64 = 1.5;
/// A gain is halved when it makes things worse, down to this.
const LEAST_GAIN: f64 = 1e-3;

impl QuaternionSpline {
    /// Finds the curve of some keys.
    ///
    /// The shortest arcs between neighbours are taken, so `q` and `-q` are the same key. Returns the
    /// curve and the largest angle in radians by which it misses a key: below 1e-10, unless
    /// neighbours are so far apart (near half a turn) that there is no such curve nearby.
    ///
    /// # Panics
    /// If there is no key.
    pub fn new(keys: &[UnitQuaternion<f64>], mode: Keys) -> (Self, f64) {
        assert!(!keys.is_empty(), "a curve needs a key");
        let mut curve = Self { controls: with_ends(keys, turn_on) };
        if mode == Keys::Approached {
            return (curve, 0.0);
        }
        let mut best = (curve.clone(), f64::INFINITY);
        let mut corrections = Vec::new();
        let mut gain = GAIN;
        for _ in 0..MAX_ROUNDS {
            let misses: Vec<Vec3> = (keys.iter().enumerate())
                .map(|(at, key)| (key * curve.at(at as f64).inverse()).scaled_axis())
                .collect();
            let largest = misses.iter().fold(0.0, |most: f64, it| most.max(it.norm()));
            if largest < best.1 {
                best = (curve, largest);
                corrections = misses;
            } else {
                gain *= 0.5;
            }
            if best.1 < TOLERANCE || gain < LEAST_GAIN {
                break;
            }
            let corrected: Vec<UnitQuaternion<f64>> = (corrections.iter())
                .zip(&best.0.controls[1..])
                .map(|(miss, it)| UnitQuaternion::from_scaled_axis(miss * gain) * it)
                .collect();
            curve = Self { controls: with_ends(&corrected, turn_on) };
        }
        best
    }

    /// The rotation at a time, from 0 at the first key; times outside are moved to the ends.
    pub fn at(&self, time: f64) -> UnitQuaternion<f64> {
        let (first, [_, b, c, d]) = weights(time, self.controls.len() - 2);
        let it = &self.controls[first..first + 4];
        let step = |at: usize, part: f64| {
            let turn = (it[at - 1].inverse() * it[at]).scaled_axis();
            UnitQuaternion::from_scaled_axis(turn * part)
        };
        it[0] * step(1, b + c + d) * step(2, c + d) * step(3, d)
    }
}

impl PointSpline {
    /// Finds the curve of some keys.
    ///
    /// # Panics
    /// If there is no key.
    pub fn new(keys: &[Vec3], mode: Keys) -> Self {
        assert!(!keys.is_empty(), "a curve needs a key");
        let mut curve = Self { controls: with_ends(keys, go_on) };
        if mode == Keys::Approached {
            return curve;
        }
        let size = keys.iter().fold(0.0, |most: f64, it| most.max(it.amax()));
        for _ in 0..MAX_ROUNDS {
            let misses: Vec<Vec3> =
                keys.iter().enumerate().map(|(at, key)| key - curve.at(at as f64)).collect();
            if misses.iter().all(|it| it.amax() <= TOLERANCE * size) {
                break;
            }
            let corrected: Vec<Vec3> = misses
                .iter()
                .zip(&curve.controls[1..])
                .map(|(miss, it)| it + miss * GAIN)
                .collect();
            curve.controls = with_ends(&corrected, go_on);
        }
        curve
    }

    /// The point at a time, from 0 at the first key; times outside are moved to the ends.
    pub fn at(&self, time: f64) -> Vec3 {
        let (first, weights) = weights(time, self.controls.len() - 2);
        (0..4).map(|it| self.controls[first + it] * weights[it]).sum()
    }
}

/// Where `from` leads to when what led to it from `before` is done again.
fn turn_on(before: &UnitQuaternion<f64>, from: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    from * (before.inverse() * from)
}

fn go_on(before: &Vec3, from: &Vec3) -> Vec3 {
    from * 2.0 - before
}

/// One value more at both ends; at least four in all.
fn with_ends<T: Copy>(keys: &[T], on: fn(&T, &T) -> T) -> Vec<T> {
    let (first, last) = (keys[0], keys[keys.len() - 1]);
    if keys.len() == 1 {
        return vec![first; 4];
    }
    let mut res = vec![on(&keys[1], &first)];
    res.extend(keys);
    res.push(on(&keys[keys.len() - 2], &last));
    res
}

/// The first of the four controls that matter at a time, and their weights.
fn weights(time: f64, n_keys: usize) -> (usize, [f64; 4]) {
    let last = n_keys.saturating_sub(1);
    let time = time.clamp(0.0, last as f64);
    let first = (time.floor() as usize).min(last.saturating_sub(1));
    let u = time - first as f64;
    let (square, cube) = (u * u, u * u * u);
    let rest = 1.0 - u;
    let all = [
        rest * rest * rest,
        3.0 * cube - 6.0 * square + 4.0,
        -3.0 * cube + 3.0 * square + 3.0 * u + 1.0,
        cube,
    ];
    (first, all.map(|it| it / 6.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::numerics::random::Random;

    /// Rotations that turn by up to so much from key to key.
    fn wander(n_keys: usize, angle_rad: f64, seed: u64) -> Vec<UnitQuaternion<f64>> {
        let mut random = Random::new(seed);
        let mut turn = UnitQuaternion::identity();
        let mut step = || {
            let axis = Vec3::from_fn(|_, _| random.normal()).normalize();
            turn *= UnitQuaternion::from_scaled_axis(axis * random.between(0.0, angle_rad));
            // Signs must not matter.
            if random.uniform() < 0.5 {
                UnitQuaternion::new_unchecked(-turn.into_inner())
            } else {
                turn
            }
        };
        (0..n_keys).map(|_| step()).collect()
    }

    #[test]
    fn keys_that_are_all_the_same_stay() {
        let key = UnitQuaternion::from_euler_angles(0.3, -1.0, 2.0);
        for n_keys in [1, 2, 5] {
            for mode in [Keys::Passed, Keys::Approached] {
                let (curve, miss) = QuaternionSpline::new(&vec![key; n_keys], mode);
                assert!(miss < 1e-10);
                assert!((0..40).all(|it| curve.at(0.1 * f64::from(it)).angle_to(&key) < 1e-7));
                let points = PointSpline::new(&vec![Vec3::new(1.0, 2.0, 3.0); n_keys], mode);
                assert!((points.at(0.4) - Vec3::new(1.0, 2.0, 3.0)).norm() < 1e-12);
            }
        }
    }

    #[test]
    fn two_keys_make_an_even_turn() {
        let [a, b] = wander(2, 2.0, 1)[..] else { panic!("two keys") };
        let (curve, _) = QuaternionSpline::new(&[a, b], Keys::Passed);
        let line = PointSpline::new(&[Vec3::x(), Vec3::y()], Keys::Approached);
        for it in 0..=20 {
            let t = f64::from(it) / 20.0;
            assert!(curve.at(t).angle_to(&a.slerp(&b, t)) < 1e-7, "{t}");
            assert!((line.at(t) - Vec3::new(1.0 - t, t, 0.0)).norm() < 1e-12);
        }
    }

    #[test]
    fn the_curve_passes_through_its_keys() {
        for seed in 0..20 {
            let keys = wander(12, 1.3, seed);
            let (curve, miss) = QuaternionSpline::new(&keys, Keys::Passed);
            assert!(miss < 1e-10, "{miss}");
            for (at, key) in keys.iter().enumerate() {
                let off = (key * curve.at(at as f64).inverse()).scaled_axis().norm();
                assert!(off < 1e-10, "{off}");
            }
            let points: Vec<Vec3> = keys.iter().map(|it| it * Vec3::x() * 100.0).collect();
            let curve = PointSpline::new(&points, Keys::Passed);
            let miss = |(at, it): (usize, &Vec3)| (curve.at(at as f64) - it).norm();
            assert!(points.iter().enumerate().map(miss).fold(0.0, f64::max) < 1e-7);
        }
    }

    #[test]
    fn control_points_only_attract() {
        let keys = wander(6, 1.5, 4);
        let (curve, _) = QuaternionSpline::new(&keys, Keys::Approached);
        for (at, is_end) in [(0, true), (2, false), (3, false), (5, true)] {
            let off = (keys[at] * curve.at(at as f64).inverse()).scaled_axis().norm();
            assert_eq!(off < 1e-12, is_end, "{at}: {off}");
        }
    }

    /// Left and right of a key the second derivatives agree; they are found by one-sided differences of
    /// second order, and the third derivative jumps.
    #[test]
    fn the_curve_is_twice_differentiable_at_keys() {
        let keys = wander(8, 1.2, 9);
        let points: Vec<Vec3> = keys.iter().map(|it| it * Vec3::new(1.0, 2.0, 3.0)).collect();
        let (turns, _) = QuaternionSpline::new(&keys, Keys::Passed);
        let points = PointSpline::new(&points, Keys::Passed);
        let probe = Vec3::new(0.3, -1.0, 0.5);
        let check = |at: &dyn Fn(f64) -> Vec3, key: f64| {
            let h = 1e-3;
            let second = |h: f64| {
                let it = |steps: f64| at(key + steps * h);
                (it(0.0) * 2.0 - it(1.0) * 5.0 + it(2.0) * 4.0 - it(3.0)) / (h * h)
            };
            let first = |h: f64| (at(key) * -1.5 + at(key + h) * 2.0 - at(key + 2.0 * h) * 0.5) / h;
            let size = second(h).norm().max(1.0);
            assert!((first(h) - first(-h)).norm() < 1e-4 * size);
            assert!((second(h) - second(-h)).norm() < 1e-3 * size);
            let third = |h: f64| {
                let it = |steps: f64| at(key + steps * h);
                (it(3.0) - it(2.0) * 3.0 + it(1.0) * 3.0 - it(0.0)) / (h * h * h)
            };
            assert!((third(h) - third(-h)).norm() > 0.1, "no B-spline, but one polynomial");
        };
        for key in [2.0, 3.0, 4.0, 5.0] {
            check(&|t| turns.at(t) * probe, key);
            check(&|t| points.at(t), key);
        }
    }
}
