//! Skeletons as plain graphs.

use crate::kernels::curve_skeletons::curve_skeleton::CurveSkeleton;
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::rigs::skeleton::Skeleton;

use super::MatchError;

/// Nodes and the edges between them; cycles and parallel edges are welcome.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SkeletonGraph {
    pub positions: Vec<Vec3>,
    pub edges: Vec<[u32; 2]>,
    /// Where skeletons begin, one a component at most; empty if unknown.
    pub roots: Vec<u32>,
}

impl From<&Skeleton> for SkeletonGraph {
    fn from(skeleton: &Skeleton) -> Self {
        let parents = skeleton.parents();
        let is_root = |it: &u32| parents[*it as usize].is_none();
        Self {
            positions: skeleton.positions().to_vec(),
            edges: skeleton.bones().map(|(a, b)| [a as u32, b as u32]).collect(),
            roots: (0..parents.len() as u32).filter(is_root).collect(),
        }
    }
}

impl From<&CurveSkeleton> for SkeletonGraph {
    fn from(skeleton: &CurveSkeleton) -> Self {
        let (positions, edges) = (skeleton.positions().to_vec(), skeleton.edges().to_vec());
        Self { positions, edges, roots: Vec::new() }
    }
}

impl SkeletonGraph {
    pub fn length(&self, edge: usize) -> f64 {
        let [a, b] = self.edges[edge].map(|it| self.positions[it as usize]);
        (a - b).norm()
    }

    /// The edges at every node, ascending; a loop is there twice.
    pub fn incident(&self) -> Vec<Vec<u32>> {
        let mut incident = vec![Vec::new(); self.positions.len()];
        for (edge, ends) in self.edges.iter().enumerate() {
            for &end in ends {
                incident[end as usize].push(edge as u32);
            }
        }
        incident
    }

    /// The end of an edge that is not `node`; of a loop the node itself.
    pub fn other_end(&self, edge: u32, node: u32) -> u32 {
        let [a, b] = self.edges[edge as usize];
        if a == node { b } else { a }
    }

    /// How many edges every node is away from a root of its component (from its first node, if it has
    /// no root).
    pub fn depths(&self) -> Vec<u32> {
        let incident = self.incident();
        let mut depths = vec![u32::MAX; self.positions.len()];
        let all = 0..self.positions.len() as u32;
        for first in self.roots.iter().copied().chain(all) {
            if depths[first as usize] != u32::MAX {
                continue;
            }
            depths[first as usize] = 0;
            let mut queue = std::collections::VecDeque::from([first]);
            while let Some(node) = queue.pop_front() {
                for &edge in &incident[node as usize] {
                    let next = self.other_end(edge, node);
                    if depths[next as usize] == u32::MAX {
                        depths[next as usize] = depths[node as usize] + 1;
                        queue.push_back(next);
                    }
                }
            }
        }
        depths
    }

    /// # Errors
    /// [`MatchError::NoNodes`] or [`MatchError::OutOfRange`].
    pub fn check(&self, whose: &'static str) -> Result<(), MatchError> {
        let n_nodes = self.positions.len();
        if n_nodes == 0 {
            return Err(MatchError::NoNodes { whose });
        }
        let mut named = self.edges.iter().flatten().chain(&self.roots);
        match named.find(|&&it| it as usize >= n_nodes) {
            Some(&node) => Err(MatchError::OutOfRange { whose, node, n_nodes }),
            None => Ok(()),
        }
    }
}
