//! The Laplacian of any triangles, however badly they hang together.

use super::intrinsic::{Flips, IntrinsicTriangulation};
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

/// Which of the faces around an edge are neighbours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Gluing {
    /// In the order in which they stand around the edge.
    ByAngle,
    /// One from either side of the edge in turn: for triangles that cover a surface several times,
    /// every copy of a triangle continues into a copy of its neighbour.
    FromSideToSide,
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

/// One side of a face: the edge from corner `side` to the next corner.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Side {
    /// The greater vertex of the edge.
    high: u32,
    /// `3 * face + side`, times two, and one more if the face walks from the smaller vertex.
    packed: u32,
}

impl Side {
    fn new(high: u32, half_edge: u32, forward: bool) -> Self {
        Self { high, packed: 2 * half_edge + u32::from(forward) }
    }

    /// `3 * face + side`.
    fn half_edge(self) -> u32 {
        self.packed / 2
    }

    fn is_forward(self) -> bool {
        self.packed % 2 == 1
    }
}

/// The sides of all faces, grouped into edges.
///
/// Sorted by counting their smaller vertices first: for the many faces of a cloud, that is several
/// times faster than sorting by comparison.
struct Sides {
    sides: Vec<Side>,
    /// One more than edges.
    offsets: Vec<u32>,
}

impl Sides {
    fn of(n_vertices: usize, faces: &[[u32; 3]]) -> Self {
        assert!(faces.len() < u32::MAX as usize / 12, "half-edges are numbered by 32 bits");
        let mut begins = vec![0_u32; n_vertices + 1];
        for [a, b, c] in faces {
            for low in [a.min(b), b.min(c), c.min(a)] {
                begins[*low as usize + 1] += 1;
            }
        }
        for vertex in 0..n_vertices {
            begins[vertex + 1] += begins[vertex];
        }
        let mut ends = begins.clone();
        let mut sides = vec![Side { high: 0, packed: 0 }; 3 * faces.len()];
        for (face, corners) in faces.iter().enumerate() {
            for side in 0..3 {
                let (from, to) = (corners[side], corners[(side + 1) % 3]);
                let place = &mut ends[from.min(to) as usize];
                let half_edge = (3 * face + side) as u32;
                sides[*place as usize] = Side::new(from.max(to), half_edge, from < to);
                *place += 1;
            }
        }
        let mut offsets = Vec::with_capacity(sides.len() / 2 + 1);
        for low in 0..n_vertices {
            let (begin, end) = (begins[low] as usize, begins[low + 1] as usize);
            sides[begin..end].sort_unstable();
            let starts =
                (begin..end).filter(|&it| it == begin || sides[it].high != sides[it - 1].high);
            offsets.extend(starts.map(|it| it as u32));
        }
        offsets.push(sides.len() as u32);
        Self { sides, offsets }
    }

    /// The sides that lie on every edge, by ascending face.
    fn edges(&self) -> impl Iterator<Item = &[Side]> + '_ {
        self.offsets.windows(2).map(|it| &self.sides[it[0] as usize..it[1] as usize])
    }
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
    let mean = total / (sides.offsets.len() - 1) as f64;
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

/// Doubles the faces and glues the doubles.
///
/// The front of face `f` is face `2 f` of the cover, its back `2 f + 1`.
fn tufted_cover(
    vertices: &[Vec3],
    faces: &[[u32; 3]],
    sides: &Sides,
    lengths: &[f64],
    gluing: Gluing,
) -> IntrinsicTriangulation {
    let n_half_edges = 6 * faces.len();
    let mut origins = Vec::with_capacity(n_half_edges);
    let mut cover_lengths = Vec::with_capacity(n_half_edges);
    for (&[a, b, c], &[ab, bc, ca]) in faces.iter().zip(lengths.as_chunks::<3>().0) {
        origins.extend([a, b, c, a, c, b]);
        cover_lengths.extend([ab, bc, ca, ca, bc, ab]);
    }
    let mut twins = vec![0; n_half_edges];
    let mut around = Around::default();
    for edge in sides.edges() {
        around.order(vertices, faces, edge, gluing);
        for place in 0..edge.len() {
            let (side, following) = (around.sides[place], around.sides[(place + 1) % edge.len()]);
            // Looking along the edge, the sheet that walks with us faces the next face that comes
            // counter-clockwise, which turns to us the sheet that walks against us.
            let (one, other) = (sheet(side, true), sheet(following, false));
            twins[one as usize] = other;
            twins[other as usize] = one;
        }
    }
    IntrinsicTriangulation::new(origins, twins, cover_lengths)
}

