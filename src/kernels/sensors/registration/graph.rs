//! Embedded deformation graphs (Sumner, Schmid & Pauly 2007).

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};

use rayon::prelude::*;

use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::geometry::point_tree::PointTree;
use crate::kernels::numerics::sparse::row_offsets;

/// The most nodes that move a vertex.
pub const N_INFLUENCES: usize = 4;

/// The most neighbours of a node.
const N_NEIGHBOURS: usize = 8;

/// Weights below this do not count.
const LEAST_WEIGHT: f64 = 1e-5;

/// Nodes on a surface, edges between them, and how they move the surface.
#[derive(Debug, Clone)]
pub struct DeformationGraph {
    /// `N` rest positions.
    pub nodes: Vec<Vec3>,
    /// The vertex at which each node lies; empty for a graph of one rigid node.
    pub node_vertices: Vec<u32>,
    /// Directed edges `(i, j, w_ij)`; the weights of a node's edges add up to 1.
    pub edges: Vec<(u32, u32, f64)>,
    /// For each vertex up to four nodes, ascending, and their weights, which add up to 1; unused
    /// places have the weight 0.
    pub skin: Vec<[(u32, f64); N_INFLUENCES]>,
    /// Whether a vertex is joined to its nodes by the surface; others follow the nearest node.
    pub is_bound: Vec<bool>,
}

impl DeformationGraph {
    /// Spreads nodes `spacing` apart over the vertices that may hold them, in their order.
    ///
    /// Distances between nodes, and from nodes to vertices, are measured along edges of the mesh
    /// (Dijkstra), so that limbs that touch the body do not stick to it; beyond three spacings nothing is
    /// joined. Weights are `exp(-d^2 / 2 spacing^2)`. Nodes with one neighbour or none are removed.
    /// Returns `None` if there is no place for a node.
    pub fn new(
        vertices: &[Vec3],
        faces: &[[u32; 3]],
        may_hold: &[bool],
        spacing: f64,
    ) -> Option<Self> {
        let node_vertices = sample(vertices, may_hold, spacing);
        if node_vertices.is_empty() {
            return None;
        }
        let surface = Surface::new(vertices, faces);
        let reach: Vec<Vec<(u32, f64)>> =
            node_vertices.par_iter().map(|it| surface.within(*it, 3.0 * spacing)).collect();
        let mut node_at = vec![u32::MAX; vertices.len()];
        for (node, vertex) in (0_u32..).zip(&node_vertices) {
            node_at[*vertex as usize] = node;
        }
        let neighbours: Vec<Vec<(u32, f64)>> = (0_u32..)
            .zip(&reach)
            .map(|(own, reach)| {
                let nodes = reach.iter().map(|it| (node_at[it.0 as usize], it.1));
                nodes.filter(|it| it.0 != u32::MAX && it.0 != own).take(N_NEIGHBOURS).collect()
            })
            .collect();
        let lives = living(&neighbours);
        let mut new_of_old = vec![u32::MAX; lives.len()];
        for (new, old) in (0_u32..).zip((0..lives.len()).filter(|it| lives[*it])) {
            new_of_old[old] = new;
        }
        let weight = |distance: f64| (-0.5 * (distance / spacing).powi(2)).exp();
        let mut edges = Vec::new();
        let mut near: Vec<Vec<(f64, u32)>> = vec![Vec::new(); vertices.len()];
        for old in (0..lives.len()).filter(|it| lives[*it]) {
            let own: Vec<(u32, f64)> = neighbours[old]
                .iter()
                .filter(|it| lives[it.0 as usize])
                .map(|it| (new_of_old[it.0 as usize], weight(it.1)))
                .collect();
            let sum: f64 = own.iter().map(|it| it.1).sum();
            edges.extend(own.iter().map(|it| (new_of_old[old], it.0, it.1 / sum)));
            for (vertex, distance) in &reach[old] {
                near[*vertex as usize].push((*distance, new_of_old[old]));
            }
        }
        let kept = (0..lives.len()).filter(|it| lives[*it]).map(|it| node_vertices[it]);
        let node_vertices: Vec<u32> = kept.collect();
        let nodes: Vec<Vec3> = node_vertices.iter().map(|it| vertices[*it as usize]).collect();
        let tree = PointTree::new(&nodes);
        let bound: Vec<Option<[(u32, f64); N_INFLUENCES]>> =
            near.iter_mut().map(|it| influences(it, &weight)).collect();
        let is_bound = bound.iter().map(Option::is_some).collect();
        let follow = |vertex: usize| {
            let mut found = Vec::new();
            tree.nearest(vertices[vertex], 1, &mut found);
            [(found[0].1, 1.0), (0, 0.0), (0, 0.0), (0, 0.0)]
        };
        let skin = (bound.into_iter().enumerate())
            .map(|(vertex, it)| it.unwrap_or_else(|| follow(vertex)))
            .collect();
        Some(Self { nodes, node_vertices, edges, skin, is_bound })
    }

