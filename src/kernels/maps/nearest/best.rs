//! The nearest point of a query so far, and what may still turn out to be it.

use super::rows::Rows;

/// What is known of one query so far.
pub struct Best {
    /// The smallest score `|p|^2 - 2 q.p` seen.
    pub score: f32,
    /// Points whose score was within the error bound of the smallest at their time.
    candidates: Vec<(u32, f32)>,
}

impl Best {
    pub fn new() -> Self {
        Self { score: f32::INFINITY, candidates: Vec::new() }
    }

    /// Takes the scores of some points, of which `point` tells the index.
    #[inline(always)]
    pub fn compare(&mut self, scores: &[f32], slack: f32, point: impl Fn(usize) -> u32) {
        let least = minimum(scores);
        if least > self.score + slack {
            return;
        }
        self.score = self.score.min(least);
        let limit = self.score + slack;
        for (index, &score) in scores.iter().enumerate() {
            if score <= limit {
                self.candidates.push((point(index), score));
            }
        }
    }

    /// The nearest of the candidates in double precision; of equally near ones the smallest index.
    pub fn nearest(&self, query: &[f64], points: &Rows, slack: f32) -> u32 {
        let limit = self.score + slack;
        let mut nearest = (0, f64::INFINITY);
        for &(index, _) in self.candidates.iter().filter(|it| it.1 <= limit) {
            let point = points.row(index as usize);
            let distance = query.iter().zip(point).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
            if distance < nearest.1 || distance == nearest.1 && index < nearest.0 {
                nearest = (index, distance);
            }
        }
        nearest.0
    }
}

/// Twice a bound of the rounding error of any score of a query.
///
/// In units `u = 2^-24`, for the longest point `p`: rounding of both factors and a sum of `d + 1`
/// products in any order give `(d + 3) u (|q| |p| + |p|^2 / 2)`, doubled by the factor two; what is
/// done with the score and `|q|^2` later, a few `u` of both.
pub fn slack(queries: &Rows, query: usize, points: &Rows) -> f32 {
    let unit = f64::from(f32::EPSILON) / 2.0;
    let (longest, square) = (f64::from(points.longest), f64::from(queries.squares[query]));
    let product = longest.sqrt() * square.sqrt();
    let terms = queries.dim as f64 + 4.0;
    let error = unit * (terms * (2.0 * product + longest) + 8.0 * (longest + square));
    (2.0 * error) as f32
}

/// The smallest score, in sixteen interleaved minima that become vector instructions.
#[inline(always)]
pub fn minimum(scores: &[f32]) -> f32 {
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

/// The first place of the smallest score.
#[inline(always)]
pub fn first_minimum(scores: &[f32]) -> usize {
    let least = minimum(scores);
    scores.iter().position(|&it| it == least).unwrap_or(0)
}
