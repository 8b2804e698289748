//! Nearest neighbours among points in space.

use super::mesh::Vec3;

/// Points in a k-d tree, for exact nearest neighbours.
///
/// Of equally distant points those with smaller indices are nearer, so answers do not depend on how
/// the tree was built.
#[derive(Debug, Clone)]
pub struct PointTree {
    /// Points in the order of the leaves.
    points: Vec<Vec3>,
    /// The index of every one of them among the given points.
    indices: Vec<u32>,
    nodes: Vec<Node>,
}

#[derive(Debug, Clone, Copy)]
enum Node {
    /// The points `begin..end`.
    Leaf { begin: u32, end: u32 },
    /// Points with a smaller coordinate are below the next node, others below `upper`.
    Inner { axis: u8, upper: u32, split: f64 },
}

/// The most points of a leaf.
const LEAF: usize = 16;

impl PointTree {
    /// Sorts points into a tree.
    ///
    /// # Panics
    /// If there are `2^32` points or more.
    pub fn new(points: &[Vec3]) -> Self {
        assert!(u32::try_from(points.len()).is_ok(), "points are numbered by 32 bits");
        let mut indices: Vec<u32> = (0..points.len() as u32).collect();
        let mut nodes = Vec::with_capacity(4 * points.len() / LEAF + 1);
        build(points, &mut indices, 0, &mut nodes);
        let points = indices.iter().map(|&it| points[it as usize]).collect();
        Self { points, indices, nodes }
    }

    /// Points that lie close to each other, in groups of at most 16: queries in this order find what
    /// they need in the processor's cache.
    pub fn order(&self) -> &[u32] {
        &self.indices
    }

    /// Finds the points at most `radius` away from a place, by ascending distance.
    ///
    /// `found` is emptied and filled with squared distances and indices.
    pub fn within(&self, place: Vec3, radius: f64, found: &mut Vec<(f64, u32)>) {
        found.clear();
        if !self.points.is_empty() {
            let (k, bound) = (usize::MAX, radius * radius);
            let mut search = Search { tree: self, place, k, bound, found };
            search.visit(0, Vec3::zeros());
            search.finish();
        }
    }

    /// Finds the `k` points nearest to a place, by ascending distance; fewer if there are not so many.
    ///
    /// `found` is emptied and filled with squared distances and indices.
    pub fn nearest(&self, place: Vec3, k: usize, found: &mut Vec<(f64, u32)>) {
        found.clear();
        if k > 0 && !self.points.is_empty() {
            let mut search = Search { tree: self, place, k, bound: f64::INFINITY, found };
            search.visit(0, Vec3::zeros());
            search.finish();
        }
    }
}

/// Appends the node of a range of points, and what is below it; points from `begin` on are in order.
fn build(points: &[Vec3], indices: &mut [u32], begin: usize, nodes: &mut Vec<Node>) {
    if indices.len() <= LEAF {
        nodes.push(Node::Leaf { begin: begin as u32, end: (begin + indices.len()) as u32 });
        return;
    }
    let first = points[indices[0] as usize];
    let (low, high) = indices.iter().fold((first, first), |(low, high), &it| {
        let point = points[it as usize];
        (low.inf(&point), high.sup(&point))
    });
    let axis = (high - low).imax();
    let middle = indices.len() / 2;
    indices.select_nth_unstable_by(middle, |&a, &b| {
        points[a as usize][axis].total_cmp(&points[b as usize][axis]).then(a.cmp(&b))
    });
    let split = points[indices[middle] as usize][axis];
    let own = nodes.len();
    nodes.push(Node::Leaf { begin: 0, end: 0 });
    let (lower, upper) = indices.split_at_mut(middle);
    build(points, lower, begin, nodes);
    nodes[own] = Node::Inner { axis: axis as u8, upper: nodes.len() as u32, split };
    build(points, upper, begin + middle, nodes);
}

struct Search<'a> {
    tree: &'a PointTree,
    place: Vec3,
    k: usize,
    /// No point at a larger squared distance can be among the nearest.
    bound: f64,
    /// Candidates: the nearest so far and some that turned out to be too far.
    found: &'a mut Vec<(f64, u32)>,
}

