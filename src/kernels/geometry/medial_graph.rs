//! Which balls are connected inside a body, and the shortest ways.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use rayon::prelude::*;

use super::distance_field::DistanceField;
use super::medial_balls::Ball;
use super::point_tree::PointTree;

/// Packed balls, connected along the inside of the body.
#[derive(Debug)]
pub struct MedialGraph {
    pub balls: Vec<Ball>,
    /// Neighbours of every ball, ascending.
    pub neighbours: Vec<Vec<u32>>,
    /// `N x N` lengths of the shortest paths, infinite where there is none.
    distances: Vec<f64>,
    /// `N x N`: the ball before the end on the path from a first to a second ball.
    previous: Vec<u32>,
}

impl MedialGraph {
    /// Connects balls that intersect, and balls between whose centres there is no other (in the
    /// ball that they span; Gabriel & Sokal 1969) if the way between them keeps away from the surface
    /// by half the smaller radius.
    pub fn new(balls: Vec<Ball>, field: &DistanceField) -> Self {
        let neighbours = neighbours(&balls, field);
        let n = balls.len();
        let trees: Vec<(Vec<f64>, Vec<u32>)> =
            (0..n).into_par_iter().map(|it| shortest_paths(&balls, &neighbours, it)).collect();
        let mut distances = Vec::with_capacity(n * n);
        let mut previous = Vec::with_capacity(n * n);
        for (lengths, before) in trees {
            distances.extend(lengths);
            previous.extend(before);
        }
        Self { balls, neighbours, distances, previous }
    }

    pub fn n(&self) -> usize {
        self.balls.len()
    }

    pub fn n_edges(&self) -> usize {
        self.neighbours.iter().map(Vec::len).sum::<usize>() / 2
    }

    pub fn distance(&self, from: usize, to: usize) -> f64 {
        self.distances[from * self.n() + to]
    }

    /// The balls of the shortest path, from its end back to its beginning, both included. There must
    /// be a path.
    pub fn path_back(&self, from: usize, to: usize) -> impl Iterator<Item = usize> + '_ {
        let mut next = Some(to);
        std::iter::from_fn(move || {
            let here = next?;
            next = (here != from).then(|| self.previous[from * self.n() + here] as usize);
            Some(here)
        })
    }
}

fn neighbours(balls: &[Ball], field: &DistanceField) -> Vec<Vec<u32>> {
    let centers: Vec<_> = balls.iter().map(|it| it.center).collect();
    let tree = PointTree::new(&centers);
    let of_ball = |first: usize| {
        let mut found = Vec::new();
        let mut later = Vec::new();
        for second in first + 1..balls.len() {
            let (a, b) = (&balls[first], &balls[second]);
            let length = (b.center - a.center).norm();
            if length < a.radius + b.radius {
                later.push(second as u32);
                continue;
            }
            tree.nearest((a.center + b.center) / 2.0, 1, &mut found);
            let is_gabriel = found[0].0.sqrt() >= length / 2.0 * (1.0 - 1e-9);
            let limit = -a.radius.min(b.radius) / 2.0;
            if is_gabriel && field.stays_below(limit, a.center, b.center, length / 100.0) {
                later.push(second as u32);
            }
        }
        later
    };
    let later: Vec<Vec<u32>> = (0..balls.len()).into_par_iter().map(of_ball).collect();
    let mut all = vec![Vec::new(); balls.len()];
    for (first, list) in later.iter().enumerate() {
        for &second in list {
            all[first].push(second);
            all[second as usize].push(first as u32);
        }
    }
    for list in &mut all {
        list.sort_unstable();
    }
    all
}

#[derive(PartialEq)]
struct Reached {
    length: f64,
    ball: u32,
}

impl Eq for Reached {}

impl Ord for Reached {
    /// The greatest is the nearest; of equally near ones that with the smallest index.
    fn cmp(&self, other: &Self) -> Ordering {
        other.length.total_cmp(&self.length).then(other.ball.cmp(&self.ball))
    }
}

impl PartialOrd for Reached {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// Lengths of the shortest paths from a ball (Dijkstra 1959), and the ball before every end.
fn shortest_paths(balls: &[Ball], neighbours: &[Vec<u32>], from: usize) -> (Vec<f64>, Vec<u32>) {
    let mut lengths = vec![f64::INFINITY; balls.len()];
    let mut previous = vec![from as u32; balls.len()];
    lengths[from] = 0.0;
    let mut queue = BinaryHeap::from([Reached { length: 0.0, ball: from as u32 }]);
    while let Some(Reached { length, ball }) = queue.pop() {
        if length > lengths[ball as usize] {
            continue;
        }
        for &next in &neighbours[ball as usize] {
            let step = (balls[next as usize].center - balls[ball as usize].center).norm();
            if length + step < lengths[next as usize] {
                lengths[next as usize] = length + step;
                previous[next as usize] = ball;
                queue.push(Reached { length: length + step, ball: next });
            }
        }
    }
    (lengths, previous)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::medial_balls::{MedialOptions, medial_balls, pack};
    use crate::kernels::geometry::shapes::torus;

    #[test]
    fn paths_in_a_torus_go_around_its_hole() {
        let mesh = torus(0.3, 0.08, 100, 40);
        let field = DistanceField::new(&mesh);
        let options = MedialOptions { spacing: 0.01, least_radius: 0.006, greatest_cosine: 0.0 };
        let graph = MedialGraph::new(pack(&medial_balls(&field, &mesh, &options), 1000), &field);
        assert!(graph.n() >= 12 && graph.neighbours.iter().all(|it| it.len() >= 2));
        let center = |it: usize| graph.balls[it].center;
        let farthest = (0..graph.n()).max_by(|&a, &b| {
            (center(a) - center(0)).norm().total_cmp(&(center(b) - center(0)).norm())
        });
        let farthest = farthest.unwrap();
        let around = 0.3 * std::f64::consts::PI;
        let length = graph.distance(0, farthest);
        assert!(length > 0.85 * around && length < 1.05 * around, "{length} of {around}");
        assert!((length - graph.distance(farthest, 0)).abs() < 1e-12);
        let path: Vec<usize> = graph.path_back(0, farthest).collect();
        assert_eq!((path[0], *path.last().unwrap()), (farthest, 0));
        let sum: f64 = path.windows(2).map(|it| (center(it[0]) - center(it[1])).norm()).sum();
        assert!((sum - length).abs() < 1e-12);
    }
}
