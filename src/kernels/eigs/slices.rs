//! Spectrum slicing: a shift for every few dozen eigenvalues.

use super::factor::ShiftedFactor;
use super::lanczos::{Lanczos, RitzPairs};
use super::standard::StandardForm;
use super::{EigsError, Observer, Pairs, Phase};
use crate::kernels::operator::Operator;
use crate::kernels::tall;
use faer::Mat;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Eigenpairs for which one shift is used: fewer cost more factorizations, more cost more
/// orthogonalization, which grows with their square.
const SLICE: usize = 50;
/// Eigenpairs that both of two neighbouring slices compute, half of them on each side.
const OVERLAP: usize = 4;
/// The residual to which pairs converge, in parts of the largest wanted eigenvalue.
const TOLERANCE: f64 = 1e-12;
/// Two slices may part between eigenvalues that differ by this part of the largest.
const PARTABLE: f64 = 1e-6;

/// The `k` smallest eigenpairs of an operator whose graph is connected.
pub(super) fn solve(
    operator: &Operator,
    k: usize,
    observer: &dyn Observer,
) -> Result<Pairs, EigsError> {
    observer.enter(Phase::Ordering);
    let problem = StandardForm::new(operator)?;
    // Blocks grow only if copies of a multiple eigenvalue were missed, which inertia reveals.
    let mut n_block = 8;
    loop {
        match Slicing::new(&problem, k, n_block, observer)?.solve() {
            Err(EigsError::Missed { .. }) if n_block < 32 => n_block *= 2,
            result => return result,
        }
    }
}

struct Slicing<'a> {
    problem: &'a StandardForm,
    k: usize,
    n_block: usize,
    /// By ascending shift.
    factors: Vec<ShiftedFactor>,
    /// The unit eigenvector of the eigenvalue zero, if it is known.
    known: Option<Vec<f64>>,
    n_factors: usize,
    observer: &'a dyn Observer,
}

/// The eigenpairs that were found around one shift.
struct Slice<'a> {
    lanczos: Lanczos<'a>,
    pairs: RitzPairs,
    /// Number of the first eigenvalue, from zero.
    begin: usize,
    n_below: usize,
    n_above: usize,
}

impl<'a> Slicing<'a> {
    fn new(
        problem: &'a StandardForm,
        k: usize,
        n_block: usize,
        observer: &'a dyn Observer,
    ) -> Result<Self, EigsError> {
        let known = problem.kills_constants.then(|| problem.root_mass.clone());
        let mut res = Self { problem, k, n_block, factors: vec![], known, n_factors: 0, observer };
        res.choose_shifts()?;
        Ok(res)
    }

    /// Places shifts so that each has about [`SLICE`] of the wanted eigenvalues around it.
    ///
    /// The last one is searched, beginning with Weyl's law; the others follow from the counts that
    /// every factorization brings.
    fn choose_shifts(&mut self) -> Result<(), EigsError> {
        let n_slices = (self.k as f64 / SLICE as f64).round().max(1.0);
        let per_slice = self.k as f64 / n_slices;
        let target = self.k as f64 - 0.5 * per_slice;
        let mut shift = 4.0 * PI * target;
        let (mut low, mut high) = ((0.0, 0), None);
        let last = loop {
            let factor = self.factor(shift)?;
            let count = factor.n_below;
            let misses = count as f64 - target;
            if misses.abs() <= 0.4 * per_slice || self.n_factors > 40 {
                break factor;
            }
            if misses < 0.0 {
                low = (factor.shift, count);
            } else {
                high = Some((factor.shift, count));
            }
            shift = match high {
                // Counts grow with the shift at least like its root.
                None => factor.shift * (target / count.max(1) as f64).powf(1.3).clamp(1.3, 100.0),
                Some(high) => interpolate(low, high, target, self.n_factors),
            };
        };
        let (shift, count) = (last.shift, last.n_below);
        self.factors.push(last);
        self.fill_gap((0.0, 0), (shift, count), per_slice)?;
        self.factors.sort_by(|a, b| a.shift.total_cmp(&b.shift));
        Ok(())
    }

