//! Wavefront OBJ: vertices and faces.

use std::fmt::Write as _;

use super::error::{ReadError, fan, number, text};
use crate::kernels::geometry::mesh::{TriMesh, Vec3};

const FORMAT: &str = "OBJ";

/// Reads all vertices and the faces of all groups and objects; without faces, a point cloud.
///
/// Vertices keep their order and number, used or not, so that indices from elsewhere (landmarks,
/// correspondences) stay valid: the reason for a reader of our own, since `tobj` numbers vertices by
/// their first use and rounds to single precision. Polygons are cut into fans. Negative indices
/// count back from the last vertex so far. Normals, texture coordinates, materials, lines and points
/// are skipped.
///
/// # Errors
/// With the line where a face or a number is wrong.
pub fn read_obj(bytes: &[u8]) -> Result<TriMesh, ReadError> {
    let mut vertices = Vec::new();
    let mut faces = Vec::new();
    let mut face_lines = Vec::new();
    let mut corners = Vec::new();
    for (line, content) in logical_lines(text(FORMAT, bytes)?) {
        let content = content.split('#').next().unwrap_or_default();
        let mut tokens = content.split_whitespace();
        match tokens.next() {
            Some("v") => {
                let mut next = |what| number::<f64>(FORMAT, line, tokens.next(), what);
                vertices.push(Vec3::new(next("x")?, next("y")?, next("z")?));
            }
            Some("f") => {
                corners.clear();
                for token in tokens {
                    corners.push(corner(line, token, vertices.len())?);
                }
                if corners.len() < 3 {
                    let what = format!("a face with {} corners", corners.len());
                    return Err(ReadError::line(FORMAT, line, what));
                }
                faces.extend(fan(&corners));
                face_lines.resize(faces.len(), line);
            }
            _ => {}
        }
    }
    let n_vertices = vertices.len();
    if let Some(face) = faces.iter().position(|it| it.iter().any(|&it| it as usize >= n_vertices)) {
        let index = faces[face].iter().max().map_or(0, |&it| u64::from(it) + 1);
        let what = format!("a face refers to vertex {index}, but the file has {n_vertices}");
        return Err(ReadError::line(FORMAT, face_lines[face], what));
    }
    TriMesh::new(vertices, faces).map_err(ReadError::mesh(FORMAT))
}

/// Writes a mesh with the shortest decimals that read back to the same numbers.
pub fn write_obj(mesh: &TriMesh) -> Vec<u8> {
    let mut out = String::new();
    for it in mesh.vertices() {
        writeln!(out, "v {} {} {}", it.x, it.y, it.z).expect("strings take all");
    }
    for [a, b, c] in mesh.faces() {
        writeln!(out, "f {} {} {}", a + 1, b + 1, c + 1).expect("strings take all");
    }
    out.into_bytes()
}

/// Numbered lines, where a `\` at the end continues a line.
fn logical_lines(text: &str) -> impl Iterator<Item = (usize, std::borrow::Cow<'_, str>)> {
    let mut lines = text.lines().enumerate();
    std::iter::from_fn(move || {
        let (index, first) = lines.next()?;
        let mut content = std::borrow::Cow::Borrowed(first);
        while let Some(start) = content.strip_suffix('\\') {
            let next = lines.next().map_or("", |it| it.1);
            content = std::borrow::Cow::Owned(format!("{start} {next}"));
        }
        Some((index + 1, content))
    })
}

/// The vertex of `7`, `7/1`, `7//3`, `7/1/3` or `-1`, from zero.
fn corner(line: usize, token: &str, n_vertices: usize) -> Result<u32, ReadError> {
    let index: i64 = number(FORMAT, line, token.split('/').next(), "a vertex index")?;
    let from_zero = if index < 0 { n_vertices as i64 + index } else { index - 1 };
    u32::try_from(from_zero).map_err(|_| {
        let what = format!("a face refers to vertex {index} after {n_vertices} vertices");
        ReadError::line(FORMAT, line, what)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error(text: &str) -> String {
        read_obj(text.as_bytes()).unwrap_err().to_string()
    }

    #[test]
    fn unused_vertices_keep_their_place() {
        let text = "v 9 9 9\nv 0 0 0\nv 1 0 0\nv 1 1 0\ng a\nf 4 3 2\ng b\nf -1/1 -3//2 -2/1/1\n";
        let mesh = read_obj(text.as_bytes()).unwrap();
        assert_eq!(mesh.vertices()[0], Vec3::repeat(9.0));
        assert_eq!(mesh.faces(), [[3, 2, 1], [3, 1, 2]]);
    }

    #[test]
    fn polygons_become_fans_and_lines_continue() {
        let text = "v 0 0 0 0.5 0.5 0.5\nv 1 0 0\nv 1 1 0\nv 0 1 0 # a comment\nf 1 2 \\\n3 4\n";
        assert_eq!(read_obj(text.as_bytes()).unwrap().faces(), [[0, 1, 2], [0, 2, 3]]);
    }

    #[test]
    fn errors_name_the_line() {
        let three = "v 0 0 0\nv 1 0 0\nv 1 1 0\n";
        assert_eq!(error(""), "the OBJ file is empty");
        assert_eq!(error("v 0 0\n"), "OBJ file, line 1: the line ends before z");
        assert_eq!(error("v 0 x 0\n"), "OBJ file, line 1: `x` is no number for y");
        assert!(read_obj(three.as_bytes()).unwrap().is_point_cloud());
        assert_eq!(error(&format!("{three}f 1 2\n")), "OBJ file, line 4: a face with 2 corners");
        assert_eq!(
            error(&format!("{three}f 1 2 7\n")),
            "OBJ file, line 4: a face refers to vertex 7, but the file has 3"
        );
        assert_eq!(
            error(&format!("{three}f 1 2 0\n")),
            "OBJ file, line 4: a face refers to vertex 0 after 3 vertices"
        );
        assert_eq!(
            error("v 0 0 0\nv 1 nan 0\nv 1 1 0\nf 1 2 3\n"),
            "OBJ file: vertex 1 has the coordinate NaN"
        );
    }

    #[test]
    fn a_mesh_survives_the_round_trip_bit_by_bit() {
        let vertices =
            vec![Vec3::new(0.1, -1e-300, 3.0), Vec3::new(1.0 / 3.0, 2e20, 0.0), Vec3::z()];
        let mesh = TriMesh::new(vertices, vec![[0, 1, 2]]).unwrap();
        assert_eq!(read_obj(&write_obj(&mesh)).unwrap(), mesh);
    }
}
