//! Triangulations that know lengths instead of positions.

use super::edge_weights::EdgeWeights;
use crate::kernels::geometry::corner_table::{next, previous};
use crate::kernels::numerics::sparse::CsrMatrix;

/// A closed, oriented triangulation with a length for every edge.
///
/// Half-edge `3 f + i` leads from corner `i` of face `f` to the next corner. Vertices are only labels
/// of corners: an edge may lead from a vertex to itself, and several edges may join the same two, so
/// nothing is ever looked up by its ends.
#[derive(Debug, Clone)]
pub struct IntrinsicTriangulation {
    /// The vertex where every half-edge starts.
    origins: Vec<u32>,
    /// The same edge, seen from its other face.
    twins: Vec<u32>,
    lengths: Vec<f64>,
    /// The cotangent of the angle that faces every half-edge in its own face.
    cotangents: Vec<f64>,
}

/// What [`IntrinsicTriangulation::flip_to_delaunay`] did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Flips {
    pub n_flips: usize,
    /// Edges that still are not Delaunay, because the limit of flips was reached.
    pub n_left: usize,
}

/// An edge is Delaunay if the cotangents that face it add up to no less than this: between zero and
/// this number lies rounding.
const DELAUNAY: f64 = -1e-9;

/// The limit of flips, by edge. Usual meshes need less than one flip for ten edges.
const FLIPS_AN_EDGE: usize = 100;

impl IntrinsicTriangulation {
    /// Links half-edges; all three lists are as long as there are half-edges.
    ///
    /// `twins` must pair every half-edge with another one of the same length and opposite ends, and
    /// lengths of a face must satisfy the triangle inequality.
    pub fn new(origins: Vec<u32>, twins: Vec<u32>, lengths: Vec<f64>) -> Self {
        let mut res = Self { cotangents: vec![0.0; lengths.len()], origins, twins, lengths };
        for face in 0..res.lengths.len() / 3 {
            res.measure(3 * face);
        }
        res
    }

    /// Flips edges until every edge is Delaunay: the two angles that face it add up to at most pi.
    pub fn flip_to_delaunay(&mut self) -> Flips {
        let mut flips = Flips::default();
        let limit = FLIPS_AN_EDGE * self.twins.len() / 2;
        let mut suspects = Vec::new();
        for edge in 0..self.twins.len() as u32 {
            if edge > self.twin(edge) || self.is_delaunay(edge) {
                continue;
            }
            suspects.push(edge);
            while let Some(edge) = suspects.pop() {
                if flips.n_flips < limit && !self.is_delaunay(edge) {
                    flips.n_flips += 1;
                    suspects.extend(self.flip(edge));
                }
            }
        }
        if flips.n_flips == limit {
            let all = 0..self.twins.len() as u32;
            let left = all.filter(|&it| it < self.twin(it) && !self.is_delaunay(it));
            flips.n_left = left.count();
        }
        flips
    }

    /// The stiffness of piecewise linear functions, `V x V`: `factor` times the half cotangent sums.
    ///
    /// Sums that are negative by rounding only count as zero.
    pub fn stiffness(&self, n_vertices: usize, factor: f64) -> CsrMatrix {
        let mut room = vec![0; n_vertices];
        for &origin in &self.origins {
            room[origin as usize] += 1;
        }
        let mut weights = EdgeWeights::with_room(&room);
        for edge in 0..self.twins.len() as u32 {
            let twin = self.twin(edge);
            let (from, to) = (self.origins[edge as usize], self.origins[twin as usize]);
            let sum = self.cotangent_sum(edge);
            // An edge from a vertex to itself says nothing about a function on the vertices.
            if edge < twin && from != to && !(DELAUNAY..=0.0).contains(&sum) {
                weights.add(from, to, 0.5 * factor * sum);
            }
        }
        weights.into_stiffness()
    }

    /// A third of the area of the faces around every vertex, times `factor`.
    pub fn barycentric_mass(&self, n_vertices: usize, factor: f64) -> Vec<f64> {
        let mut mass = vec![0.0; n_vertices];
        for (face, lengths) in self.lengths.as_chunks::<3>().0.iter().enumerate() {
            let third = factor * area(*lengths) / 3.0;
            for &vertex in &self.origins[3 * face..3 * face + 3] {
                mass[vertex as usize] += third;
            }
        }
        mass
    }

    fn twin(&self, edge: u32) -> u32 {
        self.twins[edge as usize]
    }

    fn cotangent_sum(&self, edge: u32) -> f64 {
        self.cotangents[edge as usize] + self.cotangents[self.twin(edge) as usize]
    }

    /// Edges with the same face on both sides cannot be flipped; they are Delaunay whenever the face
    /// is a triangle at all, for the two angles are those at its base.
    fn is_delaunay(&self, edge: u32) -> bool {
        self.cotangent_sum(edge) >= DELAUNAY || edge / 3 == self.twin(edge) / 3
    }

