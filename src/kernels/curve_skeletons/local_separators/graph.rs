//! Points in space that are joined by edges.

use crate::kernels::geometry::mesh::{TriMesh, Vec3};

/// An undirected graph in space: no loops, no repeated edges, neighbours in ascending order.
#[derive(Debug, Clone, PartialEq)]
pub struct SpatialGraph {
    positions: Vec<Vec3>,
    /// One more than points.
    offsets: Vec<u32>,
    neighbors: Vec<u32>,
}

impl SpatialGraph {
    /// The vertices of a mesh, joined by the sides of its faces.
    pub fn of_mesh(mesh: &TriMesh) -> Self {
        let sides = mesh.faces().iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
        Self::new(mesh.vertices().to_vec(), sides.collect())
    }

    /// Joins points by edges in any order; loops and repeated edges are dropped.
    ///
    /// # Panics
    /// If an edge names no point, or there are `2^32` ends of edges or more.
    pub fn new(positions: Vec<Vec3>, mut edges: Vec<[u32; 2]>) -> Self {
        let n_points = positions.len();
        edges.retain(|[from, to]| from != to);
        for edge in &mut edges {
            edge.sort_unstable();
        }
        edges.sort_unstable();
        edges.dedup();
        assert!(u32::try_from(2 * edges.len()).is_ok(), "ends of edges are numbered by 32 bits");
        let mut offsets = vec![0; n_points + 1];
        for &point in edges.iter().flatten() {
            offsets[point as usize + 1] += 1;
        }
        for point in 0..n_points {
            offsets[point + 1] += offsets[point];
        }
        let mut neighbors = vec![0; 2 * edges.len()];
        let mut next = offsets.clone();
        let mut put = |at: u32, neighbor: u32| {
            neighbors[next[at as usize] as usize] = neighbor;
            next[at as usize] += 1;
        };
        // Smaller neighbours first: the edges ascend, so both loops leave every list ascending.
        edges.iter().for_each(|&[low, high]| put(high, low));
        edges.iter().for_each(|&[low, high]| put(low, high));
        Self { positions, offsets, neighbors }
    }

    pub fn n_points(&self) -> usize {
        self.positions.len()
    }

    pub fn positions(&self) -> &[Vec3] {
        &self.positions
    }

    pub fn position(&self, point: u32) -> Vec3 {
        self.positions[point as usize]
    }

    /// The neighbours of a point, in ascending order.
    pub fn neighbors(&self, point: u32) -> &[u32] {
        let point = point as usize;
        &self.neighbors[self.offsets[point] as usize..self.offsets[point + 1] as usize]
    }

    /// Every edge once, the smaller point first, in ascending order.
    pub fn edges(&self) -> impl Iterator<Item = [u32; 2]> + '_ {
        (0..self.n_points() as u32).flat_map(|from| {
            let larger = self.neighbors(from).iter().filter(move |&&to| from < to);
            larger.map(move |&to| [from, to])
        })
    }

    /// The points of every connected part, in ascending order; parts by their first points.
    pub fn parts(&self) -> Vec<Vec<u32>> {
        let mut is_seen = vec![false; self.n_points()];
        let mut parts = vec![];
        for first in 0..self.n_points() as u32 {
            if is_seen[first as usize] {
                continue;
            }
            is_seen[first as usize] = true;
            let mut part = vec![first];
            let mut next = 0;
            while let Some(&point) = part.get(next) {
                next += 1;
                for &neighbor in self.neighbors(point) {
                    if !is_seen[neighbor as usize] {
                        is_seen[neighbor as usize] = true;
                        part.push(neighbor);
                    }
                }
            }
            part.sort_unstable();
            parts.push(part);
        }
        parts
    }

    /// A part by itself: its point `k` is the point `part[k]` of this graph. No edge may lead out of it.
    pub fn part(&self, part: &[u32]) -> Self {
        let place =
            |point: u32| part.binary_search(&point).expect("no edge leads out of a part") as u32;
        let mut res = Self { positions: vec![], offsets: vec![0], neighbors: vec![] };
        for &point in part {
            res.positions.push(self.position(point));
            res.neighbors.extend(self.neighbors(point).iter().map(|&it| place(it)));
            res.offsets.push(res.neighbors.len() as u32);
        }
        res
    }

    pub fn length(&self, from: u32, to: u32) -> f64 {
        (self.position(to) - self.position(from)).norm()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loops_and_repeated_edges_are_dropped() {
        let positions = vec![Vec3::zeros(), Vec3::x() * 2.0, Vec3::y(), Vec3::z()];
        let edges = vec![[2, 0], [1, 1], [0, 1], [1, 0], [2, 1]];
        let graph = SpatialGraph::new(positions, edges);
        assert_eq!(graph.edges().collect::<Vec<_>>(), [[0, 1], [0, 2], [1, 2]]);
        assert_eq!((graph.neighbors(2), graph.neighbors(3)), (&[0, 1][..], &[][..]));
        assert_eq!(graph.length(1, 0), 2.0);
        assert_eq!(graph.parts(), [vec![0, 1, 2], vec![3]]);
        assert_eq!(graph.part(&[0, 1, 2]).edges().count(), 3);
    }
}
