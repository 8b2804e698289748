//! Laplacian matrices from the weights of edges.

use crate::kernels::numerics::sparse::CsrMatrix;

/// Weights of edges, gathered by row before equal columns are added up.
///
/// Faster than sorting triplets: rows are short and their lengths are known beforehand.
pub struct EdgeWeights {
    /// Where the entries of every row begin, and one more.
    begins: Vec<usize>,
    ends: Vec<usize>,
    entries: Vec<(u32, f64)>,
}

impl EdgeWeights {
    /// Makes room in the row of every vertex: `room[v]` calls of [`EdgeWeights::add`] name vertex `v`.
    pub fn with_room(room: &[u32]) -> Self {
        let mut begins = Vec::with_capacity(room.len() + 1);
        let mut n_entries = 0;
        begins.push(0);
        for &it in room {
            n_entries += it as usize;
            begins.push(n_entries);
        }
        let ends = begins[..room.len()].to_vec();
        Self { begins, ends, entries: vec![(0, 0.0); n_entries] }
    }

    /// Adds an edge's weight to both triangles of the matrix.
    pub fn add(&mut self, from: u32, to: u32, weight: f64) {
        for (row, column) in [(from as usize, to), (to as usize, from)] {
            self.entries[self.ends[row]] = (column, weight);
            self.ends[row] += 1;
        }
    }

    /// The matrix whose off-diagonal entries are the sums of the weights with the other sign, and
    /// whose rows add up to zero.
    ///
    /// Equal columns are summed in the order of the calls, which is the same for an entry and its
    /// mirror image: the matrix is exactly symmetric.
    pub fn into_stiffness(self) -> CsrMatrix {
        let n_rows = self.ends.len();
        let n_stored_guess = self.entries.len() / 2 + n_rows;
        let mut matrix = CsrMatrix {
            n_rows,
            n_cols: n_rows,
            offsets: Vec::with_capacity(n_rows + 1),
            columns: Vec::with_capacity(n_stored_guess),
            values: Vec::with_capacity(n_stored_guess),
        };
        matrix.offsets.push(0);
        let mut row = Row::new(n_rows);
        for vertex in 0..n_rows {
            row.gather(vertex as u32, &self.entries[self.begins[vertex]..self.ends[vertex]]);
            row.push_to(&mut matrix, vertex as u32);
        }
        matrix
    }
}

/// One row at a time: its columns, and sums by column.
struct Row {
    columns: Vec<u32>,
    sums: Vec<f64>,
    /// For every column, one more than the last row that has it.
    seen_in: Vec<u32>,
}

impl Row {
    fn new(n_columns: usize) -> Self {
        Self { columns: Vec::new(), sums: vec![0.0; n_columns], seen_in: vec![0; n_columns] }
    }

    fn gather(&mut self, row: u32, entries: &[(u32, f64)]) {
        self.columns.clear();
        for &(column, weight) in entries {
            let place = column as usize;
            if self.seen_in[place] == row + 1 {
                self.sums[place] += weight;
            } else {
                self.seen_in[place] = row + 1;
                self.sums[place] = weight;
                self.columns.push(column);
            }
        }
        self.columns.sort_unstable();
    }

    /// Appends the row, with the sum of its weights on the diagonal.
    fn push_to(&self, matrix: &mut CsrMatrix, row: u32) {
        let n_before = self.columns.partition_point(|&it| it < row);
        let mut total = 0.0;
        for &column in &self.columns[..n_before] {
            total += self.sums[column as usize];
            matrix.columns.push(column);
            matrix.values.push(-self.sums[column as usize]);
        }
        let diagonal = matrix.values.len();
        matrix.columns.push(row);
        matrix.values.push(0.0);
        for &column in &self.columns[n_before..] {
            total += self.sums[column as usize];
            matrix.columns.push(column);
            matrix.values.push(-self.sums[column as usize]);
        }
        matrix.values[diagonal] = total;
        matrix.offsets.push(matrix.values.len());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_of_one_edge_add_up_on_both_sides() {
        let mut weights = EdgeWeights::with_room(&[2, 3, 1, 0]);
        weights.add(1, 0, 2.0);
        weights.add(0, 1, 0.5);
        weights.add(2, 1, 1.0);
        let matrix = weights.into_stiffness();
        assert_eq!(matrix.row(0).collect::<Vec<_>>(), [(0, 2.5), (1, -2.5)]);
        assert_eq!(matrix.row(1).collect::<Vec<_>>(), [(0, -2.5), (1, 3.5), (2, -1.0)]);
        assert_eq!(matrix.row(2).collect::<Vec<_>>(), [(1, -1.0), (2, 1.0)]);
        assert_eq!(matrix.row(3).collect::<Vec<_>>(), [(3, 0.0)]);
    }
}
