//! The cotangent Laplacian of triangle meshes.

use super::edge_weights::EdgeWeights;
use super::operator::Operator;
use crate::kernels::geometry::mesh::{MeshError, TriMesh, Vec3};

/// How the area of the faces is shared out among their corners.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MassLumping {
    /// Voronoi cells inside non-obtuse triangles, halves and quarters of obtuse ones
    /// (the mixed area of Meyer et al. 2003).
    #[default]
    MixedVoronoi,
    /// A third of every triangle to each corner.
    Barycentric,
}

/// Why a mesh has no Laplacian.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LaplacianError {
    #[error(transparent)]
    Mesh(#[from] MeshError),
    #[error(
        "{n_massless} of {n_vertices} vertices have no area ({n_unreferenced} belong to no face, \
         {n_degenerate} only to faces without area), the first is vertex {first}"
    )]
    NoArea {
        n_massless: usize,
        n_vertices: usize,
        n_unreferenced: usize,
        n_degenerate: usize,
        first: usize,
    },
    #[error(
        "the {n_faces} faces have a mean area of {mean_area:e}: \
         the coordinates are too large or too small for double precision"
    )]
    Range { n_faces: usize, mean_area: f64 },
}

/// Faces below this share of the mean area are skipped: their cotangents are noise.
const DEGENERATE_AREA: f64 = 1e-14;

/// Assembles the cotangent Laplacian and the lumped masses of a triangle mesh.
///
/// `L[i][j] = -(cot a + cot b) / 2` for the angles `a`, `b` that face the edge `ij`
/// (Pinkall & Polthier 1993), with one term on boundaries and as many terms as there are faces on
/// non-manifold edges; the diagonal makes every row sum to zero. Faces whose area is at most `1e-14`
/// of the mean are left out. Weights of edges between flat obtuse triangles may be negative.
///
/// The `V x V` stiffness is exactly symmetric, positive semi-definite and without unit; the `V`
/// masses add up to the area of the faces that are kept. Other libraries use the opposite sign.
///
/// # Errors
/// See [`LaplacianError`].
pub fn cotangent_laplacian(
    mesh: &TriMesh,
    lumping: MassLumping,
) -> Result<Operator, LaplacianError> {
    mesh.check_has_faces()?;
    let smallest_area = smallest_area(mesh)?;
    let mut mass = vec![0.0; mesh.n_vertices()];
    let mut weights = EdgeWeights::with_room(&room(mesh));
    for &face in mesh.faces() {
        let corners = face.map(|vertex| mesh.vertices()[vertex as usize]);
        let Some(triangle) = Triangle::new(corners, smallest_area) else { continue };
        for corner in 0..3 {
            let [_, from, to] = [0, 1, 2].map(|step| face[(corner + step) % 3]);
            weights.add(from, to, 0.5 * triangle.cotangents[corner]);
            mass[face[corner] as usize] += triangle.mass(corner, lumping);
        }
    }
    if mass.iter().any(|&it| it <= 0.0) {
        return Err(no_area(mesh, &mass));
    }
    Ok(Operator { stiffness: weights.into_stiffness(), mass })
}

/// How many edges the faces of every vertex name at it.
fn room(mesh: &TriMesh) -> Vec<u32> {
    let mut room = vec![0; mesh.n_vertices()];
    for &vertex in mesh.faces().iter().flatten() {
        room[vertex as usize] += 2;
    }
    room
}

/// The area at or below which a face is degenerate.
fn smallest_area(mesh: &TriMesh) -> Result<f64, LaplacianError> {
    let mean_area = mesh.area() / mesh.n_faces() as f64;
    // Cotangents and masses need products of edges, which must neither overflow nor vanish.
    if mean_area != 0.0 && !(1e-250..1e250).contains(&mean_area) {
        return Err(LaplacianError::Range { n_faces: mesh.n_faces(), mean_area });
    }
    Ok(DEGENERATE_AREA * mean_area)
}

