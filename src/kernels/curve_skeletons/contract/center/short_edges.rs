//! New nodes in long edges, and whose vertices are whose then.

use rayon::prelude::*;

use super::super::super::curve_skeleton::{CurveSkeleton, NO_NODE};
use super::super::with_radii;
use crate::kernels::geometry::mesh::Vec3;

/// The most new nodes of an edge.
const MOST_NEW: usize = 15;

/// Curves without long edges.
pub struct Split {
    /// The old nodes and, after these, the new ones, which have no vertices.
    pub curves: CurveSkeleton,
    /// For every old node the new ones that are nearer to it than to the other end of their edge.
    new_beside: Vec<Vec<u32>>,
}

impl Split {
    /// Puts nodes into edges that are longer than `max_edge` radii of the shape around them.
    pub fn new(old: &CurveSkeleton, max_edge: f64) -> Self {
        let (mut positions, mut radii) = (old.positions().to_vec(), old.radii().to_vec());
        let mut new_beside = vec![Vec::new(); old.n_nodes()];
        let mut edges = Vec::new();
        for (edge, &[from, to]) in old.edges().iter().enumerate() {
            let [a, b] = [from, to].map(|it| it as usize);
            let longest = max_edge * 0.5 * (radii[a] + radii[b]);
            let n_parts = if longest > 0.0 { (old.length(edge) / longest).ceil() } else { 1.0 };
            let n_new = (n_parts as usize).saturating_sub(1).min(MOST_NEW);
            let mut last = from;
            for step in 1..=n_new {
                let share = step as f64 / (n_new + 1) as f64;
                let new = positions.len() as u32;
                positions.push(positions[a].lerp(&positions[b], share));
                radii.push(radii[a] + (radii[b] - radii[a]) * share);
                // The one in the middle is beside both.
                if 2 * step <= n_new + 1 {
                    new_beside[a].push(new);
                }
                if 2 * step > n_new {
                    new_beside[b].push(new);
                }
                edges.push([last, new]);
                last = new;
            }
            edges.push([last, to]);
        }
        let labels = old.node_of_vertex().to_vec();
        let curves = CurveSkeleton::new(positions, radii, edges, labels);
        Self { curves: curves.expect("nodes between nodes"), new_beside }
    }

    /// Gives vertices to the nearest of their node and the new ones beside it, and radii by them.
    ///
    /// `new_of_old` has the numbers in `curves` of all nodes, or [`NO_NODE`] for those it lacks.
    pub fn labelled(
        &self,
        curves: &CurveSkeleton,
        vertices: &[Vec3],
        new_of_old: &[u32],
    ) -> CurveSkeleton {
        let mut candidates = vec![Vec::new(); curves.n_nodes()];
        for (node, beside) in
            self.new_beside.iter().enumerate().filter(|it| new_of_old[it.0] != NO_NODE)
        {
            let all = std::iter::once(node as u32).chain(beside.iter().copied());
            let all = all.map(|it| new_of_old[it as usize]).filter(|it| *it != NO_NODE);
            candidates[new_of_old[node] as usize] = all.collect();
        }
        let nearest = |(&node, vertex): (&u32, &Vec3)| {
            if node == NO_NODE {
                return node;
            }
            let distance = |it: u32| (curves.positions()[it as usize] - vertex).norm_squared();
            let all = candidates[node as usize].iter().copied();
            all.min_by(|&a, &b| distance(a).total_cmp(&distance(b))).unwrap_or(node)
        };
        let labels = curves.node_of_vertex().par_iter().zip(vertices).map(nearest).collect();
        let (places, edges) = (curves.positions().to_vec(), curves.edges().to_vec());
        let labelled = CurveSkeleton::new(places, curves.radii().to_vec(), edges, labels);
        let labelled = labelled.expect("labels of nodes there are");
        // Those without vertices keep what was between their neighbours.
        let measured = with_radii(&labelled, vertices);
        let radius = |(new, old): (&f64, &f64)| if *new > 0.0 { *new } else { *old };
        let radii = measured.radii().iter().zip(curves.radii()).map(radius).collect();
        let (places, edges) = (curves.positions().to_vec(), curves.edges().to_vec());
        CurveSkeleton::new(places, radii, edges, labelled.node_of_vertex().to_vec())
            .expect("only radii are others, and they are finite")
    }
}
