//! True skin weights: they follow from the parts that form the surface.

use rayon::prelude::*;

use super::surface::{Part, Surface};
use crate::kernels::{geometry::mesh::Vec3, rigs::weights::SkinWeights};

/// At most this many joints move a vertex.
const MAX_INFLUENCES: usize = 4;

/// Weights below this are dropped.
const LEAST: f64 = 0.01;

/// A vertex takes part in two limbs only where they are this close to equally near, in metres.
const BETWEEN_LIMBS: f64 = 0.03;

/// Computes smooth, local weights of points on the surface.
///
/// Along a part, each joint takes over from the one before within a short stretch around its
/// position. Where parts blend, they share a point by their distances from it, and fade out at the
/// width of their blend.
pub fn skin_weights(surface: &Surface, n_joints: usize, points: &[Vec3]) -> SkinWeights {
    let rows: Vec<Vec<(u32, f64)>> = points.par_iter().map(|&it| row(surface, it)).collect();
    SkinWeights::from_rows(n_joints, &rows).expect("the nearest part moves every point")
}

fn row(surface: &Surface, point: Vec3) -> Vec<(u32, f64)> {
    let samples: Vec<(Option<usize>, &Part, f64, f64)> = surface
        .parts()
        .map(|(limb, part)| (limb, part, part.sample(point)))
        .map(|(limb, part, sample)| (limb, part, sample.distance, sample.along))
        .collect();
    let nearest = samples.iter().map(|it| it.2).fold(f64::INFINITY, f64::min);
    let limb_distance = |limb: usize| {
        let of_limb = samples.iter().filter(|it| it.0 == Some(limb));
        of_limb.map(|it| it.2).fold(f64::INFINITY, f64::min)
    };
    let limbs: Vec<f64> = (0..surface.limbs.len()).map(limb_distance).collect();
    let mut row: Vec<(u32, f64)> = Vec::new();
    for &(limb, part, distance, along) in &samples {
        let own_blend = limb.map_or(part.blend, |it| part.blend.max(surface.limbs[it].blend));
        let reach = own_blend.max(0.05);
        let mut share = smooth_step(1.0 - (distance - nearest) / reach);
        if let Some(limb) = limb {
            let rivals = limbs.iter().enumerate().filter(|it| it.0 != limb);
            let rival = rivals.map(|it| *it.1).fold(f64::INFINITY, f64::min);
            share *= smooth_step(1.0 - (limbs[limb] - rival) / BETWEEN_LIMBS);
        }
        if share > 0.0 {
            add_stretches(part, along, share, &mut row);
        }
    }
    row.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    row.truncate(MAX_INFLUENCES);
    let total: f64 = row.iter().map(|it| it.1).sum();
    row.retain(|it| it.1 > LEAST * total);
    row
}

/// Adds the weights of a part's joints at a place along it.
fn add_stretches(part: &Part, along: f64, share: f64, row: &mut Vec<(u32, f64)>) {
    let taken_over = |k: usize| match part.stretches.get(k) {
        Some(it) if k > 0 => smooth_step(0.5 + 0.5 * (along - it.start) / it.softness),
        Some(_) => 1.0,
        None => 0.0,
    };
    for (k, stretch) in part.stretches.iter().enumerate() {
        let weight = share * (taken_over(k) - taken_over(k + 1)).max(0.0);
        if weight > 0.0 {
            match row.iter_mut().find(|it| it.0 == stretch.joint as u32) {
                Some(entry) => entry.1 += weight,
                None => row.push((stretch.joint as u32, weight)),
            }
        }
    }
}

/// 0 below 0, 1 above 1, smooth between.
pub fn smooth_step(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}