    /// Adds shifts between two for which the counts are known (the lower end has no factor).
    fn fill_gap(
        &mut self,
        low: (f64, usize),
        high: (f64, usize),
        per_slice: f64,
    ) -> Result<(), EigsError> {
        // Below the first shift, a slice needs half as many, as there is no other on that side.
        let mut ends = vec![low];
        let n_between = ((high.1 - low.1) as f64 / per_slice - 0.5).round().max(0.0) as usize;
        let shifts: Vec<f64> = (0..n_between)
            .map(|it| {
                let target = low.1 as f64 + per_slice * (it as f64 + 0.5);
                low.0 + (high.0 - low.0) * (target - low.1 as f64) / (high.1 - low.1) as f64
            })
            .collect();
        let factors: Vec<_> = shifts.into_par_iter().map(|it| self.try_factor(it)).collect();
        for factor in factors {
            let factor = factor?;
            ends.push((factor.shift, factor.n_below));
            self.factors.push(factor);
            self.n_factors += 1;
        }
        ends.push(high);
        // Where the density is far from even, one more in the middle.
        for (it, pair) in ends.windows(2).enumerate() {
            let allowed = if it == 0 { 1.2 } else { 1.8 } * per_slice;
            let [low, high] = [pair[0], pair[1]];
            if (high.1.min(self.k) - low.1.min(self.k)) as f64 > allowed && self.n_factors < 40 {
                let factor = self.factor(0.5 * (low.0 + high.0))?;
                self.factors.push(factor);
            }
        }
        Ok(())
    }

    fn factor(&mut self, shift: f64) -> Result<ShiftedFactor, EigsError> {
        self.n_factors += 1;
        self.try_factor(shift)
    }

    /// Moves the shift a little where it hits an eigenvalue.
    fn try_factor(&self, shift: f64) -> Result<ShiftedFactor, EigsError> {
        self.observer.enter(Phase::Factorization);
        (0..6)
            .map(|attempt| shift * (1.0 + 0.003 * attempt as f64))
            .find_map(|shift| ShiftedFactor::new(self.problem, shift))
            .ok_or(EigsError::Factorization {
                n_vertices: self.problem.n(),
                shift: shift / self.problem.total_mass,
            })
    }

    fn tolerance(&self) -> f64 {
        TOLERANCE * 4.0 * PI * self.k as f64
    }

    fn solve(&self) -> Result<Pairs, EigsError> {
        let mut slices: Vec<Slice<'_>> = (0..self.factors.len())
            .into_par_iter()
            .filter_map(|it| self.solve_slice(it).transpose())
            .collect::<Result<_, _>>()?;
        let mut cuts = vec![0];
        for it in 1..slices.len() {
            cuts.push(self.cut(&mut slices, it)?);
        }
        cuts.push(self.k);
        self.observer.enter(Phase::RitzVectors);
        let mut eigenvalues = Vec::with_capacity(self.k);
        let mut vectors = Mat::zeros(self.problem.n(), self.k);
        for (slice, cut) in slices.iter().zip(cuts.windows(2)) {
            let columns: Vec<usize> = (cut[0]..cut[1]).map(|it| slice.pair(it)).collect();
            eigenvalues.extend(columns.iter().map(|&it| slice.pairs.eigenvalue(it)));
            vectors
                .subcols_mut(cut[0], columns.len())
                .copy_from(slice.lanczos.vectors(&slice.pairs, &columns));
        }
        let n_solves = slices.iter().map(|it| it.lanczos.n_solves()).sum();
        Ok(self.unscaled(eigenvalues, vectors, n_solves))
    }

