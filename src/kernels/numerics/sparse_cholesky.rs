//! Sparse symmetric positive definite systems, solved the same way on any number of threads.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side};

use super::sparse::CsrMatrix;

/// `A = G G^T` of a sparse matrix, in an order that keeps `G` sparse (approximate minimum degree,
/// Amestoy, Davis & Duff 1996).
#[derive(Debug)]
pub struct SparseCholesky {
    symbolic: SymbolicCholesky<u32>,
    offsets: Vec<u32>,
    columns: Vec<u32>,
    values: Vec<f64>,
}

impl SparseCholesky {
    /// Factors a symmetric matrix; `None` if it is not positive definite or too large for 32-bit
    /// indices. Only what is on the diagonal and above it is read; the rest may be missing.
    pub fn new(matrix: &CsrMatrix) -> Option<Self> {
        let mut res = Self::of_pattern(matrix)?;
        res.refactor(matrix).then_some(res)
    }

    /// Finds out where the factor has entries.
    fn of_pattern(matrix: &CsrMatrix) -> Option<Self> {
        u32::try_from(matrix.n_stored()).ok()?;
        let offsets: Vec<u32> = matrix.offsets.iter().map(|&it| it as u32).collect();
        let n = matrix.n_rows;
        // The matrix is symmetric: its rows are its columns.
        let pattern = SymbolicSparseColMatRef::new_checked(n, n, &offsets, None, &matrix.columns);
        let params = CholeskySymbolicParams::default();
        let symbolic =
            factorize_symbolic_cholesky(pattern, Side::Lower, SymmetricOrdering::Amd, params)
                .ok()?;
        let values = vec![0.0; symbolic.len_val()];
        Some(Self { symbolic, offsets, columns: matrix.columns.clone(), values })
    }

    /// Factors another matrix with entries at the same places, for which the order of elimination and
    /// the pattern of the factor are known. Returns whether it is positive definite; if not, there is
    /// no factor until the next success.
    ///
    /// # Panics
    /// If entries are at other places.
    pub fn refactor(&mut self, matrix: &CsrMatrix) -> bool {
        assert!(self.columns == matrix.columns, "entries at the same places");
        let n = matrix.n_rows;
        let pattern =
            SymbolicSparseColMatRef::new_checked(n, n, &self.offsets, None, &self.columns);
        let scratch =
            self.symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default());
        let mut memory = MemBuffer::new(scratch);
        let made = self.symbolic.factorize_numeric_llt(
            &mut self.values,
            SparseColMatRef::new(pattern, &matrix.values),
            Side::Lower,
            LltRegularization::default(),
            Par::Seq,
            MemStack::new(&mut memory),
            Default::default(),
        );
        made.is_ok() && self.values.iter().all(|it| it.is_finite())
    }

    /// Solves `A X = B` in place, for `n x p` right-hand sides.
    ///
    /// # Panics
    /// If the numbers of rows differ.
    pub fn solve_in_place(&self, right: MatMut<'_, f64>) {
        assert_eq!(right.nrows(), self.symbolic.nrows(), "as many right-hand sides as rows");
        let scratch = self.symbolic.solve_in_place_scratch::<f64>(right.ncols(), Par::Seq);
        let mut memory = MemBuffer::new(scratch);
        LltRef::new(&self.symbolic, &self.values).solve_in_place_with_conj(
            Conj::No,
            right,
            Par::Seq,
            MemStack::new(&mut memory),
        );
    }
}

#[cfg(test)]
mod tests {
    use faer::Mat;

    use super::*;

    /// Second differences on a line, shifted.
    fn line(n: usize, shift: f64) -> CsrMatrix {
        let mut triplets = Vec::new();
        for row in 0..n as u32 {
            triplets.push((row, row, 2.0 + shift));
            if row > 0 {
                triplets.push((row, row - 1, -1.0));
                triplets.push((row - 1, row, -1.0));
            }
        }
        CsrMatrix::from_triplets(n, n, &triplets)
    }

    #[test]
    fn the_solution_solves() {
        for n in [1, 2, 50, 700] {
            let matrix = line(n, 0.01);
            let exact = Mat::from_fn(n, 3, |row, col| ((row * 7 + col * 3) % 11) as f64);
            let mut right = Mat::zeros(n, 3);
            for col in 0..3 {
                let image = matrix.mul_vec(exact.col_as_slice(col));
                right.col_as_slice_mut(col).copy_from_slice(&image);
            }
            SparseCholesky::new(&matrix).unwrap().solve_in_place(right.as_mut());
            assert!((&right - &exact).norm_max() < 1e-8, "{n}");
        }
    }

    #[test]
    fn a_second_matrix_of_the_same_pattern_and_the_upper_half_alone_do() {
        let exact = Mat::from_fn(300, 1, |row, _| (row % 13) as f64);
        let upper = |matrix: &CsrMatrix| {
            let rows = 0..matrix.n_rows;
            let entries = rows.flat_map(|row| matrix.row(row).map(move |it| (row, it.0, it.1)));
            let kept = entries.filter(|it| it.1 >= it.0).map(|it| (it.0 as u32, it.1 as u32, it.2));
            CsrMatrix::from_triplets(matrix.n_rows, matrix.n_cols, &kept.collect::<Vec<_>>())
        };
        let mut factor = SparseCholesky::new(&upper(&line(300, 1.0))).unwrap();
        assert!(!factor.refactor(&upper(&line(300, -3.0))));
        assert!(factor.refactor(&upper(&line(300, 0.01))));
        let image = line(300, 0.01).mul_vec(exact.col_as_slice(0));
        let mut right = Mat::from_fn(300, 1, |row, _| image[row]);
        factor.solve_in_place(right.as_mut());
        assert!((&right - &exact).norm_max() < 1e-8);
    }

    #[test]
    fn an_indefinite_matrix_has_no_factor() {
        assert!(SparseCholesky::new(&line(9, -1.0)).is_none());
    }
}
