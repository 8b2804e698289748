//! What is decomposed: a mesh in motion.

use faer::{Mat, MatRef};

use crate::kernels::geometry::mesh::Vec3;

/// The moving mesh, with every frame about its own centre and a size of about one.
pub struct Moving {
    /// Homogeneous rest positions.
    pub rest: Vec<[f64; 4]>,
    /// `3T x V`.
    pub frames: Mat<f64>,
    /// The squared length of every column of `frames`.
    pub squares: Vec<f64>,
    pub rest_center: Vec3,
    pub centers: Vec<Vec3>,
    pub scale: f64,
}

impl Moving {
    pub fn new(rest: &[Vec3], frames: &[&[Vec3]]) -> Self {
        let center = |points: &[Vec3]| points.iter().sum::<Vec3>() / points.len() as f64;
        let rest_center = center(rest);
        let centers: Vec<Vec3> = frames.iter().map(|it| center(it)).collect();
        let square: f64 = rest.iter().map(|it| (it - rest_center).norm_squared()).sum();
        let size = (square / rest.len() as f64).sqrt();
        // All vertices at one place have no size.
        let scale = if size == 0.0 { 1.0 } else { 1.0 / size };
        let homogeneous = |it: &Vec3| {
            let at = (it - rest_center) * scale;
            [at.x, at.y, at.z, 1.0]
        };
        let matrix = Mat::from_fn(3 * frames.len(), rest.len(), |row, vertex| {
            let (frame, axis) = (row / 3, row % 3);
            (frames[frame][vertex][axis] - centers[frame][axis]) * scale
        });
        let squares = (0..rest.len()).map(|it| matrix.col(it).squared_norm_l2()).collect();
        let rest = rest.iter().map(homogeneous).collect();
        Self { rest, frames: matrix, squares, rest_center, centers, scale }
    }

    pub fn n_vertices(&self) -> usize {
        self.rest.len()
    }

    pub fn n_frames(&self) -> usize {
        self.centers.len()
    }

    /// The positions of some vertices, by columns.
    pub fn columns(&self, range: std::ops::Range<usize>) -> MatRef<'_, f64> {
        self.frames.as_ref().subcols(range.start, range.len())
    }

    /// Some of the vertices, in the same unit and about the same centres.
    pub fn part(&self, vertices: &[u32]) -> Self {
        let frames = Mat::from_fn(self.frames.nrows(), vertices.len(), |row, it| {
            self.frames[(row, vertices[it] as usize)]
        });
        Self {
            rest: vertices.iter().map(|&it| self.rest[it as usize]).collect(),
            frames,
            squares: vertices.iter().map(|&it| self.squares[it as usize]).collect(),
            rest_center: self.rest_center,
            centers: self.centers.clone(),
            scale: self.scale,
        }
    }
}
