//! Simple surfaces whose spectra are known, for tests, examples and benchmarks.

use super::mesh::{TriMesh, Vec3};
use std::collections::BTreeMap;

/// A unit sphere of `10 f^2 + 2` vertices: an icosahedron with its edges cut into `f` parts.
///
/// As long as `f` is even, edges are halved and their middles moved to the sphere, so powers of two
/// give the usual icosphere (16 is the one of 2,562 vertices).
///
/// # Panics
/// If `frequency` is zero.
pub fn geodesic_sphere(frequency: usize) -> TriMesh {
    assert!(frequency > 0, "edges are cut into one part at least");
    let mut odd = frequency;
    let mut parts = vec![];
    while odd % 2 == 0 {
        parts.push(2);
        odd /= 2;
    }
    parts.push(odd);
    let (mut vertices, mut faces) = icosahedron();
    for &n_parts in parts.iter().rev() {
        (vertices, faces) = cut_edges(&vertices, &faces, n_parts);
    }
    TriMesh::new(vertices, faces).expect("points of the unit sphere are finite")
}

/// An uneven closed surface of `10 f^2 + 2` vertices: a sphere with swellings and a waist, with
/// triangles of different shapes and sizes.
///
/// # Panics
/// If `frequency` is zero.
pub fn bumpy_sphere(frequency: usize) -> TriMesh {
    let sphere = geodesic_sphere(frequency);
    let bump = |p: &Vec3| {
        let waves = (3.0 * p.x + 1.0).sin() * (4.0 * p.y).cos() + (5.0 * p.z + p.x).sin();
        let skewed = p + Vec3::new(0.15 * (7.0 * p.y).sin(), 0.1 * (9.0 * p.z).sin(), 0.0);
        skewed.normalize().component_mul(&Vec3::new(0.6, 0.8, 1.7)) * (1.0 + 0.2 * waves)
    };
    let vertices = sphere.vertices().iter().map(bump).collect();
    sphere.with_vertices(vertices).expect("bumps are finite")
}

/// A flat `width x height` rectangle of `(n_x + 1) (n_y + 1)` vertices, row by row, in the plane
/// `z = 0`; every cell is two triangles.
///
/// # Panics
/// If a count is zero or a side is not finite.
pub fn rectangle(n_x: usize, n_y: usize, width: f64, height: f64) -> TriMesh {
    assert!(n_x > 0 && n_y > 0, "one cell at least in both directions");
    let at = |x: usize, y: usize| (y * (n_x + 1) + x) as u32;
    let mut vertices = Vec::with_capacity((n_x + 1) * (n_y + 1));
    let mut faces = Vec::with_capacity(2 * n_x * n_y);
    for y in 0..=n_y {
        for x in 0..=n_x {
            let (u, v) = (x as f64 / n_x as f64, y as f64 / n_y as f64);
            vertices.push(Vec3::new(width * u, height * v, 0.0));
            if x < n_x && y < n_y {
                faces.push([at(x, y), at(x + 1, y), at(x + 1, y + 1)]);
                faces.push([at(x, y), at(x + 1, y + 1), at(x, y + 1)]);
            }
        }
    }
    TriMesh::new(vertices, faces).expect("the sides are finite")
}

fn icosahedron() -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let golden = 0.5 + 1.25f64.sqrt();
    let mut vertices = Vec::with_capacity(12);
    for axis in 0..3 {
        for (a, b) in [(1.0, golden), (-1.0, golden), (1.0, -golden), (-1.0, -golden)] {
            let mut vertex = Vec3::zeros();
            vertex[(axis + 1) % 3] = a;
            vertex[(axis + 2) % 3] = b;
            vertices.push(vertex);
        }
    }
    // Faces are the triples of vertices at the distance of an edge, turned to look outwards.
    let is_edge = |a: usize, b: usize| (vertices[a] - vertices[b]).norm() < 2.1;
    let mut faces = Vec::with_capacity(20);
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                if is_edge(a, b) && is_edge(b, c) && is_edge(c, a) {
                    let volume = vertices[a].dot(&vertices[b].cross(&vertices[c]));
                    let face = if volume > 0.0 { [a, b, c] } else { [a, c, b] };
                    faces.push(face.map(|it| it as u32));
                }
            }
        }
    }
    (vertices.iter().map(|it| it.normalize()).collect(), faces)
}

/// Cuts every edge into `n_parts` and every face into `n_parts^2`; new vertices go to the sphere.
fn cut_edges(vertices: &[Vec3], faces: &[[u32; 3]], n_parts: usize) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut points = vertices.to_vec();
    let mut finer = Vec::with_capacity(faces.len() * n_parts * n_parts);
    // A point on an edge belongs to both of its faces: it is found again by the edge's ends and its
    // steps away from the lesser one.
    let mut on_edges: BTreeMap<(u32, u32, usize), u32> = BTreeMap::new();
    for &[a, b, c] in faces {
        // Steps towards b and towards c.
        let mut index_at = |to_b: usize, to_c: usize| {
            let steps = [n_parts - to_b - to_c, to_b, to_c];
            let ends: Vec<(u32, usize)> =
                [a, b, c].into_iter().zip(steps).filter(|it| it.1 > 0).collect();
            let mut push = || {
                let sum: Vec3 = ends.iter().map(|it| vertices[it.0 as usize] * it.1 as f64).sum();
                points.push(sum.normalize());
                points.len() as u32 - 1
            };
            match ends[..] {
                [(corner, _)] => corner,
                [one, other] => {
                    let (lesser, greater) = (one.min(other), one.max(other));
                    *on_edges.entry((lesser.0, greater.0, greater.1)).or_insert_with(push)
                }
                _ => push(),
            }
        };
        let rows: Vec<Vec<u32>> = (0..=n_parts)
            .map(|to_c| (0..=n_parts - to_c).map(|to_b| index_at(to_b, to_c)).collect())
            .collect();
        for (row, next) in rows.iter().zip(&rows[1..]) {
            for x in 0..next.len() {
                finer.push([row[x], row[x + 1], next[x]]);
                if x + 1 < next.len() {
                    finer.push([row[x + 1], next[x + 1], next[x]]);
                }
            }
        }
    }
    (points, finer)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spheres_are_closed_round_and_face_outwards() {
        for frequency in [1, 2, 3, 4, 6, 7] {
            let mesh = geodesic_sphere(frequency);
            assert_eq!(mesh.n_vertices(), 10 * frequency * frequency + 2);
            assert_eq!(mesh.n_faces(), 20 * frequency * frequency);
            let mut edges = BTreeMap::new();
            for [a, b, c] in mesh.faces() {
                for (from, to) in [(a, b), (b, c), (c, a)] {
                    *edges.entry((from, to)).or_insert(0) += 1;
                }
            }
            assert!(edges.iter().all(|((a, b), &n)| n == 1 && edges.contains_key(&(*b, *a))));
            for face in 0..mesh.n_faces() {
                assert!(mesh.area_vector(face).dot(&mesh.corners(face)[0]) > 0.0);
            }
            assert!(mesh.vertices().iter().all(|it| (it.norm() - 1.0).abs() < 1e-15));
        }
    }

    #[test]
    fn a_rectangle_has_its_area() {
        assert!((rectangle(3, 5, 2.0, 0.5).area() - 1.0).abs() < 1e-15);
    }
}
