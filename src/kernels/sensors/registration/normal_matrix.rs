//! Block-sparse normal equations of a deformation graph: six unknowns a node.

use nalgebra::{SMatrix, SVector};
use rayon::prelude::*;

use super::graph::{DeformationGraph, N_INFLUENCES};
use crate::kernels::numerics::block_pattern::BlockPattern;

pub type Block = SMatrix<f64, 6, 6>;
pub type Six = SVector<f64, 6>;

/// Where there are blocks: nodes that move a common vertex, and ends of edges.
pub struct Pattern {
    pub blocks: BlockPattern,
    /// For each row the (sample, place in its skin) pairs that it sums over.
    pub samples: Vec<Vec<(u32, u8)>>,
}

impl Pattern {
    /// `samples` are the vertices that carry data.
    pub fn new(graph: &DeformationGraph, samples: &[u32]) -> Self {
        let n_nodes = graph.n_nodes();
        let mut pairs: Vec<(u32, u32)> = (0..n_nodes as u32).map(|it| (it, it)).collect();
        let mut by_row = vec![Vec::new(); n_nodes];
        for (sample, vertex) in (0_u32..).zip(samples) {
            let skin = &graph.skin[*vertex as usize];
            for place in (0..N_INFLUENCES).filter(|it| skin[*it].1 > 0.0) {
                by_row[skin[place].0 as usize].push((sample, place as u8));
                let others = skin.iter().filter(|it| it.1 > 0.0);
                pairs.extend(others.map(|it| (skin[place].0, it.0)));
            }
        }
        for &(i, j, _) in &graph.edges {
            pairs.extend([(i, j), (j, i)]);
        }
        Self { blocks: BlockPattern::new(n_nodes, pairs), samples: by_row }
    }
}

/// Rows that one task multiplies.
const ROWS: usize = 64;

/// Solves `(H + damping diag(H)) x = b` by conjugate gradients, preconditioned by the inverses of
/// the diagonal blocks; at most `most` iterations, to a relative residual of `tolerance`.
pub fn solve(
    pattern: &BlockPattern,
    blocks: &[Block],
    b: &[Six],
    damping: f64,
    most: usize,
    tolerance: f64,
) -> Vec<Six> {
    let n = pattern.n_rows();
    let damped: Vec<Block> = (0..n as u32)
        .map(|it| {
            let mut block = blocks[pattern.place(it, it)];
            for axis in 0..6 {
                block[(axis, axis)] += damping * block[(axis, axis)] + 1e-12;
            }
            block
        })
        .collect();
    let inverses: Vec<Block> =
        damped.iter().map(|it| it.try_inverse().unwrap_or_else(Block::identity)).collect();
    let row_product = |row: usize, x: &[Six]| {
        let mut sum = Six::zeros();
        for place in pattern.row(row) {
            let column = pattern.columns()[place] as usize;
            let block = if column == row { &damped[row] } else { &blocks[place] };
            sum += block * x[column];
        }
        sum
    };
    let product = |x: &[Six]| -> Vec<Six> {
        (0..n).into_par_iter().with_min_len(ROWS).map(|row| row_product(row, x)).collect()
    };
    let dot = |x: &[Six], y: &[Six]| x.iter().zip(y).map(|(x, y)| x.dot(y)).sum::<f64>();
    let precondition =
        |r: &[Six]| -> Vec<Six> { inverses.iter().zip(r).map(|(m, r)| m * r).collect() };
    let mut x = vec![Six::zeros(); n];
    let mut r = b.to_vec();
    let mut z = precondition(&r);
    let mut p = z.clone();
    let mut rz = dot(&r, &z);
    let bound = rz * tolerance * tolerance;
    for _ in 0..most {
        if !(rz > bound) {
            break;
        }
        let hp = product(&p);
        let curvature = dot(&p, &hp);
        if !(curvature > 0.0) {
            break;
        }
        let step = rz / curvature;
        for node in 0..n {
            x[node] += p[node] * step;
            r[node] -= hp[node] * step;
        }
        z = precondition(&r);
        let next = dot(&r, &z);
        let ratio = next / rz;
        rz = next;
        p.iter_mut().zip(&z).for_each(|(p, z)| *p = z + *p * ratio);
    }
    x
}
