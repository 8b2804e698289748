//! Refinement of meshes: every triangle becomes four.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::resampled::Resampled;
use crate::kernels::geometry::mesh::{MeshError, TriMesh, Vec3};
use crate::kernels::geometry::topology::Edges;
use crate::kernels::numerics::sparse::CsrMatrix;

/// Where the new vertices lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Scheme {
    /// On the edges' midpoints: the shape stays as it is.
    Midpoint,
    /// By the masks of Loop (1987): the shape becomes smooth and a little thinner.
    #[default]
    Loop,
}

/// Why a mesh cannot be subdivided.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SubdivideError {
    #[error("{levels} levels make {n_faces} faces, more than {limit}")]
    TooMany { levels: usize, n_faces: u64, limit: u64 },
    #[error(transparent)]
    Mesh(#[from] MeshError),
}

/// The largest number of faces that is made.
const LIMIT: u64 = 1 << 26;

/// Subdivides a mesh `levels` times. Old vertices keep their numbers.
///
/// Boundaries follow the cubic B-spline rules of Loop's scheme; edges of three and more faces are
/// treated like boundaries. Faces that name a vertex twice are left out.
///
/// # Errors
/// [`SubdivideError::TooMany`], or there is no face that names three vertices.
pub fn subdivide(
    mesh: &TriMesh,
    scheme: Scheme,
    levels: usize,
) -> Result<Resampled, SubdivideError> {
    mesh.check_has_faces()?;
    let n_faces = (mesh.n_faces() as u64).saturating_mul(4u64.saturating_pow(levels as u32));
    if n_faces > LIMIT {
        return Err(SubdivideError::TooMany { levels, n_faces, limit: LIMIT });
    }
    let n_old = mesh.n_vertices();
    let mut faces = mesh.faces().to_vec();
    let mut new_from_old = identity(n_old);
    for _ in 0..levels {
        faces.retain(|it| !crate::kernels::geometry::topology::is_collapsed(it));
        let edges = Edges::of(&faces);
        let masks = match scheme {
            Scheme::Midpoint => midpoint_masks(&edges, new_from_old.n_rows),
            Scheme::Loop => loop_masks(&edges, &faces, new_from_old.n_rows),
        };
        faces = quarter(&faces, &edges, new_from_old.n_rows as u32);
        new_from_old = product(&masks, &new_from_old);
    }
    let position = |row: usize| -> Vec3 {
        new_from_old.row(row).map(|(old, share)| mesh.vertices()[old] * share).sum()
    };
    let vertices = (0..new_from_old.n_rows).map(position).collect();
    let mesh = TriMesh::new(vertices, faces)?;
    mesh.check_has_faces()?;
    let new_of_old = (0..n_old as u32).map(Some).collect();
    Ok(Resampled { mesh, new_from_old, new_of_old })
}

fn identity(n: usize) -> CsrMatrix {
    let offsets = (0..=n).collect();
    CsrMatrix {
        n_rows: n,
        n_cols: n,
        offsets,
        columns: (0..n as u32).collect(),
        values: vec![1.0; n],
    }
}

