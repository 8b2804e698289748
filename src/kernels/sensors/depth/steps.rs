//! The steps in depth between pixels of one surface.

use super::DepthVideo;

/// Larger steps lead from one object to another.
const LARGEST: f32 = 0.3;

/// What 90 % of the steps stay below is multiplied by this.
const FACTOR: f64 = 1.5;

/// The least gate, in metres.
const LEAST: f64 = 0.05;

/// Tells from a frame the step in depth, in metres, at which surfaces part.
///
/// One and a half times what nine of ten neighbouring pixels of one object differ by, and 0.05 m at
/// least: sensors that measure disparity have steps that grow with the square of the distance (Kinect:
/// 0.03 m at 3 m, 0.06 m at 4.5 m), at which a fixed gate would cut surfaces to pieces.
pub fn step_gate(video: &DepthVideo, frame: usize) -> f64 {
    let (width, depths) = (video.width(), video.frame(frame));
    let mut steps: Vec<f32> = Vec::new();
    for (pixel, depth) in depths.iter().enumerate().filter(|it| *it.1 > 0.0) {
        let right = (pixel % width + 1 < width).then(|| depths[pixel + 1]);
        let below = depths.get(pixel + width).copied();
        let near = [right, below].into_iter().flatten().filter(|it| *it > 0.0);
        steps.extend(near.map(|it| (it - depth).abs()).filter(|it| *it < LARGEST));
    }
    if steps.is_empty() {
        return LEAST;
    }
    let nine_tenths = steps.len() * 9 / 10;
    let (_, step, _) = steps.select_nth_unstable_by(nine_tenths, f32::total_cmp);
    LEAST.max(FACTOR * f64::from(*step))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::sensors::depth::Intrinsics;

    fn gate(depth: impl Fn(usize, usize) -> f32) -> f64 {
        let camera = Intrinsics { fx: 100.0, fy: 100.0, cx: 20.0, cy: 20.0 };
        let depths = (0..1600).map(|it| depth(it % 40, it / 40)).collect();
        let video = DepthVideo::new([40, 40], camera, 30.0, vec![depths]).unwrap();
        step_gate(&video, 0)
    }

    #[test]
    fn gates_are_above_the_steps_of_the_sensor() {
        // Smooth, and empty.
        assert_eq!(gate(|x, _| 2.0 + 0.01 * x as f32), LEAST);
        assert_eq!(gate(|_, _| 0.0), LEAST);
        // Every second column is 0.08 m deeper: half of the steps.
        assert!((gate(|x, _| 2.0 + 0.08 * (x % 2) as f32) - 0.12).abs() < 1e-6);
        // One step from an object to another does not count.
        assert_eq!(gate(|x, _| if x < 20 { 2.0 } else { 3.0 }), LEAST);
    }
}
