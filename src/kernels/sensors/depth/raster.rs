//! A software z-buffer behind a pinhole camera.

use super::Intrinsics;
use crate::kernels::geometry::mesh::Vec3;

/// What a camera sees of a mesh: the nearest surface at the centre of every pixel.
#[derive(Debug, Clone)]
pub struct ZBuffer {
    pub width: usize,
    pub height: usize,
    /// Metres along the optical axis; 0 where there is nothing.
    pub depths: Vec<f32>,
    /// The face that is seen; [`NO_FACE`] where there is none.
    pub faces: Vec<u32>,
}

pub const NO_FACE: u32 = u32::MAX;

/// Triangles with a corner nearer than this are left out, in metres.
const NEAR: f64 = 0.01;

/// Rounding errors do not exclude the rim of a triangle.
const EDGE: f64 = 1e-9;

impl ZBuffer {
    /// Draws triangles, whichever side they show; of equally near ones the first stays.
    ///
    /// Depths are interpolated as the perspective demands: `1 / z` is linear in the picture.
    pub fn draw(
        [width, height]: [usize; 2],
        camera: &Intrinsics,
        vertices: &[Vec3],
        faces: &[[u32; 3]],
    ) -> Self {
        let n_pixels = width * height;
        let mut res =
            Self { width, height, depths: vec![0.0; n_pixels], faces: vec![NO_FACE; n_pixels] };
        let mut inverse = vec![0.0_f64; n_pixels];
        let seen: Vec<[f64; 3]> = vertices
            .iter()
            .map(|it| {
                let [u, v] = camera.project(it);
                [u, v, if it.z > NEAR { 1.0 / it.z } else { -1.0 }]
            })
            .collect();
        for (face, corners) in (0_u32..).zip(faces) {
            let corners = corners.map(|it| seen[it as usize]);
            if corners.iter().all(|it| it[2] > 0.0) {
                res.draw_face(face, corners, &mut inverse);
            }
        }
        for (depth, inverse) in res.depths.iter_mut().zip(inverse) {
            if inverse > 0.0 {
                *depth = (1.0 / inverse) as f32;
            }
        }
        res
    }

    fn draw_face(&mut self, face: u32, corners: [[f64; 3]; 3], inverse: &mut [f64]) {
        let [[ax, ay, az], [bx, by, bz], [cx, cy, cz]] = corners;
        let area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
        if area == 0.0 {
            return;
        }
        let span = |a: f64, b: f64, c: f64, n: usize| {
            let low = a.min(b).min(c).ceil().clamp(0.0, n as f64) as usize;
            let high = (a.max(b).max(c).floor() + 1.0).clamp(0.0, n as f64) as usize;
            low..high
        };
        for y in span(ay, by, cy, self.height) {
            for x in span(ax, bx, cx, self.width) {
                let (px, py) = (x as f64, y as f64);
                let b = ((px - ax) * (cy - ay) - (py - ay) * (cx - ax)) / area;
                let c = ((bx - ax) * (py - ay) - (by - ay) * (px - ax)) / area;
                if b < -EDGE || c < -EDGE || b + c > 1.0 + EDGE {
                    continue;
                }
                let value = az + b * (bz - az) + c * (cz - az);
                let pixel = y * self.width + x;
                if value > inverse[pixel] {
                    inverse[pixel] = value;
                    self.faces[pixel] = face;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes;

    const CAMERA: Intrinsics = Intrinsics { fx: 200.0, fy: 200.0, cx: 79.5, cy: 59.5 };

    #[test]
    fn a_tilted_plane_has_the_depth_of_its_equation() {
        // z = 2 + 0.5 x.
        let corners = [[-3.0, -3.0], [3.0, -3.0], [3.0, 3.0], [-3.0, 3.0]];
        let vertices = corners.map(|[x, y]| Vec3::new(x, y, 2.0 + 0.5 * x)).to_vec();
        let seen = ZBuffer::draw([160, 120], &CAMERA, &vertices, &[[0, 1, 2], [0, 2, 3]]);
        for pixel in 0..160 * 120 {
            let slope = ((pixel % 160) as f64 - CAMERA.cx) / CAMERA.fx;
            let expected = 2.0 / (1.0 - 0.5 * slope);
            assert!((f64::from(seen.depths[pixel]) - expected).abs() < 1e-6 * expected);
        }
    }

    #[test]
    fn the_nearer_side_of_a_sphere_is_seen() {
        let sphere = shapes::moved(&shapes::icosphere(5), Vec3::new(0.0, 0.0, 5.0));
        let seen = ZBuffer::draw([160, 120], &CAMERA, sphere.vertices(), sphere.faces());
        let middle = f64::from(seen.depths[60 * 160 + 80]);
        assert!((middle - 4.0).abs() < 2e-3, "{middle}");
        // A sphere of radius r at distance d fills a disc of tan(alpha) = r / sqrt(d^2 - r^2).
        let radius = CAMERA.fx / 24.0_f64.sqrt();
        let n_seen = seen.depths.iter().filter(|it| **it > 0.0).count() as f64;
        let expected = std::f64::consts::PI * radius * radius;
        assert!((n_seen / expected - 1.0).abs() < 0.01, "{n_seen} of {expected}");
    }

    #[test]
    fn what_is_behind_the_camera_or_flat_draws_nothing() {
        let behind = [Vec3::new(0.0, 0.0, -1.0), Vec3::x(), Vec3::y()];
        let seen = ZBuffer::draw([160, 120], &CAMERA, &behind, &[[0, 1, 2], [0, 0, 0]]);
        assert!(seen.faces.iter().all(|it| *it == NO_FACE));
    }
}
