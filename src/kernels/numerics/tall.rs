//! Products of tall matrices: many rows (one a vertex), few columns.
//!
//! Rows are cut into chunks of a fixed size which are worked on in parallel and added up in order,
//! so the result has the same bytes at any number of threads. The chunk of the thinner factor stays
//! in the processor's cache meanwhile.

use faer::diag::Diag;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::evd::{ComputeEigenvectors, self_adjoint_evd, self_adjoint_evd_scratch};
use faer::linalg::matmul::matmul;
use faer::linalg::svd::{ComputeSvdVectors, svd, svd_scratch};
use faer::{Accum, Mat, MatMut, MatRef, Par};
use rayon::prelude::*;

/// Rows that are worked on at a time: eight columns of doubles are 256 KiB.
pub const CHUNK: usize = 4096;

/// `A^T B` for `A` of `n x p` and `B` of `n x q`: a `p x q` matrix of inner products.
///
/// # Panics
/// If the numbers of rows differ.
pub fn inner_products(a: MatRef<'_, f64>, b: MatRef<'_, f64>) -> Mat<f64> {
    assert_eq!(a.nrows(), b.nrows(), "as many rows in both factors");
    let n_rows = a.nrows();
    let parts: Vec<Mat<f64>> = (0..n_rows.div_ceil(CHUNK))
        .into_par_iter()
        .map(|chunk| {
            let first_row = chunk * CHUNK;
            let height = CHUNK.min(n_rows - first_row);
            let (a, b) = (a.subrows(first_row, height), b.subrows(first_row, height));
            // The thin factor first: it is the one that gets copied into the order of the product.
            if b.ncols() < a.ncols() {
                small_product(b.transpose(), a).transpose().to_owned()
            } else {
                small_product(a.transpose(), b)
            }
        })
        .collect();
    let mut sum = Mat::zeros(a.ncols(), b.ncols());
    for part in &parts {
        sum += part;
    }
    sum
}

/// `A^T diag(mass) B` for `A` of `n x p`, `n` masses and `B` of `n x q`.
///
/// # Panics
/// If the numbers of rows differ.
pub fn mass_products(a: MatRef<'_, f64>, mass: &[f64], b: MatRef<'_, f64>) -> Mat<f64> {
    assert_eq!(mass.len(), b.nrows(), "one mass for every row");
    let weighted = Mat::from_fn(b.nrows(), b.ncols(), |row, col| mass[row] * b[(row, col)]);
    inner_products(a, weighted.as_ref())
}

/// `target += factor * A C` for `A` of `n x p` and a small `C` of `p x q`.
///
/// # Panics
/// If the shapes do not fit.
pub fn add_product(target: MatMut<'_, f64>, a: MatRef<'_, f64>, c: MatRef<'_, f64>, factor: f64) {
    combine(target, Accum::Add, a, c, factor);
}

/// `A C` for `A` of `n x p` and a small `C` of `p x q`.
///
/// # Panics
/// If the shapes do not fit.
pub fn product(a: MatRef<'_, f64>, c: MatRef<'_, f64>) -> Mat<f64> {
    let mut res = Mat::zeros(a.nrows(), c.ncols());
    combine(res.as_mut(), Accum::Replace, a, c, 1.0);
    res
}

/// `A B` of small matrices, on the calling thread.
///
/// # Panics
/// If the shapes do not fit.
pub fn small_product(a: MatRef<'_, f64>, b: MatRef<'_, f64>) -> Mat<f64> {
    let mut res = Mat::zeros(a.nrows(), b.ncols());
    matmul(res.as_mut(), Accum::Replace, a, b, 1.0, Par::Seq);
    res
}

/// All eigenvalues, ascending, and eigenvectors by columns of a symmetric matrix (its lower
/// triangle); `None` if it is not finite.
///
/// On the calling thread: faer's own shorthand cuts the work by the number of threads, and so do
/// its sums.
pub fn symmetric_eigen(matrix: MatRef<'_, f64>) -> Option<(Vec<f64>, Mat<f64>)> {
    let n = matrix.nrows();
    let with_vectors = ComputeEigenvectors::Yes;
    let scratch = self_adjoint_evd_scratch::<f64>(n, with_vectors, Par::Seq, Default::default());
    let mut memory = MemBuffer::new(scratch);
    let mut values = Diag::zeros(n);
    let mut vectors = Mat::zeros(n, n);
    let (values_mut, vectors_mut) = (values.as_mut(), Some(vectors.as_mut()));
    let stack = MemStack::new(&mut memory);
    self_adjoint_evd(matrix, values_mut, vectors_mut, Par::Seq, stack, Default::default()).ok()?;
    Some((values.column_vector().iter().copied().collect(), vectors))
}

