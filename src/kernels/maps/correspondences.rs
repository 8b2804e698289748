//! Where the vertices of one shape lie on another.

use crate::kernels::geometry::{
    mesh::{TriMesh, Vec3},
    point_tree::PointTree,
    triangle::closest_on_triangle,
};

/// For every vertex of a shape, a place on the surface of a reference shape.
///
/// Shapes that share the reference's faces, as the bodies of one template do, share the places.
#[derive(Debug, Clone, PartialEq)]
pub struct Correspondences {
    /// `V` faces of the reference.
    pub faces: Vec<u32>,
    /// `V` barycentric coordinates; each adds up to one.
    pub barycentric: Vec<[f64; 3]>,
    /// The number of faces of the reference.
    pub n_faces: usize,
}

/// Why there are no correspondences.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CorrespondenceError {
    #[error("the file of correspondences is no text")]
    Encoding,
    #[error("line {line} is `{text}` instead of a face and two barycentric coordinates")]
    Line { line: usize, text: String },
    #[error("line {line}: the barycentric coordinates {b0} and {b1} leave the face")]
    Outside { line: usize, b0: f64, b1: f64 },
    #[error("line {line} refers to face {face}, but the reference has {n_faces} faces")]
    Face { line: usize, face: u32, n_faces: usize },
    #[error("the file holds no correspondences")]
    Empty,
    #[error("the reference is a point cloud: correspondences are places on faces")]
    PointCloud,
}

/// How far barycentric coordinates may leave a face: files round them.
const ROUNDING: f64 = 1e-3;

/// Reads lines `face,b0,b1`, one a vertex; the third coordinate is the rest to one.
///
/// Faces count from zero. Lines that begin with `#` and a line of names at the beginning are skipped.
///
/// # Errors
/// See [`CorrespondenceError`].
pub fn read_correspondences(
    bytes: &[u8],
    n_faces: usize,
) -> Result<Correspondences, CorrespondenceError> {
    let text = std::str::from_utf8(bytes).map_err(|_| CorrespondenceError::Encoding)?;
    let mut res = Correspondences { faces: Vec::new(), barycentric: Vec::new(), n_faces };
    let mut may_be_names = true;
    for (index, line) in text.lines().enumerate() {
        let (line, text) = (index + 1, line.trim());
        if text.is_empty() || text.starts_with('#') {
            continue;
        }
        let is_names = may_be_names && text.starts_with(|it: char| it.is_ascii_alphabetic());
        may_be_names = false;
        if is_names {
            continue;
        }
        let wrong = || CorrespondenceError::Line { line, text: text.to_owned() };
        let (face, b0, b1) = parse(text).ok_or_else(wrong)?;
        if face as usize >= n_faces {
            return Err(CorrespondenceError::Face { line, face, n_faces });
        }
        let barycentric = [b0, b1, 1.0 - b0 - b1];
        if !barycentric.iter().all(|it| (-ROUNDING..=1.0 + ROUNDING).contains(it)) {
            return Err(CorrespondenceError::Outside { line, b0, b1 });
        }
        let inside = barycentric.map(|it| it.max(0.0));
        let sum: f64 = inside.iter().sum();
        res.faces.push(face);
        res.barycentric.push(inside.map(|it| it / sum));
    }
    match res.faces.is_empty() {
        true => Err(CorrespondenceError::Empty),
        false => Ok(res),
    }
}

fn parse(line: &str) -> Option<(u32, f64, f64)> {
    let mut fields = line.split([',', ';', '\t', ' ']).filter(|it| !it.is_empty());
    let face = fields.next()?.parse().ok()?;
    Some((face, fields.next()?.parse().ok()?, fields.next()?.parse().ok()?))
}

/// For every point the closest place on the surface of a reference.
///
/// Exact. For shapes that lie on top of each other: a remeshed or decimated copy and its original.
///
/// # Errors
/// [`CorrespondenceError::PointCloud`].
pub fn closest_places(
    points: &[Vec3],
    reference: &TriMesh,
) -> Result<Correspondences, CorrespondenceError> {
    use rayon::prelude::*;
    if reference.is_point_cloud() {
        return Err(CorrespondenceError::PointCloud);
    }
    let search = Search::new(reference);
    let places: Vec<(u32, [f64; 3])> =
        points.par_iter().with_min_len(64).map(|&it| search.closest(it)).collect();
    let (faces, barycentric) = places.into_iter().unzip();
    Ok(Correspondences { faces, barycentric, n_faces: reference.n_faces() })
}