impl Search<'_> {
    /// `offset` leads from the place to the box of the node, in the axes where it lies outside.
    fn visit(&mut self, node: u32, offset: Vec3) {
        match self.tree.nodes[node as usize] {
            Node::Leaf { begin, end } => self.scan(begin as usize..end as usize),
            Node::Inner { axis, upper, split } => {
                let axis = usize::from(axis);
                let beyond = self.place[axis] - split;
                let (near, far) = if beyond < 0.0 { (node + 1, upper) } else { (upper, node + 1) };
                self.visit(near, offset);
                let mut offset = offset;
                offset[axis] = beyond;
                if offset.norm_squared() <= self.bound {
                    self.visit(far, offset);
                }
            }
        }
    }

    fn scan(&mut self, range: std::ops::Range<usize>) {
        for (point, &index) in self.tree.points[range.clone()].iter().zip(&self.tree.indices[range])
        {
            let square = (point - self.place).norm_squared();
            if square <= self.bound {
                self.found.push((square, index));
            }
        }
        // Sorting out is cheaper by many at a time than one by one.
        if self.found.len() >= self.k.saturating_mul(2).saturating_add(LEAF) {
            self.keep_nearest();
        }
    }

    fn keep_nearest(&mut self) {
        if self.found.len() > self.k {
            self.found.select_nth_unstable_by(self.k - 1, nearer);
            self.found.truncate(self.k);
            self.bound = self.found[self.k - 1].0;
        } else if self.found.len() == self.k {
            self.bound = self.found.iter().fold(0.0, |bound, it| it.0.max(bound));
        }
    }

    fn finish(&mut self) {
        self.keep_nearest();
        self.found.sort_unstable_by(nearer);
    }
}

fn nearer(a: &(f64, u32), b: &(f64, u32)) -> std::cmp::Ordering {
    a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::numerics::random::Random;

    fn check(points: &[Vec3], places: &[Vec3], k: usize) {
        let tree = PointTree::new(points);
        let mut found = Vec::new();
        for &place in places {
            let squares = points.iter().map(|it| (it - place).norm_squared());
            let mut expected: Vec<(f64, u32)> = squares.zip(0..).collect();
            expected.sort_by(nearer);
            expected.truncate(k);
            tree.nearest(place, k, &mut found);
            assert_eq!(found, expected, "{k} nearest to {place}");
            let radius = expected.last().map_or(1.0, |it| it.0.sqrt() * (1.0 + 1e-12));
            tree.within(place, radius, &mut found);
            expected = points.iter().map(|it| (it - place).norm_squared()).zip(0..).collect();
            expected.retain(|it| it.0 <= radius * radius);
            expected.sort_by(nearer);
            assert_eq!(found, expected, "within {radius} of {place}");
        }
    }

    #[test]
    fn trees_answer_as_the_definition_does() {
        let mut random = Random::new(5);
        let mut point = |scale: f64| Vec3::from_fn(|_, _| scale * random.uniform());
        let cloud: Vec<Vec3> = (0..700).map(|_| point(1.0)).collect();
        let flat: Vec<Vec3> = (0..300).map(|_| point(1.0).component_mul(&Vec3::x())).collect();
        let places: Vec<Vec3> = (0..40).map(|_| point(2.0)).collect();
        for k in [1, 7, 30, 2000] {
            check(&cloud, &places, k);
            check(&cloud, &cloud[..50], k);
            check(&flat, &places, k);
        }
        check(&[], &places, 3);
        check(&cloud[..1], &places, 3);
    }

    #[test]
    fn ties_go_to_smaller_indices() {
        let grid: Vec<Vec3> = (0..400).map(|it| Vec3::new((it % 5) as f64, 0.0, 1.0)).collect();
        check(&grid, &grid[..6], 90);
        let equal = vec![Vec3::y(); 100];
        check(&equal, &[Vec3::y(), Vec3::zeros()], 10);
    }
}
