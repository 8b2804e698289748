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
    values: Vec<f64>,
}

impl SparseCholesky {
    /// Factors a symmetric matrix, given in full; `None` if it is not positive definite or too large
    /// for 32-bit indices.
    pub fn new(matrix: &CsrMatrix) -> Option<Self> {
        u32::try_from(matrix.n_stored()).ok()?;
        let offsets: Vec<u32> = matrix.offsets.iter().map(|&it| it as u32).collect();
        let n = matrix.n_rows;
        // The matrix is symmetric: its rows are its columns.
        let pattern = SymbolicSparseColMatRef::new_checked(n, n, &offsets, None, &matrix.columns);
        let params = CholeskySymbolicParams::default();
        let symbolic =
            factorize_symbolic_cholesky(pattern, Side::Lower, SymmetricOrdering::Amd, params)
                .ok()?;
        let mut values = vec![0.0; symbolic.len_val()];
        let scratch = symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default());
        let mut memory = MemBuffer::new(scratch);
        symbolic
            .factorize_numeric_llt(
                &mut values,
                SparseColMatRef::new(pattern, &matrix.values),
                Side::Lower,
                LltRegularization::default(),
                Par::Seq,
                MemStack::new(&mut memory),
                Default::default(),
            )
            .ok()?;
        values.iter().all(|it| it.is_finite()).then_some(Self { symbolic, values })
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
    fn an_indefinite_matrix_has_no_factor() {
        assert!(SparseCholesky::new(&line(9, -1.0)).is_none());
    }
}
