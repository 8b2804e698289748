//! Sparse matrices by rows.

/// A sparse matrix by rows; columns ascend within a row and none is repeated.
#[derive(Debug, Clone, PartialEq)]
pub struct CsrMatrix {
    pub n_rows: usize,
    pub n_cols: usize,
    /// `n_rows + 1` offsets into `columns` and `values`.
    pub offsets: Vec<usize>,
    pub columns: Vec<u32>,
    pub values: Vec<f64>,
}

/// Where the entries of every row begin if they lie row by row: `n_rows + 1` offsets.
///
/// # Panics
/// If there is no such row.
pub fn row_offsets(n_rows: usize, rows: impl IntoIterator<Item = u32>) -> Vec<usize> {
    let mut offsets = vec![0; n_rows + 1];
    for row in rows {
        offsets[row as usize + 1] += 1;
    }
    for row in 0..n_rows {
        offsets[row + 1] += offsets[row];
    }
    offsets
}

impl CsrMatrix {
    /// Adds up (row, column, value) triplets given in any order.
    ///
    /// Duplicates are summed in the order in which they are given, so the result does not depend on
    /// how the sort breaks ties.
    ///
    /// # Panics
    /// If an index is out of range.
    pub fn from_triplets(n_rows: usize, n_cols: usize, triplets: &[(u32, u32, f64)]) -> Self {
        for &(row, col, _) in triplets {
            assert!((row as usize) < n_rows && (col as usize) < n_cols, "triplet out of range");
        }
        let begins = row_offsets(n_rows, triplets.iter().map(|it| it.0));
        let mut by_row = vec![(0u32, 0.0f64); triplets.len()];
        let mut next = begins.clone();
        for &(row, col, value) in triplets {
            by_row[next[row as usize]] = (col, value);
            next[row as usize] += 1;
        }
        let mut res = Self {
            n_rows,
            n_cols,
            offsets: Vec::with_capacity(n_rows + 1),
            columns: Vec::with_capacity(triplets.len() / 2),
            values: Vec::with_capacity(triplets.len() / 2),
        };
        res.offsets.push(0);
        for row in 0..n_rows {
            let entries = &mut by_row[begins[row]..begins[row + 1]];
            entries.sort_by_key(|it| it.0);
            let first = res.columns.len();
            for &(col, value) in entries.iter() {
                if res.columns.len() > first && res.columns.last() == Some(&col) {
                    *res.values.last_mut().expect("as long as `columns`") += value;
                } else {
                    res.columns.push(col);
                    res.values.push(value);
                }
            }
            res.offsets.push(res.columns.len());
        }
        res
    }

    pub fn n_stored(&self) -> usize {
        self.values.len()
    }

    /// The stored (column, value) pairs of a row, ascending.
    pub fn row(&self, row: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let range = self.offsets[row]..self.offsets[row + 1];
        self.columns[range.clone()]
            .iter()
            .map(|&it| it as usize)
            .zip(self.values[range].iter().copied())
    }

    /// `y = A x` for one vector.
    pub fn mul_vec(&self, x: &[f64]) -> Vec<f64> {
        (0..self.n_rows).map(|row| self.row(row).map(|(col, value)| value * x[col]).sum()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triplets_are_sorted_and_added_up() {
        let triplets = [(1, 2, 3.0), (0, 1, 1.0), (1, 0, 4.0), (1, 2, 0.5)];
        let matrix = CsrMatrix::from_triplets(2, 3, &triplets);
        assert_eq!(matrix.offsets, [0, 1, 3]);
        assert_eq!(matrix.row(1).collect::<Vec<_>>(), [(0, 4.0), (2, 3.5)]);
        assert_eq!(matrix.mul_vec(&[1.0, 1.0, 2.0]), [1.0, 11.0]);
    }
}
