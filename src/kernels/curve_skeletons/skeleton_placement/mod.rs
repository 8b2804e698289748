//! Moving the nodes of a curve skeleton to the middle of the shape.

mod block_system;
mod boundaries;
#[cfg(test)]
mod tests;

use nalgebra::Matrix3;
use rayon::prelude::*;

use super::curve_skeleton::{CurveSkeleton, CurveSkeletonError};
use crate::kernels::geometry::mesh::Vec3;
use block_system::BlockSystem;

pub use boundaries::place_by_boundaries;

/// Weights of the energy.
#[derive(Debug, Clone, PartialEq)]
pub struct PlacementOptions {
    /// Of the distances from the lines through vertices along their normals.
    pub lambda_cpp: f64,
    /// Of the distances from vertices.
    pub lambda_euc: f64,
    /// Of the lengths of edges.
    pub lambda_s: f64,
    /// `lambda_s` counts in mean numbers of vertices of a node, so that the density of the mesh does
    /// not matter.
    pub is_relative: bool,
    /// Every edge counts for both of its nodes, as the sum over nodes and their neighbours does; once
    /// otherwise.
    pub counts_edges_twice: bool,
    pub norm: Norm,
}

impl Default for PlacementOptions {
    fn default() -> Self {
        Self {
            lambda_cpp: 0.8,
            lambda_euc: 0.2,
            lambda_s: 200.0,
            is_relative: false,
            counts_edges_twice: true,
            norm: Norm::Squared,
        }
    }
}

/// What is summed up.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Norm {
    /// Squared distances: one linear system.
    #[default]
    Squared,
    /// Distances, to which outliers matter less; vertices of leaves count twice.
    Plain,
}

/// Why nodes cannot be placed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlacementError {
    #[error("the skeleton labels {n_labels} vertices, but the shape has {n_vertices}")]
    Labels { n_labels: usize, n_vertices: usize },
    #[error("there are {n_normals} normals for {n_vertices} vertices")]
    Normals { n_normals: usize, n_vertices: usize },
    #[error("`{name}` is {value}, which is no weight")]
    Weight { name: &'static str, value: f64 },
    #[error(
        "nothing holds node {node} in place: its vertices' normals are parallel or it has none, and `lambda_euc` or `lambda_s` is 0"
    )]
    Undetermined { node: usize },
    #[error(transparent)]
    Skeleton(#[from] CurveSkeletonError),
}

/// Moves all nodes to where they minimize
///
/// `sum_i sum_{v in S_i} (cpp |(j_i - v) x n_v|^2 + euc |j_i - v|^2) + s sum_i sum_{k ~ i} |j_i - j_k|^2`
///
/// with the vertices `S_i` of node `i` and their normals `n` (Transfer4D, equation 7). In the middle of
/// a limb the lines along the normals meet, also where only one side of it is seen.
///
/// `normals` are of unit length, or zero where unknown; there are none for a point cloud. Vertices
/// without a normal count by their distance only; nodes without vertices follow their
/// neighbours; parts of the skeleton without any vertex stay as they are.
///
/// # Errors
/// See [`PlacementError`].
pub fn place(
    skeleton: &CurveSkeleton,
    vertices: &[Vec3],
    normals: &[Vec3],
    options: &PlacementOptions,
) -> Result<CurveSkeleton, PlacementError> {
    check(skeleton, vertices, normals, options)?;
    let vertices_of_nodes = skeleton.vertices_of_nodes();
    let problem = Problem {
        skeleton,
        vertices,
        normals,
        edge_weight: edge_weight(&vertices_of_nodes, options),
        is_free: is_free(skeleton, &vertices_of_nodes),
        degrees: skeleton.degrees(),
        vertices_of_nodes: &vertices_of_nodes,
        options,
    };
    let positions = match options.norm {
        Norm::Squared => problem.solve(None)?,
        Norm::Plain => problem.reweight()?,
    };
    Ok(skeleton.with_positions(positions)?)
}

fn check(
    skeleton: &CurveSkeleton,
    vertices: &[Vec3],
    normals: &[Vec3],
    options: &PlacementOptions,
) -> Result<(), PlacementError> {
    let (n_labels, n_vertices) = (skeleton.node_of_vertex().len(), vertices.len());
    if n_labels != n_vertices {
        return Err(PlacementError::Labels { n_labels, n_vertices });
    }
    if !normals.is_empty() && normals.len() != n_vertices {
        return Err(PlacementError::Normals { n_normals: normals.len(), n_vertices });
    }
    let weights = [
        ("lambda_cpp", options.lambda_cpp),
        ("lambda_euc", options.lambda_euc),
        ("lambda_s", options.lambda_s),
    ];
    match weights.iter().find(|it| !(it.1 >= 0.0 && it.1.is_finite())) {
        Some(&(name, value)) => Err(PlacementError::Weight { name, value }),
        None => Ok(()),
    }
}