    /// One node in the middle that moves everything.
    pub fn rigid(vertices: &[Vec3]) -> Self {
        let middle = vertices.iter().sum::<Vec3>() / vertices.len() as f64;
        let skin = vec![[(0, 1.0), (0, 0.0), (0, 0.0), (0, 0.0)]; vertices.len()];
        let is_bound = vec![true; vertices.len()];
        Self { nodes: vec![middle], node_vertices: vec![], edges: vec![], skin, is_bound }
    }

    pub fn n_nodes(&self) -> usize {
        self.nodes.len()
    }
}

/// The nearest nodes with their normalised weights, by ascending node.
fn influences(
    near: &mut [(f64, u32)],
    weight: &dyn Fn(f64) -> f64,
) -> Option<[(u32, f64); N_INFLUENCES]> {
    near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut res = [(0, 0.0); N_INFLUENCES];
    let mut n_used = 0;
    for (distance, node) in near.iter().take(N_INFLUENCES) {
        let value = weight(*distance);
        if value >= LEAST_WEIGHT {
            res[n_used] = (*node, value);
            n_used += 1;
        }
    }
    res[..n_used].sort_by_key(|it| it.0);
    let sum: f64 = res.iter().map(|it| it.1).sum();
    res.iter_mut().for_each(|it| it.1 /= sum);
    (n_used > 0).then_some(res)
}

/// Accepts vertices in their order that are farther than `spacing` from all accepted ones.
fn sample(vertices: &[Vec3], may_hold: &[bool], spacing: f64) -> Vec<u32> {
    // The map is only looked up, never iterated.
    let mut cells: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
    let mut accepted = Vec::new();
    for vertex in (0..vertices.len()).filter(|it| may_hold[*it]) {
        let place = vertices[vertex];
        let [i, j, k] = <[f64; 3]>::from(place).map(|it| (it / spacing).floor() as i64);
        let mut is_free = true;
        for cell in 0..27 {
            let cell = [i + cell % 3 - 1, j + cell / 3 % 3 - 1, k + cell / 9 - 1];
            let close = |it: &u32| (vertices[*it as usize] - place).norm() <= spacing;
            is_free &= !cells.get(&cell).is_some_and(|it| it.iter().any(close));
        }
        if is_free {
            cells.entry([i, j, k]).or_default().push(vertex as u32);
            accepted.push(vertex as u32);
        }
    }
    accepted
}

/// Removes nodes that at most one other node neighbours, until there are none; keeps all nodes
/// rather than none.
fn living(neighbours: &[Vec<(u32, f64)>]) -> Vec<bool> {
    let mut lives = vec![true; neighbours.len()];
    loop {
        let lonely: Vec<usize> = (0..lives.len())
            .filter(|it| {
                let n_live = neighbours[*it].iter().filter(|it| lives[it.0 as usize]).count();
                lives[*it] && n_live <= 1
            })
            .collect();
        if lonely.is_empty() {
            return lives;
        }
        lonely.iter().for_each(|it| lives[*it] = false);
        if !lives.contains(&true) {
            return vec![true; lives.len()];
        }
    }
}

/// Vertices and the lengths of their edges.
struct Surface {
    offsets: Vec<usize>,
    edges: Vec<(u32, f64)>,
}

