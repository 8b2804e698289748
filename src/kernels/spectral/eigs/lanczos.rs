//! Block Lanczos on the inverse of the shifted matrix.

use super::factor::ShiftedFactor;
use super::{Observer, Phase};
use crate::kernels::numerics::random::Random;
use crate::kernels::numerics::tall;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{cholesky_in_place, cholesky_in_place_scratch};
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::reborrow::ReborrowMut;
use faer::{Mat, MatMut, MatRef, Par};

/// Vectors of a block. Larger ones need fewer passes over the factor but a larger space.
pub(super) const BLOCK: usize = 4;
/// Blocks between two orthogonalizations against the whole space, at first.
const EVERY: usize = 4;

/// A growing Krylov space of `(B - shift)^-1`, which the eigenvectors nearest to the shift enter
/// first.
///
/// New blocks are made orthogonal to the two before them, which is enough in exact arithmetic, and
/// to the whole space only every few steps: inner products up to the root of the rounding unit do
/// not harm the projected problem (semi-orthogonality: Simon 1984; by pairs of blocks: Grimes,
/// Lewis & Simon 1994).
pub(super) struct Lanczos<'a> {
    factor: &'a ShiftedFactor,
    /// Orthonormal columns; the last block is yet to be multiplied. The rest is room to grow.
    space: Mat<f64>,
    /// `space^T (B - shift)^-1 space`, as far as it is known: `n_done` columns.
    projected: Mat<f64>,
    n_done: usize,
    /// The triangle that couples the last block to those before.
    coupling: Mat<f64>,
    n_since_full: usize,
    every: usize,
    panel: Vec<[f64; BLOCK]>,
    random: Random,
    observer: &'a dyn Observer,
}

/// Approximate eigenpairs of `(B - shift)^-1`.
pub(super) struct RitzPairs {
    /// Ascending.
    inverses: Vec<f64>,
    coefficients: Mat<f64>,
    /// `coupling * (last rows of coefficients)`: the part of the residual in the next block.
    residuals: Mat<f64>,
    shift: f64,
}

impl<'a> Lanczos<'a> {
    /// Starts from a random block, with room for `capacity` columns.
    pub fn new(factor: &'a ShiftedFactor, capacity: usize, observer: &'a dyn Observer) -> Self {
        let capacity = capacity.max(2 * BLOCK);
        let mut res = Self {
            factor,
            space: Mat::zeros(factor.n(), capacity),
            projected: Mat::zeros(capacity, capacity),
            n_done: 0,
            coupling: Mat::zeros(BLOCK, BLOCK),
            n_since_full: 0,
            every: EVERY,
            panel: vec![],
            random: Random::new(1),
            observer,
        };
        observer.enter(Phase::Orthogonalization);
        let mut start = Mat::from_fn(factor.n(), BLOCK, |_, _| res.random.uniform() - 0.5);
        res.orthonormalize(start.as_mut(), 0);
        res.space.subcols_mut(0, BLOCK).copy_from(&start);
        res
    }

    /// The number of right-hand sides that were solved for.
    pub fn n_solves(&self) -> usize {
        self.n_done
    }

    /// Enlarges the space until the `n_wanted` pairs nearest to the shift have residuals
    /// `|B x - lambda x| <= tolerance lambda_last`; `None` if the space becomes as large as the
    /// matrix before.
    pub fn converge(&mut self, n_wanted: usize, tolerance: f64) -> Option<RitzPairs> {
        let mut next_check = (2 * n_wanted).max(n_wanted + 8 * BLOCK);
        let mut last: Option<(usize, f64)> = None;
        loop {
            while self.n_done < next_check {
                if self.n_done + 2 * BLOCK > self.space.nrows() {
                    return None;
                }
                self.step();
            }
            let pairs = self.ritz_pairs();
            let error = pairs.largest_residual(n_wanted) / tolerance;
            if error <= 1.0 {
                return Some(pairs);
            }
            let guess = steps_to_go(last, (self.n_done, error));
            last = Some((self.n_done, error));
            let n_missing = guess.unwrap_or(0.1 * n_wanted as f64);
            let most = (n_wanted / 3).max(4 * BLOCK) as f64;
            next_check = self.n_done + n_missing.clamp(1.0, most) as usize;
        }
    }