/// The half-edge of the cover on a side, in the sheet that walks from the smaller vertex (forward) or
/// in the other one.
fn sheet(side: Side, forward: bool) -> u32 {
    let half_edge = side.half_edge();
    let (face, corner) = (half_edge / 3, half_edge % 3);
    if side.is_forward() == forward { 6 * face + corner } else { 6 * face + 5 - corner }
}

/// The faces around one edge at a time.
#[derive(Default)]
struct Around {
    sides: Vec<Side>,
    /// A key for every side, by which they are sorted.
    keyed: Vec<(bool, f64, Side)>,
}

impl Around {
    /// Puts the sides of an edge into the order in which they are glued.
    fn order(&mut self, vertices: &[Vec3], faces: &[[u32; 3]], edge: &[Side], gluing: Gluing) {
        self.sides.clear();
        self.sides.extend(edge);
        // Two faces are neighbours on both sides anyway.
        if edge.len() < 3 {
            return;
        }
        let arms = Arms::of(vertices, faces, edge);
        self.keyed.clear();
        match gluing {
            Gluing::ByAngle => {
                let keys = edge.iter().map(|&it| (false, arms.angle(vertices, faces, it), it));
                self.keyed.extend(keys);
                self.keyed.sort_by(|a, b| a.1.total_cmp(&b.1));
                self.sides.clear();
                self.sides.extend(self.keyed.iter().map(|it| it.2));
            }
            Gluing::FromSideToSide => {
                let keys = edge.iter().map(|&it| {
                    let arm = arms.arm(vertices, faces, it);
                    (arm.dot(&arms.first) < 0.0, arm.norm_squared(), it)
                });
                self.keyed.extend(keys);
                self.keyed.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
                let n_first = self.keyed.partition_point(|it| !it.0);
                let (one, other) = self.keyed.split_at(n_first);
                // Which side is called the first must not matter.
                let swap = matches!((one, other), ([a, ..], [b, ..]) if b.1 < a.1);
                let (one, other) = if swap { (other, one) } else { (one, other) };
                self.sides.clear();
                for place in 0..one.len().max(other.len()) {
                    self.sides.extend(one.get(place).map(|it| it.2));
                    self.sides.extend(other.get(place).map(|it| it.2));
                }
            }
        }
    }
}

/// An edge, seen along its direction from the smaller vertex to the greater.
struct Arms {
    origin: Vec3,
    axis: Vec3,
    /// From the edge to the apex of the first face, at a right angle to the edge.
    first: Vec3,
}

impl Arms {
    fn of(vertices: &[Vec3], faces: &[[u32; 3]], edge: &[Side]) -> Self {
        let first = edge[0].half_edge() as usize;
        let corners = faces[first / 3];
        let (a, b) = (corners[first % 3], corners[(first % 3 + 1) % 3]);
        let [origin, end] = [a.min(b), a.max(b)].map(|it| vertices[it as usize]);
        let axis = (end - origin).try_normalize(0.0).unwrap_or_default();
        let mut res = Self { origin, axis, first: Vec3::zeros() };
        res.first = res.arm(vertices, faces, edge[0]);
        res
    }

    fn arm(&self, vertices: &[Vec3], faces: &[[u32; 3]], side: Side) -> Vec3 {
        let half_edge = side.half_edge() as usize;
        let apex = faces[half_edge / 3][(half_edge % 3 + 2) % 3];
        let arm = vertices[apex as usize] - self.origin;
        arm - self.axis * arm.dot(&self.axis)
    }

