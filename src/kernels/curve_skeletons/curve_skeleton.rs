//! Curve skeletons: a graph of curves inside a shape.

use crate::kernels::geometry::mesh::Vec3;

/// What a vertex has that belongs to no node.
pub const NO_NODE: u32 = u32::MAX;

/// A graph of curves inside a shape, as extractors find it: no names, no root, cycles are allowed.
///
/// `N` nodes with positions in the shape's unit and the radius of the shape around them (0 where
/// unknown); undirected edges; for every vertex of the shape the node it belongs to. There may be no
/// node at all: a ball has no curve.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CurveSkeleton {
    positions: Vec<Vec3>,
    radii: Vec<f64>,
    edges: Vec<[u32; 2]>,
    node_of_vertex: Vec<u32>,
}

/// Why something is no curve skeleton.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CurveSkeletonError {
    #[error("there are {positions} positions and {radii} radii")]
    Counts { positions: usize, radii: usize },
    #[error("node {node} has the coordinate {value}")]
    NotFinite { node: usize, value: f64 },
    #[error("node {node} has the radius {value}")]
    Radius { node: usize, value: f64 },
    #[error("edge {edge} joins node {node}, but there are {n_nodes} nodes")]
    EdgeOutOfRange { edge: usize, node: u32, n_nodes: usize },
    #[error("edge {edge} joins node {node} with itself")]
    Loop { edge: usize, node: u32 },
    #[error("vertex {vertex} belongs to node {node}, but there are {n_nodes} nodes")]
    NodeOutOfRange { vertex: usize, node: u32, n_nodes: usize },
}

impl CurveSkeleton {
    /// Checks and wraps `N` nodes; edges are put in order, repeated ones dropped.
    ///
    /// `node_of_vertex` has a node for every vertex of the shape, or [`NO_NODE`]; it is empty when
    /// that is unknown.
    ///
    /// # Errors
    /// See [`CurveSkeletonError`]; the first offending node, edge or vertex is named.
    pub fn new(
        positions: Vec<Vec3>,
        radii: Vec<f64>,
        mut edges: Vec<[u32; 2]>,
        node_of_vertex: Vec<u32>,
    ) -> Result<Self, CurveSkeletonError> {
        let n_nodes = positions.len();
        if radii.len() != n_nodes {
            return Err(CurveSkeletonError::Counts { positions: n_nodes, radii: radii.len() });
        }
        for (node, (position, &radius)) in positions.iter().zip(&radii).enumerate() {
            if let Some(&value) = position.iter().find(|it| !it.is_finite()) {
                return Err(CurveSkeletonError::NotFinite { node, value });
            }
            if !radius.is_finite() || radius < 0.0 {
                return Err(CurveSkeletonError::Radius { node, value: radius });
            }
        }
        for (edge, ends) in edges.iter_mut().enumerate() {
            if let Some(&node) = ends.iter().find(|&&it| it as usize >= n_nodes) {
                return Err(CurveSkeletonError::EdgeOutOfRange { edge, node, n_nodes });
            }
            if ends[0] == ends[1] {
                return Err(CurveSkeletonError::Loop { edge, node: ends[0] });
            }
            ends.sort_unstable();
        }
        edges.sort_unstable();
        edges.dedup();
        let is_wrong = |node: u32| node as usize >= n_nodes && node != NO_NODE;
        if let Some(vertex) = node_of_vertex.iter().position(|&it| is_wrong(it)) {
            let node = node_of_vertex[vertex];
            return Err(CurveSkeletonError::NodeOutOfRange { vertex, node, n_nodes });
        }
        Ok(Self { positions, radii, edges, node_of_vertex })
    }

    pub fn n_nodes(&self) -> usize {
        self.positions.len()
    }

    pub fn n_edges(&self) -> usize {
        self.edges.len()
    }

    /// `N` positions.
    pub fn positions(&self) -> &[Vec3] {
        &self.positions
    }

    /// The radius of the shape around every node; 0 where unknown.
    pub fn radii(&self) -> &[f64] {
        &self.radii
    }

    /// Pairs of nodes, the smaller index first, in ascending order, none twice.
    pub fn edges(&self) -> &[[u32; 2]] {
        &self.edges
    }

    /// The node of every vertex of the shape, or [`NO_NODE`]; empty when unknown.
    pub fn node_of_vertex(&self) -> &[u32] {
        &self.node_of_vertex
    }

    /// The vertices of every node, in ascending order.
    pub fn vertices_of_nodes(&self) -> Vec<Vec<u32>> {
        let mut vertices = vec![Vec::new(); self.n_nodes()];
        for (vertex, &node) in self.node_of_vertex.iter().enumerate() {
            if node != NO_NODE {
                vertices[node as usize].push(vertex as u32);
            }
        }
        vertices
    }

    /// The neighbours of every node, in ascending order.
    pub fn neighbors(&self) -> Vec<Vec<u32>> {
        let mut neighbors = vec![Vec::new(); self.n_nodes()];
        for &[low, high] in &self.edges {
            neighbors[low as usize].push(high);
            neighbors[high as usize].push(low);
        }
        for list in &mut neighbors {
            list.sort_unstable();
        }
        neighbors
    }

