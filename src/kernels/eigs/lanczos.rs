//! Block Lanczos on the inverse of the shifted matrix.

use super::factor::{PANEL, ShiftedFactor};
use super::{Observer, Phase};
use crate::kernels::random::Random;
use crate::kernels::tall;
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::reborrow::ReborrowMut;
use faer::{Mat, MatMut, Par, Side};

/// A growing Krylov space of `(B - shift)^-1`, which the eigenvalues nearest to the shift enter
/// first, from both sides (Grimes, Lewis & Simon 1994).
pub(super) struct Lanczos<'a> {
    factor: &'a ShiftedFactor,
    n_block: usize,
    /// Orthonormal columns: what is known beforehand, then blocks; the last block is yet to be
    /// multiplied. The rest is room to grow.
    space: Mat<f64>,
    /// `space^T (B - shift)^-1 space`, as far as it is known: `n_done` columns.
    projected: Mat<f64>,
    n_done: usize,
    /// The triangle that couples the last block to those before.
    coupling: Mat<f64>,
    n_solves: usize,
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
    /// Starts from a random block; `known` is a unit eigenvector with the eigenvalue zero.
    pub fn new(
        factor: &'a ShiftedFactor,
        known: Option<&[f64]>,
        n_block: usize,
        capacity: usize,
        seed: u64,
        observer: &'a dyn Observer,
    ) -> Self {
        let n = factor.n();
        let n_known = usize::from(known.is_some());
        let capacity = capacity.max(n_known + 2 * n_block);
        let mut res = Self {
            factor,
            n_block,
            space: Mat::zeros(n, capacity),
            projected: Mat::zeros(capacity, capacity),
            n_done: n_known,
            coupling: Mat::zeros(n_block, n_block),
            n_solves: 0,
            random: Random::new(seed),
            observer,
        };
        observer.enter(Phase::Orthogonalization);
        if let Some(known) = known {
            res.space.col_mut(0).iter_mut().zip(known).for_each(|(to, from)| *to = *from);
            res.projected[(0, 0)] = -1.0 / factor.shift;
        }
        let mut start = res.random_block();
        res.remove_space(start.as_mut(), n_known);
        res.orthonormalize(start.as_mut(), n_known);
        res.space.subcols_mut(n_known, n_block).copy_from(&start);
        res
    }

    pub fn n_solves(&self) -> usize {
        self.n_solves
    }

    /// Enlarges the space until the `n_below` pairs next below the shift and the `n_above` next
    /// above it have residuals `|B x - lambda x| <= tolerance`; `None` if the space becomes as large
    /// as the matrix before.
    pub fn converge(
        &mut self,
        n_below: usize,
        n_above: usize,
        tolerance: f64,
    ) -> Option<RitzPairs> {
        let n_wanted = n_below + n_above;
        let mut next_check = self.n_done.max((19 * n_wanted).div_ceil(10) + 2 * self.n_block);
        let mut last: Option<(usize, f64)> = None;
        loop {
            while self.n_done < next_check {
                if self.n_done + 2 * self.n_block > self.space.nrows() {
                    return None;
                }
                self.step();
            }
            let pairs = self.ritz_pairs();
            let error = pairs.largest_residual(n_below, n_above);
            if error <= tolerance {
                return Some(pairs);
            }
            let n_missing = steps_to_go(last, (self.n_done, error), tolerance)
                .unwrap_or(n_wanted as f64 * 0.12)
                .clamp(1.0, (n_wanted as f64 / 3.0).max(1.0));
            last = Some((self.n_done, error));
            next_check = self.n_done + n_missing as usize + 1;
        }
    }

    /// Multiplies the last block and makes the next one of what is new in the result.
    fn step(&mut self) {
        let (n_block, n_done) = (self.n_block, self.n_done);
        self.reserve(n_done + 2 * n_block);
        self.observer.enter(Phase::Solves);
        let mut block = Mat::zeros(self.space.nrows(), n_block);
        for begin in (0..n_block).step_by(PANEL) {
            let width = PANEL.min(n_block - begin);
            let right = self.space.subcols(n_done + begin, width);
            self.factor.solve(right, block.subcols_mut(begin, width));
        }
        self.n_solves += n_block;
        self.observer.enter(Phase::Orthogonalization);
        let products = self.remove_space(block.as_mut(), n_done + n_block);
        for col in 0..n_block {
            for row in 0..n_done + col + 1 {
                self.projected[(row, n_done + col)] = products[(row, col)];
                self.projected[(n_done + col, row)] = products[(row, col)];
            }
        }
        self.coupling = self.orthonormalize(block.as_mut(), n_done + n_block);
        self.space.subcols_mut(n_done + n_block, n_block).copy_from(&block);
        self.n_done += n_block;
    }

    /// Removes the first `n_columns` of the space from a block; returns the inner products.
    fn remove_space(&self, block: MatMut<'_, f64>, n_columns: usize) -> Mat<f64> {
        let space = self.space.subcols(0, n_columns);
        let products = tall::inner_products(space, block.as_ref());
        tall::add_product(block, space, products.as_ref(), -1.0);
        products
    }

    /// Replaces a block by orthonormal columns, returns the upper triangle that gives it back.
    ///
    /// Cholesky's factor of the Gram matrix, twice if the first is inaccurate. Where the block has
    /// not its full rank (an invariant space is exhausted), random columns fill it up, and the
    /// triangle has zeros for them.
    fn orthonormalize(&mut self, mut block: MatMut<'_, f64>, n_columns: usize) -> Mat<f64> {
        let Some((triangle, conditioning)) = cholesky_qr(block.rb_mut()) else {
            return self.fill_up(block, n_columns);
        };
        if conditioning > 0.1 {
            return triangle;
        }
        match cholesky_qr(block.rb_mut()) {
            Some((second, _)) => &second * &triangle,
            None => self.fill_up(block, n_columns),
        }
    }

    /// Gram-Schmidt by columns; a column without anything new is replaced by a random one.
    fn fill_up(&mut self, mut block: MatMut<'_, f64>, n_columns: usize) -> Mat<f64> {
        let n_block = block.ncols();
        let original = block.as_ref().to_owned();
        for col in 0..n_block {
            let mut column = block.as_ref().subcols(col, 1).to_owned();
            let mut size = column.norm_l2();
            for attempt in 0.. {
                for _ in 0..2 {
                    self.remove_space(column.as_mut(), n_columns);
                    let before = block.as_ref().subcols(0, col);
                    let products = tall::inner_products(before, column.as_ref());
                    tall::add_product(column.as_mut(), before, products.as_ref(), -1.0);
                }
                let rest = column.norm_l2();
                if rest > 1e-8 * size || attempt > 8 {
                    column = faer::Scale(1.0 / rest) * column;
                    break;
                }
                column = self.random_block().subcols(0, 1).to_owned();
                size = column.norm_l2();
            }
            block.rb_mut().subcols_mut(col, 1).copy_from(&column);
        }
        let mut triangle = tall::inner_products(block.as_ref(), original.as_ref());
        for col in 0..n_block {
            for row in col + 1..n_block {
                triangle[(row, col)] = 0.0;
            }
        }
        triangle
    }

    fn random_block(&mut self) -> Mat<f64> {
        Mat::from_fn(self.space.nrows(), self.n_block, |_, _| self.random.uniform() - 0.5)
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
    fn ritz_pairs(&self) -> RitzPairs {
        self.observer.enter(Phase::SmallEigenproblems);
        let m = self.n_done;
        let small = self.projected.submatrix(0, 0, m, m);
        let decomposition =
            small.self_adjoint_eigen(Side::Lower).expect("the projected matrix is finite");
        let coefficients = decomposition.U().to_owned();
        let last_rows = coefficients.subrows(m - self.n_block, self.n_block);
        RitzPairs {
            inverses: decomposition.S().column_vector().iter().copied().collect(),
            residuals: &self.coupling * last_rows,
            coefficients,
            shift: self.factor.shift,
        }
    }

    /// Eigenvectors of `B` for the pairs `range` of [`RitzPairs::nearest`], as columns.
    ///
    /// They are the Ritz vectors after one more multiplication, which costs no solve: with
    /// `A = (B - shift)^-1` and `A x = theta x + r`, the vector `x + r / theta` is `A x / theta`.
    /// Rounding and what has not converged in it is damped where `B` is large (Nour-Omid et al. 1987).
    pub fn vectors(&self, pairs: &RitzPairs, columns: &[usize]) -> Mat<f64> {
        let m = pairs.inverses.len();
        let coefficients = Mat::from_fn(m + self.n_block, columns.len(), |row, col| {
            let pair = columns[col];
            if row < m {
                pairs.coefficients[(row, pair)]
            } else {
                pairs.residuals[(row - m, pair)] / pairs.inverses[pair]
            }
        });
        tall::product(self.space.subcols(0, m + self.n_block), coefficients.as_ref())
    }
}