/// The factor of `|j_i - j_k|^2` for every edge once.
fn edge_weight(vertices_of_nodes: &[Vec<u32>], options: &PlacementOptions) -> f64 {
    let n_labelled: usize = vertices_of_nodes.iter().map(Vec::len).sum();
    let n_nodes = vertices_of_nodes.iter().filter(|it| !it.is_empty()).count();
    let unit = match options.is_relative {
        true => n_labelled as f64 / n_nodes.max(1) as f64,
        false => 1.0,
    };
    options.lambda_s * unit * if options.counts_edges_twice { 2.0 } else { 1.0 }
}

/// Whether the component of a node has no vertex at all.
fn is_free(skeleton: &CurveSkeleton, vertices_of_nodes: &[Vec<u32>]) -> Vec<bool> {
    let components = skeleton.components();
    let mut is_held = vec![false; skeleton.n_components()];
    for (node, vertices) in vertices_of_nodes.iter().enumerate() {
        is_held[components[node] as usize] |= !vertices.is_empty();
    }
    components.iter().map(|&it| !is_held[it as usize]).collect()
}

struct Problem<'a> {
    skeleton: &'a CurveSkeleton,
    vertices: &'a [Vec3],
    normals: &'a [Vec3],
    vertices_of_nodes: &'a [Vec<u32>],
    edge_weight: f64,
    is_free: Vec<bool>,
    degrees: Vec<usize>,
    options: &'a PlacementOptions,
}

/// With plain distances the ends of curves, which have neighbours on one side only, are held twice as
/// strongly.
const LEAF_WEIGHT: f64 = 2.0;

/// A node without vertices is drawn to its neighbours by so much at least.
const BARE: f64 = 1e-6;

/// Rounds of reweighting, and the share of the diagonal below which a step ends them.
const ROUNDS: usize = 200;
const STEP: f64 = 1e-7;

impl Problem<'_> {
    /// Minimizes squared distances; divided, each, by its value at other positions if they are given.
    fn solve(&self, at: Option<(&[Vec3], f64)>) -> Result<Vec<Vec3>, PlacementError> {
        let n_nodes = self.skeleton.n_nodes();
        let terms: Vec<(Matrix3<f64>, Vec3)> =
            (0..n_nodes).into_par_iter().map(|node| self.term(node, at)).collect();
        let mut system = BlockSystem::new(n_nodes);
        for (node, (matrix, right)) in terms.iter().enumerate() {
            system.add_term(node, matrix, right);
        }
        for &[a, b] in self.skeleton.edges() {
            let divisor = at.map_or(1.0, |(positions, floor)| {
                2.0 * (positions[a as usize] - positions[b as usize]).norm().max(floor)
            });
            let has_bare_end =
                [a, b].iter().any(|&it| self.vertices_of_nodes[it as usize].is_empty());
            let weight = if has_bare_end { self.edge_weight.max(BARE) } else { self.edge_weight };
            if weight > 0.0 {
                system.add_spring([a, b], weight / divisor);
            }
        }
        system.solve().map_err(|node| PlacementError::Undetermined { node })
    }

    /// The matrix and the right-hand side of a node by itself.
    fn term(&self, node: usize, at: Option<(&[Vec3], f64)>) -> (Matrix3<f64>, Vec3) {
        if self.is_free[node] {
            return (Matrix3::identity(), self.skeleton.positions()[node]);
        }
        let (mut matrix, mut right) = (Matrix3::zeros(), Vec3::zeros());
        let share = if at.is_some() && self.degrees[node] == 1 { LEAF_WEIGHT } else { 1.0 };
        for &vertex in &self.vertices_of_nodes[node] {
            let place = self.vertices[vertex as usize];
            let normal = self.normals.get(vertex as usize).filter(|it| it.norm_squared() > 0.0);
            let across =
                normal.map_or(Matrix3::zeros(), |n| Matrix3::identity() - n * n.transpose());
            let (mut cpp, mut euc) = (self.options.lambda_cpp, self.options.lambda_euc);
            if let Some((positions, floor)) = at {
                let offset = positions[node] - place;
                cpp /= 2.0 * (across * offset).norm().max(floor);
                euc /= 2.0 * offset.norm().max(floor);
            }
            let block = (across * cpp + Matrix3::identity() * euc) * share;
            matrix += block;
            right += block * place;
        }
        (matrix, right)
    }

    /// Minimizes distances by least squares that are weighted again and again (Weiszfeld 1937).
    fn reweight(&self) -> Result<Vec<Vec3>, PlacementError> {
        let Some(&first) = self.vertices.first() else {
            return Ok(self.skeleton.positions().to_vec());
        };
        let bounds = self.vertices.iter().fold((first, first), |it, v| (it.0.inf(v), it.1.sup(v)));
        let size = (bounds.1 - bounds.0).norm();
        let mut positions = self.skeleton.positions().to_vec();
        for _ in 0..ROUNDS {
            let next = self.solve(Some((&positions, 1e-6 * size)))?;
            let steps = next.iter().zip(&positions).map(|(a, b)| (a - b).norm());
            let largest = steps.fold(0.0, f64::max);
            positions = next;
            if largest <= STEP * size {
                break;
            }
        }
        Ok(positions)
    }
}
