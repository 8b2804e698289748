//! Where nodes lie in balance.

use faer::Mat;
use nalgebra::Matrix3;

use super::FitSurfaceError;
use super::embedding::Embedding;
use super::pulls::Pull;
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::numerics::block_pattern::BlockPattern;
use crate::kernels::numerics::sparse::CsrMatrix;
use crate::kernels::numerics::sparse_cholesky::SparseCholesky;
use crate::kernels::sensors::registration::graph::N_INFLUENCES;

/// How much nodes keep to where they are, over the mean of the diagonal: those that nothing else holds
/// stay.
const STAY: f64 = 1e-8;

/// The normal equations of the places of all nodes, by blocks of three rows and columns.
pub struct System {
    /// Pairs of nodes, the smaller first.
    pattern: BlockPattern,
    matrix: CsrMatrix,
    factor: Option<SparseCholesky>,
}

impl System {
    /// Finds out which nodes share an edge or a vertex.
    pub fn new(embedding: &Embedding<'_>) -> Self {
        let n_nodes = embedding.n_nodes();
        let graph = &embedding.graph;
        let mut pairs: Vec<(u32, u32)> = (0..n_nodes as u32).map(|it| (it, it)).collect();
        pairs.extend(graph.edges.iter().map(|it| (it.0.min(it.1), it.0.max(it.1))));
        for skin in &graph.skin {
            let used = |it: &&(u32, f64)| it.1 > 0.0;
            for &(a, _) in skin.iter().filter(used) {
                pairs.extend(skin.iter().filter(used).filter(|it| it.0 > a).map(|it| (a, it.0)));
            }
        }
        let pattern = BlockPattern::new(n_nodes, pairs);
        let matrix = zero_matrix(&pattern);
        Self { pattern, matrix, factor: None }
    }

    /// The places of nodes with the least energy, for fixed frames.
    pub fn solve(
        &mut self,
        embedding: &Embedding<'_>,
        nodes: &[Vec3],
        frames: &[Matrix3<f64>],
        pulls: &[Pull],
        stiffness: f64,
    ) -> Result<Vec<Vec3>, FitSurfaceError> {
        self.matrix.values.fill(0.0);
        let mut right = vec![Vec3::zeros(); nodes.len()];
        for pull in pulls {
            self.add_pull(embedding, frames, pull, &mut right);
        }
        let rest = &embedding.graph.nodes;
        for &(from, to, weight) in &embedding.graph.edges {
            let weight = stiffness * weight;
            let wanted = frames[from as usize] * (rest[to as usize] - rest[from as usize]) * weight;
            let block = Matrix3::from_diagonal_element(weight);
            self.add(from, from, &block);
            self.add(to, to, &block);
            self.add(from.min(to), from.max(to), &-block);
            right[to as usize] += wanted;
            right[from as usize] -= wanted;
        }
        let stay = Matrix3::from_diagonal_element(STAY * self.mean_diagonal());
        for (node, place) in nodes.iter().enumerate() {
            self.add(node as u32, node as u32, &stay);
            right[node] += stay * place;
        }
        self.solved(&right)
    }

    fn add_pull(
        &mut self,
        embedding: &Embedding<'_>,
        frames: &[Matrix3<f64>],
        pull: &Pull,
        right: &mut [Vec3],
    ) {
        let Pull { vertex, place, normal, weight, hold } = *pull;
        let form = (normal * normal.transpose() + Matrix3::from_diagonal_element(hold)) * weight;
        let wanted = form * (place - embedding.offset(frames, vertex as usize));
        let skin: &[(u32, f64); N_INFLUENCES] = embedding.skin(vertex as usize);
        for (at, &(a, share)) in skin.iter().enumerate().filter(|it| it.1.1 > 0.0) {
            right[a as usize] += wanted * share;
            for &(b, other) in skin[at..].iter().filter(|it| it.1 > 0.0) {
                self.add(a.min(b), a.max(b), &(form * (share * other)));
            }
        }
    }

    /// Adds a symmetric block at a pair of nodes, the smaller first.
    fn add(&mut self, row: u32, column: u32, block: &Matrix3<f64>) {
        let own = self.pattern.row(row as usize);
        let at = self.pattern.place(row, column) - own.start;
        for i in 0..3 {
            let begin = 9 * own.start + 3 * (i * own.len() + at);
            for j in 0..3 {
                self.matrix.values[begin + j] += block[(i, j)];
            }
        }
    }

    fn mean_diagonal(&self) -> f64 {
        let n_rows = self.matrix.n_rows;
        let own = |row: usize| self.matrix.row(row).find(|it| it.0 == row).map_or(0.0, |it| it.1);
        (0..n_rows).map(own).sum::<f64>() / n_rows as f64
    }

    fn solved(&mut self, right: &[Vec3]) -> Result<Vec<Vec3>, FitSurfaceError> {
        let is_factored = match &mut self.factor {
            Some(factor) => factor.refactor(&self.matrix),
            None => {
                self.factor = SparseCholesky::new(&self.matrix);
                self.factor.is_some()
            }
        };
        let Some(factor) = self.factor.as_ref().filter(|_| is_factored) else {
            return Err(FitSurfaceError::Undetermined);
        };
        let mut places = Mat::from_fn(3 * right.len(), 1, |row, _| right[row / 3][row % 3]);
        factor.solve_in_place(places.as_mut());
        let place = |it: usize| Vec3::from_fn(|axis, _| places[(3 * it + axis, 0)]);
        let res: Vec<Vec3> = (0..right.len()).map(place).collect();
        match res.iter().all(|it| it.iter().all(|it| it.is_finite())) {
            true => Ok(res),
            false => Err(FitSurfaceError::Undetermined),
        }
    }
}

/// Three rows a node, three columns a block, all zero.
fn zero_matrix(pattern: &BlockPattern) -> CsrMatrix {
    let n_rows = 3 * pattern.n_rows();
    let mut columns = Vec::with_capacity(9 * pattern.columns().len());
    let mut offsets = vec![0];
    for node in 0..pattern.n_rows() {
        let blocks = &pattern.columns()[pattern.row(node)];
        for _ in 0..3 {
            columns.extend(blocks.iter().flat_map(|it| [3 * it, 3 * it + 1, 3 * it + 2]));
            offsets.push(columns.len());
        }
    }
    let values = vec![0.0; columns.len()];
    CsrMatrix { n_rows, n_cols: n_rows, offsets, columns, values }
}
