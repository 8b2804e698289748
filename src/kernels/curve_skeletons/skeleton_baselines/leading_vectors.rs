//! Eigenvectors of a dense symmetric matrix for its largest eigenvalues.

use faer::{Mat, MatRef};
use rayon::prelude::*;

use crate::kernels::numerics::random::Random;
use crate::kernels::numerics::tall;

/// Below this size all eigenvectors are computed.
const DENSE: usize = 300;

/// The largest `|A x - lambda x|` of unit vectors, in parts of the largest eigenvalue.
const TOLERANCE: f64 = 1e-8;

/// The `n x k` eigenvectors of the `k` largest eigenvalues, the largest first.
///
/// Lanczos' method with all vectors kept orthogonal; where the space is exhausted (eigenvalues that
/// coincide), it goes on from a new vector. `None` if it does not converge.
pub fn leading_vectors(matrix: MatRef<'_, f64>, k: usize) -> Option<Mat<f64>> {
    let n = matrix.nrows();
    if n <= DENSE.max(2 * k) {
        let (_, vectors) = tall::symmetric_eigen(matrix)?;
        return Some(Mat::from_fn(n, k, |row, column| vectors[(row, n - 1 - column)]));
    }
    let mut space = Space::new(matrix);
    let mut size = (4 * k).max(60);
    loop {
        space.grow(size.min(n));
        if let Some(found) = space.ritz(k) {
            return Some(found);
        }
        if size >= n {
            return None;
        }
        size *= 2;
    }
}

/// Orthonormal vectors and their images.
struct Space<'a> {
    matrix: MatRef<'a, f64>,
    vectors: Vec<Vec<f64>>,
    images: Vec<Vec<f64>>,
    random: Random,
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

impl<'a> Space<'a> {
    fn new(matrix: MatRef<'a, f64>) -> Self {
        let random = Random::stream(0, "leading_vectors");
        Self { matrix, vectors: Vec::new(), images: Vec::new(), random }
    }

    fn grow(&mut self, size: usize) {
        while self.vectors.len() < size {
            let vector = self.next();
            let image = (0..self.matrix.nrows()).into_par_iter().with_min_len(64);
            // A column is a row of a symmetric matrix, and lies in one piece.
            let column = |it: usize| self.matrix.col(it).try_as_col_major().expect("whole columns");
            self.images.push(image.map(|it| dot(column(it).as_slice(), &vector)).collect());
            self.vectors.push(vector);
        }
    }

    /// The last image, or else a random vector, freed of all vectors so far.
    fn next(&mut self) -> Vec<f64> {
        if let Some(found) = self.images.last().and_then(|it| self.freed(it.clone())) {
            return found;
        }
        loop {
            let vector = (0..self.matrix.nrows()).map(|_| self.random.normal()).collect();
            if let Some(found) = self.freed(vector) {
                return found;
            }
        }
    }

    fn freed(&self, mut vector: Vec<f64>) -> Option<Vec<f64>> {
        let before = dot(&vector, &vector).sqrt();
        // Twice is enough (Kahan; Parlett 1998).
        for _ in 0..2 {
            for other in &self.vectors {
                let share = dot(&vector, other);
                vector.iter_mut().zip(other).for_each(|(it, other)| *it -= share * other);
            }
        }
        let norm = dot(&vector, &vector).sqrt();
        if !(norm > 1e-10 * before) {
            return None;
        }
        vector.iter_mut().for_each(|it| *it /= norm);
        Some(vector)
    }

    /// The best eigenvectors in the space, if they are good enough.
    fn ritz(&self, k: usize) -> Option<Mat<f64>> {
        let (n, size) = (self.matrix.nrows(), self.vectors.len());
        let small = Mat::from_fn(size, size, |i, j| {
            0.5 * (dot(&self.vectors[i], &self.images[j]) + dot(&self.vectors[j], &self.images[i]))
        });
        let (values, shares) = tall::symmetric_eigen(small.as_ref())?;
        let mut res = Mat::zeros(n, k);
        for column in 0..k {
            let from = size - 1 - column;
            let mut off = vec![0.0; n];
            for (index, (vector, image)) in self.vectors.iter().zip(&self.images).enumerate() {
                let share = shares[(index, from)];
                for row in 0..n {
                    res[(row, column)] += share * vector[row];
                    off[row] += share * (image[row] - values[from] * vector[row]);
                }
            }
            if !(dot(&off, &off).sqrt() <= TOLERANCE * values[size - 1].abs()) {
                return None;
            }
        }
        Some(res)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vectors_are_those_of_the_largest_eigenvalues() {
        let n = 500;
        let mut random = Random::new(1);
        let places: Vec<f64> = (0..n).map(|_| random.between(0.0, 10.0)).collect();
        let matrix = Mat::from_fn(n, n, |i, j| (-(places[i] - places[j]).abs()).exp());
        let found = leading_vectors(matrix.as_ref(), 6).unwrap();
        let (values, _) = tall::symmetric_eigen(matrix.as_ref()).unwrap();
        let images = &matrix * &found;
        for column in 0..6 {
            let value = found.col(column).transpose() * images.col(column);
            assert!((value / values[n - 1 - column] - 1.0).abs() < 1e-10, "{column}");
        }
        let products = found.transpose() * &found - Mat::<f64>::identity(6, 6);
        assert!(products.norm_max() < 1e-10);
    }

    #[test]
    fn eigenvalues_that_coincide_are_all_found() {
        let n = 400;
        let matrix = Mat::from_fn(n, n, |i, j| f64::from(u8::from(i % 4 == j % 4)));
        let found = leading_vectors(matrix.as_ref(), 4).unwrap();
        let images = &matrix * &found;
        for column in 0..4 {
            let value = found.col(column).transpose() * images.col(column);
            assert!((value - 100.0).abs() < 1e-8);
        }
    }
}
