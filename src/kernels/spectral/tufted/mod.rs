//! The Laplacian of any triangles, however badly they hang together.

mod cover;
mod sides;
#[cfg(test)]
mod tests;

pub(super) use cover::Gluing;

use self::cover::tufted_cover;
use self::sides::Sides;
use super::intrinsic::Flips;
use super::operator::Operator;
use crate::kernels::geometry::mesh::{MeshError, TriMesh, Vec3};
use crate::kernels::geometry::topology::is_collapsed;

/// What was found and done on the way to the operator.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TuftedReport {
    /// What was added to every edge, in parts of the mean length of an edge: no more than `1e-5`
    /// above what the flattest face needed; zero if no face was nearly flat.
    pub lengthened: f64,
    pub flips: Flips,
    /// Edges of one face.
    pub n_boundary_edges: usize,
    /// Edges of more than two faces.
    pub n_nonmanifold_edges: usize,
    /// Faces that name a vertex twice; they were left out.
    pub n_collapsed_faces: usize,
    /// Vertices of no other face. Functions are zero there.
    pub n_unreferenced: usize,
}

/// Why there is no operator.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TuftedError {
    #[error(transparent)]
    Mesh(#[from] MeshError),
    #[error("each of the {n_faces} faces names a vertex twice")]
    AllCollapsed { n_faces: usize },
    #[error(
        "the edges of the {n_faces} faces have a mean length of {mean_length:e}: \
         the coordinates are too large or too small for double precision, or all the same"
    )]
    Range { n_faces: usize, mean_length: f64 },
}

/// Every triangle inequality is made to hold by this part of the mean length of an edge.
const SLACK: f64 = 1e-5;

/// The mass of a vertex of no face, in parts of the smallest mass: its eigenvalue lies far above all
/// that are wanted.
const UNREFERENCED_MASS: f64 = 1e-3;

/// Assembles the Laplacian of the tufted cover of a mesh, after flips to the intrinsic Delaunay
/// triangulation (Sharp & Crane 2020).
///
/// Takes any triangles: non-manifold and unorientable surfaces, boundaries, repeated, flat and
/// crossing faces, stray vertices. All edges are lengthened a little until no face is flat; every
/// face is doubled, and the doubles are glued around every edge, each to its neighbour, so that the
/// result is a closed manifold with the old vertices; edges are flipped, without moving anything,
/// until all weights are non-negative; half the cotangent matrix of that is the stiffness.
///
/// Off-diagonal entries are never positive, so the maximum principle holds. Masses are a third of the
/// faces around and add up to the area. Where the mesh is a manifold whose edges are Delaunay, it is
/// the cotangent Laplacian. A vertex of no face has the stiffness 1 and a tiny mass: functions are
/// zero there.
///
/// # Errors
/// See [`TuftedError`].
pub fn tufted_laplacian(mesh: &TriMesh) -> Result<(Operator, TuftedReport), TuftedError> {
    mesh.check_has_faces()?;
    cover_laplacian(mesh.vertices(), mesh.faces(), Gluing::ByAngle)
}

/// [`tufted_laplacian`] of a list of triangles, of which some may be the same.
///
/// # Panics
/// If a face refers to a vertex that there is not.
pub(super) fn cover_laplacian(
    vertices: &[Vec3],
    faces: &[[u32; 3]],
    gluing: Gluing,
) -> Result<(Operator, TuftedReport), TuftedError> {
    let good: Vec<[u32; 3]> = faces.iter().copied().filter(|it| !is_collapsed(it)).collect();
    let n_faces = faces.len();
    if good.is_empty() {
        return Err(TuftedError::AllCollapsed { n_faces });
    }
    let n_collapsed_faces = n_faces - good.len();
    let sides = Sides::of(vertices.len(), &good);
    let (lengths, unit, lengthened) = mollified_lengths(vertices, &good, &sides)
        .map_err(|mean_length| TuftedError::Range { n_faces, mean_length })?;
    let mut cover = tufted_cover(vertices, &good, &sides, &lengths, gluing);
    let flips = cover.flip_to_delaunay();
    let n_vertices = vertices.len();
    let mut operator = Operator {
        stiffness: cover.stiffness(n_vertices, 0.5),
        mass: cover.barycentric_mass(n_vertices, 0.5 * unit * unit),
    };
    let n_unreferenced = pin_unreferenced(&mut operator);
    let count = |holds: fn(usize) -> bool| sides.edges().filter(|it| holds(it.len())).count();
    let report = TuftedReport {
        lengthened,
        flips,
        n_boundary_edges: count(|it| it == 1),
        n_nonmanifold_edges: count(|it| it > 2),
        n_collapsed_faces,
        n_unreferenced,
    };
    Ok((operator, report))
}

/// Gives vertices without mass an eigenvalue beyond all others; returns how many there are.
fn pin_unreferenced(operator: &mut Operator) -> usize {
    let positive = operator.mass.iter().copied().filter(|&it| it > 0.0);
    let pinned = UNREFERENCED_MASS * positive.fold(f64::INFINITY, f64::min);
    let mut n_unreferenced = 0;
    for (vertex, mass) in operator.mass.iter_mut().enumerate().filter(|it| *it.1 <= 0.0) {
        *mass = pinned;
        // The row of a vertex without neighbours has its diagonal only.
        operator.stiffness.values[operator.stiffness.offsets[vertex]] = 1.0;
        n_unreferenced += 1;
    }
    n_unreferenced
}

/// The length of every side in units of the mean length, and that unit, and what was added.
///
/// # Errors
/// The mean length, if it is out of range.
fn mollified_lengths(
    vertices: &[Vec3],
    faces: &[[u32; 3]],
    sides: &Sides,
) -> Result<(Vec<f64>, f64, f64), f64> {
    let mut lengths = vec![0.0; 3 * faces.len()];
    let mut total = 0.0;
    for edge in sides.edges() {
        let first = edge[0].half_edge() as usize;
        let corners = faces[first / 3];
        let ends = [corners[first % 3], corners[(first % 3 + 1) % 3]];
        let [from, to] = ends.map(|it| vertices[it as usize]);
        let length = (to - from).norm();
        total += length;
        for it in edge {
            lengths[it.half_edge() as usize] = length;
        }
    }
    let mean = total / sides.n_edges() as f64;
    // Squares of lengths become masses, and squares of lengths to be computed with before that.
    if !(1e-150..1e150).contains(&mean) {
        return Err(mean);
    }
    lengths.iter_mut().for_each(|it| *it /= mean);
    let mut missing = 0.0_f64;
    for &[a, b, c] in lengths.as_chunks::<3>().0 {
        let longest = a.max(b).max(c);
        // What the two shorter sides have more than the longest one.
        let excess = (a + b + c - longest) - longest;
        missing = missing.max(SLACK - excess);
    }
    lengths.iter_mut().for_each(|it| *it += missing);
    Ok((lengths, mean, missing))
}
