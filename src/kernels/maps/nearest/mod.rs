//! Nearest rows among points of a few to hundreds of dimensions.

mod best;
mod dense;
mod patches;
mod rows;

use faer::{Mat, MatRef};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use best::{Best, first_minimum, minimum, slack};
use patches::{PATCH, Patches};
use rows::Rows;

/// Queries that one task answers. Fixed, so that results do not depend on threads.
const QUERIES: usize = 256;

/// Below so many points, patches do not pay.
const FEW: usize = 16 * PATCH;

/// Queries to which so many patches remain are compared with all points at once, which takes a third
/// of the time a point.
const PART_OF_PATCHES: usize = 8;

/// For every row of `queries` (`n x d`), the index of the nearest row of `points` (`m x d`).
///
/// Exact: distances are compared in double precision, and of equally near points the one with the
/// smallest index is taken. Single precision only finds out which points cannot be nearest, given a
/// bound of its rounding errors. Points lie in patches of sixteen. For every query, patches whose
/// center is too far, given the radius and the nearest point of the first patch, are passed over, and
/// so are those whose points are too far by their first coordinates alone.
/// Where few can be passed over, as for random points of many dimensions, all points are compared by
/// products of whole blocks.
///
/// # Panics
/// If there are no points or the dimensions differ.
pub fn nearest_rows(queries: MatRef<'_, f64>, points: MatRef<'_, f64>) -> Vec<u32> {
    assert!(points.nrows() > 0, "there must be points to be near to");
    assert_eq!(queries.ncols(), points.ncols(), "one dimension of queries and points");
    // Large numbers of either sign would leave the range of single precision.
    let scale = 1.0 / queries.norm_max().max(points.norm_max()).max(f64::MIN_POSITIVE);
    let (queries, points) = (Rows::queries(queries, scale), Rows::points(points, scale));
    let all: Vec<u32> = (0..queries.count as u32).collect();
    if points.count < FEW {
        return dense::nearest(&queries, &all, &points);
    }
    let patches = Patches::new(&points);
    let mut res: Vec<u32> = all
        .par_chunks(QUERIES)
        .flat_map_iter(|chunk| {
            Arch::new().dispatch(Search {
                queries: &queries,
                chunk,
                points: &points,
                patches: &patches,
            })
        })
        .collect();
    let open: Vec<u32> = all.into_iter().filter(|&it| res[it as usize] == OPEN).collect();
    for (query, nearest) in open.iter().zip(dense::nearest(&queries, &open, &points)) {
        res[*query as usize] = nearest;
    }
    res
}

/// Stands for the nearest point of a query to which too many patches remain.
const OPEN: u32 = u32::MAX;

/// The search among patches, compiled for every vector width that the processor may have.
struct Search<'a> {
    queries: &'a Rows,
    /// Consecutive queries.
    chunk: &'a [u32],
    points: &'a Rows,
    patches: &'a Patches,
}

impl WithSimd for Search<'_> {
    type Output = Vec<u32>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Vec<u32> {
        let range = self.chunk[0] as usize..self.chunk[0] as usize + self.chunk.len();
        let mut scores = Mat::zeros(self.patches.count(), range.len());
        self.patches.center_scores(scores.as_mut(), self.queries.columns(range.clone()));
        let mut left = Vec::with_capacity(self.patches.count());
        // Loops, since closures would be compiled for the smallest width.
        let mut res = Vec::with_capacity(range.len());
        for (index, query) in range.enumerate() {
            let scores = scores.col_as_slice(index);
            res.push(self.nearest(query, scores, &mut left));
        }
        res
    }
}

