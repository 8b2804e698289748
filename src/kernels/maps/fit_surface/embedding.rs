//! A surface that follows nodes.

use nalgebra::Matrix3;
use rayon::prelude::*;

use crate::kernels::geometry::kabsch::best_rotation;
use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::numerics::sparse::row_offsets;
use crate::kernels::sensors::registration::graph::{DeformationGraph, N_INFLUENCES};

/// How often factors are averaged with those of the neighbours.
const SCALE_ROUNDS: usize = 12;

/// How far a node's factor may be from that of the whole.
const SCALE_RANGE: f64 = 3.0;

/// Nodes on a surface at rest, and how vertices follow them.
pub struct Embedding<'a> {
    rest: &'a [Vec3],
    pub graph: DeformationGraph,
    /// By node, the range of its edges in the graph's.
    offsets: Vec<usize>,
}

impl<'a> Embedding<'a> {
    /// Spreads about so many nodes; `None` if the surface has no area.
    pub fn new(mesh: &'a TriMesh, n_nodes: usize) -> Option<Self> {
        let areas = mesh.vertex_areas();
        let may_hold: Vec<bool> = areas.iter().map(|it| *it > 0.0).collect();
        let spacing = (areas.iter().sum::<f64>() / n_nodes as f64).sqrt();
        let graph = DeformationGraph::new(mesh.vertices(), mesh.faces(), &may_hold, spacing)?;
        let offsets = row_offsets(graph.n_nodes(), graph.edges.iter().map(|it| it.0));
        Some(Self { rest: mesh.vertices(), graph, offsets })
    }

    pub fn n_nodes(&self) -> usize {
        self.graph.n_nodes()
    }

    fn edges_of(&self, node: usize) -> &[(u32, u32, f64)] {
        &self.graph.edges[self.offsets[node]..self.offsets[node + 1]]
    }

    /// Where nodes lie if every vertex lies at its place: means with the vertices' areas.
    pub fn means(&self, places: &[Vec3], areas: &[f64]) -> Vec<Vec3> {
        let mut sums = vec![(Vec3::zeros(), 0.0); self.n_nodes()];
        for ((skin, place), area) in self.graph.skin.iter().zip(places).zip(areas) {
            for &(node, weight) in skin {
                let (sum, total) = &mut sums[node as usize];
                *sum += place * (weight * area);
                *total += weight * area;
            }
        }
        sums.into_iter().map(|(sum, total)| sum / total.max(f64::MIN_POSITIVE)).collect()
    }

    /// The similarity of every node's surroundings: a rotation times a factor.
    pub fn frames(&self, nodes: &[Vec3]) -> Vec<Matrix3<f64>> {
        let fits: Vec<(Matrix3<f64>, [f64; 2])> =
            (0..self.n_nodes()).into_par_iter().map(|it| self.fit(nodes, it)).collect();
        let sums: Vec<[f64; 2]> = fits.iter().map(|it| it.1).collect();
        let whole = sums.iter().fold([0.0; 2], |sum, it| [sum[0] + it[0], sum[1] + it[1]]);
        let whole = whole[0] / whole[1];
        let bounds = (whole / SCALE_RANGE, whole * SCALE_RANGE);
        let smooth = (0..SCALE_ROUNDS).fold(sums, |sums, _| self.averaged(&sums));
        let factor = |[fitted, rest]: [f64; 2]| (fitted / rest).clamp(bounds.0, bounds.1);
        fits.iter().zip(smooth).map(|(fit, sums)| fit.0 * factor(sums)).collect()
    }

    /// The best rotation of a node's edges, and what their best factor is the quotient of.
    fn fit(&self, nodes: &[Vec3], node: usize) -> (Matrix3<f64>, [f64; 2]) {
        let rest = &self.graph.nodes;
        let (mut covariance, mut square) = (Matrix3::zeros(), f64::MIN_POSITIVE);
        for &(from, to, weight) in self.edges_of(node) {
            let at_rest = rest[to as usize] - rest[from as usize];
            let now = nodes[to as usize] - nodes[from as usize];
            covariance += now * at_rest.transpose() * weight;
            square += at_rest.norm_squared() * weight;
        }
        let rotation = best_rotation(&covariance).to_rotation_matrix().into_inner();
        let fitted = (rotation.transpose() * covariance).trace();
        (rotation, [fitted.max(0.0), square])
    }

    /// Means of nodes and their neighbours.
    fn averaged(&self, values: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let mean = |node: usize| {
            let edges = self.edges_of(node);
            let mut sum = values[node];
            for edge in edges {
                let other = values[edge.1 as usize];
                sum = [sum[0] + other[0], sum[1] + other[1]];
            }
            sum.map(|it| it / (edges.len() + 1) as f64)
        };
        (0..self.n_nodes()).map(mean).collect()
    }

    /// What of a vertex's place does not depend on where nodes lie: `sum_j w_j M_j (v - g_j)`.
    pub fn offset(&self, frames: &[Matrix3<f64>], vertex: usize) -> Vec3 {
        let place = self.rest[vertex];
        let part = |&(node, weight): &(u32, f64)| {
            frames[node as usize] * (place - self.graph.nodes[node as usize]) * weight
        };
        self.skin(vertex).iter().map(part).sum()
    }

    pub fn skin(&self, vertex: usize) -> &[(u32, f64); N_INFLUENCES] {
        &self.graph.skin[vertex]
    }

    /// Where all vertices lie.
    pub fn deformed(&self, nodes: &[Vec3], frames: &[Matrix3<f64>]) -> Vec<Vec3> {
        let place = |vertex: usize| {
            let carried = self.skin(vertex).iter().map(|it| nodes[it.0 as usize] * it.1);
            carried.sum::<Vec3>() + self.offset(frames, vertex)
        };
        (0..self.rest.len()).into_par_iter().map(place).collect()
    }
}