    /// The angle of a face from the first one, counter-clockwise about the axis.
    fn angle(&self, vertices: &[Vec3], faces: &[[u32; 3]], side: Side) -> f64 {
        let arm = self.arm(vertices, faces, side);
        let angle = self.axis.dot(&self.first.cross(&arm)).atan2(self.first.dot(&arm));
        // Copies of the first face must not be torn apart by the last bit of their angles.
        if angle < -1e-12 { angle + std::f64::consts::TAU } else { angle }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes::{bumpy_sphere, icosphere, rectangle, torus};
    use crate::kernels::numerics::random::Random;
    use crate::kernels::spectral::eigs::{Disconnected, EigsOptions, eigs};
    use crate::kernels::spectral::laplacian::{MassLumping, cotangent_laplacian};
    use crate::kernels::test_shapes::permuted;

    fn three_faces_on_an_edge() -> TriMesh {
        let vertices =
            vec![Vec3::zeros(), Vec3::z(), Vec3::x(), Vec3::y(), Vec3::new(-1.0, -0.4, 0.2)];
        TriMesh::new(vertices, vec![[0, 1, 2], [0, 1, 3], [0, 1, 4]]).unwrap()
    }

    fn moebius_strip(n_around: usize) -> TriMesh {
        let mut vertices = Vec::new();
        for step in 0..n_around {
            let angle = std::f64::consts::TAU * step as f64 / n_around as f64;
            let out = Vec3::new(angle.cos(), angle.sin(), 0.0);
            let across = out * (angle / 2.0).cos() + Vec3::z() * (angle / 2.0).sin();
            vertices.extend([out - across * 0.2, out + across * 0.2]);
        }
        let n = n_around as u32;
        let mut faces = Vec::new();
        for step in 0..n {
            let (a, b) = (2 * step, 2 * step + 1);
            let next = [2 * ((step + 1) % n), 2 * ((step + 1) % n) + 1];
            // After a whole turn, left is right.
            let [c, d] = if step + 1 == n { [next[1], next[0]] } else { next };
            faces.extend([[a, c, b], [b, c, d]]);
        }
        TriMesh::new(vertices, faces).unwrap()
    }

    fn with_faces(mesh: &TriMesh, more: &[[u32; 3]]) -> TriMesh {
        TriMesh::new(mesh.vertices().to_vec(), [mesh.faces(), more].concat()).unwrap()
    }

    /// Triangles between random points: everything crosses everything.
    fn soup(seed: u64) -> TriMesh {
        let mut random = Random::new(seed);
        let vertices = (0..40).map(|_| Vec3::from_fn(|_, _| random.uniform())).collect();
        let faces = (0..150).map(|_| [0; 3].map(|_| random.below(38) as u32)).collect();
        TriMesh::new(vertices, faces).unwrap()
    }

    fn meshes() -> Vec<TriMesh> {
        let sphere = icosphere(2);
        let flat = vec![Vec3::zeros(), Vec3::x(), Vec3::x() * 0.5, Vec3::y()];
        vec![
            sphere.clone(),
            bumpy_sphere(7),
            rectangle(9, 3, 5.0, 0.2),
            torus(1.0, 0.3, 20, 9),
            three_faces_on_an_edge(),
            moebius_strip(24),
            with_faces(&sphere, &[sphere.faces()[5]]),
            with_faces(&sphere, &[[3, 3, 8], [0, 50, 100]]),
            TriMesh::new(flat, vec![[0, 1, 2], [0, 1, 3]]).unwrap(),
            soup(1),
            soup(2),
            soup(3),
        ]
    }

    fn scaled(mesh: &TriMesh, factor: f64) -> TriMesh {
        mesh.with_vertices(mesh.vertices().iter().map(|it| it * factor).collect()).unwrap()
    }

    fn entry(operator: &Operator, row: usize, column: usize) -> f64 {
        operator.stiffness.row(row).find(|it| it.0 == column).map_or(0.0, |it| it.1)
    }

    fn check(mesh: &TriMesh) -> (Operator, TuftedReport) {
        let (operator, report) = tufted_laplacian(mesh).unwrap();
        assert_eq!(report.flips.n_left, 0);
        let mut named = vec![false; mesh.n_vertices()];
        for &vertex in mesh.faces().iter().filter(|it| !is_collapsed(it)).flatten() {
            named[vertex as usize] = true;
        }
        let largest = operator.stiffness.values.iter().fold(0.0f64, |max, it| max.max(it.abs()));
        let sums = operator.stiffness.mul_vec(&vec![1.0; mesh.n_vertices()]);
        for (row, sum) in sums.into_iter().enumerate() {
            let expected = if named[row] { 0.0 } else { 1.0 };
            assert!((sum - expected).abs() <= 1e-14 * largest, "row {row} adds up to {sum}");
            for (column, value) in operator.stiffness.row(row) {
                assert!(column == row || value <= 0.0, "{row}, {column}: {value}");
                assert_eq!(entry(&operator, column, row), value, "{row}, {column}");
            }
        }
        assert!(operator.mass.iter().all(|&it| it > 0.0));
        (operator, report)
    }

    #[test]
    fn no_weight_is_negative_whatever_the_triangles() {
        for mesh in meshes() {
            let (operator, report) = check(&mesh);
            if report.lengthened == 0.0 && report.n_unreferenced == 0 {
                let relative = operator.mass.iter().sum::<f64>() / mesh.area() - 1.0;
                assert!(relative.abs() < 1e-12, "{relative}");
            }
        }
    }

    #[test]
    fn good_meshes_have_their_cotangent_laplacian() {
        for mesh in [icosphere(3), rectangle(8, 5, 8.0, 5.0), torus(3.0, 1.0, 40, 20)] {
            let (operator, report) = check(&mesh);
            let cotan = cotangent_laplacian(&mesh, MassLumping::Barycentric).unwrap();
            assert_eq!((report.flips.n_flips, report.lengthened), (0, 0.0));
            for row in 0..mesh.n_vertices() {
                for (column, value) in cotan.stiffness.row(row) {
                    let own = entry(&operator, row, column);
                    assert!((own - value).abs() < 1e-12, "{row}, {column}: {own} and {value}");
                }
                assert!((operator.mass[row] / cotan.mass[row] - 1.0).abs() < 1e-12);
            }
        }
    }

    /// Every face twice is the same surface twice: all of the operator doubles.
    #[test]
    fn repeated_faces_count_twice() {
        for mesh in [icosphere(2), rectangle(9, 3, 5.0, 0.2)] {
            let (one, _) = check(&mesh);
            let backs: Vec<[u32; 3]> = mesh.faces().iter().map(|&[a, b, c]| [a, c, b]).collect();
            let (two, report) = check(&with_faces(&mesh, &backs));
            assert!(report.n_nonmanifold_edges > 0);
            let sum = |operator: &Operator| operator.mass.iter().sum::<f64>();
            assert!((sum(&two) / sum(&one) - 2.0).abs() < 1e-12);
            assert_eq!(two.mass.len(), one.mass.len());
        }
    }

    #[test]
    fn the_order_of_vertices_and_faces_does_not_matter() {
        for mesh in [bumpy_sphere(6), moebius_strip(23), soup(4)] {
            let (one, _) = check(&mesh);
            let (other_mesh, order) = permuted(&mesh);
            let turned = other_mesh.faces().iter().rev().map(|&[a, b, c]| [c, a, b]).collect();
            let other_mesh = TriMesh::new(other_mesh.vertices().to_vec(), turned).unwrap();
            let (other, _) = check(&other_mesh);
            for row in 0..mesh.n_vertices() {
                let new_row = order[row] as usize;
                assert!((other.mass[new_row] / one.mass[row] - 1.0).abs() < 1e-12);
                for (column, value) in one.stiffness.row(row) {
                    let found = entry(&other, new_row, order[column] as usize);
                    assert!((found - value).abs() < 1e-8, "{row}, {column}: {found} and {value}");
                }
            }
        }
    }

    #[test]
    fn scale_leaves_the_stiffness_and_squares_the_mass() {
        for mesh in meshes() {
            let (one, _) = check(&mesh);
            for factor in [1e-6, 1e6] {
                let (other, _) = check(&scaled(&mesh, factor));
                for row in 0..mesh.n_vertices() {
                    let square = factor * factor;
                    assert!((other.mass[row] / (one.mass[row] * square) - 1.0).abs() < 1e-9);
                    for (column, value) in one.stiffness.row(row) {
                        let error = (entry(&other, row, column) - value).abs();
                        assert!(error < 1e-6 * (1.0 + value.abs()), "{row}, {column}: {error}");
                    }
                }
            }
        }
    }

    #[test]
    fn stray_vertices_change_nothing_for_the_others() {
        let mesh = icosphere(3);
        let (one, _) = check(&mesh);
        let vertices = [mesh.vertices(), &[Vec3::zeros(), Vec3::x()]].concat();
        let (two, report) = check(&TriMesh::new(vertices, mesh.faces().to_vec()).unwrap());
        assert_eq!(report.n_unreferenced, 2);
        let options = EigsOptions { k: 10, ..Default::default() };
        let (one, _) = eigs(&one, &options).unwrap();
        let (two, stats) = eigs(&two, &options).unwrap();
        assert_eq!(stats.n_components, 1);
        for (a, b) in one.eigenvalues.iter().zip(&two.eigenvalues) {
            assert!((a - b).abs() < 1e-8, "{a} and {b}");
        }
        for column in 0..10 {
            assert_eq!(two.eigenvectors[(mesh.n_vertices(), column)], 0.0);
        }
    }

    /// Weights of faces whose vertices coincide are a hundred thousand times those of others.
    #[test]
    fn faces_without_area_do_not_spoil_eigenpairs() {
        let mesh = icosphere(4);
        let (one, _) = check(&mesh);
        let mut vertices = mesh.vertices().to_vec();
        for &[a, b, _] in mesh.faces().iter().step_by(400) {
            vertices[a as usize] = vertices[b as usize];
        }
        let (other, report) = check(&mesh.with_vertices(vertices).unwrap());
        assert!(report.lengthened > 0.0);
        let options = EigsOptions { k: 9, ..Default::default() };
        let (one, _) = eigs(&one, &options).unwrap();
        let (other, _) = eigs(&other, &options).unwrap();
        for (a, b) in one.eigenvalues.iter().zip(&other.eigenvalues) {
            assert!((a - b).abs() < 0.02 * (1.0 + a), "{a} and {b}");
        }
    }

    #[test]
    fn two_parts_have_two_zeros() {
        let sphere = icosphere(2);
        let n = sphere.n_vertices() as u32;
        let apart = sphere.vertices().iter().map(|it| it * 0.5 + Vec3::x() * 4.0);
        let vertices = sphere.vertices().iter().copied().chain(apart).collect();
        let shifted = sphere.faces().iter().map(|it| it.map(|it| it + n));
        let faces = sphere.faces().iter().copied().chain(shifted).collect();
        let (operator, _) = check(&TriMesh::new(vertices, faces).unwrap());
        let options = EigsOptions { k: 6, disconnected: Disconnected::Merge, ..Default::default() };
        let (basis, _) = eigs(&operator, &options).unwrap();
        assert_eq!(basis.eigenvalues[..2], [0.0, 0.0]);
        assert!(basis.eigenvalues[2] > 1.0);
    }

    #[test]
    fn eigenvalues_of_the_sphere() {
        let (operator, _) = check(&icosphere(4));
        let total: f64 = operator.mass.iter().sum();
        assert!((total - 12.5514).abs() < 5e-5, "{total}");
        let (basis, _) = eigs(&operator, &EigsOptions { k: 17, ..Default::default() }).unwrap();
        let expected = [(1..4, 2.0, 5e-5), (4..9, 5.9915, 5e-5), (9..13, 11.9565, 5e-5)];
        for (range, expected, tolerance) in expected {
            for found in &basis.eigenvalues[range] {
                assert!((found - expected).abs() < tolerance, "{found} for {expected}");
            }
        }
        for found in &basis.eigenvalues[13..16] {
            assert!((found - 11.9584).abs() < 5e-5, "{found}");
        }
        assert!((basis.eigenvalues[16] - 19.8665).abs() < 1e-2, "{}", basis.eigenvalues[16]);
    }

    /// Free edges: `pi^2 (m^2 / a^2 + n^2 / b^2)`.
    #[test]
    fn eigenvalues_of_a_rectangle() {
        let (a, b) = (2.0, 1.3);
        let mesh = rectangle(80, 52, a, b);
        let (operator, report) = check(&mesh);
        assert_eq!(report.n_boundary_edges, 2 * (80 + 52));
        let (basis, _) = eigs(&operator, &EigsOptions { k: 12, ..Default::default() }).unwrap();
        let mode = |m: usize, n: usize| {
            let square = |count: usize, side: f64| (count as f64 / side).powi(2);
            std::f64::consts::PI.powi(2) * (square(m, a) + square(n, b))
        };
        let mut expected: Vec<f64> = (0..6).flat_map(|m| (0..6).map(move |n| mode(m, n))).collect();
        expected.sort_by(f64::total_cmp);
        for (found, expected) in basis.eigenvalues.iter().zip(&expected).skip(1) {
            assert!((found / expected - 1.0).abs() < 3e-3, "{found} for {expected}");
        }
    }

    #[test]
    fn what_has_no_triangle_is_refused() {
        let points = vec![Vec3::zeros(), Vec3::x(), Vec3::y()];
        let message = |mesh: &TriMesh| tufted_laplacian(mesh).unwrap_err().to_string();
        let cloud = TriMesh::from_points(points.clone()).unwrap();
        assert!(message(&cloud).starts_with("there are 3 points but no faces"));
        let collapsed = TriMesh::new(points.clone(), vec![[0, 0, 1], [1, 2, 1]]).unwrap();
        assert_eq!(message(&collapsed), "each of the 2 faces names a vertex twice");
        let mesh = TriMesh::new(points, vec![[0, 1, 2]]).unwrap();
        for factor in [0.0, 1e-170, 1e170] {
            let message = message(&scaled(&mesh, factor));
            assert!(message.starts_with("the edges of the 1 faces have a mean length of"));
        }
    }
}
