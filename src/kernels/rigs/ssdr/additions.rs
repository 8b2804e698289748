//! Bones that might be added where the error is large.

use faer::Mat;
use nalgebra::{Matrix4, Vector3, Vector4};

use super::Moving;
use super::descent::Descent;
use super::motions::{Matrix3x4, fit};

/// A bone that might be added, and the share of every vertex that it would move.
pub struct Addition {
    pub motion: Vec<Matrix3x4>,
    pub shares: Vec<f64>,
}

/// Vertices that a new bone is first fitted to.
const NEAR: usize = 6;
/// Rounds of fitting a new bone to its vertices, and vertices to the bone.
const ROUNDS: usize = 3;
/// Places that are looked at beyond those wanted.
const MORE: usize = 3;
/// A new bone takes vertices of which it would move a larger share.
pub const TAKEN: f64 = 0.3;
/// A vertex that is off by this, in sizes of the mesh, needs no bone.
const RIGID: f64 = 1e-6;

/// The bones that would lower the error most; the first `n_skipped` are left out.
///
/// A bone begins at the vertex with the largest error and its neighbours in space. If it moves the
/// share `w` of a vertex and the bones before the rest, `r` becomes `r - w d`, where `r = v - s` is the
/// vertex's residual and `d` the way from the skinned `s` to where the new bone alone would move it.
pub fn additions(now: &Descent, n_wanted: usize, n_skipped: usize) -> Vec<Addition> {
    let moving = now.moving;
    let residuals = now.motions.residuals(moving, &now.rows);
    let mut left = now.errors.clone();
    let mut found: Vec<(f64, Addition)> = Vec::new();
    for _ in 0..n_wanted + n_skipped + MORE {
        let worst = (0..left.len()).max_by(|&a, &b| left[a].total_cmp(&left[b]).then(b.cmp(&a)));
        let worst = worst.expect("there are vertices");
        if left[worst] <= RIGID * RIGID * moving.n_frames() as f64 {
            break;
        }
        let mut shares = vec![0.0; left.len()];
        for it in nearest(moving, worst) {
            (left[it], shares[it]) = (0.0, 1.0);
        }
        let mut best: Option<(f64, Addition)> = None;
        for _ in 0..ROUNDS {
            let motion = fitted(moving, &residuals, &shares);
            let gain = share_out(moving, &residuals, &motion, &mut shares);
            if best.as_ref().is_none_or(|it| gain > it.0) {
                best = Some((gain, Addition { motion, shares: shares.clone() }));
            }
        }
        // The next bone begins where this one does not help.
        for (left, share) in left.iter_mut().zip(best.iter().flat_map(|it| &it.1.shares)) {
            *left *= 1.0 - share;
        }
        found.extend(best.filter(|it| it.1.shares.iter().any(|&share| share > TAKEN)));
    }
    // A stable sort: the larger error first where gains are the same.
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.into_iter().map(|it| it.1).skip(n_skipped).take(n_wanted).collect()
}

fn nearest(moving: &Moving, vertex: usize) -> Vec<usize> {
    let at = Vector4::from(moving.rest[vertex]);
    let far = |it: &[f64; 4]| (Vector4::from(*it) - at).norm_squared();
    let mut order: Vec<(f64, usize)> = moving.rest.iter().map(far).zip(0..).collect();
    let n = NEAR.min(order.len());
    order.select_nth_unstable_by(n - 1, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    order[..n].iter().map(|it| it.1).collect()
}

/// The rigid motion that fits best for these shares.
fn fitted(moving: &Moving, residuals: &Mat<f64>, shares: &[f64]) -> Vec<Matrix3x4> {
    let mut moments = Matrix4::zeros();
    let mut targets = vec![Matrix3x4::zeros(); moving.n_frames()];
    for (vertex, &share) in shares.iter().enumerate().filter(|it| *it.1 > 0.0) {
        let u = Vector4::from(moving.rest[vertex]);
        moments += u * u.transpose() * (share * share);
        let positions = moving.frames.col_as_slice(vertex).as_chunks::<3>().0;
        let residuals = residuals.col_as_slice(vertex).as_chunks::<3>().0;
        for (target, (v, r)) in targets.iter_mut().zip(positions.iter().zip(residuals)) {
            // `v - (1 - w) s`
            let aim = Vector3::from(*v) * share + Vector3::from(*r) * (1.0 - share);
            *target += aim * share * u.transpose();
        }
    }
    let motion = |it: &Matrix3x4| fit(it, &moments).unwrap_or_else(Matrix3x4::identity);
    targets.iter().map(motion).collect()
}

/// Finds the best share of every vertex, and returns by how much the error falls.
fn share_out(
    moving: &Moving,
    residuals: &Mat<f64>,
    motion: &[Matrix3x4],
    shares: &mut [f64],
) -> f64 {
    let mut gain = 0.0;
    for (vertex, share) in shares.iter_mut().enumerate() {
        let u = Vector4::from(moving.rest[vertex]);
        let positions = moving.frames.col_as_slice(vertex).as_chunks::<3>().0;
        let residuals = residuals.col_as_slice(vertex).as_chunks::<3>().0;
        let (mut along, mut square) = (0.0, 0.0);
        for (motion, (v, r)) in motion.iter().zip(positions.iter().zip(residuals)) {
            let r = Vector3::from(*r);
            let d = motion * u - (Vector3::from(*v) - r);
            along += r.dot(&d);
            square += d.norm_squared();
        }
        *share = if square > 0.0 { (along / square).clamp(0.0, 1.0) } else { 0.0 };
        gain += *share * (2.0 * along - *share * square);
    }
    gain
}
