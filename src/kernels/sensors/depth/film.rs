//! Filming a moving mesh with a depth camera.

use nalgebra::{Isometry3, Point3};
use rayon::prelude::*;

use super::camera::Orbit;
use super::noise::{NoiseModel, disturb};
use super::raster::ZBuffer;
use super::{DepthError, DepthVideo, Intrinsics};
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::geometry::mesh_sequence::{MeshSequence, SequenceError};
use crate::kernels::numerics::random::Random;

/// The camera and its faults.
#[derive(Debug, Clone, PartialEq)]
pub struct FilmOptions {
    pub width: usize,
    pub height: usize,
    pub intrinsics: Intrinsics,
    pub orbit: Orbit,
    /// Without, depths are exact.
    pub noise: Option<NoiseModel>,
    pub seed: u64,
}

/// Why there is no film.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FilmError {
    #[error("a sequence without faces cannot be filmed")]
    NoFaces,
    #[error(transparent)]
    Depth(#[from] DepthError),
    #[error(transparent)]
    Sequence(#[from] SequenceError),
}

/// A film and what is true in it.
#[derive(Debug, Clone)]
pub struct Film {
    pub video: DepthVideo,
    /// The filmed surface in camera space.
    pub truth: MeshSequence,
    pub camera_from_world: Isometry3<f64>,
}

/// Films a sequence of world +y up, looking at the middle of the box around its first frame.
///
/// # Errors
/// See [`FilmError`].
pub fn film(sequence: &MeshSequence, options: &FilmOptions) -> Result<Film, FilmError> {
    if sequence.faces().is_empty() {
        return Err(FilmError::NoFaces);
    }
    options.intrinsics.check()?;
    let (low, high) = sequence.mesh(0).expect("a sequence has a frame").bounds();
    let camera_from_world = options.orbit.camera_from_world(&((low + high) / 2.0));
    let truth = move_sequence(sequence, &camera_from_world)?;
    let size = [options.width, options.height];
    let shoot = |frame: usize| {
        let camera = &options.intrinsics;
        let seen = ZBuffer::draw(size, camera, truth.frame(frame), truth.faces());
        match &options.noise {
            None => seen.depths,
            Some(model) => {
                let mut random = Random::stream(options.seed, &format!("depth frame {frame}"));
                disturb(&seen.depths, options.width, camera, model, &mut random)
            }
        }
    };
    let frames = (0..truth.n_frames()).into_par_iter().map(shoot).collect();
    let video = DepthVideo::new(size, options.intrinsics, sequence.frames_per_second(), frames)?;
    Ok(Film { video, truth, camera_from_world })
}

/// Moves all frames of a sequence rigidly.
///
/// # Errors
/// [`SequenceError`] if positions overflow.
pub fn move_sequence(
    sequence: &MeshSequence,
    motion: &Isometry3<f64>,
) -> Result<MeshSequence, SequenceError> {
    let moved = |it: &Vec3| (motion * Point3::from(*it)).coords;
    let frames = (0..sequence.n_frames())
        .map(|frame| sequence.frame(frame).iter().map(moved).collect())
        .collect();
    MeshSequence::from_frames(frames, sequence.faces().to_vec(), sequence.frames_per_second())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes;

    #[test]
    fn the_truth_is_what_is_filmed() {
        let sphere = shapes::icosphere(4);
        let frames = vec![sphere.vertices().to_vec(), sphere.vertices().to_vec()];
        let sequence = MeshSequence::from_frames(frames, sphere.faces().to_vec(), 30.0).unwrap();
        let intrinsics = Intrinsics { fx: 100.0, fy: 100.0, cx: 39.5, cy: 29.5 };
        let orbit = Orbit { distance: 4.0, azimuth_deg: 40.0, elevation_deg: 20.0 };
        let mut options =
            FilmOptions { width: 80, height: 60, intrinsics, orbit, noise: None, seed: 1 };
        let exact = film(&sequence, &options).unwrap();
        assert_eq!(exact.video.frame(0), exact.video.frame(1));
        let middle = exact.video.frame(0)[30 * 80 + 40];
        assert!((middle - 3.0).abs() < 0.01, "{middle}");
        options.noise = Some(NoiseModel::default());
        let noisy = film(&sequence, &options).unwrap();
        assert_ne!(noisy.video.frame(0), noisy.video.frame(1), "every frame has noise of its own");
        assert_eq!(noisy.truth, exact.truth);
    }
}
