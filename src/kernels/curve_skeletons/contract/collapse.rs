//! From a contracted shape to a graph of curves.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use nalgebra::{Matrix4, Vector4};

use crate::kernels::geometry::mesh::Vec3;

/// How edges are chosen.
#[derive(Debug, Clone, PartialEq)]
pub struct CollapseOptions {
    /// The weight of squared distances from the lines of edges that went.
    pub shape: f64,
    /// The weight of the lengths of edges around the point that goes.
    pub sampling: f64,
}

impl Default for CollapseOptions {
    fn default() -> Self {
        Self { shape: 1.0, sampling: 0.1 }
    }
}

/// What is left of triangles when edges have been collapsed.
#[derive(Debug, Clone, PartialEq)]
pub struct Collapsed {
    /// The points that stay, ascending.
    pub nodes: Vec<u32>,
    /// Pairs of places in `nodes`, the smaller first, ascending.
    pub edges: Vec<[u32; 2]>,
    /// For every point the place in `nodes` of the one it went to.
    pub node_of_point: Vec<u32>,
}

/// Collapses edges that have a triangle, the cheapest first, until there is no triangle (Au et al.
/// 2008, section 6).
///
/// A point goes to the other end of an edge, which stays in its place. It costs the squared distances
/// of that place from the lines of all edges that both points stand for, and, so that long edges stay
/// rare, the edge's length times those of all edges of the point that goes. Triangles need not make a
/// surface. `positions` are those of the contracted points.
pub fn collapse(
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    options: &CollapseOptions,
) -> Collapsed {
    let mut graph = Graph::new(positions, triangles, options);
    let mut heap: BinaryHeap<Candidate> =
        (0..positions.len() as u32).filter_map(|it| graph.candidate(it)).collect();
    while let Some(best) = heap.pop() {
        if best.version == graph.versions[best.from as usize] {
            graph.collapse(best.from, best.to, &mut heap);
        }
    }
    graph.finish()
}

/// The cheapest edge from a point.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Candidate {
    cost: f64,
    from: u32,
    to: u32,
    /// The state of `from` that the cost belongs to.
    version: u32,
}

impl Eq for Candidate {}

impl Ord for Candidate {
    /// The cheapest is the greatest; of equal ones that of the smaller points.
    fn cmp(&self, other: &Self) -> Ordering {
        let own = (other.from, other.to);
        other.cost.total_cmp(&self.cost).then(own.cmp(&(self.from, self.to)))
    }
}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

struct Graph<'a> {
    /// About the first one, so that quadrics lose no digits.
    positions: Vec<Vec3>,
    options: &'a CollapseOptions,
    quadrics: Vec<Matrix4<f64>>,
    neighbors: Vec<Vec<u32>>,
    /// The other two corners of every triangle of a point, the smaller first.
    stars: Vec<Vec<[u32; 2]>>,
    versions: Vec<u32>,
    /// The point itself while it is there.
    successors: Vec<u32>,
}

impl<'a> Graph<'a> {
    fn new(positions: &[Vec3], triangles: &[[u32; 3]], options: &'a CollapseOptions) -> Self {
        let n_points = positions.len();
        let mut res = Self {
            positions: positions.iter().map(|it| it - positions[0]).collect(),
            options,
            quadrics: vec![Matrix4::zeros(); n_points],
            neighbors: vec![Vec::new(); n_points],
            stars: vec![Vec::new(); n_points],
            versions: vec![0; n_points],
            successors: (0..n_points as u32).collect(),
        };
        for &[a, b, c] in triangles {
            for [at, one, other] in [[a, b, c], [b, c, a], [c, a, b]] {
                res.stars[at as usize].push([one.min(other), one.max(other)]);
                res.neighbors[at as usize].extend([one, other]);
            }
        }
        for list in &mut res.neighbors {
            list.sort_unstable();
            list.dedup();
        }
        for point in 0..n_points {
            res.quadrics[point] = res.quadric(point);
        }
        res
    }

    /// Squared distances from the lines of a point's edges.
    fn quadric(&self, point: usize) -> Matrix4<f64> {
        let place = self.positions[point];
        let directions =
            self.neighbors[point].iter().map(|&it| self.positions[it as usize] - place);
        // With `M = 1 - a a^T` that is `(p - v)^T M (p - v)`, since `[a]^T [a] = M`.
        let mut sum = Matrix4::zeros();
        for direction in directions.filter_map(|it| it.try_normalize(0.0)) {
            let across = nalgebra::Matrix3::identity() - direction * direction.transpose();
            let image = across * place;
            let mut own = across.to_homogeneous();
            own.fixed_view_mut::<3, 1>(0, 3).copy_from(&-image);
            own.fixed_view_mut::<1, 3>(3, 0).copy_from(&-image.transpose());
            own[(3, 3)] = place.dot(&image);
            sum += own;
        }
        sum
    }

