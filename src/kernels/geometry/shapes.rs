//! Simple surfaces with known areas, volumes, topology and spectra, for tests, examples and benchmarks.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use super::mesh::{TriMesh, Vec3};

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
    while odd.is_multiple_of(2) {
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

/// A unit sphere of `10 * 4^level + 2` vertices: an icosahedron refined `level` times.
pub fn icosphere(level: u32) -> TriMesh {
    geodesic_sphere(1 << level)
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

/// An open tube about the y axis, from `y = 0`: `n_along` rings of `n_around` vertices. With a
/// `share` of the full turn below 1, a strip that is bent around the axis.
///
/// # Panics
/// If there are fewer than 3 vertices around or 2 along.
pub fn tube(radius: f64, length: f64, n_around: usize, n_along: usize, share: f64) -> TriMesh {
    assert!(n_around >= 3 && n_along >= 2, "a tube needs three steps around and two rings");
    let n_columns = if share < 1.0 { n_around - 1 } else { n_around };
    let step = share.min(1.0) * TAU / n_columns as f64;
    let vertex = |ring: usize, column: usize| {
        let (sin, cos) = (step * column as f64).sin_cos();
        Vec3::new(radius * cos, length * ring as f64 / (n_along - 1) as f64, radius * sin)
    };
    let vertices = (0..n_along)
        .flat_map(|ring| (0..n_around).map(move |column| vertex(ring, column)))
        .collect();
    let index = |ring: usize, column: usize| (ring * n_around + column % n_around) as u32;
    let mut faces = Vec::with_capacity(2 * n_columns * (n_along - 1));
    for ring in 0..n_along - 1 {
        for column in 0..n_columns {
            let [a, b] = [index(ring, column), index(ring, column + 1)];
            let [c, d] = [index(ring + 1, column + 1), index(ring + 1, column)];
            faces.extend([[a, c, b], [a, d, c]]);
        }
    }
    TriMesh::new(vertices, faces).expect("a tube is a mesh")
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

/// A closed mesh with its faces outward.
pub fn outward(mesh: TriMesh) -> TriMesh {
    if signed_volume(&mesh) < 0.0 { mesh.inverted() } else { mesh }
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
    use std::f64::consts::PI;

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
}
