//! Areas with smooth edges.

use super::{Canvas, color::Color, pixels_between};

/// Fills a polygon that does not cross itself; every pixel by the exact share of it that is covered.
pub fn fill_polygon(canvas: &mut Canvas, points: &[[f32; 2]], color: Color, alpha: f32) {
    let bound = |axis: usize, limit: usize| {
        let low = points.iter().fold(f32::INFINITY, |res, it| res.min(it[axis]));
        let high = points.iter().fold(f32::NEG_INFINITY, |res, it| res.max(it[axis]));
        pixels_between(low, high, limit)
    };
    let (rows, columns) = (bound(1, canvas.height), bound(0, canvas.width));
    if rows.is_empty() || columns.is_empty() {
        return;
    }
    let mut shares = Shares::new([columns.start, rows.start], [columns.len(), rows.len()]);
    for index in 0..points.len() {
        shares.add_edge(points[index], points[(index + 1) % points.len()]);
    }
    for y in 0..rows.len() {
        let mut sum = 0.0;
        for x in 0..columns.len() {
            sum += shares.changes[y * shares.stride + x];
            let share = sum.abs().min(1.0);
            // Rounding errors of the sums are no ink.
            if share > 1e-4 {
                canvas.blend(columns.start + x, rows.start + y, color, share * alpha);
            }
        }
    }
}

/// How much of each pixel lies to the right of edges that go down, less those that go up: as changes from
/// pixel to pixel, so that a sum along a row gives the covered shares.
struct Shares {
    origin: [f32; 2],
    stride: usize,
    n_rows: usize,
    changes: Vec<f32>,
}

impl Shares {
    fn new(origin: [usize; 2], [width, height]: [usize; 2]) -> Self {
        let stride = width + 2;
        let origin = origin.map(|it| it as f32);
        Self { origin, stride, n_rows: height, changes: vec![0.0; stride * height] }
    }

    fn add_edge(&mut self, from: [f32; 2], to: [f32; 2]) {
        let local = |it: [f32; 2]| [it[0] - self.origin[0], it[1] - self.origin[1]];
        let (from, to) = (local(from), local(to));
        if from[1] == to[1] {
            return;
        }
        let (direction, top, bottom) =
            if from[1] < to[1] { (1.0, from, to) } else { (-1.0, to, from) };
        let slope = (bottom[0] - top[0]) / (bottom[1] - top[1]);
        let x_at = |y: f32| top[0] + (y - top[1]) * slope;
        let last = (bottom[1].ceil().max(0.0) as usize).min(self.n_rows);
        for row in (top[1].max(0.0) as usize)..last {
            let y0 = top[1].max(row as f32);
            let y1 = bottom[1].min(row as f32 + 1.0);
            if y1 > y0 {
                self.add_in_row(row, x_at(y0), x_at(y1), direction * (y1 - y0));
            }
        }
    }

    /// An edge within one row of pixels, that covers so much of its height.
    fn add_in_row(&mut self, row: usize, from: f32, to: f32, height: f32) {
        let limit = (self.stride - 2) as f32;
        let (left, right) = (from.min(to).clamp(0.0, limit), from.max(to).clamp(0.0, limit));
        let line = &mut self.changes[row * self.stride..][..self.stride];
        let first = left as usize;
        if right <= (first + 1) as f32 {
            // Within one pixel: a trapezoid to its right end, and all of the next ones.
            let share = height * ((first + 1) as f32 - (left + right) / 2.0);
            line[first] += share;
            line[first + 1] += height - share;
            return;
        }
        let per_x = height / (right - left);
        for x in first..=(right.ceil() as usize - 1) {
            let (x0, x1) = (left.max(x as f32), right.min((x + 1) as f32));
            // What passes here covers this pixel from its middle to the right end, and all of the next.
            let passed = per_x * (x1 - x0);
            let share = passed * ((x + 1) as f32 - (x0 + x1) / 2.0);
            line[x] += share;
            line[x + 1] += passed - share;
        }
    }
}

/// Fills a disk.
pub fn fill_circle(canvas: &mut Canvas, [x, y]: [f32; 2], radius: f32, color: Color, alpha: f32) {
    let reach = radius + 1.0;
    for row in pixels_between(y - reach, y + reach, canvas.height) {
        for column in pixels_between(x - reach, x + reach, canvas.width) {
            let distance = (column as f32 + 0.5 - x).hypot(row as f32 + 0.5 - y);
            let share = (radius + 0.5 - distance).clamp(0.0, 1.0);
            if share > 0.0 {
                canvas.blend(column, row, color, share * alpha);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::numerics::random::Random;

    /// The sum of all ink.
    fn ink(points: &[[f32; 2]]) -> f64 {
        let mut canvas = Canvas::white(40, 30);
        fill_polygon(&mut canvas, points, [0.0; 3], 1.0);
        canvas.pixels.iter().map(|it| 1.0 - f64::from(it[0])).sum()
    }

    #[test]
    fn a_triangle_has_as_much_ink_as_area() {
        let mut random = Random::new(3);
        let mut uniform = move || random.next_u64() as f64 / u64::MAX as f64;
        for _ in 0..500 {
            let mut point = || [(uniform() * 40.0) as f32, (uniform() * 30.0) as f32];
            let (a, b, c) = (point(), point(), point());
            let cross = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
            let area = f64::from(cross).abs() / 2.0;
            let found = ink(&[a, b, c]);
            assert!(
                (found - area).abs() < 0.02 + 1e-4 * area,
                "{a:?} {b:?} {c:?}: {found}, {area}"
            );
        }
    }

    #[test]
    fn what_lies_outside_is_cut() {
        let found = ink(&[[-50.0, -50.0], [20.5, -50.0], [20.5, 90.0], [-50.0, 90.0]]);
        assert!((found - 20.5 * 30.0).abs() < 1e-2, "{found}");
        assert_eq!(ink(&[[-9.0, 3.0], [-4.0, 3.0], [-4.0, 8.0]]), 0.0);
        assert_eq!(ink(&[]), 0.0);
    }

    #[test]
    fn a_disk_has_the_area_of_a_disk() {
        let mut canvas = Canvas::white(40, 30);
        fill_circle(&mut canvas, [20.25, 15.5], 9.0, [0.0; 3], 1.0);
        let ink: f64 = canvas.pixels.iter().map(|it| 1.0 - f64::from(it[0])).sum();
        let area = std::f64::consts::PI * 81.0;
        assert!((ink / area - 1.0).abs() < 0.01, "{ink} instead of {area}");
    }
}
