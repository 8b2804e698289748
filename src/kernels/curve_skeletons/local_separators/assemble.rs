//! From disjoint separators to a curve skeleton.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, BinaryHeap};

use super::super::curve_skeleton::{CurveSkeleton, NO_NODE};
use super::graph::SpatialGraph;
use super::shrink::Separator;
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::geometry::topology::DisjointSets;

/// Makes a node of every separator, and joins those whose surroundings touch.
///
/// Every point belongs to the separator that is nearest along edges; a node is at the mean of its
/// points, its radius is their median distance from there. Where several nodes touch each other, they
/// are joined to a branch node in their middle instead, which has no points (Bærentzen & Rotenberg
/// 2021, section 3.3).
pub fn assemble(graph: &SpatialGraph, separators: &[Separator]) -> CurveSkeleton {
    let node_of_point = nearest_separators(graph, separators);
    let mut nodes = Nodes::of(graph, &node_of_point, separators.len());
    let edges = touching(graph, &node_of_point);
    let edges = add_branch_nodes(&mut nodes, edges);
    CurveSkeleton::new(nodes.positions, nodes.radii, edges, node_of_point)
        .expect("means of finite points are finite, and edges join nodes")
}

/// Dijkstra's algorithm from all separators at once.
fn nearest_separators(graph: &SpatialGraph, separators: &[Separator]) -> Vec<u32> {
    let mut nodes = vec![NO_NODE; graph.n_points()];
    let mut distances = vec![f64::INFINITY; graph.n_points()];
    let mut heap = BinaryHeap::new();
    for (node, separator) in separators.iter().enumerate() {
        for &point in &separator.points {
            nodes[point as usize] = node as u32;
            distances[point as usize] = 0.0;
            heap.push(Reverse((0_u64, point)));
        }
    }
    // Distances are not negative, so their bits order like they do.
    while let Some(Reverse((bits, point))) = heap.pop() {
        let distance = f64::from_bits(bits);
        if distance > distances[point as usize] {
            continue;
        }
        for &next in graph.neighbors(point) {
            let length = distance + graph.length(point, next);
            if length < distances[next as usize] {
                distances[next as usize] = length;
                nodes[next as usize] = nodes[point as usize];
                heap.push(Reverse((length.to_bits(), next)));
            }
        }
    }
    nodes
}

struct Nodes {
    positions: Vec<Vec3>,
    radii: Vec<f64>,
    n_points: Vec<usize>,
}

impl Nodes {
    fn of(graph: &SpatialGraph, node_of_point: &[u32], n_nodes: usize) -> Self {
        let mut points = vec![vec![]; n_nodes];
        for (&node, position) in node_of_point.iter().zip(graph.positions()) {
            if node != NO_NODE {
                points[node as usize].push(*position);
            }
        }
        let positions: Vec<Vec3> =
            points.iter().map(|it| it.iter().sum::<Vec3>() / it.len() as f64).collect();
        let radii = points.iter().zip(&positions).map(|(it, mean)| median_distance(it, mean));
        let radii = radii.collect();
        Self { positions, radii, n_points: points.iter().map(Vec::len).collect() }
    }

    /// Adds a node without points in the middle of others.
    fn add_between(&mut self, members: &BTreeSet<u32>) -> u32 {
        let total = members.iter().map(|&it| self.n_points[it as usize]).sum::<usize>() as f64;
        let share = |it: u32| self.n_points[it as usize] as f64 / total;
        let position =
            members.iter().map(|&it| self.positions[it as usize] * share(it)).sum::<Vec3>();
        let radius = members.iter().map(|&it| self.radii[it as usize] * share(it)).sum();
        self.positions.push(position);
        self.radii.push(radius);
        self.n_points.push(0);
        (self.positions.len() - 1) as u32
    }
}

/// The median distance of points from a place; the upper one of two.
pub fn median_distance(points: &[Vec3], place: &Vec3) -> f64 {
    let mut distances: Vec<f64> = points.iter().map(|it| (it - place).norm()).collect();
    distances.sort_by(f64::total_cmp);
    distances.get(distances.len() / 2).copied().unwrap_or(0.0)
}

/// Pairs of nodes whose points are joined by an edge.
fn touching(graph: &SpatialGraph, node_of_point: &[u32]) -> BTreeSet<[u32; 2]> {
    let ends = graph.edges().map(|edge| edge.map(|it| node_of_point[it as usize]));
    ends.filter(|[a, b]| a != b && *a != NO_NODE && *b != NO_NODE)
        .map(|[a, b]| [a.min(b), a.max(b)])
        .collect()
}

/// Replaces the edges among groups of nodes that touch each other by edges to a branch node.
fn add_branch_nodes(nodes: &mut Nodes, edges: BTreeSet<[u32; 2]>) -> Vec<[u32; 2]> {
    let groups = merged(triangles(&edges));
    let mut group_of_pair = BTreeSet::new();
    for members in &groups {
        group_of_pair.extend(pairs(members));
    }
    let mut edges: Vec<[u32; 2]> =
        edges.into_iter().filter(|it| !group_of_pair.contains(it)).collect();
    for members in &groups {
        let branch = nodes.add_between(members);
        edges.extend(members.iter().map(|&it| [it, branch]));
    }
    edges
}

/// All triples of nodes that are joined to each other.
fn triangles(edges: &BTreeSet<[u32; 2]>) -> Vec<BTreeSet<u32>> {
    let mut larger: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for &[low, high] in edges {
        larger.entry(low).or_default().push(high);
    }
    let mut triangles = vec![];
    for (&low, highs) in &larger {
        for (place, &middle) in highs.iter().enumerate() {
            let closing = highs[place + 1..].iter().filter(|&&it| edges.contains(&[middle, it]));
            triangles.extend(closing.map(|&high| BTreeSet::from([low, middle, high])));
        }
    }
    triangles
}

/// Unites groups that share two nodes, until no two do.
fn merged(mut groups: Vec<BTreeSet<u32>>) -> Vec<BTreeSet<u32>> {
    loop {
        let mut sets = DisjointSets::new(groups.len());
        let mut first_with: BTreeMap<[u32; 2], usize> = BTreeMap::new();
        for (group, members) in groups.iter().enumerate() {
            for pair in pairs(members) {
                let first = *first_with.entry(pair).or_insert(group);
                sets.join(first, group);
            }
        }
        let mut united: BTreeMap<usize, BTreeSet<u32>> = BTreeMap::new();
        for (group, members) in groups.iter().enumerate() {
            united.entry(sets.find(group)).or_default().extend(members);
        }
        if united.len() == groups.len() {
            return groups;
        }
        groups = united.into_values().collect();
    }
}

fn pairs(members: &BTreeSet<u32>) -> impl Iterator<Item = [u32; 2]> + '_ {
    members.iter().flat_map(|&low| members.range(low + 1..).map(move |&high| [low, high]))
}
