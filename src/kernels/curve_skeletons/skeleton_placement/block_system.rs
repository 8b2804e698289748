//! Sparse symmetric systems of 3 x 3 blocks.

use std::collections::BTreeMap;

use nalgebra::Matrix3;

use crate::kernels::geometry::mesh::Vec3;

/// A symmetric positive definite matrix with a 3 x 3 block for every pair of joined nodes.
///
/// Solved by eliminating nodes with few neighbours first: a tree gets no new blocks, and the graphs of
/// skeletons are nearly trees.
pub struct BlockSystem {
    diagonal: Vec<Matrix3<f64>>,
    /// Both of every pair of blocks off the diagonal.
    rows: Vec<BTreeMap<u32, Matrix3<f64>>>,
    right: Vec<Vec3>,
}

impl BlockSystem {
    pub fn new(n_nodes: usize) -> Self {
        Self {
            diagonal: vec![Matrix3::zeros(); n_nodes],
            rows: vec![BTreeMap::new(); n_nodes],
            right: vec![Vec3::zeros(); n_nodes],
        }
    }

    /// Adds `x^T A x / 2 - b^T x` for one node.
    pub fn add_term(&mut self, node: usize, matrix: &Matrix3<f64>, right: &Vec3) {
        self.diagonal[node] += matrix;
        self.right[node] += right;
    }

    /// Adds `weight |x_a - x_b|^2 / 2`.
    pub fn add_spring(&mut self, [a, b]: [u32; 2], weight: f64) {
        let block = Matrix3::from_diagonal_element(weight);
        for (from, to) in [(a, b), (b, a)] {
            self.diagonal[from as usize] += block;
            *self.rows[from as usize].entry(to).or_default() -= block;
        }
    }

    /// Solves for all nodes.
    ///
    /// # Errors
    /// The first node that is eliminated and not determined: its block is singular to rounding.
    pub fn solve(mut self) -> Result<Vec<Vec3>, usize> {
        let n_nodes = self.diagonal.len();
        let scales: Vec<f64> = self.diagonal.iter().map(Matrix3::norm).collect();
        let mut queue: std::collections::BTreeSet<(usize, u32)> =
            (0..n_nodes as u32).map(|it| (self.rows[it as usize].len(), it)).collect();
        let mut eliminated = Vec::with_capacity(n_nodes);
        while let Some((_, node)) = queue.pop_first() {
            let inverse = inverse(&self.diagonal[node as usize], scales[node as usize])
                .ok_or(node as usize)?;
            let row = std::mem::take(&mut self.rows[node as usize]);
            for (&other, block) in &row {
                queue.remove(&(self.rows[other as usize].len(), other));
                self.rows[other as usize].remove(&node);
                let factor = block.transpose() * inverse;
                self.diagonal[other as usize] -= factor * block;
                let right = self.right[node as usize];
                self.right[other as usize] -= factor * right;
                for (&third, next) in row.iter().filter(|it| *it.0 != other) {
                    *self.rows[other as usize].entry(third).or_default() -= factor * next;
                }
            }
            for &other in row.keys() {
                queue.insert((self.rows[other as usize].len(), other));
            }
            eliminated.push((node, inverse, row));
        }
        let mut solution = self.right;
        for (node, inverse, row) in eliminated.into_iter().rev() {
            let coupled: Vec3 =
                row.iter().map(|(&other, block)| block * solution[other as usize]).sum();
            solution[node as usize] = inverse * (solution[node as usize] - coupled);
        }
        Ok(solution)
    }
}

/// The inverse of a block that is positive definite, compared with what it was at first.
fn inverse(block: &Matrix3<f64>, scale: f64) -> Option<Matrix3<f64>> {
    let symmetric = (block + block.transpose()) * 0.5;
    let cholesky = symmetric.cholesky()?;
    let least = cholesky.l_dirty().diagonal().min();
    (least * least > 1e-13 * scale).then(|| cholesky.inverse())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_solution_satisfies_the_equations() {
        // A cycle of four with a tail, different matrices everywhere.
        let edges = [[0, 1], [1, 2], [2, 3], [0, 3], [3, 4]];
        let matrix = |node: usize| {
            let v = Vec3::new(1.0, node as f64, 0.5);
            v * v.transpose() + Matrix3::identity() * 0.1
        };
        let right = |node: usize| Vec3::new(node as f64, 1.0, -2.0);
        let mut system = BlockSystem::new(5);
        (0..5).for_each(|it| system.add_term(it, &matrix(it), &right(it)));
        edges.iter().for_each(|&it| system.add_spring(it, 3.0));
        let x = system.solve().unwrap();
        for node in 0..5 {
            let mut residual = matrix(node) * x[node] - right(node);
            for [a, b] in edges {
                let [a, b] = [a as usize, b as usize];
                if a == node || b == node {
                    residual += (x[node] - x[a + b - node]) * 3.0;
                }
            }
            assert!(residual.norm() < 1e-12, "{residual}");
        }
    }

    #[test]
    fn nodes_without_a_hold_are_named() {
        let mut system = BlockSystem::new(2);
        system.add_spring([0, 1], 1.0);
        assert!(system.solve().is_err());
    }
}
