//! Dense matrices as arrays: row by row, as numpy reads them.

use faer::Mat;

use crate::engine::artifact::{DecodeError, Decoder, Encoder};

/// So many rows are turned together that they stay in the cache.
const ROWS: usize = 32;

/// Writes a dense matrix.
pub fn put_matrix(to: &mut Encoder<'_>, name: &str, matrix: &Mat<f64>) {
    let (n_rows, n_cols) = (matrix.nrows(), matrix.ncols());
    let mut values = vec![0.0; n_rows * n_cols];
    for (block, rows) in values.chunks_mut((ROWS * n_cols).max(1)).enumerate() {
        for column in 0..n_cols {
            let column_values = &matrix.col_as_slice(column)[block * ROWS..];
            for (row, value) in rows.chunks_exact_mut(n_cols).zip(column_values) {
                row[column] = *value;
            }
        }
    }
    to.owned(name, &[n_rows, n_cols], values);
}

/// Reads a dense matrix of finite numbers.
///
/// # Errors
/// If the array is missing, is no matrix or holds a number that is not finite.
pub fn matrix(from: &Decoder<'_>, name: &str) -> Result<Mat<f64>, DecodeError> {
    let (n_rows, n_cols, values) = from.matrix::<f64>(name)?;
    if let Some(value) = values.iter().find(|it| !it.is_finite()) {
        return Err(DecodeError(format!("array `{name}` holds {value}")));
    }
    let mut res = Mat::zeros(n_rows, n_cols);
    for (block, rows) in values.chunks((ROWS * n_cols).max(1)).enumerate() {
        for column in 0..n_cols {
            let column_values = &mut res.col_as_slice_mut(column)[block * ROWS..];
            for (row, value) in rows.chunks_exact(n_cols).zip(column_values) {
                *value = row[column];
            }
        }
    }
    Ok(res)
}

/// The range of a matrix for a summary: `-1.2 to 3.4`.
pub fn show_range(matrix: &Mat<f64>) -> String {
    let values = (0..matrix.ncols()).flat_map(|it| matrix.col_as_slice(it));
    let (low, high) = values
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &it| (low.min(it), high.max(it)));
    format!("{low:.4} to {high:.4}")
}