struct Search<'a> {
    mesh: &'a TriMesh,
    /// The centers of the faces.
    tree: PointTree,
    /// The largest distance of a corner from its face's center.
    reach: f64,
}

impl<'a> Search<'a> {
    fn new(mesh: &'a TriMesh) -> Self {
        let faces = 0..mesh.n_faces();
        let center = |face| mesh.corners(face).iter().sum::<Vec3>() / 3.0;
        let far = |face: usize| {
            let corners = mesh.corners(face);
            corners.iter().map(|it| (it - center(face)).norm()).fold(0.0, f64::max)
        };
        let reach = faces.clone().map(far).fold(0.0, f64::max);
        let centers: Vec<Vec3> = faces.map(center).collect();
        Self { mesh, tree: PointTree::new(&centers), reach }
    }

    fn closest(&self, point: Vec3) -> (u32, [f64; 3]) {
        let mut best = (f64::INFINITY, 0, [1.0, 0.0, 0.0]);
        let (mut found, mut done, mut count) = (Vec::new(), 0, 16);
        loop {
            self.tree.nearest(point, count, &mut found);
            for &(_, face) in &found[done..] {
                let corners = self.mesh.corners(face as usize);
                let weights = closest_on_triangle(&point, &corners);
                let place: Vec3 = (0..3).map(|it| corners[it] * weights[it]).sum();
                let distance = (place - point).norm();
                if distance < best.0 || distance == best.0 && face < best.1 {
                    best = (distance, face, weights);
                }
            }
            // Faces whose centers are farther cannot reach as near.
            let farthest = found.last().map_or(f64::INFINITY, |it| it.0.sqrt());
            if farthest > best.0 + self.reach || found.len() == self.mesh.n_faces() {
                return (best.1, best.2);
            }
            (done, count) = (found.len(), 2 * count);
        }
    }
}

impl Correspondences {
    /// The places on a shape with the reference's faces.
    ///
    /// # Panics
    /// If the shape has fewer faces.
    pub fn positions(&self, reference: &TriMesh) -> Vec<Vec3> {
        let place = |(&face, weights): (&u32, &[f64; 3])| {
            let corners = reference.corners(face as usize);
            (0..3).map(|it| corners[it] * weights[it]).sum()
        };
        self.faces.iter().zip(&self.barycentric).map(place).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::{geometry::shapes::bumpy_sphere, numerics::random::Random};

    #[test]
    fn a_file_is_read_and_its_mistakes_are_placed() {
        let read = |text: &str| read_correspondences(text.as_bytes(), 10);
        let found = read("# row i = vertex i\ntri,b0,b1\n3,0.25,0.5\n9,1.0001,0\n").unwrap();
        assert_eq!(found.faces, [3, 9]);
        assert_eq!(found.barycentric[0], [0.25, 0.5, 0.25]);
        assert_eq!(found.barycentric[1], [1.0, 0.0, 0.0]);
        let check = |text: &str, expected: &str| {
            assert_eq!(read(text).unwrap_err().to_string(), expected);
        };
        check("10,0,0", "line 1 refers to face 10, but the reference has 10 faces");
        check("tri\n2,0.7,0.7", "line 2: the barycentric coordinates 0.7 and 0.7 leave the face");
        check("1,0", "line 1 is `1,0` instead of a face and two barycentric coordinates");
        check("2,NaN,0", "line 1: the barycentric coordinates NaN and 0 leave the face");
        check("# nothing", "the file holds no correspondences");
    }

    #[test]
    fn closest_places_are_not_beaten_by_any_face() {
        let mesh = bumpy_sphere(6);
        let mut random = Random::new(8);
        let points: Vec<Vec3> =
            (0..40).map(|_| Vec3::from_fn(|_, _| random.between(-1.5, 1.5))).collect();
        let found = closest_places(&points, &mesh).unwrap().positions(&mesh);
        for (point, place) in points.iter().zip(&found) {
            let distance = |face: usize| {
                let corners = mesh.corners(face);
                let weights = closest_on_triangle(point, &corners);
                ((0..3).map(|it| corners[it] * weights[it]).sum::<Vec3>() - point).norm()
            };
            let least = (0..mesh.n_faces()).map(distance).fold(f64::INFINITY, f64::min);
            assert!(((place - point).norm() - least).abs() < 1e-12);
        }
    }
}
