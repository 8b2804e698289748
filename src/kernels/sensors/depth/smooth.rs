//! Averaging away the noise of depths.

use rayon::prelude::*;

use super::{DepthError, DepthVideo};

/// Averages all frames of a video; see [`smooth`]. `gate` is in metres.
///
/// # Errors
/// [`DepthError`] does not occur for a valid video.
pub fn smooth_video(
    video: &DepthVideo,
    gate: f64,
    radius: usize,
) -> Result<DepthVideo, DepthError> {
    let frames = (0..video.n_frames())
        .into_par_iter()
        .map(|it| smooth(video.frame(it), video.width(), gate as f32, radius))
        .collect();
    video.with_frames(frames)
}

/// Means of the depths around each pixel that are within the gate of its own.
pub fn smooth(depths: &[f32], width: usize, gate: f32, radius: usize) -> Vec<f32> {
    let height = depths.len() / width;
    let mut res = depths.to_vec();
    for (pixel, value) in res.iter_mut().enumerate().filter(|it| *it.1 > 0.0) {
        let (column, row) = (pixel % width, pixel / width);
        let (mut sum, mut count) = (0.0, 0.0);
        for y in row.saturating_sub(radius)..=(row + radius).min(height - 1) {
            for x in column.saturating_sub(radius)..=(column + radius).min(width - 1) {
                let depth = depths[y * width + x];
                // Mirrored pairs only: a one-sided mean would shift slanted surfaces at their rims.
                let (mirror_y, mirror_x) =
                    (2 * row as isize - y as isize, 2 * column as isize - x as isize);
                let is_inside = (0..height as isize).contains(&mirror_y)
                    && (0..width as isize).contains(&mirror_x);
                if !is_inside {
                    continue;
                }
                let mirrored = depths[mirror_y as usize * width + mirror_x as usize];
                let is_near = |it: f32| it > 0.0 && (it - *value).abs() <= gate;
                if is_near(depth) && is_near(mirrored) {
                    sum += depth;
                    count += 1.0;
                }
            }
        }
        *value = sum / count;
    }
    res
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::numerics::random::Random;

    #[test]
    fn a_slope_stays_and_noise_goes() {
        let slope = |it: usize| 2.0 + 0.01 * (it % 40) as f32 - 0.005 * (it / 40) as f32;
        let exact: Vec<f32> = (0..1600).map(slope).collect();
        let off = |a: &[f32]| {
            let squares = a.iter().zip(&exact).map(|(a, b)| f64::from(a - b).powi(2));
            (squares.sum::<f64>() / 1600.0).sqrt()
        };
        assert!(off(&smooth(&exact, 40, 0.05, 2)) < 1e-6);
        let mut random = Random::new(2);
        let noisy: Vec<f32> = exact.iter().map(|it| it + 0.01 * random.normal() as f32).collect();
        assert!(off(&smooth(&noisy, 40, 0.2, 2)) < 0.3 * off(&noisy));
    }

    #[test]
    fn steps_and_gaps_stay() {
        let depth = |it: usize| if it % 20 < 10 { 1.0 } else { 2.0 };
        let mut depths: Vec<f32> = (0..400).map(depth).collect();
        depths[25] = 0.0;
        assert_eq!(smooth(&depths, 20, 0.05, 3), depths);
    }
}