fn no_area(mesh: &TriMesh, mass: &[f64]) -> LaplacianError {
    let mut referenced = vec![false; mesh.n_vertices()];
    for &vertex in mesh.faces().iter().flatten() {
        referenced[vertex as usize] = true;
    }
    let massless: Vec<usize> = (0..mass.len()).filter(|&it| mass[it] <= 0.0).collect();
    let n_unreferenced = massless.iter().filter(|&&it| !referenced[it]).count();
    LaplacianError::NoArea {
        n_massless: massless.len(),
        n_vertices: mesh.n_vertices(),
        n_unreferenced,
        n_degenerate: massless.len() - n_unreferenced,
        first: massless[0],
    }
}

/// What a face contributes, by corner.
struct Triangle {
    area: f64,
    /// The cotangents of the angles at the three corners.
    cotangents: [f64; 3],
    /// The squared lengths of the edges that face the corners.
    squared_edges: [f64; 3],
}

impl Triangle {
    /// `None` if the triangle is not larger than `smallest_area`.
    fn new(corners: [Vec3; 3], smallest_area: f64) -> Option<Self> {
        let [a, b, c] = corners;
        let edges = [c - b, a - c, b - a];
        let double_area = edges[0].cross(&edges[1]).norm();
        // Written so that it also holds where a coordinate's product is no number.
        if !(0.5 * double_area > smallest_area) {
            return None;
        }
        let dots = [0, 1, 2].map(|it| -edges[(it + 1) % 3].dot(&edges[(it + 2) % 3]));
        Some(Self {
            area: 0.5 * double_area,
            cotangents: dots.map(|it| it / double_area),
            squared_edges: edges.map(|it| it.norm_squared()),
        })
    }

