//! Skin weights made smooth, and freed of scattered pieces.

use rayon::prelude::*;

use crate::kernels::geometry::{mesh::TriMesh, topology::Edges};

/// Neighbours along edges with positive conductances; rows sum to one.
pub struct Neighbours {
    offsets: Vec<usize>,
    entries: Vec<(u32, f64)>,
}

impl Neighbours {
    /// Of the vertices of a mesh: conductances are one over the edge's length, so that near ones count.
    pub fn of(mesh: &TriMesh) -> Self {
        let edges = Edges::of(mesh.faces());
        let mut rows: Vec<Vec<(u32, f64)>> = vec![Vec::new(); mesh.n_vertices()];
        let at = |it: u32| mesh.vertices()[it as usize];
        let lengths: Vec<f64> =
            edges.iter().map(|it| (at(it[0].low) - at(it[0].high)).norm()).collect();
        let mean = lengths.iter().sum::<f64>() / lengths.len().max(1) as f64;
        for (sides, length) in edges.iter().zip(&lengths) {
            let (a, b) = (sides[0].low, sides[0].high);
            // Lengths of nothing would outweigh all others.
            let conductance = 1.0 / length.max(0.01 * mean).max(f64::MIN_POSITIVE);
            rows[a as usize].push((b, conductance));
            rows[b as usize].push((a, conductance));
        }
        let mut res = Self { offsets: vec![0], entries: Vec::new() };
        for row in rows {
            let sum: f64 = row.iter().map(|it| it.1).sum();
            res.entries.extend(row.into_iter().map(|(vertex, share)| (vertex, share / sum)));
            res.offsets.push(res.entries.len());
        }
        res
    }

    pub fn n_vertices(&self) -> usize {
        self.offsets.len() - 1
    }

    pub fn row(&self, vertex: usize) -> &[(u32, f64)] {
        &self.entries[self.offsets[vertex]..self.offsets[vertex + 1]]
    }
}

/// Takes implicit steps of diffusion: `(1 + t) w - t mean(w of neighbours) = w_before`, each `t = 1`.
///
/// Solved by sweeps that all vertices make at once (Jacobi), which keep values between the least and
/// the greatest; `n_steps` steps reach about the root of `n_steps` edges far.
pub fn diffuse(neighbours: &Neighbours, columns: &mut [Vec<f64>], n_steps: usize) {
    /// After which the rest of a step is below a thousandth.
    const SWEEPS: usize = 10;
    columns.par_iter_mut().for_each(|column| {
        for _ in 0..n_steps {
            if column.iter().all(|&it| it == 0.0) {
                return;
            }
            let before = column.clone();
            for _ in 0..SWEEPS {
                let swept = (0..column.len()).map(|vertex| {
                    let row = neighbours.row(vertex);
                    if row.is_empty() {
                        return before[vertex];
                    }
                    let mean: f64 = row.iter().map(|it| column[it.0 as usize] * it.1).sum();
                    0.5 * (before[vertex] + mean)
                });
                *column = swept.collect();
            }
        }
    });
}

/// Sets weights to zero in pieces of a joint's influence that carry only a small part of it.
///
/// A piece is a connected set of vertices with positive weights; it goes if its sum of weights is less
/// than `share` of the largest piece's. Vertices that would be left without any weight keep theirs.
pub fn remove_islands(neighbours: &Neighbours, columns: &mut [Vec<f64>], share: f64) {
    let sums = |columns: &[Vec<f64>]| -> Vec<f64> {
        (0..neighbours.n_vertices())
            .map(|it| columns.iter().map(|column| column[it]).sum())
            .collect()
    };
    let before = columns.to_vec();
    columns.par_iter_mut().for_each(|column| {
        let pieces = pieces(neighbours, column);
        let weight = |piece: &Vec<u32>| piece.iter().map(|&it| column[it as usize]).sum::<f64>();
        let weights: Vec<f64> = pieces.iter().map(weight).collect();
        let largest = weights.iter().fold(0.0f64, |a, &b| a.max(b));
        for (piece, weight) in pieces.iter().zip(weights) {
            if weight < share * largest {
                piece.iter().for_each(|&it| column[it as usize] = 0.0);
            }
        }
    });
    for (vertex, sum) in sums(columns).into_iter().enumerate() {
        if !(sum > 0.0) {
            for (column, before) in columns.iter_mut().zip(&before) {
                column[vertex] = before[vertex];
            }
        }
    }
}

fn pieces(neighbours: &Neighbours, column: &[f64]) -> Vec<Vec<u32>> {
    let mut seen = vec![false; column.len()];
    let mut pieces = Vec::new();
    for start in 0..column.len() {
        if seen[start] || !(column[start] > 0.0) {
            continue;
        }
        seen[start] = true;
        let mut piece = vec![start as u32];
        let mut next = 0;
        while next < piece.len() {
            for &(neighbour, _) in neighbours.row(piece[next] as usize) {
                if !seen[neighbour as usize] && column[neighbour as usize] > 0.0 {
                    seen[neighbour as usize] = true;
                    piece.push(neighbour);
                }
            }
            next += 1;
        }
        pieces.push(piece);
    }
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes::{bumpy_sphere, rectangle};

    #[test]
    fn diffusion_keeps_constants_and_bounds() {
        let mesh = bumpy_sphere(8);
        let neighbours = Neighbours::of(&mesh);
        let step: Vec<f64> =
            mesh.vertices().iter().map(|it| if it.x > 0.0 { 1.0 } else { 0.0 }).collect();
        let rest: Vec<f64> = step.iter().map(|it| 1.0 - it).collect();
        let mut columns = vec![step.clone(), rest];
        diffuse(&neighbours, &mut columns, 3);
        let roughness = |values: &[f64]| -> f64 {
            (0..values.len())
                .flat_map(|it| neighbours.row(it).iter().map(move |n| (it, n.0 as usize)))
                .map(|(a, b)| (values[a] - values[b]).powi(2))
                .sum()
        };
        assert!(columns[0].iter().all(|&it| (0.0..=1.0).contains(&it)));
        assert!(roughness(&columns[0]) < 0.5 * roughness(&step));
        for (a, b) in columns[0].iter().zip(&columns[1]) {
            assert!((a + b - 1.0).abs() < 2e-2, "{a} and {b}");
        }
    }

    #[test]
    fn scattered_pieces_go_unless_a_vertex_would_be_left_bare() {
        let mesh = rectangle(10, 1, 10.0, 1.0);
        let neighbours = Neighbours::of(&mesh);
        // The first joint moves the left half and, wrongly, two vertices at the right end.
        let wrong = |it: &crate::kernels::geometry::mesh::Vec3| it.x > 9.5;
        let first: Vec<f64> = mesh
            .vertices()
            .iter()
            .map(|it| {
                if it.x < 5.0 {
                    1.0
                } else if wrong(it) {
                    0.3
                } else {
                    0.0
                }
            })
            .collect();
        let second: Vec<f64> = first.iter().map(|it| 1.0 - it).collect();
        let mut columns = vec![first.clone(), second];
        remove_islands(&neighbours, &mut columns, 0.1);
        for (vertex, position) in mesh.vertices().iter().enumerate() {
            let expected = if wrong(position) { 0.0 } else { first[vertex] };
            assert_eq!(columns[0][vertex], expected);
        }
        let mut alone = vec![first.clone()];
        remove_islands(&neighbours, &mut alone, 0.1);
        assert_eq!(alone[0], first);
    }
}
