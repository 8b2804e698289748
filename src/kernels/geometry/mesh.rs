//! Triangle meshes.

/// A point or a direction in space.
pub type Vec3 = nalgebra::Vector3<f64>;

/// A triangle mesh whose coordinates are finite and whose indices are in range.
///
/// Nothing else is promised: faces may be degenerate or repeated, edges non-manifold, parts
/// disconnected, vertices unreferenced. A mesh without any faces is a point cloud. `V x 3` positions in the file's unit, `F x 3` indices,
/// counter-clockwise seen from outside where the mesh has an outside.
#[derive(Debug, Clone, PartialEq)]
pub struct TriMesh {
    vertices: Vec<Vec3>,
    faces: Vec<[u32; 3]>,
}

/// Why something is no triangle mesh.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MeshError {
    #[error("the mesh has no vertices")]
    NoVertices,
    #[error(
        "there are {n_points} points but no faces: this is a point cloud, and a surface is needed"
    )]
    PointCloud { n_points: usize },
    #[error("vertex {vertex} has the coordinate {value}")]
    NotFinite { vertex: usize, value: f64 },
    #[error("face {face} refers to vertex {vertex}, but the mesh has {n_vertices} vertices")]
    OutOfRange { face: usize, vertex: u32, n_vertices: usize },
}

impl TriMesh {
    /// Checks and wraps `V x 3` positions and `F x 3` indices.
    ///
    /// # Errors
    /// See [`MeshError`]; the first offending vertex or face is named.
    pub fn new(vertices: Vec<Vec3>, faces: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        let n_vertices = vertices.len();
        if n_vertices == 0 {
            return Err(MeshError::NoVertices);
        }
        for (vertex, position) in vertices.iter().enumerate() {
            if let Some(&value) = position.iter().find(|it| !it.is_finite()) {
                return Err(MeshError::NotFinite { vertex, value });
            }
        }
        for (face, corners) in faces.iter().enumerate() {
            if let Some(&vertex) = corners.iter().find(|&&it| it as usize >= n_vertices) {
                return Err(MeshError::OutOfRange { face, vertex, n_vertices });
            }
        }
        Ok(Self { vertices, faces })
    }

    /// A point cloud.
    ///
    /// # Errors
    /// See [`MeshError`]; the first offending point is named.
    pub fn from_points(points: Vec<Vec3>) -> Result<Self, MeshError> {
        Self::new(points, Vec::new())
    }

    /// Whether there are no faces.
    pub fn is_point_cloud(&self) -> bool {
        self.faces.is_empty()
    }

    /// Refuses a point cloud, for what works on faces.
    ///
    /// # Errors
    /// [`MeshError::PointCloud`].
    pub fn check_has_faces(&self) -> Result<(), MeshError> {
        match self.is_point_cloud() {
            true => Err(MeshError::PointCloud { n_points: self.n_vertices() }),
            false => Ok(()),
        }
    }

    /// `V` positions.
    pub fn vertices(&self) -> &[Vec3] {
        &self.vertices
    }

    /// `F` triples of vertex indices.
    pub fn faces(&self) -> &[[u32; 3]] {
        &self.faces
    }

    pub fn n_vertices(&self) -> usize {
        self.vertices.len()
    }

    pub fn n_faces(&self) -> usize {
        self.faces.len()
    }

    /// The same connectivity at other positions.
    ///
    /// # Errors
    /// [`MeshError::NotFinite`].
    ///
    /// # Panics
    /// If the number of positions differs from the number of vertices.
    pub fn with_vertices(&self, vertices: Vec<Vec3>) -> Result<Self, MeshError> {
        assert_eq!(vertices.len(), self.n_vertices(), "one position for every vertex");
        Self::new(vertices, self.faces.clone())
    }

    /// The same surface inside out: every face is turned.
    pub fn inverted(&self) -> Self {
        let turned = self.faces.iter().map(|&[a, b, c]| [a, c, b]);
        Self { vertices: self.vertices.clone(), faces: turned.collect() }
    }

    /// The three corners of a face.
    pub fn corners(&self, face: usize) -> [Vec3; 3] {
        self.faces[face].map(|vertex| self.vertices[vertex as usize])
    }

    /// Half the cross product of two edges: the face's normal, as long as its area.
    pub fn area_vector(&self, face: usize) -> Vec3 {
        let [a, b, c] = self.corners(face);
        (b - a).cross(&(c - a)) * 0.5
    }

    /// The sum of all face areas.
    pub fn area(&self) -> f64 {
        (0..self.n_faces()).map(|face| self.area_vector(face).norm()).sum()
    }

    /// The least and the greatest coordinates.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        let first = self.vertices[0];
        self.vertices.iter().fold((first, first), |(lo, hi), it| (lo.inf(it), hi.sup(it)))
    }

    /// A third of the area of the faces around each vertex.
    pub fn vertex_areas(&self) -> Vec<f64> {
        let mut areas = vec![0.0; self.n_vertices()];
        for (face, corners) in self.faces.iter().enumerate() {
            let third = self.area_vector(face).norm() / 3.0;
            corners.iter().for_each(|&it| areas[it as usize] += third);
        }
        areas
    }

    /// Area-weighted unit normals, one a vertex; zero where no face has an area.
    pub fn vertex_normals(&self) -> Vec<Vec3> {
        let mut normals = vec![Vec3::zeros(); self.n_vertices()];
        for (face, corners) in self.faces.iter().enumerate() {
            let area_vector = self.area_vector(face);
            for &vertex in corners {
                normals[vertex as usize] += area_vector;
            }
        }
        for normal in &mut normals {
            *normal = normal.try_normalize(0.0).unwrap_or_default();
        }
        normals
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangle() -> Vec<Vec3> {
        vec![Vec3::zeros(), Vec3::x(), Vec3::y()]
    }

    #[test]
    fn a_mesh_says_which_face_and_vertex_are_wrong() {
        let error = TriMesh::new(triangle(), vec![[0, 1, 2], [0, 1, 3]]).unwrap_err();
        assert_eq!(error.to_string(), "face 1 refers to vertex 3, but the mesh has 3 vertices");
        let mut vertices = triangle();
        vertices[2].y = f64::NAN;
        let error = TriMesh::new(vertices, vec![[0, 1, 2]]).unwrap_err();
        assert_eq!(error.to_string(), "vertex 2 has the coordinate NaN");
        assert_eq!(TriMesh::new(vec![], vec![]), Err(MeshError::NoVertices));
    }

    #[test]
    fn points_alone_are_a_cloud() {
        let cloud = TriMesh::from_points(triangle()).unwrap();
        assert!(cloud.is_point_cloud());
        assert_eq!(
            cloud.check_has_faces().unwrap_err().to_string(),
            "there are 3 points but no faces: this is a point cloud, and a surface is needed"
        );
        assert_eq!((cloud.n_vertices(), cloud.n_faces(), cloud.area()), (3, 0, 0.0));
        assert_eq!(TriMesh::from_points(vec![]), Err(MeshError::NoVertices));
    }

    #[test]
    fn area_of_the_half_unit_square() {
        let mesh = TriMesh::new(triangle(), vec![[0, 1, 2]]).unwrap();
        assert_eq!(mesh.area(), 0.5);
        assert_eq!(mesh.vertex_normals(), vec![Vec3::z(); 3]);
    }
}
