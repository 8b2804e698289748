//! A skeleton that gets joints between others, and other roots.

use std::collections::HashSet;

use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::rigs::skeleton::Skeleton;

/// A forest without direction. The first nodes are the joints it was made of.
#[derive(Debug, Clone)]
pub struct GrowingSkeleton {
    names: Vec<String>,
    positions: Vec<Vec3>,
    neighbors: Vec<Vec<u32>>,
    roots: Vec<u32>,
    /// What nodes are sorted by: a new one stands before the joint that it was put in front of.
    ranks: Vec<u32>,
}

/// A skeleton with the nodes that its joints were.
#[derive(Debug, Clone, PartialEq)]
pub struct Grown {
    pub skeleton: Skeleton,
    pub node_of_joint: Vec<u32>,
}

impl GrowingSkeleton {
    pub fn new(skeleton: &Skeleton) -> Self {
        let n_joints = skeleton.n_joints();
        let mut neighbors = vec![Vec::new(); n_joints];
        for (parent, child) in skeleton.bones() {
            neighbors[parent].push(child as u32);
            neighbors[child].push(parent as u32);
        }
        let is_root = |it: &u32| skeleton.parents()[*it as usize].is_none();
        Self {
            names: skeleton.names().to_vec(),
            positions: skeleton.positions().to_vec(),
            neighbors,
            roots: (0..n_joints as u32).filter(is_root).collect(),
            ranks: (0..n_joints as u32).collect(),
        }
    }

    pub fn n_nodes(&self) -> usize {
        self.positions.len()
    }

    pub fn position(&self, node: u32) -> Vec3 {
        self.positions[node as usize]
    }

    /// Puts a node between two neighbours, at a share of the way.
    pub fn insert(&mut self, from: u32, to: u32, share: f64) -> u32 {
        let node = self.n_nodes() as u32;
        let [a, b] = [from, to].map(|it| self.positions[it as usize]);
        self.positions.push(a + (b - a) * share);
        self.neighbors.push(vec![from, to]);
        self.ranks.push(self.ranks[from as usize].max(self.ranks[to as usize]));
        let base = &self.names[self.ranks[node as usize] as usize];
        let known: HashSet<&String> = self.names.iter().collect();
        let name = (1..).map(|it| format!("{base}.{it}")).find(|it| !known.contains(it));
        self.names.push(name.expect("numbers do not end"));
        for (own, other) in [(from, to), (to, from)] {
            for it in self.neighbors[own as usize].iter_mut().filter(|it| **it == other) {
                *it = node;
            }
        }
        node
    }

    /// The skeleton whose components begin at these nodes, or else where they began.
    pub fn build(&self, roots: &[u32]) -> Grown {
        let mut is_seen = vec![false; self.n_nodes()];
        let mut order: Vec<(u32, Option<usize>)> = Vec::new();
        let mut firsts = self.firsts(roots);
        firsts.sort_by_key(|it| it.0);
        for (_, first) in firsts {
            let mut stack = vec![(first, None)];
            while let Some((node, parent)) = stack.pop() {
                is_seen[node as usize] = true;
                let joint = order.len();
                order.push((node, parent));
                let next = self.neighbors[node as usize].iter();
                let mut next: Vec<u32> =
                    next.copied().filter(|it| !is_seen[*it as usize]).collect();
                next.sort_by_key(|&it| std::cmp::Reverse((self.ranks[it as usize], it)));
                stack.extend(next.into_iter().map(|it| (it, Some(joint))));
            }
        }
        let names = order.iter().map(|it| self.names[it.0 as usize].clone()).collect();
        let positions = order.iter().map(|it| self.positions[it.0 as usize]).collect();
        let skeleton = Skeleton::new(names, order.iter().map(|it| it.1).collect(), positions)
            .expect("a forest in depth-first order with names of its own");
        Grown { skeleton, node_of_joint: order.iter().map(|it| it.0).collect() }
    }

    /// The first node of every component, with the root that the component had.
    fn firsts(&self, roots: &[u32]) -> Vec<(u32, u32)> {
        self.roots
            .iter()
            .map(|&root| {
                let mut members = HashSet::from([root]);
                let mut stack = vec![root];
                while let Some(node) = stack.pop() {
                    let next = self.neighbors[node as usize].iter();
                    stack.extend(next.copied().filter(|&it| members.insert(it)));
                }
                (root, roots.iter().copied().find(|it| members.contains(it)).unwrap_or(root))
            })
            .collect()
    }
}
