//! Stereolithography files, ASCII and binary.

use std::collections::HashMap;

use super::error::{ReadError, number, text};
use crate::kernels::geometry::mesh::{TriMesh, Vec3};

const FORMAT: &str = "STL";
const HEADER_BYTES: usize = 84;
const FACE_BYTES: usize = 50;

/// Reads triangles and joins corners whose coordinates are equal, in the order in which they come.
///
/// A file is binary if its length fits the number of triangles in its header, whatever it starts
/// with: many binary files start with `solid`. All bodies of an ASCII file become one mesh. Stored
/// normals are skipped.
///
/// # Errors
/// With the line, or with the length that a binary file should have.
pub fn read_stl(bytes: &[u8]) -> Result<TriMesh, ReadError> {
    if bytes.is_empty() {
        return Err(ReadError::Empty { format: FORMAT });
    }
    let needed = needed_bytes(bytes);
    let corners = if needed == Some(bytes.len() as u64) || !bytes.starts_with(b"solid") {
        binary(bytes, needed)?
    } else {
        ascii(text(FORMAT, bytes)?)?
    };
    joined(&corners)
}

/// Writes binary STL with unit face normals, in single precision.
pub fn write_stl(mesh: &TriMesh) -> Vec<u8> {
    let mut out = vec![0; HEADER_BYTES - 4];
    out.extend_from_slice(&(mesh.n_faces() as u32).to_le_bytes());
    for face in 0..mesh.n_faces() {
        let normal = mesh.area_vector(face).try_normalize(0.0).unwrap_or_default();
        for point in std::iter::once(normal).chain(mesh.corners(face)) {
            out.extend(point.iter().flat_map(|&it| (it as f32).to_le_bytes()));
        }
        out.extend_from_slice(&[0; 2]);
    }
    out
}

/// How long a binary file with this header is.
fn needed_bytes(bytes: &[u8]) -> Option<u64> {
    let count = bytes.get(HEADER_BYTES - 4..HEADER_BYTES)?;
    let n_faces = u32::from_le_bytes(count.try_into().expect("four bytes"));
    Some(HEADER_BYTES as u64 + FACE_BYTES as u64 * u64::from(n_faces))
}

fn binary(bytes: &[u8], needed: Option<u64>) -> Result<Vec<Vec3>, ReadError> {
    let truncated = |what: &str, needed| ReadError::Truncated {
        format: FORMAT,
        what: what.to_owned(),
        needed,
        len: bytes.len(),
    };
    let needed = needed.ok_or_else(|| truncated("the header", HEADER_BYTES as u64))?;
    if (bytes.len() as u64) < needed {
        return Err(truncated("the last triangle", needed));
    }
    let faces = &bytes[HEADER_BYTES..needed as usize];
    let coordinate = |it: &[u8]| f64::from(f32::from_le_bytes(it.try_into().expect("four bytes")));
    Ok(faces
        .chunks_exact(FACE_BYTES)
        .flat_map(|it| it[12..48].chunks_exact(12))
        .map(|it| Vec3::new(coordinate(&it[..4]), coordinate(&it[4..8]), coordinate(&it[8..])))
        .collect())
}

fn ascii(text: &str) -> Result<Vec<Vec3>, ReadError> {
    let mut corners = Vec::new();
    for (index, content) in text.lines().enumerate() {
        let line = index + 1;
        let mut tokens = content.split_whitespace();
        match tokens.next() {
            Some("vertex") => {
                let mut next = |what| number::<f64>(FORMAT, line, tokens.next(), what);
                corners.push(Vec3::new(next("x")?, next("y")?, next("z")?));
            }
            Some("endfacet") if corners.len() % 3 != 0 => {
                return Err(ReadError::line(FORMAT, line, "a facet without three vertices"));
            }
            _ => {}
        }
    }
    if corners.len() % 3 != 0 {
        return Err(ReadError::content(FORMAT, "the file ends inside of a facet"));
    }
    Ok(corners)
}

/// One vertex for all corners at the same point.
fn joined(corners: &[Vec3]) -> Result<TriMesh, ReadError> {
    let mut vertices = Vec::new();
    let mut known = HashMap::new();
    let mut indices = Vec::with_capacity(corners.len());
    for corner in corners {
        // Adding zero makes -0 equal to 0.
        let key = [corner.x, corner.y, corner.z].map(|it| (it + 0.0).to_bits());
        indices.push(*known.entry(key).or_insert_with(|| {
            vertices.push(*corner);
            vertices.len() as u32 - 1
        }));
    }
    let faces = indices.chunks_exact(3).map(|it| [it[0], it[1], it[2]]).collect();
    let mesh = TriMesh::new(vertices, faces).map_err(ReadError::mesh(FORMAT))?;
    mesh.check_has_faces().map_err(ReadError::mesh(FORMAT))?;
    Ok(mesh)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tetrahedron() -> TriMesh {
        let vertices = vec![Vec3::zeros(), Vec3::y(), Vec3::x(), Vec3::z()];
        TriMesh::new(vertices, vec![[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]]).unwrap()
    }

    #[test]
    fn binary_survives_the_round_trip() {
        assert_eq!(read_stl(&write_stl(&tetrahedron())).unwrap(), tetrahedron());
    }

    #[test]
    fn a_binary_file_may_start_with_solid() {
        let mut bytes = write_stl(&tetrahedron());
        bytes[..5].copy_from_slice(b"solid");
        assert_eq!(read_stl(&bytes).unwrap(), tetrahedron());
    }

    #[test]
    fn bodies_are_joined_and_errors_name_the_place() {
        let facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex -0 1 0\n\
                     endloop\nendfacet\n";
        let two = format!("solid a\n{facet}endsolid a\nsolid b\n{facet}endsolid b\n");
        let mesh = read_stl(two.as_bytes()).unwrap();
        assert_eq!((mesh.n_vertices(), mesh.n_faces()), (3, 2));
        let error = |bytes: &[u8]| read_stl(bytes).unwrap_err().to_string();
        assert_eq!(
            error(two.replace("vertex 1 0 0\n", "").as_bytes()),
            "STL file, line 7: a facet without three vertices"
        );
        assert_eq!(
            error(&write_stl(&tetrahedron())[..100]),
            "the STL file ends too early: the last triangle ends at byte 284, but there are 100"
        );
        assert_eq!(error(b"solid a\nendsolid\n"), "STL file: the mesh has no vertices");
    }
}