/// Corners keep the old numbers; the vertex on edge `e` has the number `n_vertices + e`.
fn quarter(faces: &[[u32; 3]], edges: &Edges, n_vertices: u32) -> Vec<[u32; 3]> {
    let edge_of_side = edges.edge_of_side();
    faces
        .iter()
        .enumerate()
        .flat_map(|(face, &[a, b, c])| {
            let [ab, bc, ca] = [0, 1, 2].map(|side| n_vertices + edge_of_side[3 * face + side]);
            [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        })
        .collect()
}

fn midpoint_masks(edges: &Edges, n_vertices: usize) -> CsrMatrix {
    let mut triplets: Vec<(u32, u32, f64)> =
        (0..n_vertices as u32).map(|it| (it, it, 1.0)).collect();
    for (edge, sides) in edges.iter().enumerate() {
        let row = (n_vertices + edge) as u32;
        triplets.extend([(row, sides[0].low, 0.5), (row, sides[0].high, 0.5)]);
    }
    CsrMatrix::from_triplets(n_vertices + edges.len(), n_vertices, &triplets)
}

/// Loop's masks with the weights of Warren (1995): `3/16` for three neighbours, else `3 / (8 n)`.
fn loop_masks(edges: &Edges, faces: &[[u32; 3]], n_vertices: usize) -> CsrMatrix {
    let mut triplets = Vec::new();
    let mut neighbours: Vec<Vec<u32>> = vec![Vec::new(); n_vertices];
    let mut creases: Vec<Vec<u32>> = vec![Vec::new(); n_vertices];
    for (edge, sides) in edges.iter().enumerate() {
        let row = (n_vertices + edge) as u32;
        let (low, high) = (sides[0].low, sides[0].high);
        let lists = if sides.len() == 2 { &mut neighbours } else { &mut creases };
        lists[low as usize].push(high);
        lists[high as usize].push(low);
        if let [first, second] = sides {
            triplets.extend([(row, low, 0.375), (row, high, 0.375)]);
            for it in [first, second] {
                let opposite = faces[it.face as usize][(it.side as usize + 2) % 3];
                triplets.push((row, opposite, 0.125));
            }
        } else {
            triplets.extend([(row, low, 0.5), (row, high, 0.5)]);
        }
    }
    for vertex in 0..n_vertices {
        let row = vertex as u32;
        let (around, along) = (&neighbours[vertex], &creases[vertex]);
        // A vertex on a crease follows the crease; where creases meet or end, it stays.
        let (others, beta) = match (around.len(), along.len()) {
            (3, 0) => (around, 3.0 / 16.0),
            (n, 0) if n > 0 => (around, 3.0 / (8.0 * n as f64)),
            (_, 2) => (along, 0.125),
            _ => (along, 0.0),
        };
        triplets.push((row, row, 1.0 - beta * others.len() as f64));
        triplets.extend(others.iter().filter(|_| beta > 0.0).map(|&it| (row, it, beta)));
    }
    CsrMatrix::from_triplets(n_vertices + edges.len(), n_vertices, &triplets)
}

/// `A B`.
fn product(a: &CsrMatrix, b: &CsrMatrix) -> CsrMatrix {
    let mut res = CsrMatrix {
        n_rows: a.n_rows,
        n_cols: b.n_cols,
        offsets: vec![0],
        columns: Vec::new(),
        values: Vec::new(),
    };
    let mut row: Vec<(usize, f64)> = Vec::new();
    for at in 0..a.n_rows {
        row.clear();
        row.extend(a.row(at).flat_map(|(k, share)| b.row(k).map(move |(c, v)| (c, share * v))));
        // Stable, so that equal columns are added in one order.
        row.sort_by_key(|it| it.0);
        for same in row.chunk_by(|x, y| x.0 == y.0) {
            res.columns.push(same[0].0 as u32);
            res.values.push(same.iter().map(|it| it.1).sum());
        }
        res.offsets.push(res.columns.len());
    }
    res
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes::{icosphere, rectangle, signed_volume, torus};
    use crate::kernels::geometry::topology::Topology;
    use crate::kernels::rigs::weights::SkinWeights;

    fn shapes() -> Vec<TriMesh> {
        vec![icosphere(1), torus(2.0, 0.5, 9, 7), rectangle(3, 3, 1.0, 1.0)]
    }

    #[test]
    fn midpoints_keep_area_volume_and_topology() {
        for mesh in shapes() {
            let fine = subdivide(&mesh, Scheme::Midpoint, 2).unwrap().mesh;
            assert_eq!(fine.n_faces(), 16 * mesh.n_faces());
            assert!((fine.area() / mesh.area() - 1.0).abs() < 1e-12);
            assert!((signed_volume(&fine) - signed_volume(&mesh)).abs() < 1e-12);
            let (before, after) = (Topology::of(&mesh), Topology::of(&fine));
            assert_eq!(before.euler_characteristic, after.euler_characteristic);
            assert_eq!(before.n_boundary_loops, after.n_boundary_loops);
            assert_eq!(before.genus, after.genus);
            assert_eq!(&fine.vertices()[..mesh.n_vertices()], mesh.vertices());
        }
    }

    #[test]
    fn loop_rows_sum_to_one_and_reproduce_a_plane() {
        for mesh in shapes() {
            let fine = subdivide(&mesh, Scheme::Loop, 2).unwrap();
            let ones = fine.function(&vec![1.0; mesh.n_vertices()]);
            assert!(ones.iter().all(|it| (it - 1.0).abs() < 1e-12));
            assert!(fine.new_from_old.values.iter().all(|&it| it > 0.0));
        }
        let plane = subdivide(&rectangle(4, 4, 1.0, 1.0), Scheme::Loop, 1).unwrap().mesh;
        assert!(plane.vertices().iter().all(|it| it.z == 0.0));
        assert!(plane.area() < 1.0 && plane.area() > 0.9, "only the square's corners are cut");
    }

    #[test]
    fn an_icosahedron_becomes_round() {
        let mesh = subdivide(&icosphere(0), Scheme::Loop, 4).unwrap().mesh;
        let radii = || mesh.vertices().iter().map(|it| it.norm());
        let (low, high) = (radii().fold(9.0, f64::min), radii().fold(0.0, f64::max));
        assert!(high / low < 1.06, "{low} to {high}");
        assert_eq!(Topology::of(&mesh).genus, Some(0));
    }

    #[test]
    fn carried_weights_sum_to_one() {
        let mesh = icosphere(1);
        let rows: Vec<_> = (0..mesh.n_vertices())
            .map(|it| vec![(0, 0.1 + mesh.vertices()[it].x.abs()), ((it % 3) as u32, 0.4)])
            .collect();
        let weights = SkinWeights::from_rows(3, &rows).unwrap();
        for scheme in [Scheme::Midpoint, Scheme::Loop] {
            let fine = subdivide(&mesh, scheme, 2).unwrap();
            let carried = fine.weights(&weights).unwrap();
            assert_eq!(carried.n_vertices(), fine.mesh.n_vertices());
            for vertex in 0..carried.n_vertices() {
                let sum: f64 = carried.row(vertex).map(|it| it.1).sum();
                assert!((sum - 1.0).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn too_many_levels_are_refused_with_their_number() {
        let error = subdivide(&icosphere(0), Scheme::Loop, 20).unwrap_err();
        assert!(error.to_string().starts_with("20 levels make 21990232555520 faces"), "{error}");
    }
}
