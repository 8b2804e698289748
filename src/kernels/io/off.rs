//! Object File Format (Geomview), ASCII.

use std::fmt::Write as _;

use super::error::{ReadError, fan, number, text};
use crate::kernels::geometry::mesh::{TriMesh, Vec3};

const FORMAT: &str = "OFF";

/// Reads `OFF` with any of the prefixes `ST`, `C`, `N`: colours, normals and texture coordinates
/// are skipped. Comments start with `#`. The counts may follow the keyword on its line, and the
/// keyword may be missing. Polygons are cut into fans; without any, it is a point cloud.
///
/// # Errors
/// With the line where something is wrong.
pub fn read_off(bytes: &[u8]) -> Result<TriMesh, ReadError> {
    let mut lines = text(FORMAT, bytes)?
        .lines()
        .enumerate()
        .map(|(index, it)| (index + 1, it.split('#').next().unwrap_or_default().trim()))
        .filter(|it| !it.1.is_empty());
    let ends = |what: String| ReadError::content(FORMAT, format!("the file ends before {what}"));
    let (line, head) = lines.next().ok_or(ReadError::Empty { format: FORMAT })?;
    let (line, counts) = match counts_after_keyword(line, head)? {
        "" => lines.next().ok_or_else(|| ends("the counts".to_owned()))?,
        counts => (line, counts),
    };
    let mut tokens = counts.split_whitespace();
    let n_vertices: usize = number(FORMAT, line, tokens.next(), "the number of vertices")?;
    let n_faces: usize = number(FORMAT, line, tokens.next(), "the number of faces")?;
    // Counts of a damaged file may be absurd: lists grow as they are read.
    let mut vertices = Vec::new();
    for vertex in 0..n_vertices {
        let what = || ends(format!("vertex {vertex} of {n_vertices}"));
        let (line, content) = lines.next().ok_or_else(what)?;
        let mut tokens = content.split_whitespace();
        let mut next = |what| number::<f64>(FORMAT, line, tokens.next(), what);
        vertices.push(Vec3::new(next("x")?, next("y")?, next("z")?));
    }
    let mut faces = Vec::new();
    for face in 0..n_faces {
        let what = || ends(format!("face {face} of {n_faces}"));
        let (line, content) = lines.next().ok_or_else(what)?;
        let corners = polygon(line, content, n_vertices)?;
        faces.extend(fan(&corners));
    }
    TriMesh::new(vertices, faces).map_err(ReadError::mesh(FORMAT))
}

/// Writes a mesh with the shortest decimals that read back to the same numbers.
pub fn write_off(mesh: &TriMesh) -> Vec<u8> {
    let mut out = format!("OFF\n{} {} 0\n", mesh.n_vertices(), mesh.n_faces());
    for it in mesh.vertices() {
        writeln!(out, "{} {} {}", it.x, it.y, it.z).expect("strings take all");
    }
    for [a, b, c] in mesh.faces() {
        writeln!(out, "3 {a} {b} {c}").expect("strings take all");
    }
    out.into_bytes()
}

/// What follows `OFF` on the first line: the counts, or nothing.
fn counts_after_keyword(line: usize, head: &str) -> Result<&str, ReadError> {
    let keyword = head.split_whitespace().next().unwrap_or_default();
    if keyword.parse::<f64>().is_ok() {
        return Ok(head);
    }
    let known = ["OFF", "COFF", "NOFF", "CNOFF", "STOFF", "STCOFF", "STNOFF", "STCNOFF"];
    if !known.contains(&keyword) {
        let what = format!("`{keyword}` is no kind of OFF that can be read");
        return Err(ReadError::line(FORMAT, line, what));
    }
    let rest = head[keyword.len()..].trim();
    if rest.starts_with("BINARY") {
        return Err(ReadError::line(FORMAT, line, "binary OFF cannot be read"));
    }
    Ok(rest)
}

fn polygon(line: usize, content: &str, n_vertices: usize) -> Result<Vec<u32>, ReadError> {
    let mut tokens = content.split_whitespace();
    let n_corners: usize = number(FORMAT, line, tokens.next(), "the number of corners")?;
    if n_corners < 3 {
        return Err(ReadError::line(FORMAT, line, format!("a face with {n_corners} corners")));
    }
    let mut corners = Vec::new();
    for _ in 0..n_corners {
        let corner: u32 = number(FORMAT, line, tokens.next(), "a vertex index")?;
        if corner as usize >= n_vertices {
            let what = format!("a face refers to vertex {corner}, but there are {n_vertices}");
            return Err(ReadError::line(FORMAT, line, what));
        }
        corners.push(corner);
    }
    Ok(corners)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error(text: &str) -> String {
        read_off(text.as_bytes()).unwrap_err().to_string()
    }

    #[test]
    fn colours_normals_comments_and_keywords() {
        let plain = "# a comment\nOFF\n\n4 1 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n";
        let colours = "COFF 4 1 0\n0 0 0 255 0 0 255\n1 0 0 1 1 1 1 # red\n1 1 0 0 0 0 1\n\
                       0 1 0 9 9 9 9\n4 0 1 2 3 0.5 0.5 0.5\n";
        let bare = "4 1 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n";
        let mesh = read_off(plain.as_bytes()).unwrap();
        assert_eq!(mesh.faces(), [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(read_off(colours.as_bytes()).unwrap(), mesh);
        assert_eq!(read_off(bare.as_bytes()).unwrap(), mesh);
        assert_eq!(read_off(&write_off(&mesh)).unwrap(), mesh);
    }

    #[test]
    fn errors_name_the_place() {
        assert_eq!(error("\n"), "the OFF file is empty");
        assert_eq!(error("4OFF\n"), "OFF file, line 1: `4OFF` is no kind of OFF that can be read");
        assert_eq!(error("OFF\n3 1 0\n0 0 0\n"), "OFF file: the file ends before vertex 1 of 3");
        assert_eq!(
            error("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n"),
            "OFF file, line 6: a face refers to vertex 3, but there are 3"
        );
        assert_eq!(
            error("OFF\n3 1 0\n0 0 0\n1 inf 0\n0 1 0\n3 0 1 2\n"),
            "OFF file: vertex 1 has the coordinate inf"
        );
        assert!(read_off(b"OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n").unwrap().is_point_cloud());
    }
}