    /// Turns the edge `ab` of the faces `abc` and `bad` into `dc`; returns the four edges around.
    ///
    /// `ca` and `db` stay where they are, `ad` and `bc` move to where `ab` and `ba` were. Any of the
    /// four may be glued to one another.
    fn flip(&mut self, edge: u32) -> [u32; 4] {
        let twin = self.twin(edge);
        let (bc, ca) = (next(edge), previous(edge));
        let (ad, db) = (next(twin), previous(twin));
        let (c, d) = (self.origins[ca as usize], self.origins[db as usize]);
        let length = self.other_diagonal(edge, twin);
        let moved = |it: u32| match it {
            it if it == ad => edge,
            it if it == bc => twin,
            it => it,
        };
        let (beside_ad, beside_bc) = (moved(self.twin(ad)), moved(self.twin(bc)));
        self.lengths[edge as usize] = self.lengths[ad as usize];
        self.lengths[twin as usize] = self.lengths[bc as usize];
        self.lengths[bc as usize] = length;
        self.lengths[ad as usize] = length;
        self.link(edge, beside_ad);
        self.link(twin, beside_bc);
        self.link(bc, ad);
        self.origins[bc as usize] = d;
        self.origins[ad as usize] = c;
        self.measure(3 * (edge as usize / 3));
        self.measure(3 * (twin as usize / 3));
        [edge, ca, twin, db]
    }

    /// The distance of the two corners that face an edge when its faces lie in one plane.
    fn other_diagonal(&self, edge: u32, twin: u32) -> f64 {
        let length = |it: u32| self.lengths[it as usize];
        let base = length(edge);
        // The foot and the height of a corner above the edge, seen from the edge's start.
        let corner = |from_start: f64, from_end: f64| {
            let along = (base * base + (from_start - from_end) * (from_start + from_end)) / 2.0;
            (along / base, 2.0 * area([base, from_start, from_end]) / base)
        };
        let one = corner(length(previous(edge)), length(next(edge)));
        let other = corner(length(next(twin)), length(previous(twin)));
        (one.0 - other.0).hypot(one.1 + other.1)
    }

    fn link(&mut self, one: u32, other: u32) {
        self.twins[one as usize] = other;
        self.twins[other as usize] = one;
    }

    /// Computes the cotangents of the face whose first half-edge is given.
    fn measure(&mut self, first: usize) {
        let [a, b, c] = [0, 1, 2].map(|it| self.lengths[first + it]);
        let four_areas = 4.0 * area([a, b, c]);
        let squares = [a * a, b * b, c * c];
        for side in 0..3 {
            let [own, next, last] = [0, 1, 2].map(|step| squares[(side + step) % 3]);
            self.cotangents[first + side] = (next + last - own) / four_areas;
        }
    }
}

/// The area of a triangle from its lengths, exact to rounding for needles too (Kahan 2014).
///
/// Never zero, so that cotangents stay finite where rounding makes a triangle flat.
fn area(lengths: [f64; 3]) -> f64 {
    let [mut a, mut b, mut c] = lengths;
    if a < b {
        (a, b) = (b, a);
    }
    if b < c {
        (b, c) = (c, b);
    }
    if a < b {
        (a, b) = (b, a);
    }
    let product = (a + (b + c)) * (c - (a - b)) * (c + (a - b)) * (a + (b - c));
    product.max(1e-30 * (a * a) * (a * a)).sqrt() / 4.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Both sides of a flat kite whose short diagonal is wanted: `ab` is the long one.
    fn kite() -> IntrinsicTriangulation {
        // a = 0, b = 1, c = 2, d = 3; faces abc, bad and their backs acb, bda.
        let origins = vec![0, 1, 2, 1, 0, 3, 0, 2, 1, 1, 3, 0];
        let twins = vec![3, 7, 6, 0, 10, 9, 2, 1, 11, 5, 4, 8];
        let side = f64::hypot(2.0, 0.5);
        let lengths = vec![4.0, side, side, 4.0, side, side, side, side, 4.0, side, side, 4.0];
        let res = IntrinsicTriangulation::new(origins, twins, lengths);
        res.check();
        res
    }

    impl IntrinsicTriangulation {
        fn check(&self) {
            for edge in 0..self.twins.len() as u32 {
                let twin = self.twin(edge);
                assert!(twin != edge && self.twin(twin) == edge, "{edge}");
                assert_eq!(self.lengths[edge as usize], self.lengths[twin as usize], "{edge}");
                let target = self.origins[next(edge) as usize];
                assert_eq!(self.origins[twin as usize], target, "{edge}");
            }
        }
    }

    #[test]
    fn the_long_diagonal_of_a_kite_is_flipped_on_both_sides() {
        let mut kite = kite();
        let mass = kite.barycentric_mass(4, 1.0);
        let flips = kite.flip_to_delaunay();
        kite.check();
        assert_eq!(flips, Flips { n_flips: 2, n_left: 0 });
        // Now `cd` of length one, and no edge between a and b.
        let stiffness = kite.stiffness(4, 1.0);
        assert!(stiffness.row(0).all(|it| it.0 != 1));
        // cot = 15/8 at a and b, in two faces each, on two sheets.
        let cd = stiffness.row(2).find(|it| it.0 == 3).unwrap().1;
        assert!((cd + 2.0 * 15.0 / 8.0).abs() < 1e-12, "{cd}");
        assert!((mass.iter().sum::<f64>() - 4.0).abs() < 1e-12);
        assert!((kite.barycentric_mass(4, 1.0).iter().sum::<f64>() - 4.0).abs() < 1e-12);
    }

    #[test]
    fn areas_of_needles_are_exact() {
        assert_eq!(area([3.0, 5.0, 4.0]), 6.0);
        let needle = area([1.0, 1.0, 1e-9]);
        assert!((needle / 5e-10 - 1.0).abs() < 1e-15, "{needle}");
        let cap = area([2.0, 1.0 + 1e-12, 1.0]);
        assert!((cap / 1e-6 - 1.0).abs() < 1e-4, "{cap}");
    }
}
