//! Which blocks a block-sparse matrix has.

use std::ops::Range;

use super::sparse::row_offsets;

/// The places of the blocks of a matrix, row by row; columns ascend within a row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BlockPattern {
    /// One more than rows.
    offsets: Vec<usize>,
    columns: Vec<u32>,
}

impl BlockPattern {
    /// Takes (row, column) pairs in any order; repeated ones count once.
    ///
    /// # Panics
    /// If there is no such row.
    pub fn new(n_rows: usize, mut pairs: Vec<(u32, u32)>) -> Self {
        pairs.sort_unstable();
        pairs.dedup();
        let offsets = row_offsets(n_rows, pairs.iter().map(|it| it.0));
        Self { offsets, columns: pairs.iter().map(|it| it.1).collect() }
    }

    pub fn n_rows(&self) -> usize {
        self.offsets.len() - 1
    }

    /// The column of every block.
    pub fn columns(&self) -> &[u32] {
        &self.columns
    }

    /// The places of the blocks of a row.
    pub fn row(&self, row: usize) -> Range<usize> {
        self.offsets[row]..self.offsets[row + 1]
    }

    /// The place of a block.
    ///
    /// # Panics
    /// If the pattern lacks it.
    pub fn place(&self, row: u32, column: u32) -> usize {
        let places = self.row(row as usize);
        let columns = &self.columns[places.clone()];
        places.start + columns.binary_search(&column).expect("the pattern holds all pairs")
    }
}
