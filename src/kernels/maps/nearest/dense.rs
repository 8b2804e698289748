//! All points compared with all queries.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::{QUERIES, best::Best, best::slack, rows::Rows};

/// Points that are compared at a time: their scores (512 KiB) stay in the processor's cache.
const POINTS: usize = 512;

/// For each of some queries, the index of the nearest point.
pub fn nearest(queries: &Rows, chosen: &[u32], points: &Rows) -> Vec<u32> {
    chosen.par_chunks(QUERIES).flat_map_iter(|it| nearest_of_block(queries, it, points)).collect()
}

fn nearest_of_block(queries: &Rows, chosen: &[u32], points: &Rows) -> Vec<u32> {
    let gathered: Vec<f32> =
        chosen.iter().flat_map(|&it| queries.single_row(it as usize)).copied().collect();
    let gathered = MatRef::from_column_major_slice(&gathered, queries.dim + 1, chosen.len());
    let slack: Vec<f32> = chosen.iter().map(|&it| slack(queries, it as usize, points)).collect();
    let mut best: Vec<Best> = chosen.iter().map(|_| Best::new()).collect();
    let mut scores = Mat::<f32>::zeros(POINTS.min(points.count), chosen.len());
    for first in (0..points.count).step_by(POINTS) {
        let block = first..points.count.min(first + POINTS);
        let mut scores = scores.as_mut().subrows_mut(0, block.len());
        let rows = points.columns(block).transpose();
        matmul(scores.as_mut(), Accum::Replace, rows, gathered, -2.0, Par::Seq);
        let scores = scores.as_ref();
        Arch::new().dispatch(Compare { best: &mut best, slack: &slack, scores, first });
    }
    let found = best.iter().zip(chosen).zip(slack);
    found
        .map(|((best, &it), slack)| best.nearest(queries.row(it as usize), points, slack))
        .collect()
}

/// Takes the scores of a block, compiled for every vector width that the processor may have.
struct Compare<'a> {
    best: &'a mut [Best],
    slack: &'a [f32],
    /// Points by queries.
    scores: MatRef<'a, f32>,
    /// The first point.
    first: usize,
}

impl WithSimd for Compare<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for (query, best) in self.best.iter_mut().enumerate() {
            let scores = self.scores.col(query).try_as_col_major();
            let scores = scores.expect("columns are contiguous").as_slice();
            best.compare(scores, self.slack[query], |index| (self.first + index) as u32);
        }
    }
}
