//! Simple shapes with known areas, volumes and topology, for tests and examples.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use super::mesh::{TriMesh, Vec3};

/// A unit sphere: an icosahedron refined `level` times, `10 * 4^level + 2` vertices.
pub fn icosphere(level: usize) -> TriMesh {
    let (mut vertices, mut faces) = icosahedron();
    for _ in 0..level {
        let mut midpoints = BTreeMap::new();
        let mut finer = Vec::with_capacity(faces.len() * 4);
        for [a, b, c] in faces {
            let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(from, to): (u32, u32)| {
                *midpoints.entry((from.min(to), from.max(to))).or_insert_with(|| {
                    let sum: Vec3 = vertices[from as usize] + vertices[to as usize];
                    vertices.push(sum.normalize());
                    vertices.len() as u32 - 1
                })
            });
            finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        faces = finer;
    }
    TriMesh::new(vertices, faces).expect("a sphere is a mesh")
}

fn icosahedron() -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let golden = (1.0 + 5.0f64.sqrt()) / 2.0;
    let mut vertices = Vec::with_capacity(12);
    for axis in 0..3 {
        for (one, phi) in [(-1.0, -golden), (1.0, -golden), (-1.0, golden), (1.0, golden)] {
            let mut vertex = Vec3::zeros();
            vertex[(axis + 1) % 3] = one;
            vertex[(axis + 2) % 3] = phi;
            vertices.push(vertex.normalize());
        }
    }
    // The faces are the triples of mutual nearest neighbours (edge length 2 / |(1, phi)|).
    let edge = 2.0 / (1.0 + golden * golden).sqrt();
    let near = |a: usize, b: usize| ((vertices[a] - vertices[b]).norm() - edge).abs() < 1e-9;
    let mut faces = Vec::with_capacity(20);
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                if near(a, b) && near(b, c) && near(a, c) {
                    let outward = vertices[a].dot(&vertices[b].cross(&vertices[c])) > 0.0;
                    let [a, b, c] = [a as u32, b as u32, c as u32];
                    faces.push(if outward { [a, b, c] } else { [a, c, b] });
                }
            }
        }
    }
    (vertices, faces)
}

/// A torus about the y axis, with `n_around * n_tube` vertices.
///
/// # Panics
/// If a count is below 3.
pub fn torus(radius: f64, tube_radius: f64, n_around: usize, n_tube: usize) -> TriMesh {
    assert!(n_around >= 3 && n_tube >= 3, "a torus needs three steps both ways");
    let mut vertices = Vec::with_capacity(n_around * n_tube);
    let mut faces = Vec::with_capacity(2 * n_around * n_tube);
    let index = |i: usize, j: usize| ((i % n_around) * n_tube + j % n_tube) as u32;
    for i in 0..n_around {
        let (sin_u, cos_u) = (TAU * i as f64 / n_around as f64).sin_cos();
        for j in 0..n_tube {
            let (sin_v, cos_v) = (TAU * j as f64 / n_tube as f64).sin_cos();
            let ring = radius + tube_radius * cos_v;
            vertices.push(Vec3::new(ring * cos_u, tube_radius * sin_v, ring * sin_u));
            let [a, b, c, d] = [index(i, j), index(i + 1, j), index(i + 1, j + 1), index(i, j + 1)];
            faces.extend([[a, c, b], [a, d, c]]);
        }
    }
    TriMesh::new(vertices, faces).expect("a torus is a mesh")
}

/// The unit square in the plane `z = 0`, facing `+z`: `n x n` cells of two triangles.
///
/// # Panics
/// If `n` is zero.
pub fn grid(n: usize) -> TriMesh {
    assert!(n > 0, "a grid has cells");
    let step = 1.0 / n as f64;
    let vertices = (0..=n)
        .flat_map(|j| (0..=n).map(move |i| Vec3::new(i as f64 * step, j as f64 * step, 0.0)))
        .collect();
    let mut faces = Vec::with_capacity(2 * n * n);
    for j in 0..n {
        for i in 0..n {
            let a = (j * (n + 1) + i) as u32;
            let above = a + n as u32 + 1;
            faces.extend([[a, a + 1, above + 1], [a, above + 1, above]]);
        }
    }
    TriMesh::new(vertices, faces).expect("a grid is a mesh")
}

/// Two shapes as one mesh: the second's vertices and faces after the first's.
pub fn union(first: &TriMesh, second: &TriMesh) -> TriMesh {
    let shift = first.n_vertices() as u32;
    let vertices = first.vertices().iter().chain(second.vertices()).copied().collect();
    let shifted = second.faces().iter().map(|face| face.map(|vertex| vertex + shift));
    let faces = first.faces().iter().copied().chain(shifted).collect();
    TriMesh::new(vertices, faces).expect("both are meshes")
}

/// The same shape elsewhere.
pub fn moved(mesh: &TriMesh, offset: Vec3) -> TriMesh {
    let vertices = mesh.vertices().iter().map(|it| it + offset).collect();
    mesh.with_vertices(vertices).expect("finite plus finite")
}

/// The volume inside a closed, outward mesh; of any mesh, the integral that Gauss' theorem makes
/// of it.
pub fn signed_volume(mesh: &TriMesh) -> f64 {
    (0..mesh.n_faces())
        .map(|face| {
            let [a, b, c] = mesh.corners(face);
            a.dot(&b.cross(&c)) / 6.0
        })
        .sum()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    #[test]
    fn a_fine_sphere_has_the_area_and_volume_of_a_ball() {
        let mesh = icosphere(4);
        assert_eq!(mesh.n_vertices(), 10 * 256 + 2);
        assert!((mesh.area() / (4.0 * PI) - 1.0).abs() < 0.005);
        assert!((signed_volume(&mesh) / (4.0 / 3.0 * PI) - 1.0).abs() < 0.01);
    }

    #[test]
    fn a_fine_torus_has_the_area_and_volume_of_pappus() {
        let mesh = torus(2.0, 0.5, 96, 48);
        assert!((mesh.area() / (TAU * 2.0 * TAU * 0.5) - 1.0).abs() < 0.005);
        assert!((signed_volume(&mesh) / (TAU * 2.0 * PI * 0.25) - 1.0).abs() < 0.01);
    }

    #[test]
    fn a_grid_covers_the_unit_square() {
        assert!((grid(7).area() - 1.0).abs() < 1e-12);
        assert_eq!(grid(3).vertex_normals()[5], Vec3::z());
    }
}
