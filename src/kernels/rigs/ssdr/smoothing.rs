//! Weights that vary little between neighbours that move alike.

use std::collections::BTreeMap;

use faer::Mat;

use super::{Moving, weights::Row};
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::numerics::sparse::CsrMatrix;
use crate::kernels::numerics::sparse_cholesky::SparseCholesky;

/// One implicit step of diffusion over the edges of the mesh.
///
/// `(D + D - A) s = D w`, where an edge counts by one over the root mean square of the change of its
/// length: across a joint, where lengths change, little is smoothed.
pub struct Smoothing {
    degrees: Vec<f64>,
    factor: Option<SparseCholesky>,
    has_neighbours: Vec<bool>,
}

impl Smoothing {
    pub fn new(moving: &Moving, edges: &[(u32, u32)]) -> Self {
        let mut edges: BTreeMap<(u32, u32), f64> = edges.iter().map(|it| (*it, 0.0)).collect();
        for (&(a, b), weight) in &mut edges {
            *weight = 1.0 / (change(moving, a as usize, b as usize) + 1e-6);
        }
        let mut degrees = vec![0.0; moving.n_vertices()];
        for (&(a, b), weight) in &edges {
            degrees[a as usize] += weight;
            degrees[b as usize] += weight;
        }
        let has_neighbours = degrees.iter().map(|it| *it > 0.0).collect();
        let mut triplets = Vec::with_capacity(2 * edges.len() + degrees.len());
        for (vertex, degree) in degrees.iter_mut().enumerate() {
            if *degree == 0.0 {
                *degree = 1.0;
                triplets.push((vertex as u32, vertex as u32, 1.0));
            } else {
                triplets.push((vertex as u32, vertex as u32, 2.0 * *degree));
            }
        }
        for (&(a, b), &weight) in &edges {
            triplets.push((a, b, -weight));
            triplets.push((b, a, -weight));
        }
        let n = moving.n_vertices();
        let factor = SparseCholesky::new(&CsrMatrix::from_triplets(n, n, &triplets));
        Self { degrees, factor, has_neighbours }
    }

    pub fn has_neighbours(&self, vertex: usize) -> bool {
        self.has_neighbours[vertex]
    }

    /// The smoothed weights, `V x B`.
    pub fn smoothed(&self, rows: &[Row], n_bones: usize) -> Mat<f64> {
        let mut res = Mat::zeros(rows.len(), n_bones);
        for (vertex, row) in rows.iter().enumerate() {
            for &(bone, weight) in row {
                let share = if self.factor.is_some() { self.degrees[vertex] } else { 1.0 };
                res[(vertex, bone as usize)] = share * weight;
            }
        }
        if let Some(factor) = &self.factor {
            factor.solve_in_place(res.as_mut());
        }
        res
    }
}

/// The root mean square of the change of an edge's length.
fn change(moving: &Moving, a: usize, b: usize) -> f64 {
    let rest: f64 = (0..3).map(|it| (moving.rest[a][it] - moving.rest[b][it]).powi(2)).sum();
    let rest = rest.sqrt();
    let (from, to) = (moving.frames.col_as_slice(a), moving.frames.col_as_slice(b));
    let squares = from.as_chunks::<3>().0.iter().zip(to.as_chunks::<3>().0).map(|(a, b)| {
        let length: f64 = (0..3).map(|it| (a[it] - b[it]).powi(2)).sum();
        (length.sqrt() - rest).powi(2)
    });
    (squares.sum::<f64>() / moving.n_frames() as f64).sqrt()
}

/// The edges of faces, ascending, and between vertices at the same place: where textures have seams,
/// a mesh is cut without being in pieces.
pub fn edges_of(rest: &[Vec3], faces: &[[u32; 3]]) -> Vec<(u32, u32)> {
    let corners = faces.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]);
    let key = |it: u32| rest[it as usize].map(f64::to_bits).into();
    let mut order: Vec<([u64; 3], u32)> = (0..rest.len() as u32).map(|it| (key(it), it)).collect();
    order.sort_unstable();
    let same = order.windows(2).filter(|it| it[0].0 == it[1].0).map(|it| (it[0].1, it[1].1));
    let mut edges: Vec<(u32, u32)> =
        corners.chain(same).filter(|(a, b)| a != b).map(|(a, b)| (a.min(b), a.max(b))).collect();
    edges.sort_unstable();
    edges.dedup();
    edges
}
