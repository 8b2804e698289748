//! Skeletons without the nodes that only continue a branch.

use super::graph::SkeletonGraph;

/// A way through nodes of two edges each, from one branch node or leaf to another.
#[derive(Debug, Clone, PartialEq)]
pub struct Branch {
    /// Indices of [`Collapsed::nodes`]; twice the same for a loop.
    pub ends: [u32; 2],
    /// The nodes of the graph between the ends, from the first end to the second.
    pub inner: Vec<u32>,
    pub length: f64,
}

/// Branch nodes, leaves and the branches between them: parallel branches and loops stay apart.
#[derive(Debug, Clone, PartialEq)]
pub struct Collapsed {
    /// The nodes of the graph that stay, ascending.
    pub nodes: Vec<u32>,
    pub branches: Vec<Branch>,
    /// For every node its branches and their other ends; a loop is there twice.
    pub incident: Vec<Vec<(u32, u32)>>,
}

/// Replaces every longest way through nodes of two edges by one branch (Madaras et al. 2014, 4.1).
///
/// A root of two edges is no branch node. Of a cycle without any branch node its root (or first node)
/// stays, and the node that is farthest from it along the cycle.
pub fn collapse(graph: &SkeletonGraph) -> Collapsed {
    let incident = graph.incident();
    let mut stays: Vec<bool> = incident.iter().map(|it| it.len() != 2).collect();
    keep_two_of_cycles(graph, &incident, &mut stays);
    let nodes: Vec<u32> = (0..stays.len() as u32).filter(|&it| stays[it as usize]).collect();
    let mut new_of_old = vec![u32::MAX; stays.len()];
    for (new, &old) in nodes.iter().enumerate() {
        new_of_old[old as usize] = new as u32;
    }
    let mut is_done = vec![false; graph.edges.len()];
    let mut branches = Vec::new();
    for &first in &nodes {
        for &edge in &incident[first as usize] {
            if is_done[edge as usize] {
                continue;
            }
            let walk = walk(graph, &incident, first, edge, |it| stays[it as usize]);
            for &it in &walk.edges {
                is_done[it as usize] = true;
            }
            let (&last, inner) = walk.nodes.split_last().expect("an edge has another end");
            let ends = [first, last].map(|it| new_of_old[it as usize]);
            let length = walk.edges.iter().map(|&it| graph.length(it as usize)).sum();
            branches.push(Branch { ends, inner: inner.to_vec(), length });
        }
    }
    let mut by_node = vec![Vec::new(); nodes.len()];
    for (branch, it) in branches.iter().enumerate() {
        by_node[it.ends[0] as usize].push((branch as u32, it.ends[1]));
        by_node[it.ends[1] as usize].push((branch as u32, it.ends[0]));
    }
    Collapsed { nodes, branches, incident: by_node }
}

impl Collapsed {
    pub fn degree(&self, node: usize) -> usize {
        self.incident[node].len()
    }

    pub fn total_length(&self) -> f64 {
        self.branches.iter().map(|it| it.length).sum()
    }

    /// The nodes of the graph along a branch, from one of its ends to the other.
    pub fn nodes_along(&self, branch: u32, from: u32) -> Vec<u32> {
        let Branch { ends, inner, .. } = &self.branches[branch as usize];
        let [first, last] = ends.map(|it| self.nodes[it as usize]);
        let mut nodes = Vec::with_capacity(inner.len() + 2);
        nodes.push(first);
        nodes.extend(inner);
        nodes.push(last);
        if ends[0] != from {
            nodes.reverse();
        }
        nodes
    }
}

struct Walk {
    /// Without the node it begins at.
    nodes: Vec<u32>,
    edges: Vec<u32>,
}

/// Follows an edge until a node that stays.
fn walk(
    graph: &SkeletonGraph,
    incident: &[Vec<u32>],
    first: u32,
    edge: u32,
    stays: impl Fn(u32) -> bool,
) -> Walk {
    let mut res = Walk { nodes: Vec::new(), edges: vec![edge] };
    let (mut node, mut edge) = (graph.other_end(edge, first), edge);
    loop {
        res.nodes.push(node);
        if stays(node) {
            return res;
        }
        let [a, b] = [incident[node as usize][0], incident[node as usize][1]];
        edge = if a == edge { b } else { a };
        node = graph.other_end(edge, node);
        res.edges.push(edge);
    }
}

/// Marks two nodes of every component that is a cycle.
fn keep_two_of_cycles(graph: &SkeletonGraph, incident: &[Vec<u32>], stays: &mut [bool]) {
    let mut is_seen = stays.to_vec();
    let mut stack: Vec<u32> = (0..stays.len() as u32).filter(|&it| stays[it as usize]).collect();
    while let Some(node) = stack.pop() {
        for &edge in &incident[node as usize] {
            let next = graph.other_end(edge, node);
            if !is_seen[next as usize] {
                is_seen[next as usize] = true;
                stack.push(next);
            }
        }
    }
    for first in graph.roots.iter().copied().chain(0..stays.len() as u32) {
        if is_seen[first as usize] {
            continue;
        }
        stays[first as usize] = true;
        let round = walk(graph, incident, first, incident[first as usize][0], |it| it == first);
        let lengths = round.edges.iter().map(|&it| graph.length(it as usize));
        let half = lengths.clone().sum::<f64>() / 2.0;
        let mut way = 0.0;
        let mut farthest = (f64::INFINITY, first);
        for (&node, length) in round.nodes.iter().zip(lengths) {
            is_seen[node as usize] = true;
            way += length;
            let distance = (way - half).abs();
            if node != first && distance < farthest.0 {
                farthest = (distance, node);
            }
        }
        stays[farthest.1 as usize] = true;
    }
}