    /// The part of the area that belongs to a corner.
    fn mass(&self, corner: usize, lumping: MassLumping) -> f64 {
        let [here, next, last] = [corner, (corner + 1) % 3, (corner + 2) % 3];
        match lumping {
            MassLumping::Barycentric => self.area / 3.0,
            MassLumping::MixedVoronoi if self.cotangents[here] < 0.0 => self.area / 2.0,
            MassLumping::MixedVoronoi if self.cotangents.iter().any(|&it| it < 0.0) => {
                self.area / 4.0
            }
            MassLumping::MixedVoronoi => {
                let shares = [next, last].map(|it| self.squared_edges[it] * self.cotangents[it]);
                (shares[0] + shares[1]) / 8.0
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes::{bumpy_sphere, geodesic_sphere, rectangle};

    /// A sphere, an uneven closed surface, a flat one with boundary, three faces on one edge.
    fn meshes() -> Vec<TriMesh> {
        let fan = vec![Vec3::zeros(), Vec3::z(), Vec3::x(), Vec3::y(), Vec3::new(-1.0, -0.4, 0.2)];
        let fan_faces = vec![[0, 1, 2], [0, 1, 3], [0, 1, 4]];
        vec![
            geodesic_sphere(5),
            bumpy_sphere(6),
            rectangle(7, 4, 2.0, 0.3),
            TriMesh::new(fan, fan_faces).unwrap(),
        ]
    }

    fn scaled(mesh: &TriMesh, factor: f64) -> TriMesh {
        mesh.with_vertices(mesh.vertices().iter().map(|it| it * factor).collect()).unwrap()
    }

    #[test]
    fn stiffness_is_symmetric_and_kills_constants() {
        for mesh in meshes() {
            let operator = cotangent_laplacian(&mesh, MassLumping::default()).unwrap();
            let matrix = &operator.stiffness;
            let largest = matrix.values.iter().fold(0.0f64, |max, it| max.max(it.abs()));
            for sum in matrix.mul_vec(&vec![1.0; mesh.n_vertices()]) {
                assert!(sum.abs() <= 1e-14 * largest, "a row adds up to {sum}");
            }
            for row in 0..matrix.n_rows {
                for (column, value) in matrix.row(row) {
                    let mirror = matrix.row(column).find(|it| it.0 == row).map(|it| it.1);
                    assert_eq!(mirror, Some(value), "{row}, {column}");
                }
            }
        }
    }

    #[test]
    fn masses_add_up_to_the_area() {
        for mesh in meshes() {
            for lumping in [MassLumping::MixedVoronoi, MassLumping::Barycentric] {
                let mass = cotangent_laplacian(&mesh, lumping).unwrap().mass;
                let relative = mass.iter().sum::<f64>() / mesh.area() - 1.0;
                assert!(relative.abs() < 1e-13, "{lumping:?}: {relative}");
                assert!(mass.iter().all(|&it| it > 0.0));
            }
        }
    }

    #[test]
    fn scale_leaves_the_stiffness_and_squares_the_mass() {
        for mesh in meshes() {
            let one = cotangent_laplacian(&mesh, MassLumping::default()).unwrap();
            let largest = one.stiffness.values.iter().fold(0.0f64, |max, it| max.max(it.abs()));
            for factor in [1e8, 1e-8] {
                let other =
                    cotangent_laplacian(&scaled(&mesh, factor), MassLumping::default()).unwrap();
                assert_eq!(other.stiffness.columns, one.stiffness.columns);
                for (a, b) in other.stiffness.values.iter().zip(&one.stiffness.values) {
                    assert!((a - b).abs() <= 1e-12 * largest, "{a} and {b}");
                }
                for (a, b) in other.mass.iter().zip(&one.mass) {
                    assert!((a / (b * factor * factor) - 1.0).abs() < 1e-12, "{a} and {b}");
                }
            }
        }
    }

    /// The energy of a linear function is its squared slope times the area, whatever the mesh.
    #[test]
    fn linear_functions_have_their_exact_dirichlet_energy() {
        let mesh = rectangle(9, 5, 3.0, 2.0);
        let operator = cotangent_laplacian(&mesh, MassLumping::default()).unwrap();
        let function: Vec<f64> = mesh.vertices().iter().map(|it| 2.0 * it.x - it.y).collect();
        let image = operator.stiffness.mul_vec(&function);
        let energy: f64 = image.iter().zip(&function).map(|(a, b)| a * b).sum();
        assert!((energy - 5.0 * 6.0).abs() < 1e-11, "{energy}");
    }

    #[test]
    fn mixed_areas_of_a_right_and_of_an_obtuse_triangle() {
        let right = vec![Vec3::zeros(), Vec3::x(), Vec3::y()];
        let mesh = TriMesh::new(right, vec![[0, 1, 2]]).unwrap();
        let mass = cotangent_laplacian(&mesh, MassLumping::MixedVoronoi).unwrap().mass;
        assert_eq!(mass, [0.25, 0.125, 0.125]);
        let obtuse = vec![Vec3::zeros(), Vec3::new(2.0, 0.0, 0.0), Vec3::new(1.0, 0.5, 0.0)];
        let mesh = TriMesh::new(obtuse, vec![[0, 1, 2]]).unwrap();
        let mass = cotangent_laplacian(&mesh, MassLumping::MixedVoronoi).unwrap().mass;
        assert_eq!(mass, [0.125, 0.125, 0.25]);
    }

    #[test]
    fn degenerate_faces_are_left_out() {
        let mesh = rectangle(3, 3, 1.0, 1.0);
        let mut faces = mesh.faces().to_vec();
        faces.push([0, 0, 1]);
        faces.push([0, 1, 2]);
        let with_slivers = TriMesh::new(mesh.vertices().to_vec(), faces).unwrap();
        assert_eq!(
            cotangent_laplacian(&with_slivers, MassLumping::default()),
            cotangent_laplacian(&mesh, MassLumping::default())
        );
    }

    #[test]
    fn vertices_without_area_are_counted() {
        let mut vertices = rectangle(2, 2, 1.0, 1.0).vertices().to_vec();
        let n_vertices = vertices.len() as u32;
        vertices.extend([Vec3::zeros(), Vec3::x(), Vec3::y()]);
        let mut faces = rectangle(2, 2, 1.0, 1.0).faces().to_vec();
        faces.push([0, n_vertices, n_vertices]);
        let mesh = TriMesh::new(vertices, faces).unwrap();
        let error = cotangent_laplacian(&mesh, MassLumping::default()).unwrap_err();
        assert_eq!(
            error.to_string(),
            "3 of 12 vertices have no area (2 belong to no face, 1 only to faces without area), \
             the first is vertex 9"
        );
    }

    #[test]
    fn coordinates_out_of_range_are_refused() {
        let mesh = scaled(&geodesic_sphere(2), 1e160);
        let error = cotangent_laplacian(&mesh, MassLumping::default()).unwrap_err();
        assert!(matches!(error, LaplacianError::Range { n_faces: 80, .. }), "{error}");
    }
}