    /// The cheapest edge with a triangle from a point, if there is one.
    fn candidate(&self, from: u32) -> Option<Candidate> {
        let star = &self.stars[from as usize];
        if star.is_empty() {
            return None;
        }
        let place = self.positions[from as usize];
        let length = |it: u32| (self.positions[it as usize] - place).norm();
        let neighbors = &self.neighbors[from as usize];
        let total: f64 = neighbors.iter().map(|&it| length(it)).sum();
        let has_triangle = |it: u32| star.iter().any(|pair| pair[0] == it || pair[1] == it);
        let cost = |to: u32| {
            let [x, y, z] = self.positions[to as usize].into();
            let at = Vector4::new(x, y, z, 1.0);
            let both = self.quadrics[from as usize] + self.quadrics[to as usize];
            let shape = at.dot(&(both * at)).max(0.0);
            self.options.shape * shape + self.options.sampling * length(to) * total
        };
        let edges = neighbors.iter().copied().filter(|&it| has_triangle(it));
        let best =
            edges.map(|to| (cost(to), to)).min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let version = self.versions[from as usize];
        best.map(|(cost, to)| Candidate { cost, from, to, version })
    }

    /// Lets a point go to the other end of an edge, and finds new candidates for all around it.
    fn collapse(&mut self, from: u32, to: u32, heap: &mut BinaryHeap<Candidate>) {
        let quadric = self.quadrics[from as usize];
        self.quadrics[to as usize] += quadric;
        for pair in std::mem::take(&mut self.stars[from as usize]) {
            self.move_triangle(from, to, pair);
        }
        for neighbor in std::mem::take(&mut self.neighbors[from as usize]) {
            let others = &mut self.neighbors[neighbor as usize];
            let place = others.iter().position(|it| *it == from).expect("joined both ways");
            others.swap_remove(place);
            if neighbor != to && !others.contains(&to) {
                others.push(to);
                self.neighbors[to as usize].push(neighbor);
            }
        }
        self.successors[from as usize] = to;
        self.versions[from as usize] += 1;
        let around = std::mem::take(&mut self.neighbors[to as usize]);
        let touched = around.iter().copied().chain([to]);
        touched.clone().for_each(|it| self.versions[it as usize] += 1);
        self.neighbors[to as usize] = around.clone();
        heap.extend(around.iter().copied().chain([to]).filter_map(|it| self.candidate(it)));
    }

    /// Gives a triangle of a point that goes to the one that stays, unless it has both.
    fn move_triangle(&mut self, from: u32, to: u32, pair: [u32; 2]) {
        let sorted = |a: u32, b: u32| [a.min(b), a.max(b)];
        let is_gone = pair.contains(&to);
        let is_new = !is_gone && !self.stars[to as usize].contains(&pair);
        for [corner, other] in [pair, [pair[1], pair[0]]] {
            let star = &mut self.stars[corner as usize];
            let old = sorted(from, other);
            let place = star.iter().position(|it| *it == old).expect("a triangle has three stars");
            if is_new {
                star[place] = sorted(to, other);
            } else {
                star.swap_remove(place);
            }
        }
        if is_new {
            self.stars[to as usize].push(pair);
        }
    }

    fn finish(self) -> Collapsed {
        let alive = |it: u32| self.successors[it as usize] == it;
        let nodes: Vec<u32> = (0..self.positions.len() as u32).filter(|&it| alive(it)).collect();
        let place = |it: u32| nodes.binary_search(&it).expect("a point that stays") as u32;
        let mut edges: Vec<[u32; 2]> = nodes
            .iter()
            .flat_map(|&from| self.neighbors[from as usize].iter().map(move |&to| [from, to]))
            .filter(|it| it[0] < it[1])
            .map(|it| it.map(place))
            .collect();
        edges.sort_unstable();
        let node_of_point = (0..self.positions.len() as u32).map(|mut it| {
            while !alive(it) {
                it = self.successors[it as usize];
            }
            place(it)
        });
        Collapsed { edges, node_of_point: node_of_point.collect(), nodes }
    }
}