/// The matrix with orthonormal columns (rows, if it is wide) that is nearest to a small one: `U V^T` of
/// its singular value decomposition `U S V^T`; `None` if it is not finite.
///
/// On the calling thread, for the same reason as [`symmetric_eigen`].
pub fn nearest_orthogonal(matrix: MatRef<'_, f64>) -> Option<Mat<f64>> {
    if !matrix.is_all_finite() {
        return None;
    }
    let (n_rows, n_cols) = (matrix.nrows(), matrix.ncols());
    let (size, thin) = (n_rows.min(n_cols), ComputeSvdVectors::Thin);
    let scratch = svd_scratch::<f64>(n_rows, n_cols, thin, thin, Par::Seq, Default::default());
    let mut memory = MemBuffer::new(scratch);
    let (mut u, mut v) = (Mat::zeros(n_rows, size), Mat::zeros(n_cols, size));
    let mut values = Diag::zeros(size);
    let (u_mut, v_mut) = (Some(u.as_mut()), Some(v.as_mut()));
    let stack = MemStack::new(&mut memory);
    svd(matrix, values.as_mut(), u_mut, v_mut, Par::Seq, stack, Default::default()).ok()?;
    Some(small_product(u.as_ref(), v.transpose()))
}

/// Calls `work` with the first row and the rows of every chunk of `target`, in parallel.
pub fn for_each_chunk(target: MatMut<'_, f64>, work: impl Fn(usize, MatMut<'_, f64>) + Sync) {
    let mut chunks = Vec::with_capacity(target.nrows().div_ceil(CHUNK));
    let mut rest = target;
    let mut first_row = 0;
    while rest.nrows() > 0 {
        let height = CHUNK.min(rest.nrows());
        let (chunk, below) = rest.split_at_row_mut(height);
        chunks.push((first_row, chunk));
        first_row += height;
        rest = below;
    }
    chunks.into_par_iter().for_each(|(first_row, chunk)| work(first_row, chunk));
}

fn combine(
    target: MatMut<'_, f64>,
    accum: Accum,
    a: MatRef<'_, f64>,
    c: MatRef<'_, f64>,
    factor: f64,
) {
    assert_eq!(target.nrows(), a.nrows(), "as many rows in the sum as in the product");
    for_each_chunk(target, |first_row, chunk| {
        let rows = a.subrows(first_row, chunk.nrows());
        matmul(chunk, accum, rows, c, factor, Par::Seq);
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filled(n_rows: usize, n_cols: usize) -> Mat<f64> {
        Mat::from_fn(n_rows, n_cols, |row, col| ((row * 7 + col * 13) % 31) as f64 - 15.0)
    }

    /// `Q R` with a positive definite symmetric `R` is the polar decomposition, whose `Q` is nearest.
    #[test]
    fn the_nearest_orthogonal_matrix_is_the_polar_factor() {
        for (n_rows, n_cols) in [(5, 5), (7, 4), (4, 7)] {
            let matrix = filled(n_rows, n_cols);
            let found = nearest_orthogonal(matrix.as_ref()).unwrap();
            let (tall, rest) = if n_rows < n_cols {
                (found.transpose().to_owned(), &matrix * found.transpose())
            } else {
                (found.clone(), found.transpose() * &matrix)
            };
            let size = tall.ncols();
            let gram = tall.transpose() * &tall - Mat::<f64>::identity(size, size);
            assert!(gram.norm_max() < 1e-13);
            assert!((&rest - rest.transpose()).norm_max() < 1e-11);
            let (values, _) = symmetric_eigen(rest.as_ref()).unwrap();
            assert!(values.iter().all(|it| *it > -1e-11), "{values:?}");
        }
        assert!(nearest_orthogonal(Mat::from_fn(2, 2, |_, _| f64::NAN).as_ref()).is_none());
    }

    /// Small integers add up exactly in any order, so chunked and plain products are equal.
    #[test]
    fn products_in_chunks_equal_plain_products() {
        for n_rows in [1, CHUNK, 2 * CHUNK + 5] {
            let (a, b) = (filled(n_rows, 3), filled(n_rows, 4));
            assert_eq!(inner_products(a.as_ref(), b.as_ref()), a.transpose() * &b);
            let mass = vec![2.0; n_rows];
            let doubled = faer::Scale(2.0) * (a.transpose() * &b);
            assert_eq!(mass_products(a.as_ref(), &mass, b.as_ref()), doubled);
            let c = filled(3, 4);
            assert_eq!(product(a.as_ref(), c.as_ref()), &a * &c);
            let mut sum = b.clone();
            add_product(sum.as_mut(), a.as_ref(), c.as_ref(), -1.0);
            assert_eq!(sum, &b - &a * &c);
        }
    }
}
