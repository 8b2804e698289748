//! Sparse matrices as arrays, by rows.

use crate::engine::artifact::{DecodeError, Decoder, Encoder};
use crate::kernels::numerics::sparse::CsrMatrix;

/// Writes a sparse matrix as `offsets`, `columns`, `values` and the text `shape`.
pub fn put_csr<'a>(to: &mut Encoder<'a>, matrix: &'a CsrMatrix) {
    let offsets: Vec<u64> = matrix.offsets.iter().map(|&it| it as u64).collect();
    to.owned("offsets", &[offsets.len()], offsets);
    to.array("columns", &[matrix.columns.len()], &matrix.columns);
    to.array("values", &[matrix.values.len()], &matrix.values);
    to.text("shape", format!("{} x {}", matrix.n_rows, matrix.n_cols));
}

/// Reads what [`put_csr`] writes.
///
/// # Errors
/// If something is missing, or the arrays are no sparse matrix with ascending columns.
pub fn csr(from: &Decoder<'_>) -> Result<CsrMatrix, DecodeError> {
    let shape = from.text("shape")?.split_once(" x ");
    let shape = shape.and_then(|(rows, cols)| Some((rows.parse().ok()?, cols.parse().ok()?)));
    let Some((n_rows, n_cols)) = shape else {
        return Err(DecodeError::new("`shape` is no shape"));
    };
    let offsets: Vec<usize> =
        from.vector::<u64>("offsets")?.iter().map(|&it| it as usize).collect();
    let columns = from.vector::<u32>("columns")?.into_owned();
    let values = from.vector::<f64>("values")?.into_owned();
    if columns.len() != values.len() || Some(&values.len()) != offsets.last() {
        let (n_columns, n_values) = (columns.len(), values.len());
        return Err(DecodeError(format!("{n_columns} columns for {n_values} values")));
    }
    if offsets.first() != Some(&0) || offsets.len() - 1 != n_rows {
        return Err(DecodeError(format!("{} offsets for {n_rows} rows", offsets.len())));
    }
    for (row, range) in offsets.windows(2).enumerate() {
        let columns = columns.get(range[0]..range[1]);
        let is_sound = columns.is_some_and(|it| {
            it.windows(2).all(|pair| pair[0] < pair[1])
                && it.last().is_none_or(|&last| (last as usize) < n_cols)
        });
        if !is_sound {
            return Err(DecodeError(format!("row {row} has no ascending columns in range")));
        }
    }
    match values.iter().find(|it| !it.is_finite()) {
        Some(value) => Err(DecodeError(format!("the value {value}"))),
        None => Ok(CsrMatrix { n_rows, n_cols, offsets, columns, values }),
    }
}
