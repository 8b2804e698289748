//! Figures as pictures, two pixels a unit.

use super::measure::CAPITAL;
use super::scene::{Anchor, Figure, Look, Mark, Point, Rgb, Shape};
use crate::kernels::image::Image;
use crate::kernels::pictures::canvas::{
    Canvas,
    color::Color,
    fill_circle, fill_polygon, stroke,
    text::{Lettering, write},
};

/// Pixels along a unit of the figure.
const SCALE: f64 = 2.0;

/// Draws a figure. Colours are blended in sRGB, as browsers do it with an SVG.
pub fn draw_png(figure: &Figure) -> Image {
    let [width, height] = [figure.width, figure.height].map(|it| (it as f64 * SCALE) as usize);
    let mut canvas = Canvas::white(width, height);
    for mark in &figure.marks {
        draw_mark(&mut canvas, mark);
    }
    canvas.into_image_of_srgb()
}

fn draw_mark(canvas: &mut Canvas, mark: &Mark) {
    let points: Vec<[f32; 2]> = mark.points.iter().map(|&it| scaled(it)).collect();
    match &mark.look {
        Look::Line { color, width, dash } => {
            let pen = (width * SCALE / 2.0) as f32;
            let pieces = match dash {
                Some(dash) => dashes(&points, dash.map(|it| (it * SCALE) as f32)),
                None => vec![points],
            };
            for piece in pieces {
                stroke(canvas, &piece, pen, canvas_color(*color), 1.0);
            }
        }
        Look::Area { color, opacity } => {
            fill_polygon(canvas, &points, canvas_color(*color), *opacity as f32);
        }
        Look::Dots { shape, color, opacity, radius } => {
            for &point in &mark.points {
                draw_dot(canvas, point, *shape, *radius, canvas_color(*color), *opacity as f32);
            }
        }
        Look::Text { text, size, anchor, angle_deg, color } => {
            let lettering = Lettering {
                height: (size * CAPITAL * SCALE) as f32,
                anchor: match anchor {
                    Anchor::Start => 0.0,
                    Anchor::Middle => 0.5,
                    Anchor::End => 1.0,
                },
                angle_rad: angle_deg.to_radians() as f32,
                pen: 0.068,
            };
            write(canvas, text, points[0], lettering, canvas_color(*color));
        }
    }
}

fn draw_dot(canvas: &mut Canvas, at: Point, shape: Shape, radius: f64, color: Color, alpha: f32) {
    let corners = shape.corners(at, radius);
    if corners.is_empty() {
        return fill_circle(canvas, scaled(at), (radius * SCALE) as f32, color, alpha);
    }
    let corners: Vec<[f32; 2]> = corners.into_iter().map(scaled).collect();
    fill_polygon(canvas, &corners, color, alpha);
}

fn scaled(point: Point) -> [f32; 2] {
    point.map(|it| (it * SCALE) as f32)
}

fn canvas_color(color: Rgb) -> Color {
    color.map(|it| f32::from(it) / 255.0)
}

/// A chain of segments as strokes of one length with gaps between them.
fn dashes(points: &[[f32; 2]], [stroke, gap]: [f32; 2]) -> Vec<Vec<[f32; 2]>> {
    let mut pieces: Vec<Vec<[f32; 2]>> = Vec::new();
    // How much is left of the stroke or gap that is under the pen.
    let (mut is_down, mut left) = (true, stroke);
    for pair in points.windows(2) {
        let along = [pair[1][0] - pair[0][0], pair[1][1] - pair[0][1]];
        let length = along[0].hypot(along[1]);
        let at = |s: f32| [0, 1].map(|it| pair[0][it] + along[it] * (s / length));
        let mut passed = 0.0;
        if is_down && pieces.is_empty() {
            pieces.push(vec![pair[0]]);
        }
        while length - passed > left {
            passed += left;
            match (is_down, pieces.last_mut()) {
                (true, Some(piece)) => piece.push(at(passed)),
                _ => pieces.push(vec![at(passed)]),
            }
            is_down = !is_down;
            left = if is_down { stroke } else { gap };
        }
        left -= length - passed;
        if let (true, Some(piece)) = (is_down, pieces.last_mut()) {
            piece.push(pair[1]);
        }
    }
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dashes_go_around_corners() {
        let pieces = dashes(&[[0.0, 0.0], [5.0, 0.0], [5.0, 5.0]], [3.0, 1.0]);
        let expected = [
            vec![[0.0, 0.0], [3.0, 0.0]],
            vec![[4.0, 0.0], [5.0, 0.0], [5.0, 2.0]],
            vec![[5.0, 3.0], [5.0, 5.0]],
        ];
        assert_eq!(pieces, expected);
    }
}
