//! The tufted cover: a closed manifold of two copies of every face.

use super::sides::{Side, Sides};
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::spectral::intrinsic::IntrinsicTriangulation;

/// Doubles the faces and glues the doubles.
///
/// The front of face `f` is face `2 f` of the cover, its back `2 f + 1`.
pub(super) fn tufted_cover(
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

/// Which of the faces around an edge are neighbours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Gluing {
    /// In the order in which they stand around the edge.
    ByAngle,
    /// One from either side of the edge in turn: for triangles that cover a surface several times,
    /// every copy of a triangle continues into a copy of its neighbour.
    FromSideToSide,
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
