//! How strongly points are drawn together and held, from one contraction to the next.

use rayon::prelude::*;

use super::rings::{Rings, area};
use crate::kernels::geometry::mesh::Vec3;

/// What the size of a one-ring is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RingSize {
    /// The square root of its area (Au et al. 2008).
    Area,
    /// Its shortest edge (Cao et al. 2010).
    ShortestEdge,
}

/// Weights of the contractions, for shapes whose box has a longest side of 1.6.
#[derive(Debug, Clone, PartialEq)]
pub struct Schedule {
    /// The first weight of the Laplacian, over the inverse of the mean length of edges.
    pub first_weight: f64,
    /// By how much it grows from each contraction to the next.
    pub growth: f64,
    /// Its greatest value.
    pub most_weight: f64,
    /// Anchors are inverse to ring sizes, one at first, and at most so strong.
    pub most_anchor: f64,
    pub ring_size: RingSize,
    /// The most contractions.
    pub max_iterations: usize,
    /// Stop when the mean ring size, in parts of the first, falls by less than this…
    pub least_gain: f64,
    /// …or when the area falls below this part of the first.
    pub least_area: f64,
}

impl Schedule {
    /// Of Au et al. for meshes, but for the first weight, which does not depend on the unit, and the
    /// growth: with 3 instead of 2 shapes become thinner in fewer steps.
    pub fn of_meshes() -> Self {
        Self {
            first_weight: 0.15,
            growth: 3.0,
            most_weight: 2048.0,
            most_anchor: 1e4,
            ring_size: RingSize::Area,
            max_iterations: 20,
            least_gain: 0.01,
            least_area: 1e-6,
        }
    }

    /// Of Cao et al. for clouds.
    pub fn of_clouds() -> Self {
        Self { first_weight: 0.2, ring_size: RingSize::ShortestEdge, ..Self::of_meshes() }
    }
}

/// The longest side of the box that weights are made for.
pub const BOX: f64 = 1.6;

/// Ring sizes are not smaller.
const LEAST_SIZE: f64 = 1e-12;

/// The size of the ring of every point.
pub fn ring_sizes(rings: &Rings, positions: &[Vec3], kind: RingSize) -> Vec<f64> {
    let size = |point: usize| match kind {
        RingSize::Area => {
            rings.star(point).iter().map(|it| area(positions, it)).sum::<f64>().sqrt()
        }
        RingSize::ShortestEdge => {
            let lengths =
                rings.ring(point).iter().map(|&it| positions[it as usize] - positions[point]);
            lengths.map(|it| it.norm()).fold(f64::INFINITY, f64::min)
        }
    };
    (0..rings.n_points()).map(|it| size(it).max(LEAST_SIZE)).collect()
}

/// Rows whose weights add up to more are scaled down to this (Cao et al. 2010).
const MOST_ROW: f64 = 1e4;

/// What is added to the lengths of edges before cotangents are taken, in parts of their first mean.
///
/// As rings collapse, cotangents become of any size and sign: contractions then grow unstable after
/// three or four steps, and so they do sooner when negative ones are set to zero. With a little more
/// length (Sharp & Crane 2020 mollify meshes so) triangles that are much smaller than this count as
/// equilateral, whose weights are those of the graph; larger ones keep their cotangents.
const SOFTNESS: f64 = 0.02;

/// The weights of the ring entries of all rows: the sum of the cotangents of the angles that face the
/// edge in the star of the row's point. `first_edge` is the mean edge before the first contraction.
pub fn cotangent_rows(rings: &Rings, positions: &[Vec3], first_edge: f64) -> Vec<f64> {
    let softness = SOFTNESS * first_edge;
    let row = |point: usize| {
        let ring = rings.ring(point);
        let mut own = vec![0.0; ring.len()];
        let place = |it: u32| ring.binary_search(&it).expect("a corner of the star is in the ring");
        for &[center, a, b] in rings.star(point) {
            let [p, q, r] = [center, a, b].map(|it| positions[it as usize]);
            let sides = [(r - q).norm(), (p - r).norm(), (q - p).norm()].map(|it| it + softness);
            let [_, facing_a, facing_b] = cotangents(sides);
            own[place(a)] += facing_b;
            own[place(b)] += facing_a;
        }
        let total = own.iter().sum::<f64>().abs();
        if total > MOST_ROW {
            own.iter_mut().for_each(|it| *it *= MOST_ROW / total);
        }
        own
    };
    let points: Vec<usize> = (0..rings.n_points()).collect();
    let blocks: Vec<Vec<f64>> = points
        .par_chunks(TOGETHER)
        .map(|block| block.iter().flat_map(|&it| row(it)).collect())
        .collect();
    blocks.concat()
}

/// Points that one task works on.
const TOGETHER: usize = 1024;

/// The cotangents of the angles that face the sides of a triangle.
fn cotangents(sides: [f64; 3]) -> [f64; 3] {
    let half = 0.5 * sides.iter().sum::<f64>();
    let product = sides.iter().fold(half, |product, it| product * (half - it));
    let fourfold_area = 4.0 * product.max(f64::MIN_POSITIVE).sqrt();
    let squares = sides.map(|it| it * it);
    let total: f64 = squares.iter().sum();
    squares.map(|it| (total - 2.0 * it) / fourfold_area)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes::icosphere;

    #[test]
    fn cotangents_of_a_half_square() {
        let [a, b, c] = cotangents([1.0, 1.0, 2.0_f64.sqrt()]);
        assert!((a - 1.0).abs() < 1e-12 && (b - 1.0).abs() < 1e-12 && c.abs() < 1e-12);
    }

    #[test]
    fn rows_point_inward_on_a_ball_and_stay_bounded_on_a_collapsed_one() {
        let ball = icosphere(3);
        let rings = Rings::of_faces(ball.n_vertices(), ball.faces());
        let edge = rings.mean_edge(ball.vertices());
        let weights = cotangent_rows(&rings, ball.vertices(), edge);
        for (point, place) in ball.vertices().iter().enumerate() {
            let own = rings.offsets[point]..rings.offsets[point + 1];
            let arms = rings.ring(point).iter().map(|&it| ball.vertices()[it as usize] - place);
            let sum: Vec3 = arms.zip(&weights[own]).map(|(arm, weight)| arm * *weight).sum();
            assert!(sum.normalize().dot(place) < -0.99);
        }
        let flat: Vec<Vec3> =
            ball.vertices().iter().map(|it| it.component_mul(&Vec3::x())).collect();
        let weights = cotangent_rows(&rings, &flat, edge);
        assert!(weights.iter().all(|it| it.abs() < 1e3));
    }
}
