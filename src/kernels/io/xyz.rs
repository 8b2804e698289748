//! Lists of points as text.

use super::error::{ReadError, number, text};
use crate::kernels::geometry::mesh::{TriMesh, Vec3};

const FORMAT: &str = "XYZ";

/// Reads a point from the first three numbers of every line, separated by blanks, commas or semicolons.
///
/// What follows them (colours, normals, intensities) is skipped, and so are empty lines and comments
/// with `#` or `//`.
///
/// # Errors
/// With the line that has no three numbers.
pub fn read_xyz(bytes: &[u8]) -> Result<TriMesh, ReadError> {
    let mut points = Vec::new();
    for (index, content) in text(FORMAT, bytes)?.lines().enumerate() {
        let content = content.split('#').next().unwrap_or_default();
        let content = content.split("//").next().unwrap_or_default();
        let is_separator = |it: char| it.is_whitespace() || it == ',' || it == ';';
        let mut tokens = content.split(is_separator).filter(|it| !it.is_empty()).peekable();
        if tokens.peek().is_none() {
            continue;
        }
        let mut next = |what| number::<f64>(FORMAT, index + 1, tokens.next(), what);
        points.push(Vec3::new(next("x")?, next("y")?, next("z")?));
    }
    TriMesh::from_points(points).map_err(ReadError::mesh(FORMAT))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_with_whatever_follows_them() {
        let text = "# a scan\n1 2 3\n\n4,5,6, 255,0,0\n-1e-3\t0;0 0.5 // here\n";
        let cloud = read_xyz(text.as_bytes()).unwrap();
        assert!(cloud.is_point_cloud());
        let expected =
            [Vec3::new(1.0, 2.0, 3.0), Vec3::new(4.0, 5.0, 6.0), Vec3::new(-1e-3, 0.0, 0.0)];
        assert_eq!(cloud.vertices(), expected);
    }

    #[test]
    fn errors_name_the_line() {
        let error = |text: &str| read_xyz(text.as_bytes()).unwrap_err().to_string();
        assert_eq!(error(""), "the XYZ file is empty");
        assert_eq!(error("# nothing\n"), "XYZ file: the mesh has no vertices");
        assert_eq!(error("0 0 0\n1 2\n"), "XYZ file, line 2: the line ends before z");
        assert_eq!(error("x y z\n"), "XYZ file, line 1: `x` is no number for x");
        assert_eq!(error("0 nan 0\n"), "XYZ file: vertex 0 has the coordinate NaN");
    }
}
