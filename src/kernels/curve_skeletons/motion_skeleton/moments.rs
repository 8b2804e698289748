//! Sums that tell how well one rigid motion a frame moves a set of vertices.

use nalgebra::Matrix3;

use super::Moving;
use crate::kernels::geometry::mesh::Vec3;

/// Sums over a set of vertices: sets that are disjoint are united by adding them.
#[derive(Debug, Clone, PartialEq)]
pub struct Moments {
    pub n: usize,
    rest: Vec3,
    rest_square: f64,
    frames: Vec<FrameMoments>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct FrameMoments {
    sum: Vec3,
    square: f64,
    /// `sum y v^T`.
    product: Matrix3<f64>,
}

impl Moments {
    /// Those of no vertex.
    pub fn none(n_frames: usize) -> Self {
        let frame = FrameMoments { sum: Vec3::zeros(), square: 0.0, product: Matrix3::zeros() };
        Self { n: 0, rest: Vec3::zeros(), rest_square: 0.0, frames: vec![frame; n_frames] }
    }

    pub fn of(moving: &Moving<'_>, vertices: &[u32]) -> Self {
        let mut res = Self::none(moving.n_frames());
        for &vertex in vertices {
            let rest = moving.rest(vertex);
            res.n += 1;
            res.rest += rest;
            res.rest_square += rest.norm_squared();
            for (frame, sums) in res.frames.iter_mut().enumerate() {
                let place = moving.place(frame, vertex);
                sums.sum += place;
                sums.square += place.norm_squared();
                sums.product += place * rest.transpose();
            }
        }
        res
    }

    pub fn add(&mut self, other: &Self) {
        self.n += other.n;
        self.rest += other.rest;
        self.rest_square += other.rest_square;
        for (own, other) in self.frames.iter_mut().zip(&other.frames) {
            own.sum += other.sum;
            own.square += other.square;
            own.product += other.product;
        }
    }

    /// Those of the set without a part of it.
    pub fn without(&self, part: &Self) -> Self {
        let mut res = self.clone();
        res.n -= part.n;
        res.rest -= part.rest;
        res.rest_square -= part.rest_square;
        for (own, part) in res.frames.iter_mut().zip(&part.frames) {
            own.sum -= part.sum;
            own.square -= part.square;
            own.product -= part.product;
        }
        res
    }

    /// The least `sum |y - R v - T|^2` over all frames, each with its own rotation and translation:
    /// `S_yy + S_vv - 2 (s1 + s2 ± s3)` of the centred sums, with the singular values of
    /// `sum y v^T` and the sign of its determinant.
    pub fn rigid_cost(&self) -> f64 {
        if self.n == 0 {
            return 0.0;
        }
        let n = self.n as f64;
        let rest_square = self.rest_square - self.rest.norm_squared() / n;
        let cost = |it: &FrameMoments| {
            let square = it.square - it.sum.norm_squared() / n;
            let product = it.product - it.sum * self.rest.transpose() / n;
            let mut values = product.singular_values();
            values.as_mut_slice().sort_by(|a, b| b.total_cmp(a));
            let sign = if product.determinant() < 0.0 { -1.0 } else { 1.0 };
            (square + rest_square - 2.0 * (values[0] + values[1] + sign * values[2])).max(0.0)
        };
        self.frames.iter().map(cost).sum()
    }
}
