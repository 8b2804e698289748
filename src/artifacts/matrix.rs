//! Dense matrices as arrays: row by row, as numpy reads them.

use std::borrow::Cow;

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
    let (n_rows, n_cols, values) = finite_matrix(from, name)?;
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

/// Checks a dense matrix of finite numbers where it lies and adds it as [`put_matrix`] would; its rows and
/// columns, or `None` if it cannot be added without a copy.
///
/// # Errors
/// As [`matrix`].
pub fn check_matrix<'a>(
    from: &Decoder<'a>,
    name: &str,
    to: &mut Encoder<'a>,
) -> Result<Option<(usize, usize)>, DecodeError> {
    let (n_rows, n_cols, values) = finite_matrix(from, name)?;
    let Cow::Borrowed(values) = values else { return Ok(None) };
    to.array(name, &[n_rows, n_cols], values);
    Ok(Some((n_rows, n_cols)))
}

type Rows<'a> = (usize, usize, Cow<'a, [f64]>);

fn finite_matrix<'a>(from: &Decoder<'a>, name: &str) -> Result<Rows<'a>, DecodeError> {
    let (n_rows, n_cols, values) = from.matrix::<f64>(name)?;
    match values.chunks(CHUNK).find_map(not_finite) {
        Some(value) => Err(DecodeError(format!("array `{name}` holds {value}"))),
        None => Ok((n_rows, n_cols, values)),
    }
}

/// So many numbers are looked at together.
const CHUNK: usize = 1024;

/// The first number that is not finite. Without an exit in between, the processor looks at several at once.
fn not_finite(values: &[f64]) -> Option<f64> {
    let all_finite = values.iter().fold(true, |all, it| all & it.is_finite());
    if all_finite { None } else { values.iter().copied().find(|it| !it.is_finite()) }
}

/// The range of a matrix for a summary: `-1.2 to 3.4`.
pub fn show_range(matrix: &Mat<f64>) -> String {
    let values = (0..matrix.ncols()).flat_map(|it| matrix.col_as_slice(it));
    let (low, high) = values
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &it| (low.min(it), high.max(it)));
    format!("{low:.4} to {high:.4}")
}
