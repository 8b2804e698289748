//! A curve skeleton whose nodes can be united and removed.

use std::collections::BTreeSet;

use super::super::curve_skeleton::{CurveSkeleton, NO_NODE};
use crate::kernels::geometry::mesh::Vec3;

/// Nodes keep their numbers while they are edited; those that are gone point to their successor.
pub struct Editor {
    pub positions: Vec<Vec3>,
    radii: Vec<f64>,
    /// How many vertices belong to every node.
    n_vertices: Vec<usize>,
    pub neighbors: Vec<BTreeSet<u32>>,
    /// The node itself while it lives, [`NO_NODE`] for one without a successor.
    successors: Vec<u32>,
    labels: Vec<u32>,
}

impl Editor {
    pub fn new(skeleton: &CurveSkeleton) -> Self {
        let n_nodes = skeleton.n_nodes();
        let mut n_vertices = vec![0; n_nodes];
        for &node in skeleton.node_of_vertex().iter().filter(|it| **it != NO_NODE) {
            n_vertices[node as usize] += 1;
        }
        let sets = skeleton.neighbors().into_iter().map(BTreeSet::from_iter);
        Self {
            positions: skeleton.positions().to_vec(),
            radii: skeleton.radii().to_vec(),
            n_vertices,
            neighbors: sets.collect(),
            successors: (0..n_nodes as u32).collect(),
            labels: skeleton.node_of_vertex().to_vec(),
        }
    }

    pub fn is_alive(&self, node: u32) -> bool {
        self.successors[node as usize] == node
    }

    /// The nodes that live, in ascending order.
    pub fn alive(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.positions.len() as u32).filter(|&it| self.is_alive(it))
    }

    pub fn degree(&self, node: u32) -> usize {
        self.neighbors[node as usize].len()
    }

    pub fn radius(&self, node: u32) -> f64 {
        self.radii[node as usize]
    }

    /// How many vertices belong to a node.
    pub fn n_vertices(&self, node: u32) -> usize {
        self.n_vertices[node as usize]
    }

    pub fn length(&self, a: u32, b: u32) -> f64 {
        (self.positions[a as usize] - self.positions[b as usize]).norm()
    }

    /// Adds an edge.
    pub fn join(&mut self, a: u32, b: u32) {
        self.neighbors[a as usize].insert(b);
        self.neighbors[b as usize].insert(a);
    }

    /// Puts the first of some nodes in the place of all: with their edges and vertices, and the mean
    /// of their radii, weighted by vertices where they have any.
    pub fn unite(&mut self, nodes: &[u32], position: Vec3) {
        let total: usize = nodes.iter().map(|&it| self.n_vertices[it as usize]).sum();
        let share = |it: u32| match total {
            0 => 1.0 / nodes.len() as f64,
            _ => self.n_vertices[it as usize] as f64 / total as f64,
        };
        let radius = nodes.iter().map(|&it| self.radius(it) * share(it)).sum();
        let first = nodes[0];
        self.positions[first as usize] = position;
        self.radii[first as usize] = radius;
        self.n_vertices[first as usize] = total;
        for &node in &nodes[1..] {
            for neighbor in self.cut_off(node) {
                if neighbor != first {
                    self.join(first, neighbor);
                }
            }
            self.successors[node as usize] = first;
        }
    }

    /// Removes a node and its edges; its vertices go to another one, or to none.
    pub fn remove(&mut self, node: u32, successor: u32) {
        self.cut_off(node);
        self.successors[node as usize] = successor;
        if successor != NO_NODE {
            self.n_vertices[successor as usize] += self.n_vertices[node as usize];
        }
    }

    fn cut_off(&mut self, node: u32) -> BTreeSet<u32> {
        let neighbors = std::mem::take(&mut self.neighbors[node as usize]);
        for &neighbor in &neighbors {
            self.neighbors[neighbor as usize].remove(&node);
        }
        neighbors
    }

    /// What is left, numbered in the old order.
    pub fn finish(self) -> CurveSkeleton {
        let alive: Vec<u32> = self.alive().collect();
        let mut new_of_old = vec![NO_NODE; self.positions.len()];
        for (new, &old) in alive.iter().enumerate() {
            new_of_old[old as usize] = new as u32;
        }
        let settle = |mut node: u32| {
            while node != NO_NODE && !self.is_alive(node) {
                node = self.successors[node as usize];
            }
            if node == NO_NODE { NO_NODE } else { new_of_old[node as usize] }
        };
        let edges = alive.iter().flat_map(|&from| {
            let larger = self.neighbors[from as usize].range(from..);
            larger.map(move |&to| [from, to])
        });
        let edges = edges.map(|edge| edge.map(|it| new_of_old[it as usize])).collect();
        let positions = alive.iter().map(|&it| self.positions[it as usize]).collect();
        let radii = alive.iter().map(|&it| self.radii[it as usize]).collect();
        let labels = self.labels.iter().map(|&it| settle(it)).collect();
        CurveSkeleton::new(positions, radii, edges, labels)
            .expect("edits keep numbers finite and edges between nodes")
    }
}