impl Surface {
    fn new(vertices: &[Vec3], faces: &[[u32; 3]]) -> Self {
        let mut pairs: Vec<(u32, u32)> = faces
            .iter()
            .flat_map(|&[a, b, c]| [(a, b), (b, a), (b, c), (c, b), (c, a), (a, c)])
            .collect();
        pairs.sort_unstable();
        pairs.dedup();
        let offsets = row_offsets(vertices.len(), pairs.iter().map(|it| it.0));
        let length = |a: u32, b: u32| (vertices[a as usize] - vertices[b as usize]).norm();
        let edges = pairs.iter().map(|&(a, b)| (b, length(a, b))).collect();
        Self { offsets, edges }
    }

    /// Vertices at most `radius` away along edges, nearest first (Dijkstra 1959).
    fn within(&self, from: u32, radius: f64) -> Vec<(u32, f64)> {
        let mut best: HashMap<u32, f64> = HashMap::from([(from, 0.0)]);
        let mut heap = BinaryHeap::from([Reverse((Ordered(0.0), from))]);
        let mut res = Vec::new();
        while let Some(Reverse((Ordered(distance), vertex))) = heap.pop() {
            if distance > best[&vertex] {
                continue;
            }
            res.push((vertex, distance));
            let range = self.offsets[vertex as usize]..self.offsets[vertex as usize + 1];
            for &(other, length) in &self.edges[range] {
                let through = distance + length;
                let known = best.get(&other).copied().unwrap_or(f64::INFINITY);
                if through <= radius && through < known {
                    best.insert(other, through);
                    heap.push(Reverse((Ordered(through), other)));
                }
            }
        }
        res
    }
}

/// A number that is never NaN.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Ordered(f64);

impl Eq for Ordered {}

impl PartialOrd for Ordered {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Ordered {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes;

    #[test]
    fn nodes_cover_a_surface_evenly() {
        let grid = shapes::rectangle(40, 30, 1.0, 0.75);
        let may_hold = vec![true; grid.n_vertices()];
        let graph = DeformationGraph::new(grid.vertices(), grid.faces(), &may_hold, 0.1).unwrap();
        for (index, node) in graph.nodes.iter().enumerate() {
            let others = graph.nodes[..index].iter();
            assert!(others.clone().all(|it| (it - node).norm() > 0.1));
        }
        for (vertex, skin) in grid.vertices().iter().zip(&graph.skin) {
            let sum: f64 = skin.iter().map(|it| it.1).sum();
            assert!((sum - 1.0).abs() < 1e-12);
            let nearest = skin.iter().map(|it| (graph.nodes[it.0 as usize] - vertex).norm());
            assert!(nearest.fold(1.0, f64::min) <= 0.1 + 1e-9);
        }
        assert!(graph.is_bound.iter().all(|it| *it));
        let mut sums = vec![0.0; graph.n_nodes()];
        graph.edges.iter().for_each(|it| sums[it.0 as usize] += it.2);
        assert!(sums.iter().all(|it| (it - 1.0).abs() < 1e-12));
    }

    #[test]
    fn two_sheets_that_nearly_touch_share_no_node() {
        let sheet = shapes::rectangle(20, 20, 1.0, 1.0);
        let both = shapes::union(&sheet, &shapes::moved(&sheet, Vec3::z() * 0.12));
        let may_hold = vec![true; both.n_vertices()];
        let graph = DeformationGraph::new(both.vertices(), both.faces(), &may_hold, 0.1).unwrap();
        for (vertex, skin) in graph.skin.iter().enumerate() {
            let is_upper = vertex >= sheet.n_vertices();
            for (node, weight) in skin {
                let holds = graph.node_vertices[*node as usize] as usize >= sheet.n_vertices();
                assert!(*weight == 0.0 || holds == is_upper);
            }
        }
    }

    #[test]
    fn without_places_there_is_no_graph() {
        let grid = shapes::rectangle(4, 4, 1.0, 1.0);
        let nowhere = vec![false; grid.n_vertices()];
        assert!(DeformationGraph::new(grid.vertices(), grid.faces(), &nowhere, 0.1).is_none());
    }
}
