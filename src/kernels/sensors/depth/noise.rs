//! What a structured-light camera does to depths.

use super::Intrinsics;
use crate::kernels::numerics::random::Random;

/// A simple model of the first Kinect: quantised disparity, lost edges, grazing dropouts, holes.
///
/// After Khoshelham & Elberink 2012 (the error grows with the square of depth) and Handa et al. 2014
/// (disparity with noise, rounded to an eighth of a pixel).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseModel {
    /// Metres between projector and camera.
    pub baseline: f64,
    /// The step of disparity, in pixels.
    pub disparity_step: f64,
    /// The deviation of disparity, in pixels.
    pub disparity_noise: f64,
    /// The chance that a pixel beside a step of more than 5 cm is lost.
    pub edge_loss: f64,
    /// The least cosine between surface and view at which a pixel is measured.
    pub grazing_cosine: f64,
    /// How many holes a frame has for 10,000 measured pixels; each is a disc of 1 to 3 pixels radius.
    pub holes: f64,
}

impl Default for NoiseModel {
    fn default() -> Self {
        Self {
            baseline: 0.075,
            disparity_step: 0.125,
            disparity_noise: 0.06,
            edge_loss: 0.4,
            grazing_cosine: 0.15,
            holes: 3.0,
        }
    }
}

/// The step in depth that makes an edge, in metres.
const EDGE: f32 = 0.05;

/// Disturbs one frame; `random` should be of its own for every frame.
pub fn disturb(
    depths: &[f32],
    width: usize,
    camera: &Intrinsics,
    model: &NoiseModel,
    random: &mut Random,
) -> Vec<f32> {
    let mut res = depths.to_vec();
    for pixel in 0..depths.len() {
        if depths[pixel] == 0.0 {
            continue;
        }
        // Both numbers are drawn for every pixel, so that one option does not reseed another.
        let (chance, normal) = (random.uniform(), random.normal());
        let is_lost = (is_edge(depths, width, pixel) && chance < model.edge_loss)
            || cosine(depths, width, camera, pixel).is_some_and(|it| it < model.grazing_cosine);
        let factor = camera.fx * model.baseline;
        let disparity = factor / f64::from(depths[pixel]) + model.disparity_noise * normal;
        let step = model.disparity_step;
        let rounded = if step > 0.0 { (disparity / step).round() * step } else { disparity };
        res[pixel] = if is_lost || rounded <= 0.0 { 0.0 } else { (factor / rounded) as f32 };
    }
    punch_holes(&mut res, depths, width, model.holes, random);
    res
}

fn punch_holes(res: &mut [f32], depths: &[f32], width: usize, holes: f64, random: &mut Random) {
    let measured: Vec<usize> = (0..depths.len()).filter(|it| depths[*it] > 0.0).collect();
    let n_holes = (measured.len() as f64 * holes / 10_000.0).round() as usize;
    let height = depths.len() / width;
    for _ in 0..n_holes {
        let centre = measured[random.below(measured.len())];
        let radius = 1 + random.below(3);
        let (column, row) = (centre % width, centre / width);
        for y in row.saturating_sub(radius)..=(row + radius).min(height - 1) {
            for x in column.saturating_sub(radius)..=(column + radius).min(width - 1) {
                let (dx, dy) = (x.abs_diff(column), y.abs_diff(row));
                if dx * dx + dy * dy <= radius * radius {
                    res[y * width + x] = 0.0;
                }
            }
        }
    }
}

/// The pixels left, right, above and below, where there are such.
fn neighbours(width: usize, n_pixels: usize, pixel: usize) -> [Option<usize>; 4] {
    let column = pixel % width;
    [
        (column > 0).then(|| pixel - 1),
        (column + 1 < width).then(|| pixel + 1),
        pixel.checked_sub(width),
        (pixel + width < n_pixels).then(|| pixel + width),
    ]
}

fn is_edge(depths: &[f32], width: usize, pixel: usize) -> bool {
    let differs = |it: usize| (depths[it] - depths[pixel]).abs() > EDGE;
    neighbours(width, depths.len(), pixel).into_iter().flatten().any(differs)
}

/// The cosine between the line of sight and the normal, if all four neighbours are measured.
fn cosine(depths: &[f32], width: usize, camera: &Intrinsics, pixel: usize) -> Option<f64> {
    let mut points = [nalgebra::Vector3::zeros(); 4];
    for (point, it) in points.iter_mut().zip(neighbours(width, depths.len(), pixel)) {
        let it = it.filter(|it| depths[*it] > 0.0)?;
        let (u, v) = ((it % width) as f64, (it / width) as f64);
        *point = camera.unproject(u, v, f64::from(depths[it]));
    }
    let normal = (points[1] - points[0]).cross(&(points[3] - points[2])).try_normalize(0.0)?;
    let (u, v) = ((pixel % width) as f64, (pixel / width) as f64);
    Some(normal.dot(&camera.unproject(u, v, 1.0).normalize()).abs())
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: Intrinsics = Intrinsics { fx: 575.8, fy: 575.8, cx: 49.5, cy: 49.5 };

    #[test]
    fn the_step_of_a_plane_is_that_of_its_disparity() {
        let model = NoiseModel { disparity_noise: 0.0, holes: 0.0, ..NoiseModel::default() };
        let noisy = disturb(&[3.0; 10_000], 100, &CAMERA, &model, &mut Random::new(1));
        let factor = CAMERA.fx * 0.075;
        let expected = (factor / ((factor / 3.0 / 0.125).round() * 0.125)) as f32;
        assert!(noisy.iter().all(|it| *it == expected));
        assert!((expected - 3.0).abs() < 0.5 * 9.0 / factor as f32 * 0.125 + 1e-4);
    }

    #[test]
    fn noise_is_unbiased_and_comes_from_the_seed() {
        let model = NoiseModel { holes: 0.0, ..NoiseModel::default() };
        let run = |seed| disturb(&[1.0; 10_000], 100, &CAMERA, &model, &mut Random::new(seed));
        let noisy = run(4);
        let mean = noisy.iter().map(|it| f64::from(*it)).sum::<f64>() / 1e4;
        assert!((mean - 1.0).abs() < 2e-4, "{mean}");
        assert_eq!(noisy, run(4));
        assert_ne!(noisy, run(5));
    }

    #[test]
    fn edges_and_holes_are_lost() {
        let depths: Vec<f32> =
            (0..10_000).map(|it| if it % 100 < 50 { 1.0 } else { 2.0 }).collect();
        let model = NoiseModel { edge_loss: 1.0, holes: 0.0, ..NoiseModel::default() };
        let noisy = disturb(&depths, 100, &CAMERA, &model, &mut Random::new(1));
        let lost: Vec<usize> = (0..10_000).filter(|it| noisy[*it] == 0.0).collect();
        assert_eq!(lost.len(), 200);
        assert!(lost.iter().all(|it| matches!(it % 100, 49 | 50)));
        let model = NoiseModel { edge_loss: 0.0, holes: 20.0, ..NoiseModel::default() };
        let noisy = disturb(&depths, 100, &CAMERA, &model, &mut Random::new(1));
        assert!((20..800).contains(&noisy.iter().filter(|it| **it == 0.0).count()));
    }
}
