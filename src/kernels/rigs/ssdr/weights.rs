//! The weights of all vertices, for fixed motions.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par};
use rayon::prelude::*;

use super::simplex::{Problem, dot};
use super::smoothing::Smoothing;
use super::{Moving, SsdrOptions, motions::Motions};

/// The bones that move a vertex, ascending, with weights that sum to one.
pub type Row = Vec<(u32, f64)>;

/// Vertices that one task works on.
const CHUNK: usize = 256;
/// Bones with a smaller smoothed weight are not near.
const NEAR: f64 = 1e-15;

/// Finds better weights for every vertex, a few times as smoothing goes on; returns them, and the
/// summed squared distances of every vertex over all frames.
///
/// A vertex's error is `w^T H w - 2 g^T w + |v|^2` with `H_jl = u^T M_j^T M_l u` and
/// `g_j = u^T M_j^T v`.
///
/// A vertex is moved by the bones with the largest smoothed weights, or by those before if they do
/// better. Bones so spread from neighbour to neighbour. Were any bones taken that fit best, those of
/// other limbs that happen to move alike would be, before the near ones have found their motions,
/// and the descent would end there: with 1.2 to 1.9 times the error (20 bones, a run and a gallop).
pub fn improve(
    moving: &Moving,
    motions: &Motions,
    rows: &[Row],
    smoothing: &Smoothing,
    options: &SsdrOptions,
) -> (Vec<Row>, Vec<f64>) {
    let gram = motions.gram();
    let pull = options.smoothness * moving.n_frames() as f64;
    let mut res = (rows.to_vec(), Vec::new());
    for _ in 0..options.weight_sweeps {
        let rows = &res.0;
        let smoothed = smoothing.smoothed(rows, motions.n_bones());
        let improved = for_all(moving, motions, |vertex, products| {
            let smoothed: Vec<f64> =
                (0..motions.n_bones()).map(|bone| smoothed[(vertex, bone)]).collect();
            let u = &moving.rest[vertex];
            let linear = linear(u, products);
            let pulled = linear.iter().zip(&smoothed).map(|(it, to)| it + pull * to).collect();
            let problem = Problem { u, gram: &gram, linear: pulled, ridge: pull };
            let near = if smoothing.has_neighbours(vertex) {
                problem.on_simplex(largest(&smoothed, options.max_influences))
            } else {
                problem.choose(options.max_influences)
            };
            let row = better(&problem, near, &rows[vertex]);
            let plain = Problem { u, gram: &gram, linear, ridge: 0.0 };
            let error = (moving.squares[vertex] + plain.value(&row)).max(0.0);
            (row, error)
        });
        res = improved.into_iter().unzip();
    }
    res
}

/// The bones with the largest smoothed weights.
fn largest(smoothed: &[f64], max_influences: usize) -> Row {
    let all = smoothed.iter().enumerate().filter(|it| *it.1 > NEAR);
    let mut row: Row = all.map(|(bone, &weight)| (bone as u32, weight)).collect();
    row.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    row.truncate(max_influences);
    row.sort_unstable_by_key(|it| it.0);
    let sum: f64 = row.iter().map(|it| it.1).sum();
    row.iter_mut().for_each(|it| it.1 /= sum);
    row
}

/// A solution, or the best weights of the bones before.
fn better(problem: &Problem<'_>, new: Row, before: &Row) -> Row {
    let is_among = |bone: u32| new.iter().any(|it| it.0 == bone);
    if before.iter().all(|it| is_among(it.0)) {
        return new;
    }
    let kept = problem.on_simplex(before.clone());
    if problem.value(&new) < problem.value(&kept) { new } else { kept }
}

/// For every vertex the squared distances that each bone alone would leave, `B` a vertex.
pub fn single_errors(moving: &Moving, motions: &Motions) -> Vec<Vec<f64>> {
    let gram = motions.gram();
    for_all(moving, motions, |vertex, products| {
        let u = &moving.rest[vertex];
        let linear = linear(u, products);
        let problem = Problem { u, gram: &gram, linear, ridge: 0.0 };
        (0..motions.n_bones())
            .map(|bone| {
                moving.squares[vertex] + problem.diagonal(bone) - 2.0 * problem.linear[bone]
            })
            .collect()
    })
}

/// Gives vertices that no bone moves the best bone.
pub fn fill(moving: &Moving, motions: &Motions, rows: &mut [Row]) {
    if rows.iter().all(|it| !it.is_empty()) {
        return;
    }
    let all = single_errors(moving, motions);
    for (row, errors) in rows.iter_mut().zip(&all).filter(|it| it.0.is_empty()) {
        let best = (0..errors.len()).min_by(|&a, &b| errors[a].total_cmp(&errors[b]));
        row.push((best.expect("there is a bone") as u32, 1.0));
    }
}

/// For every bone, by how much the error about grows without it.
pub fn removal_costs(moving: &Moving, motions: &Motions, rows: &[Row], errors: &[f64]) -> Vec<f64> {
    let gram = motions.gram();
    let costs = for_all(moving, motions, |vertex, products| {
        let u = &moving.rest[vertex];
        let problem = Problem { u, gram: &gram, linear: linear(u, products), ridge: 0.0 };
        let cost = |bone: u32| {
            let without = moving.squares[vertex] + problem.value_without(&rows[vertex], bone);
            (without - errors[vertex]).max(0.0)
        };
        rows[vertex].iter().map(|&(bone, _)| (bone, cost(bone))).collect::<Row>()
    });
    let mut res = vec![0.0; motions.n_bones()];
    for (bone, cost) in costs.into_iter().flatten() {
        res[bone as usize] += cost;
    }
    res
}

/// Calls `work` with every vertex and its column of `M^T V` (`4B`).
fn for_all<T: Send>(
    moving: &Moving,
    motions: &Motions,
    work: impl Fn(usize, &[f64]) -> T + Sync,
) -> Vec<T> {
    let n = moving.n_vertices();
    let chunk = |index: usize| {
        let range = index * CHUNK..n.min((index + 1) * CHUNK);
        let mut products = Mat::<f64>::zeros(motions.matrix.ncols(), range.len());
        let columns = moving.columns(range.clone());
        let transposed = motions.matrix.transpose();
        matmul(products.as_mut(), Accum::Replace, transposed, columns, 1.0, Par::Seq);
        range
            .enumerate()
            .map(|(column, vertex)| work(vertex, products.col_as_slice(column)))
            .collect::<Vec<T>>()
    };
    (0..n.div_ceil(CHUNK))
        .into_par_iter()
        .map(chunk)
        .collect::<Vec<_>>()
        .into_iter()
        .flatten()
        .collect()
}

/// `g`.
fn linear(u: &[f64; 4], products: &[f64]) -> Vec<f64> {
    products.as_chunks::<4>().0.iter().map(|block| dot(u, block)).collect()
}