impl Search<'_> {
    /// The point nearest to a query, given the scores of all centers, or [`OPEN`].
    #[inline(always)]
    fn nearest(&self, query: usize, center_scores: &[f32], left: &mut Vec<u32>) -> u32 {
        let (row, slack) =
            (self.queries.single_row(query), slack(self.queries, query, self.points));
        let mut best = Best::new();
        let first = first_minimum(center_scores);
        self.compare(first, row, f32::INFINITY, slack, &mut best);
        let square = self.queries.squares[query] + slack;
        let bound = (best.score + square).max(0.0);
        self.remaining(query, center_scores, bound + slack, left);
        if left.len() * PART_OF_PATCHES > self.patches.count() {
            return OPEN;
        }
        let rest = square - self.patches.head_square(row) + slack;
        for &patch in left.iter() {
            if patch as usize != first {
                let limit = best.score + rest;
                self.compare(patch as usize, row, limit, slack, &mut best);
            }
        }
        best.nearest(self.queries.row(query), self.points, slack)
    }

    /// Compares the points of a patch, if the score of one by its first coordinates is within a limit.
    #[inline(always)]
    fn compare(&self, patch: usize, row: &[f32], limit: f32, slack: f32, best: &mut Best) {
        let head = self.patches.head_scores(patch, row);
        if minimum(&head) <= limit {
            let scores = self.patches.scores(patch, row, &head);
            best.compare(&scores, slack, |lane| self.patches.members(patch)[lane]);
        }
    }

    /// Lists the patches that may hold a point within the root of `bound`.
    ///
    /// The center at the distance `c` from the query and the radius `r` must satisfy
    /// `c <= sqrt(bound) + r`, which squared is linear in the center's score.
    #[inline(always)]
    fn remaining(&self, query: usize, center_scores: &[f32], bound: f32, left: &mut Vec<u32>) {
        let (double_root, limit) = (2.0 * bound.sqrt(), bound - self.queries.squares[query]);
        left.clear();
        for (patch, (score, radius)) in center_scores.iter().zip(self.patches.radii()).enumerate() {
            if score - radius * (radius + double_root) <= limit {
                left.push(patch as u32);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::numerics::random::Random;

    fn random(n_rows: usize, dim: usize, seed: u64) -> Mat<f64> {
        let mut random = Random::new(seed);
        Mat::from_fn(n_rows, dim, |_, _| random.uniform() - 0.5)
    }

    fn by_definition(queries: &Mat<f64>, points: &Mat<f64>) -> Vec<u32> {
        let distance = |i: usize, j: usize| (queries.row(i) - points.row(j)).squared_norm_l2();
        let nearest = |i: usize| {
            (0..points.nrows()).min_by(|&a, &b| distance(i, a).total_cmp(&distance(i, b))).unwrap()
        };
        (0..queries.nrows()).map(|i| nearest(i) as u32).collect()
    }

    #[test]
    fn blocks_answer_as_the_definition_does() {
        for (n, m, dim) in [(1, 1, 1), (300, 1100, 20), (70, 513, 120)] {
            let (queries, points) = (random(n, dim, 1), random(m, dim, 2));
            let found = nearest_rows(queries.as_ref(), points.as_ref());
            assert_eq!(found, by_definition(&queries, &points), "{n} x {m} x {dim}");
        }
    }

    /// Monomials of points on a curved surface, as eigenfunctions are: most patches are passed over.
    #[test]
    fn patches_answer_as_the_definition_does() {
        let embedded = |n: usize, seed: u64| {
            let plane = random(n, 2, seed);
            Mat::from_fn(n, 30, |row, column| {
                let (x, y) = (3.0 * plane[(row, 0)], 3.0 * plane[(row, 1)]);
                (x * (column % 6) as f64).sin() + (y * (column / 6) as f64).cos()
            })
        };
        for (n, m) in [(600, 2000), (40, 257), (300, 4099)] {
            let (queries, points) = (embedded(n, 11), embedded(m, 12));
            let found = nearest_rows(queries.as_ref(), points.as_ref());
            assert_eq!(found, by_definition(&queries, &points), "{n} x {m}");
            let (queries, points) = (random(n, 3, 13), random(m, 3, 14));
            let found = nearest_rows(queries.as_ref(), points.as_ref());
            assert_eq!(found, by_definition(&queries, &points), "{n} x {m} in space");
        }
    }

    #[test]
    fn points_at_one_place_are_patches_as_well() {
        let points = Mat::from_fn(700, 9, |_, column| column as f64);
        let queries = random(20, 9, 15);
        assert_eq!(nearest_rows(queries.as_ref(), points.as_ref()), [0; 20]);
        assert_eq!(nearest_rows(points.as_ref(), points.as_ref()), [0; 700]);
    }

    #[test]
    fn differences_below_single_precision_count() {
        let dim = 40;
        let center = random(1, dim, 3);
        // Every point is the query plus a step; the steps differ by far less than 2^-24.
        let points = Mat::from_fn(900, dim, |row, column| {
            let step = if column == 0 { 1e-3 + 1e-12 * ((row * 577) % 900) as f64 } else { 0.0 };
            center[(0, column)] + step
        });
        assert_eq!(nearest_rows(center.as_ref(), points.as_ref()), [0]);
        let turned = Mat::from_fn(900, dim, |row, column| points[(899 - row, column)]);
        assert_eq!(nearest_rows(center.as_ref(), turned.as_ref()), [899]);
    }

    #[test]
    fn of_equal_points_the_first_is_taken() {
        let one = random(1, 30, 4);
        let points = Mat::from_fn(1500, 30, |row, column| {
            if row % 600 == 7 { one[(0, column)] } else { 2.0 + row as f64 }
        });
        assert_eq!(nearest_rows(one.as_ref(), points.as_ref()), [7]);
    }

    #[test]
    fn the_scale_does_not_matter() {
        let (queries, points) = (random(50, 25, 5), random(400, 25, 6));
        let expected = nearest_rows(queries.as_ref(), points.as_ref());
        for scale in [1e-150, 1e150] {
            let (q, p) = (&queries * faer::Scale(scale), &points * faer::Scale(scale));
            assert_eq!(nearest_rows(q.as_ref(), p.as_ref()), expected, "at {scale:e}");
        }
    }

    #[test]
    fn one_thread_and_three_find_the_same() {
        let (queries, points) = (random(700, 60, 7), random(900, 60, 8));
        let run = |n_threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
            pool.install(|| nearest_rows(queries.as_ref(), points.as_ref()))
        };
        assert_eq!(run(1), run(3));
    }
}
