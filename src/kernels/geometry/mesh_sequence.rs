//! Meshes in motion.

use super::mesh::{MeshError, TriMesh, Vec3};

/// `T` frames of a mesh whose faces do not change, at a constant rate.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshSequence {
    frames_per_second: f64,
    n_vertices: usize,
    faces: Vec<[u32; 3]>,
    /// `T * V` positions, frame by frame.
    positions: Vec<Vec3>,
}

/// Why something is no sequence.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SequenceError {
    #[error("a sequence needs a frame")]
    NoFrames,
    #[error("{frames_per_second} frames a second")]
    Rate { frames_per_second: f64 },
    #[error("{n_positions} positions are no whole number of frames of {n_vertices} vertices")]
    Count { n_positions: usize, n_vertices: usize },
    #[error("frame {frame} has {n_positions} positions, but the first frame has {n_vertices}")]
    FrameCount { frame: usize, n_positions: usize, n_vertices: usize },
    #[error("frame {frame}: {error}")]
    Frame { frame: usize, error: MeshError },
    #[error("frame {frame} was asked for, but there are {n_frames}")]
    NoSuchFrame { frame: usize, n_frames: usize },
}

impl MeshSequence {
    /// Checks and wraps `T * V` positions, frame by frame.
    ///
    /// # Errors
    /// See [`SequenceError`].
    pub fn new(
        frames_per_second: f64,
        n_vertices: usize,
        faces: Vec<[u32; 3]>,
        positions: Vec<Vec3>,
    ) -> Result<Self, SequenceError> {
        if !(frames_per_second > 0.0 && frames_per_second.is_finite()) {
            return Err(SequenceError::Rate { frames_per_second });
        }
        let n_positions = positions.len();
        if n_positions == 0 {
            return Err(SequenceError::NoFrames);
        }
        if n_vertices == 0 || !n_positions.is_multiple_of(n_vertices) {
            return Err(SequenceError::Count { n_positions, n_vertices });
        }
        let res = Self { frames_per_second, n_vertices, faces, positions };
        for frame in 0..res.n_frames() {
            let checked = TriMesh::new(res.frame(frame).to_vec(), res.faces.clone());
            checked.map_err(|error| SequenceError::Frame { frame, error })?;
        }
        Ok(res)
    }

    /// Checks and wraps frames of equally many positions.
    ///
    /// # Errors
    /// See [`SequenceError`].
    pub fn from_frames(
        frames: Vec<Vec<Vec3>>,
        faces: Vec<[u32; 3]>,
        frames_per_second: f64,
    ) -> Result<Self, SequenceError> {
        let n_vertices = frames.first().ok_or(SequenceError::NoFrames)?.len();
        if let Some(frame) = frames.iter().position(|it| it.len() != n_vertices) {
            let n_positions = frames[frame].len();
            return Err(SequenceError::FrameCount { frame, n_positions, n_vertices });
        }
        Self::new(frames_per_second, n_vertices, faces, frames.concat())
    }

    pub fn frames_per_second(&self) -> f64 {
        self.frames_per_second
    }

    pub fn n_frames(&self) -> usize {
        self.positions.len() / self.n_vertices
    }

    pub fn n_vertices(&self) -> usize {
        self.n_vertices
    }

    pub fn faces(&self) -> &[[u32; 3]] {
        &self.faces
    }

    /// All positions, frame by frame.
    pub fn positions(&self) -> &[Vec3] {
        &self.positions
    }

    /// The positions of a frame.
    ///
    /// # Panics
    /// If there is no such frame.
    pub fn frame(&self, frame: usize) -> &[Vec3] {
        &self.positions[frame * self.n_vertices..(frame + 1) * self.n_vertices]
    }

    /// A frame as a mesh.
    ///
    /// # Errors
    /// [`SequenceError::NoSuchFrame`].
    pub fn mesh(&self, frame: usize) -> Result<TriMesh, SequenceError> {
        let n_frames = self.n_frames();
        if frame >= n_frames {
            return Err(SequenceError::NoSuchFrame { frame, n_frames });
        }
        let mesh = TriMesh::new(self.frame(frame).to_vec(), self.faces.clone());
        Ok(mesh.expect("checked at the beginning"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_slices_and_counts_are_checked() {
        let positions: Vec<Vec3> = (0..6).map(|it| Vec3::x() * f64::from(it)).collect();
        let sequence = MeshSequence::new(30.0, 3, vec![[0, 1, 2]], positions.clone()).unwrap();
        assert_eq!(sequence.n_frames(), 2);
        assert_eq!(sequence.mesh(1).unwrap().vertices(), &positions[3..]);
        let error = sequence.mesh(2).unwrap_err().to_string();
        assert_eq!(error, "frame 2 was asked for, but there are 2");
        let error = MeshSequence::new(30.0, 4, vec![], positions.clone()).unwrap_err();
        assert_eq!(error, SequenceError::Count { n_positions: 6, n_vertices: 4 });
        let frames = vec![positions[..3].to_vec(), positions[..2].to_vec()];
        let error = MeshSequence::from_frames(frames, vec![], 30.0).unwrap_err().to_string();
        assert_eq!(error, "frame 1 has 2 positions, but the first frame has 3");
        assert!(MeshSequence::new(0.0, 3, vec![], positions.clone()).is_err());
        assert!(MeshSequence::new(30.0, 3, vec![[0, 1, 3]], positions).is_err());
    }
}
