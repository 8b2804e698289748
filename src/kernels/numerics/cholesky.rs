//! Small dense symmetric positive definite systems, solved the same way on any number of threads.

use faer::{Mat, MatRef};

/// Cholesky factor of a dense symmetric positive definite matrix of a few hundred rows.
#[derive(Debug, Clone)]
pub struct Cholesky {
    n: usize,
    /// The rows of the lower triangle, each without its zeros.
    rows: Vec<Vec<f64>>,
}

impl Cholesky {
    /// Factorizes `A = G G^T` from the lower triangle of `A`; `None` if it is not positive definite.
    pub fn new(a: MatRef<'_, f64>) -> Option<Self> {
        let n = a.nrows();
        let mut rows: Vec<Vec<f64>> = Vec::with_capacity(n);
        for i in 0..n {
            let mut row: Vec<f64> = Vec::with_capacity(i + 1);
            for j in 0..i {
                let value = (a[(i, j)] - dot(&row, &rows[j][..j])) / rows[j][j];
                row.push(value);
            }
            let square = a[(i, i)] - dot(&row, &row);
            if !(square > 0.0) {
                return None;
            }
            row.push(square.sqrt());
            rows.push(row);
        }
        Some(Self { n, rows })
    }

    /// Solves `A X = B` for `n x p` right-hand sides.
    pub fn solve(&self, b: MatRef<'_, f64>) -> Mat<f64> {
        assert_eq!(b.nrows(), self.n, "as many right-hand sides as rows");
        let mut res = b.to_owned();
        for column in 0..res.ncols() {
            self.solve_in_place(res.col_as_slice_mut(column));
        }
        res
    }

    fn solve_in_place(&self, x: &mut [f64]) {
        for i in 0..self.n {
            let row = &self.rows[i];
            x[i] = (x[i] - dot(&row[..i], &x[..i])) / row[i];
        }
        for i in (0..self.n).rev() {
            x[i] /= self.rows[i][i];
            let solved = x[i];
            for (target, value) in x[..i].iter_mut().zip(&self.rows[i]) {
                *target -= solved * value;
            }
        }
    }
}

/// An inner product in eight interleaved sums, which the compiler turns into vector instructions.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let (blocks_a, rest_a) = a.as_chunks::<8>();
    let (blocks_b, rest_b) = b[..a.len()].as_chunks::<8>();
    for (a, b) in blocks_a.iter().zip(blocks_b) {
        for lane in 0..8 {
            sums[lane] += a[lane] * b[lane];
        }
    }
    let rest: f64 = rest_a.iter().zip(rest_b).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f64>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_solution_solves() {
        let n = 37;
        let square = Mat::from_fn(n, n, |i, j| ((i * 13 + j * 7) % 17) as f64 - 8.0);
        let a = &square * square.transpose() + Mat::<f64>::identity(n, n);
        let b = Mat::from_fn(n, 2, |i, j| (i + j) as f64);
        let x = Cholesky::new(a.as_ref()).unwrap().solve(b.as_ref());
        assert!((&a * &x - &b).norm_max() < 1e-9);
    }

    #[test]
    fn an_indefinite_matrix_has_no_factor() {
        let a = Mat::from_fn(2, 2, |i, j| if i == j { 1.0 } else { 2.0 });
        assert!(Cholesky::new(a.as_ref()).is_none());
    }
}