    /// Multiplies the last block and makes the next one of what is new in the result.
    fn step(&mut self) {
        let m = self.n_done;
        self.reserve(m + 2 * BLOCK);
        self.observer.enter(Phase::Solves);
        let (done, mut next) = self.space.as_mut().split_at_col_mut(m + BLOCK);
        let right = done.subcols(m, BLOCK);
        self.factor.solve::<BLOCK>(
            right.as_ref(),
            next.rb_mut().subcols_mut(0, BLOCK),
            &mut self.panel,
        );

        self.observer.enter(Phase::Orthogonalization);
        let mut block = self.space.subcols(m + BLOCK, BLOCK).to_owned();
        let first = m.saturating_sub(BLOCK);
        let products = remove(block.as_mut(), self.space.subcols(first, m + BLOCK - first));
        for col in 0..BLOCK {
            for row in 0..=col {
                let product = products[(m - first + row, col)];
                self.projected[(m + row, m + col)] = product;
                self.projected[(m + col, m + row)] = product;
            }
        }
        self.coupling = self.orthonormalize(block.as_mut(), m + BLOCK);
        self.n_since_full += 1;
        if self.n_since_full >= self.every && m > 0 {
            self.orthogonalize_fully(block.as_mut());
        }
        for col in 0..BLOCK {
            for row in 0..=col {
                let entry = self.coupling[(row, col)];
                self.projected[(m + BLOCK + row, m + col)] = entry;
                self.projected[(m + col, m + BLOCK + row)] = entry;
            }
        }
        self.space.subcols_mut(m + BLOCK, BLOCK).copy_from(&block);
        self.n_done += BLOCK;
    }

    /// Makes the last two blocks orthogonal to all before them: one alone would be spoilt again by
    /// the other in the next step.
    fn orthogonalize_fully(&mut self, mut block: MatMut<'_, f64>) {
        let m = self.n_done;
        let n_rows = self.space.nrows();
        let mut both = Mat::zeros(n_rows, 2 * BLOCK);
        both.subcols_mut(0, BLOCK).copy_from(self.space.subcols(m, BLOCK));
        both.subcols_mut(BLOCK, BLOCK).copy_from(block.as_ref());
        let lost = remove(both.as_mut(), self.space.subcols(0, m)).norm_max();
        // Less often while nothing is lost; the aim is well below the root of the rounding unit.
        if lost > 1e-9 {
            self.every = (self.every - 1).max(1);
        } else if lost < 1e-11 {
            self.every = (self.every + 1).min(4 * EVERY);
        }
        self.n_since_full = 0;
        self.orthonormalize(both.subcols_mut(0, BLOCK), m);
        self.space.subcols_mut(m, BLOCK).copy_from(both.subcols(0, BLOCK));
        block.copy_from(both.subcols(BLOCK, BLOCK));
        remove(block.rb_mut(), self.space.subcols(m, BLOCK));
        let triangle = self.orthonormalize(block, m + BLOCK);
        self.coupling = tall::small_product(triangle.as_ref(), self.coupling.as_ref());
    }

    /// Replaces a block by orthonormal columns, returns the upper triangle that gives it back.
    ///
    /// Cholesky's factor of the Gram matrix, twice if the first is inaccurate. Where the block has
    /// not its full rank (an invariant space is exhausted), random columns orthogonal to the first
    /// `n_columns` of the space fill it up.
    fn orthonormalize(&mut self, mut block: MatMut<'_, f64>, n_columns: usize) -> Mat<f64> {
        let Some((triangle, conditioning)) = cholesky_qr(block.rb_mut()) else {
            return self.fill_up(block, n_columns);
        };
        if conditioning > 0.1 {
            return triangle;
        }
        match cholesky_qr(block.rb_mut()) {
            Some((second, _)) => tall::small_product(second.as_ref(), triangle.as_ref()),
            None => self.fill_up(block, n_columns),
        }
    }

    /// Gram-Schmidt by columns; a column without anything new is replaced by a random one.
    fn fill_up(&mut self, mut block: MatMut<'_, f64>, n_columns: usize) -> Mat<f64> {
        let original = block.as_ref().to_owned();
        for col in 0..BLOCK {
            let mut column = block.as_ref().subcols(col, 1).to_owned();
            loop {
                let size = column.norm_l2();
                for _ in 0..2 {
                    remove(column.as_mut(), self.space.subcols(0, n_columns));
                    remove(column.as_mut(), block.as_ref().subcols(0, col));
                }
                let rest = column.norm_l2();
                if rest > 1e-8 * size {
                    column *= faer::Scale(1.0 / rest);
                    break;
                }
                column = Mat::from_fn(block.nrows(), 1, |_, _| self.random.uniform() - 0.5);
            }
            block.rb_mut().subcols_mut(col, 1).copy_from(&column);
        }
        let mut triangle = tall::inner_products(block.as_ref(), original.as_ref());
        for col in 0..BLOCK {
            for row in col + 1..BLOCK {
                triangle[(row, col)] = 0.0;
            }
        }
        triangle
    }

    /// Makes room for columns, by half of what there is.
    fn reserve(&mut self, n_columns: usize) {
        let capacity = self.space.ncols();
        if n_columns > capacity {
            let grown = n_columns.max(capacity + capacity / 2);
            self.space.resize_with(self.space.nrows(), grown, |_, _| 0.0);
            self.projected.resize_with(grown, grown, |_, _| 0.0);
        }
    }