    /// The number of edges at every node.
    pub fn degrees(&self) -> Vec<usize> {
        let mut degrees = vec![0; self.n_nodes()];
        for node in self.edges.iter().flatten() {
            degrees[*node as usize] += 1;
        }
        degrees
    }

    /// Nodes with one edge.
    pub fn leaves(&self) -> Vec<u32> {
        self.nodes_where(|degree| degree == 1)
    }

    /// Nodes with more than two edges.
    pub fn junctions(&self) -> Vec<u32> {
        self.nodes_where(|degree| degree > 2)
    }

    fn nodes_where(&self, holds: impl Fn(usize) -> bool) -> Vec<u32> {
        let degrees = self.degrees();
        (0..self.n_nodes() as u32).filter(|&it| holds(degrees[it as usize])).collect()
    }

    /// The connected part of every node, numbered by their first nodes.
    pub fn components(&self) -> Vec<u32> {
        let neighbors = self.neighbors();
        let mut components = vec![u32::MAX; self.n_nodes()];
        let mut n_components = 0;
        let mut stack = vec![];
        for first in 0..self.n_nodes() as u32 {
            if components[first as usize] != u32::MAX {
                continue;
            }
            components[first as usize] = n_components;
            stack.push(first);
            while let Some(node) = stack.pop() {
                for &next in &neighbors[node as usize] {
                    if components[next as usize] == u32::MAX {
                        components[next as usize] = n_components;
                        stack.push(next);
                    }
                }
            }
            n_components += 1;
        }
        components
    }

    pub fn n_components(&self) -> usize {
        self.components().iter().max().map_or(0, |&it| it as usize + 1)
    }

    /// The number of independent cycles: edges - nodes + components.
    pub fn n_cycles(&self) -> usize {
        self.n_edges() + self.n_components() - self.n_nodes()
    }

    /// The length of an edge.
    pub fn length(&self, edge: usize) -> f64 {
        let [low, high] = self.edges[edge].map(|it| self.positions[it as usize]);
        (high - low).norm()
    }

    /// The sum of the lengths of all edges.
    pub fn total_length(&self) -> f64 {
        (0..self.n_edges()).map(|edge| self.length(edge)).sum()
    }

    /// The same graph at other positions.
    ///
    /// # Errors
    /// [`CurveSkeletonError::Counts`] or [`CurveSkeletonError::NotFinite`].
    pub fn with_positions(&self, positions: Vec<Vec3>) -> Result<Self, CurveSkeletonError> {
        let (radii, edges) = (self.radii.clone(), self.edges.clone());
        Self::new(positions, radii, edges, self.node_of_vertex.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A triangle with a tail, and a node of its own.
    fn kite() -> CurveSkeleton {
        let positions = [[0.0, 0.0], [3.0, 0.0], [0.0, 4.0], [0.0, -2.0], [9.0, 9.0]]
            .map(|[x, y]| Vec3::new(x, y, 0.0))
            .to_vec();
        let edges = vec![[2, 1], [0, 1], [0, 2], [3, 0], [1, 2]];
        CurveSkeleton::new(positions, vec![0.5; 5], edges, vec![3, NO_NODE, 0, 3]).unwrap()
    }

    #[test]
    fn counts_of_a_triangle_with_a_tail() {
        let skeleton = kite();
        assert_eq!(skeleton.edges(), [[0, 1], [0, 2], [0, 3], [1, 2]]);
        assert_eq!(skeleton.degrees(), [3, 2, 2, 1, 0]);
        assert_eq!((skeleton.leaves(), skeleton.junctions()), (vec![3], vec![0]));
        assert_eq!(skeleton.components(), [0, 0, 0, 0, 1]);
        assert_eq!((skeleton.n_components(), skeleton.n_cycles()), (2, 1));
        assert_eq!(skeleton.total_length(), 3.0 + 4.0 + 2.0 + 5.0);
        assert_eq!(skeleton.vertices_of_nodes(), [vec![2], vec![], vec![], vec![0, 3], vec![]]);
        assert_eq!(skeleton.neighbors()[0], [1, 2, 3]);
    }

    #[test]
    fn nothing_has_no_parts() {
        let nothing = CurveSkeleton::new(vec![], vec![], vec![], vec![NO_NODE]).unwrap();
        assert_eq!((nothing.n_components(), nothing.n_cycles()), (0, 0));
        assert_eq!(nothing.total_length(), 0.0);
    }

    #[test]
    fn what_is_wrong_is_named() {
        let check = |radii: &[f64], edges: &[[u32; 2]], labels: &[u32], expected: &str| {
            let positions = vec![Vec3::zeros(), Vec3::x()];
            let made =
                CurveSkeleton::new(positions, radii.to_vec(), edges.to_vec(), labels.to_vec());
            assert_eq!(made.unwrap_err().to_string(), expected);
        };
        check(&[0.0], &[], &[], "there are 2 positions and 1 radii");
        check(&[0.0, -1.0], &[], &[], "node 1 has the radius -1");
        check(&[0.0; 2], &[[0, 1], [1, 1]], &[], "edge 1 joins node 1 with itself");
        check(&[0.0; 2], &[[0, 2]], &[], "edge 0 joins node 2, but there are 2 nodes");
        check(&[0.0; 2], &[], &[0, 2], "vertex 1 belongs to node 2, but there are 2 nodes");
    }
}
