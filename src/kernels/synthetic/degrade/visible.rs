//! The part of a surface that a camera sees.

use nalgebra::Unit;

use super::DegradeError;
use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::sensors::depth::portrait::Portrait;

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
        let direction = Unit::try_new(*direction, 0.0).ok_or(DegradeError::NoDirection)?;
        let portrait = Portrait::new(mesh, direction, DISTANCE, RESOLUTION);
        for (face, seen) in seen.iter_mut().enumerate() {
            let facing = mesh.area_vector(face).dot(&direction) > 0.0;
            *seen |= facing && shows(&portrait, mesh.faces()[face]);
        }
    }
    Ok(seen)
}

/// Whether nothing lies before a face's middle by more than its own slope explains.
fn shows(portrait: &Portrait, face: [u32; 3]) -> bool {
    let corners = face.map(|it| portrait.vertices[it as usize]);
    let middle = corners.iter().sum::<Vec3>() / 3.0;
    let pixel =
        portrait.camera.project(&middle).map(|it| (it.round() as usize).min(RESOLUTION - 1));
    let depth = portrait.depth(pixel);
    let depths = corners.map(|it| it.z);
    let slope = depths.iter().fold(0.0f64, |most, it| most.max((it - middle.z).abs()));
    let slack = 2.0 * slope + 4.0 / RESOLUTION as f64;
    depth == 0.0 || depth >= middle.z - slack
}