impl RitzPairs {
    /// The pair that belongs to the `index`-th eigenvalue below the shift, from the nearest on.
    pub fn below(&self, index: usize) -> usize {
        index
    }

    /// The pair that belongs to the `index`-th eigenvalue above the shift, from the nearest on.
    pub fn above(&self, index: usize) -> usize {
        self.inverses.len() - 1 - index
    }

    pub fn eigenvalue(&self, pair: usize) -> f64 {
        self.shift + 1.0 / self.inverses[pair]
    }

    /// The largest `|B x - lambda x|` of the wanted pairs; infinite if there are not as many yet.
    fn largest_residual(&self, n_below: usize, n_above: usize) -> f64 {
        let n_negative = self.inverses.partition_point(|&it| it < 0.0);
        if n_negative < n_below || self.inverses.len() - n_negative < n_above {
            return f64::INFINITY;
        }
        let below = (0..n_below).map(|it| self.below(it));
        let above = (0..n_above).map(|it| self.above(it));
        let residual = |pair: usize| {
            self.residuals.col(pair).norm_l2() / (self.inverses[pair] * self.inverses[pair])
        };
        below.chain(above).map(residual).fold(0.0, f64::max)
    }
}

/// Extrapolates the logarithm of the residual over the size of the space; a little less, since
/// convergence becomes faster.
fn steps_to_go(last: Option<(usize, f64)>, now: (usize, f64), tolerance: f64) -> Option<f64> {
    let (last_size, last_error) = last.filter(|it| it.1.is_finite())?;
    let slope = (now.1 / last_error).ln() / (now.0 - last_size) as f64;
    (slope < 0.0).then(|| 0.9 * (tolerance / now.1).ln() / slope)
}

/// `Q` in place and `R`; also the least ratio of a diagonal entry of `R` to its column.
/// `None` if the columns are numerically dependent.
fn cholesky_qr(mut block: MatMut<'_, f64>) -> Option<(Mat<f64>, f64)> {
    let gram = tall::inner_products(block.as_ref(), block.as_ref());
    let n_block = gram.nrows();
    let factor = gram.llt(Side::Lower).ok()?;
    let lower = factor.L();
    let ratio = |it: usize| lower[(it, it)] / gram[(it, it)].sqrt();
    let conditioning = (0..n_block).map(ratio).fold(f64::INFINITY, f64::min);
    if !(conditioning > 1e-6) {
        return None;
    }
    let mut inverse = Mat::<f64>::identity(n_block, n_block);
    solve_lower_triangular_in_place(lower, inverse.as_mut(), Par::Seq);
    let copy = block.as_ref().to_owned();
    let product = tall::product(copy.as_ref(), inverse.transpose());
    block.copy_from(&product);
    Some((lower.transpose().to_owned(), conditioning))
}
