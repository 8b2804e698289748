//! Points in small patches of near ones, which are passed over as a whole.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};

use super::rows::Rows;

/// Points of a patch.
pub const PATCH: usize = 16;

/// Points in patches, each of which is a ball around its center.
///
/// Points whose coordinates are eigenfunctions of a surface lie on a surface again, so near ones form
/// patches that are small beside the distances between most points, whatever the dimension.
pub struct Patches {
    /// One more than the dimension.
    stride: usize,
    /// Points of every patch, ascending; the last ones may hold fewer than [`PATCH`].
    members: Vec<Vec<u32>>,
    /// Centers, as rows of [`Rows::points`].
    centers: Vec<f32>,
    radii: Vec<f32>,
    /// Rows of [`Rows::points`] by patches, in which coordinates come one after the other, `PATCH`
    /// numbers each.
    rows: Vec<f32>,
}

impl Patches {
    pub fn new(points: &Rows) -> Self {
        let stride = points.dim + 1;
        let mut order: Vec<u32> = (0..points.count as u32).collect();
        let mut sizes = Vec::with_capacity(points.count.div_ceil(PATCH));
        halve(points, &mut order, &mut sizes, &mut vec![(0.0, 0); points.count]);
        let mut res = Self {
            stride,
            members: Vec::with_capacity(sizes.len()),
            centers: Vec::with_capacity(sizes.len() * stride),
            radii: Vec::with_capacity(sizes.len()),
            rows: vec![0.0; sizes.len() * stride * PATCH],
        };
        let mut rest = &order[..];
        for size in sizes {
            let (members, others) = rest.split_at(size);
            rest = others;
            res.push(points, members);
        }
        res
    }

    fn push(&mut self, points: &Rows, members: &[u32]) {
        let dim = points.dim;
        let mut center = vec![0.0f64; dim];
        for &member in members {
            for (sum, value) in center.iter_mut().zip(points.row(member as usize)) {
                *sum += value / members.len() as f64;
            }
        }
        // The center is what single precision makes of it, exactly.
        let center: Vec<f64> = center.into_iter().map(|it| f64::from(it as f32)).collect();
        let square: f64 = center.iter().map(|it| it * it).sum();
        self.centers.extend(center.iter().map(|&it| it as f32));
        self.centers.push((-0.5 * square) as f32);
        let mut radius: f64 = 0.0;
        for &member in members {
            let row = points.row(member as usize).iter().zip(&center);
            radius = radius.max(row.map(|(a, b)| (a - b) * (a - b)).sum());
        }
        self.radii.push((radius.sqrt() * (1.0 + 1e-6)) as f32);
        let patch = self.members.len();
        let rows = &mut self.rows[patch * self.stride * PATCH..(patch + 1) * self.stride * PATCH];
        for (lane, &member) in members.iter().enumerate() {
            for (axis, &value) in points.single_row(member as usize).iter().enumerate() {
                rows[axis * PATCH + lane] = value;
            }
        }
        // Where there is no point, the score is infinite.
        rows[dim * PATCH + members.len()..].fill(f32::NEG_INFINITY);
        self.members.push(members.to_vec());
    }

    pub fn count(&self) -> usize {
        self.members.len()
    }

    pub fn members(&self, patch: usize) -> &[u32] {
        &self.members[patch]
    }

    pub fn radii(&self) -> &[f32] {
        &self.radii
    }

    /// The scores of all centers for the queries in the columns.
    pub fn center_scores(&self, scores: MatMut<'_, f32>, queries: MatRef<'_, f32>) {
        let centers = MatRef::from_column_major_slice(&self.centers, self.stride, self.count());
        matmul(scores, Accum::Replace, centers.transpose(), queries, -2.0, Par::Seq);
    }

    /// The scores of the points of a patch.
    #[inline(always)]
    pub fn scores(&self, patch: usize, query: &[f32]) -> [f32; PATCH] {
        let size = self.stride * PATCH;
        let (rows, _) = self.rows[patch * size..(patch + 1) * size].as_chunks::<PATCH>();
        let mut sums = [[0.0f32; PATCH]; 2];
        let (row_pairs, last_row) = rows.as_chunks::<2>();
        let (pairs, last) = query.as_chunks::<2>();
        for (row, value) in row_pairs.iter().zip(pairs) {
            for lane in 0..PATCH {
                sums[0][lane] += row[0][lane] * value[0];
            }
            for lane in 0..PATCH {
                sums[1][lane] += row[1][lane] * value[1];
            }
        }
        for (row, value) in last_row.iter().zip(last) {
            for lane in 0..PATCH {
                sums[0][lane] += row[lane] * value;
            }
        }
        let [mut res, second] = sums;
        for lane in 0..PATCH {
            res[lane] = -2.0 * (res[lane] + second[lane]);
        }
        res
    }
}

/// Halves a set of points until they are patches, whose sizes are appended in the order of `order`.
///
/// A set is cut across the line between two of its points that are far from each other.
fn halve(points: &Rows, order: &mut [u32], sizes: &mut Vec<usize>, keys: &mut [(f32, u32)]) {
    if order.len() <= PATCH {
        order.sort_unstable();
        sizes.push(order.len());
        return;
    }
    let first = farthest(points, order, order[0]);
    let second = farthest(points, order, first);
    let (a, b) = (points.single_row(first as usize), points.single_row(second as usize));
    let direction: Vec<f32> = a.iter().zip(b).map(|(a, b)| b - a).collect();
    let keys = &mut keys[..order.len()];
    for (key, &point) in keys.iter_mut().zip(order.iter()) {
        *key = (dot(&points.single_row(point as usize)[..points.dim], &direction), point);
    }
    // The lower part holds whole patches, so that few are left half empty.
    let half = (order.len() / 2).next_multiple_of(PATCH).min(order.len() - 1);
    keys.select_nth_unstable_by(half, |x, y| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)));
    for (slot, key) in order.iter_mut().zip(keys.iter()) {
        *slot = key.1;
    }
    let (lower, upper) = order.split_at_mut(half);
    halve(points, lower, sizes, keys);
    halve(points, upper, sizes, keys);
}

/// The point that is farthest from another one, nearly.
fn farthest(points: &Rows, among: &[u32], from: u32) -> u32 {
    let dim = points.dim;
    let from = &points.single_row(from as usize)[..dim];
    let mut res = (among[0], f32::NEG_INFINITY);
    for &point in among {
        let row = &points.single_row(point as usize)[..dim];
        let score = points.squares[point as usize] - 2.0 * dot(row, from);
        if score > res.1 || score == res.1 && point < res.0 {
            res = (point, score);
        }
    }
    res.0
}

fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0f32; 16];
    let (blocks_a, rest_a) = a.as_chunks::<16>();
    let (blocks_b, rest_b) = b.as_chunks::<16>();
    for (a, b) in blocks_a.iter().zip(blocks_b) {
        for lane in 0..16 {
            sums[lane] += a[lane] * b[lane];
        }
    }
    let rest: f32 = rest_a.iter().zip(rest_b).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f32>() + rest
}
