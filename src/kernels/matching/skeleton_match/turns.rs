//! How matched skeletons agree in the ways that limbs leave their branch nodes.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, UnitQuaternion};

use super::collapse::Collapsed;
use super::graph::SkeletonGraph;
use super::search::MatchedWay;
use crate::kernels::geometry::kabsch::best_rotation;
use crate::kernels::geometry::mesh::Vec3;

/// Directions are looked at over this share of the skeleton's whole length: poses turn limbs less near the
/// trunk than farther out.
const REACH: f64 = 0.025;

/// What a branch node's turn against that of the whole figure counts, in branches.
const STIFFNESS: f64 = 1.0;

/// What a branch without a partner counts; 1 is the most that a branch with a partner can.
const ALONE: f64 = 0.5;

/// The directions in which the branches of every node leave it, as [`Collapsed::incident`] lists them.
#[derive(Debug, Clone, PartialEq)]
pub struct Starts {
    of_node: Vec<Vec<Start>>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Start {
    branch: u32,
    direction: Vec3,
}

impl Starts {
    pub fn new(graph: &SkeletonGraph, collapsed: &Collapsed) -> Self {
        let reach = REACH * collapsed.total_length();
        let start = |node: usize, branch: u32| {
            let line = collapsed.nodes_along(branch, node as u32);
            Start { branch, direction: direction(graph, &line, reach) }
        };
        let of_node = collapsed.incident.iter().enumerate();
        let of_node = of_node
            .map(|(node, list)| list.iter().map(|&(branch, _)| start(node, branch)).collect())
            .collect();
        Self { of_node }
    }

    fn is_hub(&self, node: u32) -> bool {
        self.of_node[node as usize].len() > 2
    }

    fn direction(&self, node: u32, branch: u32) -> Option<Vec3> {
        let start = self.of_node[node as usize].iter().find(|it| it.branch == branch)?;
        Some(start.direction)
    }

    /// How many branches begin at branch nodes.
    fn n_ends(&self) -> usize {
        self.of_node.iter().map(Vec::len).filter(|&it| it > 2).sum()
    }
}

/// From the first node to the place after a way along a line; zero if all of it is at one place.
fn direction(graph: &SkeletonGraph, line: &[u32], reach: f64) -> Vec3 {
    let place = |it: u32| graph.positions[it as usize];
    let first = place(line[0]);
    let mut way = 0.0;
    let mut end = first;
    for pair in line.windows(2) {
        let step = place(pair[1]) - place(pair[0]);
        let share = if step.norm() > 0.0 { ((reach - way) / step.norm()).min(1.0) } else { 1.0 };
        end = place(pair[0]) + step * share;
        way += step.norm();
        if way >= reach {
            break;
        }
    }
    (end - first).try_normalize(0.0).unwrap_or_else(Vec3::zeros)
}

/// From 0 to 1: how far the directions of matched branches differ after every branch node has been turned
/// as they fit best. Turns only: left and right of a trunk stay apart, whatever the pose. Turns that
/// are not the figure's own count, too, and so do branches at branch nodes that are not matched.
pub fn turn_rating(
    [small, large]: [(&Collapsed, &Starts); 2],
    ways: &[MatchedWay],
    turn: &UnitQuaternion<f64>,
) -> f64 {
    let mut pairs: BTreeMap<[u32; 2], Vec<[Vec3; 2]>> = BTreeMap::new();
    for way in ways {
        let [own, theirs] = &way.branches;
        let (Some(ends), Some(last)) =
            (own.first().zip(theirs.first()), own.last().zip(theirs.last()))
        else {
            continue;
        };
        let to = [end_of(small.0, own, way.from[0]), end_of(large.0, theirs, way.from[1])];
        for (nodes, (a, b)) in [(way.from, ends), (to, last)] {
            let directions = small.1.direction(nodes[0], *a).zip(large.1.direction(nodes[1], *b));
            if let Some((a, b)) = directions {
                pairs.entry(nodes).or_default().push([a, b]);
            }
        }
    }
    let n_ends = small.1.n_ends() + large.1.n_ends();
    if n_ends == 0 {
        return 0.0;
    }
    let mut alone = n_ends;
    let mut sum = 0.0;
    for (nodes, pairs) in &pairs {
        let n_hubs = usize::from(small.1.is_hub(nodes[0])) + usize::from(large.1.is_hub(nodes[1]));
        if n_hubs == 0 {
            continue;
        }
        alone -= n_hubs * pairs.len();
        sum += off(pairs, turn);
    }
    (2.0 * sum + ALONE * alone as f64) / n_ends as f64
}

/// The node that some branches lead to.
fn end_of(collapsed: &Collapsed, branches: &[u32], from: u32) -> u32 {
    branches.iter().fold(from, |at, &branch| {
        let ends = collapsed.branches[branch as usize].ends;
        if ends[0] == at { ends[1] } else { ends[0] }
    })
}

/// What is left of the differences of directions and of the turn, each from 0 to 1.
fn off(pairs: &[[Vec3; 2]], turn: &UnitQuaternion<f64>) -> f64 {
    let turn = turn.to_rotation_matrix().into_inner();
    let sum: Matrix3<f64> = pairs.iter().map(|[a, b]| b * a.transpose()).sum();
    // Squares of directions differ by 4 at most, those of turns by 8.
    let own = best_rotation(&(sum + turn * (0.5 * STIFFNESS)));
    let directions: f64 = pairs.iter().map(|[a, b]| (own * a - b).norm_squared() / 4.0).sum();
    let turned = own.to_rotation_matrix().into_inner() - turn;
    directions + STIFFNESS * turned.norm_squared() / 8.0
}
