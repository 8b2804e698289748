//! Points in small patches of near ones, which are passed over as a whole.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};

use super::rows::Rows;

/// Points of a patch.
pub const PATCH: usize = 16;

/// The first coordinates, by which most patches can be passed over.
const HEAD: usize = 32;

/// Points in patches, each of which is a ball around its center.
///
/// Points whose coordinates are eigenfunctions of a surface lie on a surface again, so near ones form
/// patches that are small beside the distances between most points, whatever the dimension.
pub struct Patches {
    /// One more than the dimension.
    stride: usize,
    /// Points of every patch, ascending, at most [`PATCH`].
    members: Vec<Vec<u32>>,
    /// Centers, as rows of [`Rows::points`].
    centers: Vec<f32>,
    radii: Vec<f32>,
    /// Patch by patch the first coordinates of its points, `-1/2` of their squares, the other
    /// coordinates, and `-1/2` of theirs: `PATCH` numbers each.
    rows: Vec<f32>,
    head: usize,
}

impl Patches {
    pub fn new(points: &Rows) -> Self {
        let stride = points.dim + 1;
        let mut order: Vec<u32> = (0..points.count as u32).collect();
        let mut sizes = Vec::with_capacity(points.count.div_ceil(PATCH));
        cut(points, &mut order, &mut sizes, &mut vec![(0.0, 0); points.count]);
        let mut res = Self {
            stride,
            members: Vec::with_capacity(sizes.len()),
            centers: Vec::with_capacity(sizes.len() * stride),
            radii: Vec::with_capacity(sizes.len()),
            rows: vec![0.0; sizes.len() * (stride + 1) * PATCH],
            head: points.dim.min(HEAD),
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
        let (size, patch, head) = ((self.stride + 1) * PATCH, self.members.len(), self.head);
        let (rows, _) = self.rows[patch * size..(patch + 1) * size].as_chunks_mut::<PATCH>();
        for (lane, &member) in members.iter().enumerate() {
            let single = &points.single_row(member as usize)[..dim];
            let square = |part: &[f64]| (-0.5 * part.iter().map(|it| it * it).sum::<f64>()) as f32;
            let (exact_head, exact_tail) = points.row(member as usize).split_at(head);
            for (row, value) in rows.iter_mut().zip(&single[..head]) {
                row[lane] = *value;
            }
            rows[head][lane] = square(exact_head);
            for (row, value) in rows[head + 1..].iter_mut().zip(&single[head..]) {
                row[lane] = *value;
            }
            rows[dim + 1][lane] = square(exact_tail);
        }
        // Where there is no point, the score is infinite.
        rows[head][members.len()..].fill(f32::NEG_INFINITY);
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

    /// Scores of the points of a patch by their first coordinates alone: with the square of the query's
    /// first coordinates, squared distances that the whole ones are no less than.
    #[inline(always)]
    pub fn head_scores(&self, patch: usize, query: &[f32]) -> [f32; PATCH] {
        let (rows, _) = self.rows[patch * self.size()..][..self.size()].as_chunks::<PATCH>();
        let mut res = products(&rows[..self.head], &query[..self.head]);
        for lane in 0..PATCH {
            res[lane] = -2.0 * (res[lane] + rows[self.head][lane]);
        }
        res
    }

    /// The scores of the points of a patch, from those of [`Patches::head_scores`].
    #[inline(always)]
    pub fn scores(&self, patch: usize, query: &[f32], head: &[f32; PATCH]) -> [f32; PATCH] {
        let (rows, _) = self.rows[patch * self.size()..][..self.size()].as_chunks::<PATCH>();
        let mut res = products(&rows[self.head + 1..], &query[self.head..]);
        for lane in 0..PATCH {
            res[lane] = head[lane] - 2.0 * res[lane];
        }
        res
    }

    /// The square of the first coordinates of a query.
    #[inline(always)]
    pub fn head_square(&self, query: &[f32]) -> f32 {
        let mut sum = 0.0;
        for value in &query[..self.head] {
            sum += value * value;
        }
        sum
    }

    fn size(&self) -> usize {
        (self.stride + 1) * PATCH
    }
}

/// The inner products of `PATCH` points, given coordinate by coordinate, with a query.
#[inline(always)]
fn products(rows: &[[f32; PATCH]], query: &[f32]) -> [f32; PATCH] {
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
        res[lane] += second[lane];
    }
    res
}

/// Cuts a set of points until they are patches, whose sizes are appended in the order of `order`.
///
/// The points nearer to one of two points far from each other are separated from those nearer to the
/// other: cutting in the middle of the order instead would leave patches of two distant parts.
fn cut(points: &Rows, order: &mut [u32], sizes: &mut Vec<usize>, keys: &mut [(f32, u32)]) {
    if order.len() <= PATCH {
        order.sort_unstable();
        sizes.push(order.len());
        return;
    }
    let first = farthest(points, order, order[0]);
    let second = farthest(points, order, first);
    let row = |point: u32| &points.single_row(point as usize)[..points.dim];
    let direction: Vec<f32> = row(first).iter().zip(row(second)).map(|(a, b)| b - a).collect();
    let keys = &mut keys[..order.len()];
    for (key, &point) in keys.iter_mut().zip(order.iter()) {
        *key = (dot(row(point), &direction), point);
    }
    let between = 0.5 * (dot(row(first), &direction) + dot(row(second), &direction));
    let n_lower = keys.iter().filter(|it| it.0 < between).count();
    // A few outliers must not be cut off one by one, nor must points at one place stay together.
    let least = if order.len() <= 8 * PATCH { 1 } else { order.len() / 16 };
    let n_lower = match (least..=order.len() - least).contains(&n_lower) {
        true => n_lower,
        false => order.len() / 2,
    };
    keys.select_nth_unstable_by(n_lower, |x, y| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)));
    for (slot, key) in order.iter_mut().zip(keys.iter()) {
        *slot = key.1;
    }
    let (lower, upper) = order.split_at_mut(n_lower);
    cut(points, lower, sizes, keys);
    cut(points, upper, sizes, keys);
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
