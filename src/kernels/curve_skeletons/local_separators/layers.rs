//! Coarser and coarser versions of a graph.

use rayon::prelude::*;

use super::graph::SpatialGraph;
use crate::kernels::geometry::mesh::Vec3;

/// A graph whose points stand for points of the original one.
#[derive(Debug, Clone)]
pub struct Layer {
    pub graph: SpatialGraph,
    /// How many original points every point stands for.
    pub capacities: Vec<u32>,
    /// For every point of the next finer layer the point that stands for it; empty in the finest.
    pub coarse_of_fine: Vec<u32>,
}

/// The coarsest layer has at most so many points.
const COARSEST: usize = 64;

/// Layers from the finest to the coarsest: each has half the points of the one before, made by
/// contracting its shortest edges (Bærentzen et al. 2023, section 3).
pub fn layers(graph: SpatialGraph) -> Vec<Layer> {
    let capacities = vec![1; graph.n_points()];
    let mut layers = vec![Layer { graph, capacities, coarse_of_fine: vec![] }];
    loop {
        let finest = &layers[layers.len() - 1];
        let n_points = finest.graph.n_points();
        if n_points <= COARSEST {
            return layers;
        }
        match halve(finest) {
            // Points without edges are all that is left.
            layer if layer.graph.n_points() == n_points => return layers,
            layer => layers.push(layer),
        }
    }
}

fn halve(fine: &Layer) -> Layer {
    let n_wanted = fine.graph.n_points().div_ceil(2);
    let mut coarse = contract(&fine.graph, &fine.capacities, n_wanted);
    loop {
        let n_points = coarse.graph.n_points();
        let next = contract(&coarse.graph, &coarse.capacities, n_wanted);
        if n_points <= n_wanted || next.graph.n_points() == n_points {
            return coarse;
        }
        let through = coarse.coarse_of_fine.iter().map(|&it| next.coarse_of_fine[it as usize]);
        coarse = Layer { coarse_of_fine: through.collect(), ..next };
    }
}

/// Contracts the shortest edges, no two at a point, until `n_wanted` points are left or there are
/// none. A new point is at the mean of the original ones.
fn contract(graph: &SpatialGraph, capacities: &[u32], n_wanted: usize) -> Layer {
    let mut edges: Vec<(f64, [u32; 2])> =
        graph.edges().map(|[a, b]| (graph.length(a, b), [a, b])).collect();
    edges.par_sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let n_points = graph.n_points();
    let mut partners: Vec<u32> = (0..n_points as u32).collect();
    let mut n_left = n_points;
    for &(_, [a, b]) in &edges {
        if n_left <= n_wanted {
            break;
        }
        if partners[a as usize] == a && partners[b as usize] == b {
            partners[a as usize] = b;
            partners[b as usize] = a;
            n_left -= 1;
        }
    }
    let mut positions: Vec<Vec3> = Vec::with_capacity(n_left);
    let mut new_capacities = Vec::with_capacity(n_left);
    let mut coarse_of_fine = vec![0; n_points];
    for point in 0..n_points {
        let partner = partners[point] as usize;
        if partner < point {
            coarse_of_fine[point] = coarse_of_fine[partner];
            continue;
        }
        coarse_of_fine[point] = positions.len() as u32;
        let (own, other) = (capacities[point], capacities[partner]);
        let share = f64::from(other) / (f64::from(own) + f64::from(other));
        positions.push(graph.positions()[point].lerp(&graph.positions()[partner], share));
        new_capacities.push(if partner == point { own } else { own + other });
    }
    let coarse_edges = edges.iter().map(|(_, edge)| edge.map(|it| coarse_of_fine[it as usize]));
    let graph = SpatialGraph::new(positions, coarse_edges.collect());
    Layer { graph, capacities: new_capacities, coarse_of_fine }
}
