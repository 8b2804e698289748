//! Meshes in motion: positions that change on faces that stay.

use super::mesh::{MeshError, TriMesh, Vec3};

/// `T` frames of the same `V` vertices on the same faces; without faces, moving points.
///
/// All coordinates are finite, and all indices in range.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshSequence {
    frames_per_second: f64,
    n_vertices: usize,
    /// `T * V` positions, frame by frame.
    positions: Vec<Vec3>,
    faces: Vec<[u32; 3]>,
}

/// Why something is no mesh sequence.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SequenceError {
    #[error("the sequence has no frames")]
    NoFrames,
    #[error("{frames_per_second} frames a second")]
    Rate { frames_per_second: f64 },
    #[error("frame {frame} has {n_positions} positions, but the first frame has {n_vertices}")]
    Count { frame: usize, n_positions: usize, n_vertices: usize },
    #[error("frame {frame}: {error}")]
    Mesh { frame: usize, error: MeshError },
}

impl MeshSequence {
    /// Checks and wraps `T` frames of `V` positions each.
    ///
    /// # Errors
    /// See [`SequenceError`].
    pub fn new(
        frames: Vec<Vec<Vec3>>,
        faces: Vec<[u32; 3]>,
        frames_per_second: f64,
    ) -> Result<Self, SequenceError> {
        if !(frames_per_second > 0.0 && frames_per_second.is_finite()) {
            return Err(SequenceError::Rate { frames_per_second });
        }
        let n_vertices = frames.first().ok_or(SequenceError::NoFrames)?.len();
        let mut positions = Vec::with_capacity(frames.len() * n_vertices);
        let mut faces = faces;
        for (frame, points) in frames.into_iter().enumerate() {
            if points.len() != n_vertices {
                let n_positions = points.len();
                return Err(SequenceError::Count { frame, n_positions, n_vertices });
            }
            let mesh = TriMesh::new(points, faces)
                .map_err(|error| SequenceError::Mesh { frame, error })?;
            positions.extend_from_slice(mesh.vertices());
            faces = mesh.faces().to_vec();
        }
        Ok(Self { frames_per_second, n_vertices, positions, faces })
    }

    pub fn n_frames(&self) -> usize {
        self.positions.len() / self.n_vertices
    }

    pub fn n_vertices(&self) -> usize {
        self.n_vertices
    }

    pub fn frames_per_second(&self) -> f64 {
        self.frames_per_second
    }

    pub fn faces(&self) -> &[[u32; 3]] {
        &self.faces
    }

    /// `T * V` positions, frame by frame.
    pub fn positions(&self) -> &[Vec3] {
        &self.positions
    }

    /// The `V` positions of a frame.
    ///
    /// # Panics
    /// If there is no such frame.
    pub fn frame(&self, frame: usize) -> &[Vec3] {
        &self.positions[frame * self.n_vertices..][..self.n_vertices]
    }

    /// The mesh of a frame.
    ///
    /// # Panics
    /// If there is no such frame.
    pub fn mesh(&self, frame: usize) -> TriMesh {
        TriMesh::new(self.frame(frame).to_vec(), self.faces.clone())
            .expect("a sequence's frames were checked")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_have_the_same_vertices() {
        let two = vec![Vec3::x(), Vec3::y()];
        let sequence =
            MeshSequence::new(vec![two.clone(), vec![Vec3::z(); 2]], vec![], 30.0).unwrap();
        assert_eq!((sequence.n_frames(), sequence.n_vertices()), (2, 2));
        assert_eq!(sequence.frame(1), [Vec3::z(); 2]);
        let error = MeshSequence::new(vec![two, vec![Vec3::z()]], vec![], 30.0).unwrap_err();
        assert_eq!(error.to_string(), "frame 1 has 1 positions, but the first frame has 2");
        let error = MeshSequence::new(vec![vec![Vec3::x() * f64::NAN]], vec![], 1.0).unwrap_err();
        assert_eq!(error.to_string(), "frame 0: vertex 0 has the coordinate NaN");
        assert_eq!(MeshSequence::new(vec![], vec![], 1.0), Err(SequenceError::NoFrames));
    }
}
