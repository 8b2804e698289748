//! Nearest rows among points of tens to hundreds of dimensions.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};
use rayon::prelude::*;

/// Queries that one task answers, and points that it compares at a time: the scores of a block
/// (512 KiB) stay in the processor's cache. Fixed, so that results do not depend on threads.
const QUERIES: usize = 256;
const POINTS: usize = 512;

/// For every row of `queries` (`n x d`), the index of the nearest row of `points` (`m x d`).
///
/// Exact: distances are compared in double precision, and of equally near points the one with the
/// smallest index is taken. Single-precision products `|p|^2 - 2 q.p` of whole blocks leave a few
/// candidates for every query, namely all that may be nearest given a bound of the rounding errors.
/// Trees do not help at these dimensions.
///
/// # Panics
/// If there are no points or the dimensions differ.
pub fn nearest_rows(queries: MatRef<'_, f64>, points: MatRef<'_, f64>) -> Vec<u32> {
    assert!(points.nrows() > 0, "there must be points to be near to");
    assert_eq!(queries.ncols(), points.ncols(), "one dimension of queries and points");
    // Large numbers of either sign would leave the range of single precision.
    let scale = 1.0 / largest(queries).max(largest(points)).max(f64::MIN_POSITIVE);
    let queries = Rows::new(queries, scale);
    let points = Rows::new(points, scale);
    let longest = points.squares.iter().fold(0.0f32, |a, &b| a.max(b));
    let n_tasks = queries.count.div_ceil(QUERIES);
    let tasks = (0..n_tasks).into_par_iter().map(|task| {
        let first = task * QUERIES;
        nearest_of_block(&queries, first..queries.count.min(first + QUERIES), &points, longest)
    });
    tasks.flatten_iter().collect()
}

fn largest(matrix: MatRef<'_, f64>) -> f64 {
    matrix.norm_max()
}

/// Points row by row, in both precisions.
struct Rows {
    count: usize,
    dim: usize,
    exact: Vec<f64>,
    single: Vec<f32>,
    /// Squared lengths.
    squares: Vec<f32>,
}

impl Rows {
    fn new(matrix: MatRef<'_, f64>, scale: f64) -> Self {
        let (count, dim) = (matrix.nrows(), matrix.ncols());
        let mut exact = vec![0.0; count * dim];
        for column in 0..dim {
            for (row, value) in matrix.col(column).iter().enumerate() {
                exact[row * dim + column] = value * scale;
            }
        }
        let single = exact.iter().map(|&it| it as f32).collect();
        let square = |row: usize| exact[row * dim..(row + 1) * dim].iter().map(|it| it * it).sum();
        let squares = (0..count)
            .map(|row| {
                let it: f64 = square(row);
                it as f32
            })
            .collect();
        Self { count, dim, exact, single, squares }
    }

    fn row(&self, row: usize) -> &[f64] {
        &self.exact[row * self.dim..(row + 1) * self.dim]
    }

    /// Rows as the columns of a `d x n` matrix.
    fn columns(&self, range: std::ops::Range<usize>) -> MatRef<'_, f32> {
        let slice = &self.single[range.start * self.dim..range.end * self.dim];
        MatRef::from_column_major_slice(slice, self.dim, range.len())
    }
}

/// What is known of one query so far.
struct Best {
    /// The smallest score seen.
    score: f32,
    /// Points, ascending, whose score was within the error bound of the smallest at their time.
    candidates: Vec<(u32, f32)>,
}

fn nearest_of_block(
    queries: &Rows,
    range: std::ops::Range<usize>,
    points: &Rows,
    longest: f32,
) -> impl Iterator<Item = u32> + use<> {
    let mut best: Vec<Best> =
        range.clone().map(|_| Best { score: f32::INFINITY, candidates: Vec::new() }).collect();
    let slack: Vec<f32> = range.clone().map(|it| slack(queries, it, longest)).collect();
    let mut scores = Mat::<f32>::zeros(POINTS.min(points.count), range.len());
    for first in (0..points.count).step_by(POINTS) {
        let block = first..points.count.min(first + POINTS);
        let mut scores = scores.as_mut().subrows_mut(0, block.len());
        let (p, q) = (points.columns(block.clone()), queries.columns(range.clone()));
        matmul(scores.as_mut(), Accum::Replace, p.transpose(), q, -2.0, Par::Seq);
        for (query, best) in best.iter_mut().enumerate() {
            let products = scores.as_mut().col_mut(query).try_as_col_major_mut();
            let scores = products.expect("columns are contiguous").as_slice_mut();
            for (score, square) in scores.iter_mut().zip(&points.squares[block.clone()]) {
                *score += square;
            }
            let least = minimum(scores);
            if least > best.score + slack[query] {
                continue;
            }
            best.score = best.score.min(least);
            let limit = best.score + slack[query];
            let near = scores.iter().enumerate().filter(|it| *it.1 <= limit);
            best.candidates.extend(near.map(|(index, &score)| ((first + index) as u32, score)));
        }
    }
    let rows: Vec<u32> = best
        .into_iter()
        .zip(range)
        .zip(slack)
        .map(|((best, query), slack)| refine(queries.row(query), points, &best, slack))
        .collect();
    rows.into_iter()
}

/// Twice a bound of the rounding error of any score of a query, given the longest point's square.
///
/// In units `u = 2^-24`: rounding of both factors and a sum of `d` products in any order give
/// `(d + 2) u |q| |p|`, doubled by the factor two; the square and the last sum give
/// `3 u |p|^2 + 2 u |q| |p|`.
fn slack(queries: &Rows, query: usize, longest: f32) -> f32 {
    let unit = f64::from(f32::EPSILON) / 2.0;
    let product = f64::from(longest).sqrt() * f64::from(queries.squares[query]).sqrt();
    let error = unit * ((2.0 * queries.dim as f64 + 8.0) * product + 4.0 * f64::from(longest));
    (2.0 * error) as f32
}

/// The smallest score, in sixteen interleaved minima that become vector instructions.
fn minimum(scores: &[f32]) -> f32 {
    let less = |a: f32, b: f32| if b < a { b } else { a };
    let (blocks, rest) = scores.as_chunks::<16>();
    let mut lanes = [f32::INFINITY; 16];
    for block in blocks {
        for lane in 0..16 {
            lanes[lane] = less(lanes[lane], block[lane]);
        }
    }
    lanes.iter().chain(rest).fold(f32::INFINITY, |a, &b| less(a, b))
}

/// The nearest of the candidates in double precision; they ascend, so ties go to the smallest index.
fn refine(query: &[f64], points: &Rows, best: &Best, slack: f32) -> u32 {
    let limit = best.score + slack;
    let mut nearest = (0, f64::INFINITY);
    for &(index, _) in best.candidates.iter().filter(|it| it.1 <= limit) {
        let point = points.row(index as usize);
        let distance = query.iter().zip(point).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
        if distance < nearest.1 {
            nearest = (index, distance);
        }
    }
    nearest.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::random::Random;

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