    /// Finds the pairs around a shift: up to the middle of the gap to either neighbour, and a few
    /// more; `None` if none of them is wanted.
    fn solve_slice(&self, index: usize) -> Result<Option<Slice<'_>>, EigsError> {
        let factor = &self.factors[index];
        let count = factor.n_below;
        let begin = match index.checked_sub(1) {
            None => 0,
            Some(before) => middle(self.factors[before].n_below, count).saturating_sub(OVERLAP / 2),
        };
        let end = match self.factors.get(index + 1) {
            None => self.k.max(count),
            Some(next) => middle(count, next.n_below) + OVERLAP / 2,
        };
        let (begin, end) = match index {
            0 => (0, end),
            _ => (begin.max(self.factors[index - 1].n_below), end),
        };
        if begin >= self.k {
            return Ok(None);
        }
        let end = match self.factors.get(index + 1) {
            None => end,
            Some(next) => end.min(next.n_below),
        };
        let (n_below, n_above) = (count - begin, end.saturating_sub(count));
        let capacity = 5 * (n_below + n_above) / 2 + 4 * self.n_block;
        let known = self.known.as_deref();
        let seed = index as u64 + 1;
        let mut lanczos = Lanczos::new(factor, known, self.n_block, capacity, seed, self.observer);
        let pairs = lanczos
            .converge(n_below, n_above, self.tolerance())
            .ok_or(EigsError::NotConverged { k: self.k, n_vertices: self.problem.n() })?;
        Ok(Some(Slice { lanczos, pairs, begin, n_below, n_above }))
    }

    /// Where the slice `right` takes over from the one before: at the widest gap between two
    /// eigenvalues that both of them know.
    ///
    /// # Errors
    /// [`EigsError::Missed`] if they do not agree on these eigenvalues.
    fn cut(&self, slices: &mut [Slice<'_>], right: usize) -> Result<usize, EigsError> {
        let largest = 4.0 * PI * self.k as f64;
        loop {
            let (before, after) = slices.split_at_mut(right);
            let (left, right) = (&mut before[right - 1], &mut after[0]);
            let shared = right.begin..left.end();
            for index in shared.clone() {
                let (one, other) = (left.eigenvalue(index), right.eigenvalue(index));
                if (one - other).abs() > 1e-9 * largest {
                    return Err(EigsError::Missed {
                        index,
                        one: one / self.problem.total_mass,
                        other: other / self.problem.total_mass,
                    });
                }
            }
            let gap = |cut: usize| right.eigenvalue(cut) - left.eigenvalue(cut - 1);
            let first = shared.start.max(1);
            let widest = (first..=shared.end.min(right.end() - 1))
                .max_by(|&a, &b| gap(a).total_cmp(&gap(b)))
                .unwrap_or(first);
            let exhausted = left.end() >= right.n_counted() && right.begin <= left.n_counted();
            if gap(widest) > PARTABLE * largest || exhausted {
                return Ok(widest.min(self.k));
            }
            // A multiple eigenvalue lies across the middle: both go on until one has all of it.
            let (from, to) = (left.n_counted(), right.n_counted());
            left.extend(0, (to - left.end()).min(2 * OVERLAP), self)?;
            right.extend((right.begin - from).min(2 * OVERLAP), 0, self)?;
        }
    }

    /// Puts rows back into the order of the vertices and the units of the operator.
    fn unscaled(&self, eigenvalues: Vec<f64>, vectors: Mat<f64>, n_solves: usize) -> Pairs {
        let problem = self.problem;
        let scale = problem.total_mass.sqrt();
        let mut row_of_vertex = vec![0; problem.n()];
        for (row, &vertex) in problem.order.iter().enumerate() {
            row_of_vertex[vertex as usize] = row;
        }
        let factors: Vec<f64> = problem.root_mass.iter().map(|it| 1.0 / (it * scale)).collect();
        let mut eigenvectors = Mat::zeros(problem.n(), self.k);
        tall::for_each_chunk(eigenvectors.as_mut(), |first, mut chunk| {
            for col in 0..self.k {
                let from = vectors.col(col);
                for row in 0..chunk.nrows() {
                    let place = row_of_vertex[first + row];
                    chunk[(row, col)] = from[place] * factors[place];
                }
            }
        });
        Pairs {
            eigenvalues: eigenvalues.iter().map(|it| it / problem.total_mass).collect(),
            eigenvectors,
            n_solves,
            n_factors: self.n_factors,
        }
    }
}

impl Slice<'_> {
    /// One past the last eigenvalue that was found.
    fn end(&self) -> usize {
        self.begin + self.n_below + self.n_above
    }

    /// The number of eigenvalues below the shift.
    fn n_counted(&self) -> usize {
        self.begin + self.n_below
    }

    fn pair(&self, index: usize) -> usize {
        match index.checked_sub(self.n_counted()) {
            Some(above) => self.pairs.above(above),
            None => self.pairs.below(self.n_counted() - 1 - index),
        }
    }

    fn eigenvalue(&self, index: usize) -> f64 {
        self.pairs.eigenvalue(self.pair(index))
    }

    fn extend(
        &mut self,
        more_below: usize,
        more_above: usize,
        slicing: &Slicing<'_>,
    ) -> Result<(), EigsError> {
        let (n_below, n_above) = (self.n_below + more_below, self.n_above + more_above);
        let pairs = self.lanczos.converge(n_below, n_above, slicing.tolerance());
        self.pairs = pairs.ok_or(EigsError::NotConverged {
            k: slicing.k,
            n_vertices: slicing.problem.n(),
        })?;
        self.begin -= more_below;
        (self.n_below, self.n_above) = (n_below, n_above);
        Ok(())
    }
}

fn middle(low: usize, high: usize) -> usize {
    low + (high - low) / 2
}

/// The shift at which a count is expected between two known ones; halves the interval now and then,
/// since counts may jump.
fn interpolate(low: (f64, usize), high: (f64, usize), target: f64, n_tries: usize) -> f64 {
    let share = (target - low.1 as f64) / (high.1 - low.1) as f64;
    let share = if n_tries % 3 == 0 { 0.5 } else { share.clamp(0.05, 0.95) };
    low.0 + share * (high.0 - low.0)
}
