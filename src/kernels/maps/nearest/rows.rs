//! Points row by row, in both precisions.

use faer::MatRef;

/// Points row by row, in both precisions, divided by a common factor.
pub struct Rows {
    pub count: usize,
    /// The number of coordinates.
    pub dim: usize,
    exact: Vec<f64>,
    /// Rows of `dim + 1` numbers: see [`Rows::queries`] and [`Rows::points`].
    single: Vec<f32>,
    /// Squared lengths.
    pub squares: Vec<f32>,
    /// The largest of them.
    pub longest: f32,
}

impl Rows {
    /// Rows `(q, 1)`.
    pub fn queries(matrix: MatRef<'_, f64>, scale: f64) -> Self {
        Self::new(matrix, scale, |_| 1.0)
    }

    /// Rows `(p, -|p|^2 / 2)`, whose product with `(q, 1)` is `-1/2` times the score
    /// `|p|^2 - 2 q.p`, by which the points that are nearest to a query are told.
    pub fn points(matrix: MatRef<'_, f64>, scale: f64) -> Self {
        Self::new(matrix, scale, |square| (-0.5 * square) as f32)
    }

    fn new(matrix: MatRef<'_, f64>, scale: f64, last: impl Fn(f64) -> f32) -> Self {
        let (count, dim) = (matrix.nrows(), matrix.ncols());
        let mut exact = vec![0.0; count * dim];
        // A few rows at a time, so that what is written stays in the cache until its line is full.
        for first in (0..count).step_by(64) {
            for column in 0..dim {
                for row in first..count.min(first + 64) {
                    exact[row * dim + column] = matrix[(row, column)] * scale;
                }
            }
        }
        let (mut single, mut squares) = (Vec::with_capacity(count * (dim + 1)), vec![0.0; count]);
        for (row, square) in squares.iter_mut().enumerate() {
            let row = &exact[row * dim..(row + 1) * dim];
            let length: f64 = row.iter().map(|it| it * it).sum();
            single.extend(row.iter().map(|&it| it as f32));
            single.push(last(length));
            *square = length as f32;
        }
        let longest = squares.iter().fold(0.0f32, |a, &b| a.max(b));
        Self { count, dim, exact, single, squares, longest }
    }

    pub fn row(&self, row: usize) -> &[f64] {
        &self.exact[row * self.dim..(row + 1) * self.dim]
    }

    pub fn single_row(&self, row: usize) -> &[f32] {
        &self.single[row * (self.dim + 1)..(row + 1) * (self.dim + 1)]
    }

    /// Rows as the columns of a `(d + 1) x n` matrix.
    pub fn columns(&self, range: std::ops::Range<usize>) -> MatRef<'_, f32> {
        let stride = self.dim + 1;
        let slice = &self.single[range.start * stride..range.end * stride];
        MatRef::from_column_major_slice(slice, stride, range.len())
    }
}