    /// Solves the projected problem.
    fn ritz_pairs(&mut self) -> RitzPairs {
        self.observer.enter(Phase::SmallEigenproblems);
        let m = self.n_done;
        let last = m - BLOCK;
        let small = self.projected.submatrix(0, 0, m, m);
        let (inverses, coefficients) =
            tall::symmetric_eigen(small).expect("the projected matrix is finite");
        let last_rows = coefficients.subrows(last, BLOCK);
        let residuals = tall::small_product(self.coupling.as_ref(), last_rows);
        RitzPairs { inverses, residuals, coefficients, shift: self.factor.shift }
    }

    /// The eigenvalues of `B` nearest above the shift, ascending, and their vectors as columns.
    ///
    /// The vectors are Ritz vectors after one more multiplication, which costs no solve: with
    /// `A = (B - shift)^-1` and `A x = theta x + r`, the vector `x + r / theta` is `A x / theta`.
    /// It has the residual `r / theta^2` with respect to `B` (Nour-Omid et al. 1987).
    pub fn eigenpairs(&self, pairs: &RitzPairs, n_wanted: usize) -> (Vec<f64>, Mat<f64>) {
        self.observer.enter(Phase::RitzVectors);
        let m = pairs.inverses.len();
        let coefficients = Mat::from_fn(m + BLOCK, n_wanted, |row, col| {
            let pair = m - 1 - col;
            if row < m {
                pairs.coefficients[(row, pair)]
            } else {
                pairs.residuals[(row - m, pair)] / pairs.inverses[pair]
            }
        });
        let vectors = tall::product(self.space.subcols(0, m + BLOCK), coefficients.as_ref());
        let eigenvalues =
            pairs.inverses.iter().rev().take(n_wanted).map(|it| pairs.shift + 1.0 / it).collect();
        (eigenvalues, vectors)
    }
}

impl RitzPairs {
    /// The largest `|B x - lambda x|` of the pairs nearest to the shift, in parts of the largest of
    /// their eigenvalues' distances from the shift.
    fn largest_residual(&self, n_wanted: usize) -> f64 {
        let m = self.inverses.len();
        let Some(first) = m.checked_sub(n_wanted) else { return f64::INFINITY };
        if self.inverses[first] <= 0.0 {
            return f64::INFINITY;
        }
        let residual = |pair: usize| {
            self.residuals.col(pair).norm_l2() / (self.inverses[pair] * self.inverses[pair])
        };
        (first..m).map(residual).fold(0.0, f64::max) * self.inverses[first]
    }
}

/// Removes from a block what lies in the span of orthonormal columns; returns the inner products.
fn remove(block: MatMut<'_, f64>, space: MatRef<'_, f64>) -> Mat<f64> {
    let products = tall::inner_products(space, block.as_ref());
    tall::add_product(block, space, products.as_ref(), -1.0);
    products
}

/// Extrapolates the logarithm of the residual (in tolerances) over the size of the space; a little
/// less, since convergence becomes faster.
fn steps_to_go(last: Option<(usize, f64)>, now: (usize, f64)) -> Option<f64> {
    let (last_size, last_error) = last.filter(|it| it.1.is_finite())?;
    let slope = (now.1 / last_error).ln() / (now.0 - last_size) as f64;
    (slope < 0.0).then(|| -0.95 * now.1.ln() / slope)
}

/// `Q` in place and `R`; also the least ratio of a diagonal entry of `R` to its column.
/// `None` if the columns are numerically dependent.
fn cholesky_qr(block: MatMut<'_, f64>) -> Option<(Mat<f64>, f64)> {
    let gram = tall::inner_products(block.as_ref(), block.as_ref());
    let mut lower = gram.clone();
    let scratch = cholesky_in_place_scratch::<f64>(BLOCK, Par::Seq, Default::default());
    let mut memory = MemBuffer::new(scratch);
    let (regularization, stack) = (Default::default(), MemStack::new(&mut memory));
    cholesky_in_place(lower.as_mut(), regularization, Par::Seq, stack, Default::default()).ok()?;
    for col in 1..BLOCK {
        lower.col_mut(col).subrows_mut(0, col).fill(0.0);
    }
    let ratio = |it: usize| lower[(it, it)] / gram[(it, it)].sqrt();
    let conditioning = (0..gram.nrows()).map(ratio).fold(f64::INFINITY, f64::min);
    // Not `<=`, which would let pass what is not a number.
    if !(conditioning > 1e-6) {
        return None;
    }
    tall::for_each_chunk(block, |_, chunk| {
        solve_lower_triangular_in_place(lower.as_ref(), chunk.transpose_mut(), Par::Seq);
    });
    Some((lower.transpose().to_owned(), conditioning))
}
