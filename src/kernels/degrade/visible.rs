//! The part of a surface that a camera sees.

use nalgebra::Rotation3;

use super::DegradeError;
use crate::kernels::depth::{Intrinsics, raster::ZBuffer};
use crate::kernels::mesh::{TriMesh, Vec3};

/// Pixels along the sides of the picture.
const RESOLUTION: usize = 1024;

/// How far away the camera is, in diagonals of the bounding box: nearly parallel rays.
const DISTANCE: f64 = 20.0;

/// Which faces are seen from at least one of the directions (from the shape to a camera far away).
///
/// A face is seen if it faces the camera, and the depth buffer has nothing before its middle.
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
            *seen |= facing && picture.shows(mesh.faces()[face]);
        }
    }
    Ok(seen)
}

/// The depths that a camera sees, with the vertices in its frame at a diagonal of one.
struct Picture {
    vertices: Vec<Vec3>,
    camera: Intrinsics,
    buffer: ZBuffer,
}

impl Picture {
    fn new(mesh: &TriMesh, direction: Vec3) -> Self {
        let (low, high) = mesh.bounds();
        let (middle, diagonal) = (0.5 * (low + high), (high - low).norm().max(f64::MIN_POSITIVE));
        let other = if direction.y.abs() < 0.9 { Vec3::y() } else { Vec3::x() };
        // The camera looks along its +Z, against the direction.
        let camera_from_world = Rotation3::look_at_lh(&-direction, &other);
        let place = |it: &Vec3| {
            camera_from_world * ((it - middle) / diagonal) + Vec3::new(0.0, 0.0, DISTANCE)
        };
        let vertices: Vec<Vec3> = mesh.vertices().iter().map(place).collect();
        // The box's diagonal fills the picture but for a rim.
        let focal = DISTANCE * 0.95 * RESOLUTION as f64;
        let center = 0.5 * (RESOLUTION - 1) as f64;
        let camera = Intrinsics { fx: focal, fy: focal, cx: center, cy: center };
        let buffer = ZBuffer::draw([RESOLUTION, RESOLUTION], &camera, &vertices, mesh.faces());
        Self { vertices, camera, buffer }
    }

    /// Whether nothing lies before a face's middle by more than its own slope explains.
    fn shows(&self, face: [u32; 3]) -> bool {
        let corners = face.map(|it| self.vertices[it as usize]);
        let middle = corners.iter().sum::<Vec3>() / 3.0;
        let [u, v] = self.camera.project(&middle).map(|it| it.round() as usize);
        let depth = f64::from(
            self.buffer.depths[v.min(RESOLUTION - 1) * RESOLUTION + u.min(RESOLUTION - 1)],
        );
        let depths = corners.map(|it| it.z);
        let slope = depths.iter().fold(0.0f64, |most, it| most.max((it - middle.z).abs()));
        let slack = 2.0 * slope + 4.0 / RESOLUTION as f64;
        depth == 0.0 || depth >= middle.z - slack
    }
}
