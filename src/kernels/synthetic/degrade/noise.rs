//! Noise along the normals.

use crate::kernels::{geometry::mesh::TriMesh, numerics::random::Random};

/// Moves every vertex along its normal by normal noise of a deviation relative to the mean edge.
pub fn displaced(mesh: &TriMesh, noise: f64, random: &mut Random) -> TriMesh {
    // In a mesh of equilateral triangles of the same mean area.
    let edge = (mesh.area() / mesh.n_faces() as f64 * 4.0 / 3.0_f64.sqrt()).sqrt();
    let normals = mesh.vertex_normals();
    let moved = mesh.vertices().iter().zip(&normals);
    let moved = moved.map(|(it, normal)| it + normal * (noise * edge * random.normal())).collect();
    mesh.with_vertices(moved).expect("noise is finite")
}
