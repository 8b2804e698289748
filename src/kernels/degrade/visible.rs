//! The part of a surface that a camera sees.

use super::DegradeError;
use crate::kernels::mesh::{TriMesh, Vec3};

/// The picture's longer side, in pixels.
const RESOLUTION: f64 = 1024.0;

/// Which faces are seen from at least one of the directions (from the shape to a camera far away).
///
/// A face is seen if it faces the camera, and the depth buffer of an orthographic picture has nothing
/// before its middle.
///
/// # Errors
/// [`DegradeError::NoDirection`].
pub fn visible_faces(mesh: &TriMesh, directions: &[Vec3]) -> Result<Vec<bool>, DegradeError> {
    let mut seen = vec![false; mesh.n_faces()];
    for direction in directions {
        let direction = direction.try_normalize(0.0).ok_or(DegradeError::NoDirection)?;
        let picture = Picture::new(mesh, direction);
        for (face, seen) in seen.iter_mut().enumerate() {
            let facing = mesh.area_vector(face).dot(&direction) > 0.0;
            *seen |= facing && picture.shows(mesh.corners(face));
        }
    }
    Ok(seen)
}

/// The depths of an orthographic picture; larger is nearer to the camera.
struct Picture {
    /// Two axes of the picture in pixels, and the direction to the camera in the mesh's unit.
    axes: [Vec3; 3],
    low: [f64; 2],
    width: usize,
    depths: Vec<f64>,
    /// The side of a pixel.
    pixel: f64,
}

impl Picture {
    fn new(mesh: &TriMesh, direction: Vec3) -> Self {
        let other = if direction.y.abs() < 0.9 { Vec3::y() } else { Vec3::x() };
        let right = other.cross(&direction).normalize();
        let up = direction.cross(&right);
        let extent = |axis: Vec3| {
            let values = mesh.vertices().iter().map(|it| axis.dot(it));
            values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), it| (l.min(it), h.max(it)))
        };
        let (x, y) = (extent(right), extent(up));
        let pixel = ((x.1 - x.0).max(y.1 - y.0) / RESOLUTION).max(f64::MIN_POSITIVE);
        let (width, height) =
            (((x.1 - x.0) / pixel) as usize + 2, ((y.1 - y.0) / pixel) as usize + 2);
        let mut res = Self {
            axes: [right / pixel, up / pixel, direction],
            low: [x.0 / pixel, y.0 / pixel],
            width,
            depths: vec![f64::NEG_INFINITY; width * height],
            pixel,
        };
        for face in 0..mesh.n_faces() {
            res.draw(mesh.corners(face));
        }
        res
    }

    fn place(&self, point: &Vec3) -> [f64; 3] {
        let [x, y, z] = [0, 1, 2].map(|it| self.axes[it].dot(point));
        [x - self.low[0], y - self.low[1], z]
    }

    fn draw(&mut self, corners: [Vec3; 3]) {
        let [a, b, c] = [0, 1, 2].map(|it| self.place(&corners[it]));
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
        if area == 0.0 {
            return;
        }
        let range = |axis: usize| {
            let values = [a[axis], b[axis], c[axis]];
            let low = values.iter().fold(f64::INFINITY, |m, it| m.min(*it));
            let high = values.iter().fold(f64::NEG_INFINITY, |m, it| m.max(*it));
            (low - 0.5).ceil().max(0.0) as usize..=(high - 0.5).floor().max(0.0) as usize
        };
        for row in range(1) {
            for column in range(0) {
                let (x, y) = (column as f64 + 0.5, row as f64 + 0.5);
                let wb = ((x - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (y - a[1])) / area;
                let wc = ((b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])) / area;
                if wb >= 0.0 && wc >= 0.0 && wb + wc <= 1.0 {
                    let depth = a[2] + wb * (b[2] - a[2]) + wc * (c[2] - a[2]);
                    let at = &mut self.depths[row * self.width + column];
                    *at = at.max(depth);
                }
            }
        }
    }

    /// Whether nothing lies before a face's middle by more than its own slope explains.
    fn shows(&self, corners: [Vec3; 3]) -> bool {
        let middle = corners.iter().sum::<Vec3>() / 3.0;
        let [x, y, z] = self.place(&middle);
        let [before, after] = [0, 1].map(|it| {
            let depths = corners.map(|corner| self.axes[2].dot(&corner));
            if it == 0 {
                depths.iter().fold(f64::INFINITY, |m, d| m.min(*d))
            } else {
                depths.iter().fold(f64::NEG_INFINITY, |m, d| m.max(*d))
            }
        });
        let slack = (after - before) + 4.0 * self.pixel;
        self.depths[y as usize * self.width + x as usize] <= z + slack
    }
}
