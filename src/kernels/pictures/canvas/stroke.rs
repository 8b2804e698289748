//! Chains of segments with a round pen.

use super::{Canvas, color::Color, pixels_between};

/// Draws a chain of segments with a round pen of this radius; every pixel by its distance from the whole
/// chain, so that joints are no darker.
pub fn stroke(canvas: &mut Canvas, points: &[[f32; 2]], pen: f32, color: Color, alpha: f32) {
    let reach = pen + 1.0;
    let bound = |points: &[[f32; 2]], axis: usize, limit: usize| {
        let low = points.iter().fold(f32::INFINITY, |res, it| res.min(it[axis])) - reach;
        let high = points.iter().fold(f32::NEG_INFINITY, |res, it| res.max(it[axis])) + reach;
        pixels_between(low, high, limit)
    };
    let (rows, columns) = (bound(points, 1, canvas.height), bound(points, 0, canvas.width));
    let width = columns.len();
    let mut covered = vec![0.0f32; rows.len() * width];
    for segment in points.windows(2) {
        let thin = if pen < 0.5 { 2.0 * pen } else { 1.0 };
        for y in bound(segment, 1, canvas.height) {
            for x in bound(segment, 0, canvas.width) {
                let pixel = [x as f32 + 0.5, y as f32 + 0.5];
                let distance = distance_to_segment(pixel, segment[0], segment[1]);
                let covers = (pen.max(0.5) + 0.5 - distance).clamp(0.0, 1.0) * thin;
                let known = &mut covered[(y - rows.start) * width + x - columns.start];
                *known = known.max(covers);
            }
        }
    }
    for y in rows.clone() {
        for x in columns.clone() {
            let covers = covered[(y - rows.start) * width + x - columns.start];
            if covers > 0.0 {
                canvas.blend(x, y, color, covers * alpha);
            }
        }
    }
}

fn distance_to_segment(point: [f32; 2], from: [f32; 2], to: [f32; 2]) -> f32 {
    let along = [to[0] - from[0], to[1] - from[1]];
    let length2 = along[0] * along[0] + along[1] * along[1];
    let offset = [point[0] - from[0], point[1] - from[1]];
    let t =
        if length2 > 0.0 { (offset[0] * along[0] + offset[1] * along[1]) / length2 } else { 0.0 };
    let t = t.clamp(0.0, 1.0);
    (offset[0] - t * along[0]).hypot(offset[1] - t * along[1])
}
