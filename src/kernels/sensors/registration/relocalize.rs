//! Finding a subject anew after a jump.

use nalgebra::Rotation3;

use super::correspond::vertex_normals;
use super::fpfh::{Features, describe};
use super::target::{Pixel, Target};
use super::warp::fit_rigid;
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::numerics::random::Random;
use crate::kernels::sensors::depth::raster::ZBuffer;

/// Trials of three pairs each, and how many of them are judged (Lepard's values).
const TRIALS: usize = 50_000;
const HYPOTHESES: usize = 1000;

/// Points of either side that are described.
const N_POINTS: usize = 600;

/// Estimates one rigid motion that brings a surface onto a frame, by RANSAC over mutually nearest
/// local descriptors (Fischler & Bolles 1981; Rusu 2009), or by the centroids alone where that
/// explains the silhouette better. `None` if the surface as it is explains it best.
pub fn relocalize(
    target: &Target,
    vertices: &[Vec3],
    faces: &[[u32; 3]],
    scale: f64,
    seed: u64,
) -> Option<(Rotation3<f64>, Vec3)> {
    let (source, aim) = (source_points(vertices, faces), target_points(target));
    if source.0.len() < 3 || aim.0.len() < 3 {
        return None;
    }
    let middle = |it: &[Vec3]| it.iter().sum::<Vec3>() / it.len() as f64;
    let shift = middle(&aim.0) - middle(&source.0);
    let mut candidates = vec![(Rotation3::identity(), shift)];
    let pairs = mutual(
        &describe(&source.0, &source.1, 0.15 * scale),
        &describe(&aim.0, &aim.1, 0.15 * scale),
    );
    let pairs: Vec<(Vec3, Vec3)> = pairs.iter().map(|it| (source.0[it.0], aim.0[it.1])).collect();
    candidates.extend(ransac(&pairs, 0.05 * scale, seed));
    let fit = |(rotation, shift): &(Rotation3<f64>, Vec3)| {
        let moved: Vec<Vec3> = vertices.iter().map(|it| rotation * it + shift).collect();
        agreement(target, &moved, faces, 0.1 * scale)
    };
    let (mut best, mut best_fit) = (None, agreement(target, vertices, faces, 0.1 * scale));
    for candidate in candidates {
        let own = fit(&candidate);
        if own > best_fit {
            (best, best_fit) = (Some(candidate), own);
        }
    }
    best
}

/// The pixels where surface and frame agree in depth, over those where either is.
fn agreement(target: &Target, vertices: &[Vec3], faces: &[[u32; 3]], near: f64) -> f64 {
    let size = [target.width, target.height];
    let buffer = ZBuffer::draw(size, &target.camera, vertices, faces);
    let (mut both, mut either) = (0.0, 0.0);
    for (pixel, depth) in buffer.depths.iter().enumerate() {
        let is_measured = target.pixels[pixel] != Pixel::Nothing;
        let off = (f64::from(*depth) - target.points[pixel].z).abs();
        both += f64::from(u8::from(*depth > 0.0 && is_measured && off < near));
        either += f64::from(u8::from(*depth > 0.0 || is_measured));
    }
    if either > 0.0 { both / either } else { 0.0 }
}

fn source_points(vertices: &[Vec3], faces: &[[u32; 3]]) -> (Vec<Vec3>, Vec<Vec3>) {
    let normals = vertex_normals(vertices, faces);
    let step = vertices.len().div_ceil(N_POINTS);
    (0..vertices.len()).step_by(step).map(|it| (vertices[it], normals[it])).unzip()
}

fn target_points(target: &Target) -> (Vec<Vec3>, Vec<Vec3>) {
    let good: Vec<usize> = (target.measured.iter().map(|it| *it as usize))
        .filter(|it| target.pixels[*it] == Pixel::Surface)
        .collect();
    let step = good.len().div_ceil(N_POINTS).max(1);
    good.into_iter().step_by(step).map(|it| (target.points[it], target.normals[it])).unzip()
}

/// Pairs of which each is the other's nearest.
fn mutual(a: &Features, b: &Features) -> Vec<(usize, usize)> {
    let nearest = |x: &[f64; 33], among: &Features| {
        let square = |y: &[f64; 33]| -> f64 { x.iter().zip(y).map(|(x, y)| (x - y).powi(2)).sum() };
        let squares = among.iter().map(square).enumerate();
        squares.min_by(|x, y| x.1.total_cmp(&y.1)).map_or(0, |it| it.0)
    };
    let of_b: Vec<usize> = b.iter().map(|it| nearest(it, a)).collect();
    let pairs = a.iter().enumerate().map(|(index, it)| (index, nearest(it, b)));
    pairs.filter(|it| of_b[it.1] == it.0).collect()
}

/// The motion with the most pairs nearer than `inlier`, fitted again to those.
fn ransac(pairs: &[(Vec3, Vec3)], inlier: f64, seed: u64) -> Option<(Rotation3<f64>, Vec3)> {
    if pairs.len() < 3 {
        return None;
    }
    let mut random = Random::stream(seed, "relocalize");
    let agrees = |motion: &(Rotation3<f64>, Vec3), pair: &(Vec3, Vec3)| {
        (motion.0 * pair.0 + motion.1 - pair.1).norm() < inlier
    };
    let (mut best, mut best_count, mut judged) = (None, 2, 0);
    for _ in 0..TRIALS {
        let three = [(); 3].map(|()| pairs[random.below(pairs.len())]);
        // Lengths do not change in a rigid motion, which sorts out most triples cheaply.
        let keeps = |i: usize, j: usize| {
            let (from, to) = ((three[i].0 - three[j].0).norm(), (three[i].1 - three[j].1).norm());
            from > inlier && (from - to).abs() < inlier
        };
        if !(keeps(0, 1) && keeps(1, 2) && keeps(2, 0)) {
            continue;
        }
        let motion = fit_rigid(&three);
        let count = pairs.iter().filter(|it| agrees(&motion, it)).count();
        if count > best_count {
            (best, best_count) = (Some(motion), count);
        }
        judged += 1;
        if judged == HYPOTHESES {
            break;
        }
    }
    let best = best?;
    let inliers: Vec<(Vec3, Vec3)> = pairs.iter().filter(|it| agrees(&best, it)).copied().collect();
    Some(fit_rigid(&inliers))
}
