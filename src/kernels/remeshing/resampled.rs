//! What a change of a mesh's vertices does to the values that live on them.

use crate::kernels::geometry::landmarks::Landmarks;
use crate::kernels::geometry::mesh::{MeshError, TriMesh};
use crate::kernels::numerics::sparse::CsrMatrix;
use crate::kernels::rigs::weights::{SkinWeights, WeightsError};

/// A mesh made from another one, with the relation of their vertices.
#[derive(Debug, Clone, PartialEq)]
pub struct Resampled {
    pub mesh: TriMesh,
    /// `V_new x V_old`: every new vertex as a convex combination of old ones (rows sum to one).
    pub new_from_old: CsrMatrix,
    /// For every old vertex the new one that stands for it, or none if its place is gone.
    pub new_of_old: Vec<Option<u32>>,
}

/// Why values cannot be carried from one mesh to the other.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ResampledError {
    #[error("{n_values} rows of weights for a mesh of {n_vertices} vertices")]
    Count { n_values: usize, n_vertices: usize },
    #[error("landmark `{name}` is vertex {vertex}, but the mesh has {n_vertices} vertices")]
    OutOfRange { name: String, vertex: u32, n_vertices: usize },
    #[error("landmark `{name}` was at vertex {vertex}, which has been removed")]
    LandmarkRemoved { name: String, vertex: u32 },
    #[error(transparent)]
    Weights(#[from] WeightsError),
}

impl Resampled {
    /// A mesh whose vertices are some of the old ones: `old_of_new` names them.
    pub fn from_selection(mesh: TriMesh, old_of_new: &[u32], new_of_old: Vec<Option<u32>>) -> Self {
        let new_from_old = CsrMatrix {
            n_rows: old_of_new.len(),
            n_cols: new_of_old.len(),
            offsets: (0..=old_of_new.len()).collect(),
            columns: old_of_new.to_vec(),
            values: vec![1.0; old_of_new.len()],
        };
        Self { mesh, new_from_old, new_of_old }
    }

    /// Some faces of a mesh, with the vertices that they use.
    ///
    /// # Errors
    /// [`MeshError::NoVertices`] if there are no faces.
    pub fn of_faces(mesh: &TriMesh, faces: &[[u32; 3]]) -> Result<Self, MeshError> {
        let mut new_of_old = vec![None; mesh.n_vertices()];
        for &vertex in faces.iter().flatten() {
            new_of_old[vertex as usize] = Some(0);
        }
        let mut old_of_new: Vec<u32> = Vec::new();
        for (old, new) in new_of_old.iter_mut().enumerate().filter(|it| it.1.is_some()) {
            *new = Some(old_of_new.len() as u32);
            old_of_new.push(old as u32);
        }
        let vertices = old_of_new.iter().map(|&it| mesh.vertices()[it as usize]).collect();
        let number = |it: u32| new_of_old[it as usize].expect("a face's vertices are used");
        let faces = faces.iter().map(|it| it.map(number)).collect();
        Ok(Self::from_selection(TriMesh::new(vertices, faces)?, &old_of_new, new_of_old))
    }

    /// A function on the old vertices, carried over.
    pub fn function(&self, old: &[f64]) -> Vec<f64> {
        self.new_from_old.mul_vec(old)
    }

    /// Skin weights, carried over; every row sums to one.
    ///
    /// # Errors
    /// [`ResampledError::Count`].
    pub fn weights(&self, old: &SkinWeights) -> Result<SkinWeights, ResampledError> {
        let n_vertices = self.new_of_old.len();
        if old.n_vertices() != n_vertices {
            return Err(ResampledError::Count { n_values: old.n_vertices(), n_vertices });
        }
        let rows: Vec<Vec<(u32, f64)>> = (0..self.new_from_old.n_rows)
            .map(|new| {
                self.new_from_old
                    .row(new)
                    .flat_map(|(vertex, share)| old.row(vertex).map(move |(q, w)| (q, share * w)))
                    .collect()
            })
            .collect();
        Ok(SkinWeights::from_rows(old.n_joints(), &rows)?)
    }

    /// Landmarks, carried over.
    ///
    /// # Errors
    /// [`ResampledError::OutOfRange`] and [`ResampledError::LandmarkRemoved`].
    pub fn landmarks(&self, old: &Landmarks) -> Result<Landmarks, ResampledError> {
        let carry = |(name, &vertex): (&String, &u32)| match self.new_of_old.get(vertex as usize) {
            Some(Some(new)) => Ok(*new),
            Some(None) => Err(ResampledError::LandmarkRemoved { name: name.clone(), vertex }),
            None => {
                let n_vertices = self.new_of_old.len();
                Err(ResampledError::OutOfRange { name: name.clone(), vertex, n_vertices })
            }
        };
        let vertices = old.names.iter().zip(&old.vertices).map(carry).collect::<Result<_, _>>()?;
        Ok(Landmarks { names: old.names.clone(), vertices })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes::rectangle;

    #[test]
    fn a_removed_landmark_is_named() {
        let mesh = rectangle(1, 1, 1.0, 1.0);
        let resampled =
            Resampled::from_selection(mesh, &[0, 1, 2, 3], vec![Some(0), Some(1), Some(2), None]);
        let landmarks = |vertices| Landmarks { names: vec!["tip".to_owned()], vertices };
        assert_eq!(resampled.landmarks(&landmarks(vec![2])).unwrap().vertices, [2]);
        let error = resampled.landmarks(&landmarks(vec![3])).unwrap_err();
        assert_eq!(error.to_string(), "landmark `tip` was at vertex 3, which has been removed");
        let error = resampled.landmarks(&landmarks(vec![9])).unwrap_err();
        assert_eq!(error.to_string(), "landmark `tip` is vertex 9, but the mesh has 4 vertices");
    }
}
