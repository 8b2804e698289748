//! Pictures that a whole shape fills.

use nalgebra::{Rotation3, Unit};

use super::{Intrinsics, raster::ZBuffer};
use crate::kernels::geometry::mesh::{TriMesh, Vec3};

/// What a camera sees that stands off a shape in some direction and has all of it in its picture.
#[derive(Debug, Clone)]
pub struct Portrait {
    /// The shape in the camera's frame (x right, y down, z forward), its diagonal one long.
    pub vertices: Vec<Vec3>,
    pub camera: Intrinsics,
    pub buffer: ZBuffer,
    camera_from_world: Rotation3<f64>,
    middle: Vec3,
    diagonal: f64,
    distance: f64,
}

/// How much of the picture the diagonal of the shape's box fills.
const FILLED: f64 = 0.95;

impl Portrait {
    /// Draws a mesh from a direction (of unit length, from the shape to the camera).
    ///
    /// `distance` from the middle of its box counts in diagonals of the box and is at least one; the
    /// picture has `resolution` pixels a side.
    pub fn new(mesh: &TriMesh, direction: Unit<Vec3>, distance: f64, resolution: usize) -> Self {
        let (low, high) = mesh.bounds();
        let (middle, diagonal) = (0.5 * (low + high), (high - low).norm().max(f64::MIN_POSITIVE));
        let other = if direction.y.abs() < 0.9 { Vec3::y() } else { Vec3::x() };
        // The camera looks along its +Z, against the direction.
        let camera_from_world = Rotation3::look_at_lh(&-direction.into_inner(), &other);
        let place = |it: &Vec3| {
            camera_from_world * ((it - middle) / diagonal) + Vec3::new(0.0, 0.0, distance)
        };
        let vertices: Vec<Vec3> = mesh.vertices().iter().map(place).collect();
        let focal = distance * FILLED * resolution as f64;
        let center = 0.5 * (resolution - 1) as f64;
        let camera = Intrinsics { fx: focal, fy: focal, cx: center, cy: center };
        let buffer = ZBuffer::draw([resolution, resolution], &camera, &vertices, mesh.faces());
        Self { vertices, camera, buffer, camera_from_world, middle, diagonal, distance }
    }

    /// From the camera's frame back to the shape's.
    pub fn to_world(&self, place: &Vec3) -> Vec3 {
        let from_middle = place - Vec3::new(0.0, 0.0, self.distance);
        self.camera_from_world.inverse() * from_middle * self.diagonal + self.middle
    }

    /// The camera-frame depth at the centre of a pixel; 0 where nothing is seen.
    pub fn depth(&self, [column, row]: [usize; 2]) -> f64 {
        f64::from(self.buffer.depths[row * self.buffer.width + column])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes::{icosphere, moved};

    #[test]
    fn the_shape_fills_the_picture_and_places_come_back() {
        let sphere = moved(&icosphere(3), Vec3::new(5.0, -2.0, 1.0));
        for direction in [Vec3::z(), Vec3::y(), Vec3::new(1.0, 2.0, -0.5)] {
            let portrait = Portrait::new(&sphere, Unit::new_normalize(direction), 2.0, 100);
            for (place, vertex) in portrait.vertices.iter().zip(sphere.vertices()) {
                assert!((portrait.to_world(place) - vertex).norm() < 1e-12);
                let [u, v] = portrait.camera.project(place);
                assert!((0.0..100.0).contains(&u) && (0.0..100.0).contains(&v));
            }
            // A unit sphere in a box whose diagonal is the root of twelve.
            let nearest = portrait.depth([50, 50]);
            assert!((nearest - (2.0 - 1.0 / 12.0_f64.sqrt())).abs() < 0.01, "{nearest}");
            assert_eq!(portrait.depth([0, 0]), 0.0);
        }
    }
}
