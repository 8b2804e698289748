//! The surface that is tracked, from the frame that shows it first.

use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::sensors::depth::mesh::{DepthMeshError, depth_mesh};
use crate::kernels::sensors::depth::smooth::smooth;
use crate::kernels::sensors::depth::steps::step_gate;
use crate::kernels::sensors::depth::{DepthError, DepthVideo};

/// How a surface is made from a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct SourceOptions {
    /// The longest edge in metres; without it the gate, and `stride` times as much for a coarse grid.
    pub max_edge: Option<f64>,
    /// Only every so many columns and rows are used.
    pub stride: usize,
    /// The step in depth that separates surfaces, in metres; told from the frame if not given.
    pub gate: Option<f64>,
    /// How many pixels around each one its depth is averaged over.
    pub smoothing: usize,
}

/// Why there is no surface.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SourceError {
    #[error(transparent)]
    Mesh(#[from] DepthMeshError),
    #[error(transparent)]
    Depth(#[from] DepthError),
}

/// Makes the surface that a frame shows, from depths that are averaged as those that it is aligned with.
///
/// # Errors
/// See [`SourceError`].
pub fn source_mesh(
    video: &DepthVideo,
    frame: usize,
    options: &SourceOptions,
) -> Result<TriMesh, SourceError> {
    let n_frames = video.n_frames();
    if frame >= n_frames {
        return Err(DepthMeshError::Frame { frame, n_frames }.into());
    }
    let gate = options.gate.unwrap_or_else(|| step_gate(video, frame));
    let max_edge = options.max_edge.unwrap_or(gate * options.stride as f64);
    let depths = smooth(video.frame(frame), video.width(), gate as f32, options.smoothing);
    let one = video.with_frames(vec![depths])?;
    let res = depth_mesh(&one, 0, max_edge, options.stride);
    // The frame is known by its own number.
    let named = |error| match error {
        DepthMeshError::NoFaces { n_measured, max_edge, .. } => {
            DepthMeshError::NoFaces { frame, n_measured, max_edge }
        }
        other => other,
    };
    Ok(res.map_err(named)?.0)
}
