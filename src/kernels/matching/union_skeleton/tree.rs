//! The forest that skeletons are merged into.

use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::matching::map_segments::places_along;
use crate::kernels::matching::skeleton_match::SkeletonGraph;
use crate::kernels::rigs::skeleton::Skeleton;

/// Nodes joined by bones of a length that holds in all poses.
#[derive(Debug, Clone, Default)]
pub struct UnionTree {
    pub neighbors: Vec<Vec<(u32, f64)>>,
    /// Where components begin.
    pub roots: Vec<u32>,
    /// In how many poses an input has a node at a node's place.
    pub counts: Vec<usize>,
    poses: Vec<Pose>,
}

/// What is known of one pose.
#[derive(Debug, Clone)]
struct Pose {
    index: usize,
    /// Lines between two nodes of the union: all nodes on the way between them lie on it.
    lines: Vec<Line>,
}

#[derive(Debug, Clone)]
struct Line {
    ends: [u32; 2],
    points: Vec<Vec3>,
}

/// The places of all nodes in a pose.
#[derive(Debug, Clone, PartialEq)]
pub struct PosePlaces {
    pub places: Vec<Vec3>,
    /// Whether a node lies on what was seen in the pose; the others are brought from another pose.
    pub is_observed: Vec<bool>,
}

impl UnionTree {
    pub fn new(skeleton: &Skeleton, index: usize) -> Self {
        let mut tree = Self::default();
        tree.begin_pose(index);
        for _ in 0..skeleton.n_joints() {
            tree.add_node();
        }
        for (parent, child) in skeleton.bones() {
            let [a, b] = [parent, child].map(|it| skeleton.positions()[it]);
            tree.join([parent as u32, child as u32], (a - b).norm());
            tree.add_line([parent as u32, child as u32], vec![a, b]);
        }
        for joint in (0..skeleton.n_joints()).filter(|&it| skeleton.parents()[it].is_none()) {
            tree.roots.push(joint as u32);
            tree.add_line([joint as u32; 2], vec![skeleton.positions()[joint]]);
        }
        tree
    }

    pub fn n_nodes(&self) -> usize {
        self.neighbors.len()
    }

    /// From here on lines belong to this pose.
    pub fn begin_pose(&mut self, index: usize) {
        self.poses.push(Pose { index, lines: Vec::new() });
    }

    /// The poses that have been merged, in this order.
    pub fn pose_indices(&self) -> impl Iterator<Item = usize> + '_ {
        self.poses.iter().map(|it| it.index)
    }

    pub fn add_node(&mut self) -> u32 {
        self.neighbors.push(Vec::new());
        self.counts.push(1);
        self.n_nodes() as u32 - 1
    }

    pub fn join(&mut self, [a, b]: [u32; 2], length: f64) {
        self.neighbors[a as usize].push((b, length));
        self.neighbors[b as usize].push((a, length));
    }

    /// Says that the way between two nodes runs along these points in the present pose.
    pub fn add_line(&mut self, ends: [u32; 2], points: Vec<Vec3>) {
        let pose = self.poses.last_mut().expect("a pose has begun");
        pose.lines.push(Line { ends, points });
    }

    /// Puts a node between two neighbours, at a share of the way.
    pub fn split(&mut self, from: u32, to: u32, share: f64) -> u32 {
        let length = |it: &(u32, f64)| (it.0 == to).then_some(it.1);
        let length = self.neighbors[from as usize].iter().find_map(length);
        let length = length.expect("neighbours are joined");
        let node = self.add_node();
        for (own, other, part) in [(from, to, share), (to, from, 1.0 - share)] {
            let bones = &mut self.neighbors[own as usize];
            let bone = bones.iter_mut().find(|it| it.0 == other).expect("bones lead both ways");
            *bone = (node, length * part);
            self.neighbors[node as usize].push((own, length * part));
        }
        node
    }

    /// The nodes between two nodes, both with them; none if nothing joins them.
    pub fn way(&self, from: u32, to: u32) -> Vec<u32> {
        let mut before = vec![u32::MAX; self.n_nodes()];
        before[from as usize] = from;
        let mut stack = vec![from];
        while let Some(node) = stack.pop().filter(|&it| it != to) {
            for &(next, _) in &self.neighbors[node as usize] {
                if before[next as usize] == u32::MAX {
                    before[next as usize] = node;
                    stack.push(next);
                }
            }
        }
        if before[to as usize] == u32::MAX {
            return Vec::new();
        }
        let mut way = vec![to];
        while way[way.len() - 1] != from {
            way.push(before[way[way.len() - 1] as usize]);
        }
        way.reverse();
        way
    }

    /// The shares of a way's length before each of its nodes.
    pub fn shares(&self, way: &[u32]) -> Vec<f64> {
        let mut sums = vec![0.0];
        for pair in way.windows(2) {
            let bones = &self.neighbors[pair[0] as usize];
            let length = bones.iter().find(|it| it.0 == pair[1]).map_or(0.0, |it| it.1);
            sums.push(sums[sums.len() - 1] + length);
        }
        let total = sums[sums.len() - 1];
        let last = (way.len() - 1).max(1) as f64;
        let share = |(index, sum): (usize, &f64)| match total > 0.0 {
            true => sum / total,
            false => index as f64 / last,
        };
        sums.iter().enumerate().map(share).collect()
    }

    /// The places of all nodes in the pose that was merged as the `order`-th.
    pub fn places(&self, order: usize) -> PosePlaces {
        let own = self.observed(&self.poses[order]);
        let is_observed: Vec<bool> = own.iter().map(Option::is_some).collect();
        let mut places = own.clone();
        let others = (0..self.poses.len()).filter(|&it| it != order);
        for other in others.map(|it| self.observed(&self.poses[it])) {
            if places.iter().all(Option::is_some) {
                break;
            }
            self.bring(&own, &other, &mut places);
        }
        let place = |it: &Option<Vec3>| it.unwrap_or_else(Vec3::zeros);
        PosePlaces { places: places.iter().map(place).collect(), is_observed }
    }

    fn observed(&self, pose: &Pose) -> Vec<Option<Vec3>> {
        let mut places = vec![None; self.n_nodes()];
        for line in &pose.lines {
            let way = self.way(line.ends[0], line.ends[1]);
            if way.is_empty() {
                continue;
            }
            let along = places_along(&line.points);
            for (&node, share) in way.iter().zip(self.shares(&way)) {
                places[node as usize] = Some(point_at(&line.points, &along, share));
            }
        }
        places
    }

    /// Fills places from another pose: the whole of it turned as fits best, then each part moved to
    /// where it hangs on what is known.
    fn bring(&self, own: &[Option<Vec3>], other: &[Option<Vec3>], places: &mut [Option<Vec3>]) {
        let pairs: Vec<(Vec3, Vec3)> =
            own.iter().zip(other).filter_map(|(a, b)| Some(((*b)?, (*a)?))).collect();
        let motion = Motion::new(&pairs);
        let mut queue: Vec<u32> =
            (0..places.len() as u32).filter(|&it| places[it as usize].is_some()).collect();
        let mut index = 0;
        while let Some(&node) = queue.get(index) {
            index += 1;
            for &(next, _) in &self.neighbors[node as usize] {
                let Some(theirs) = other[next as usize] else { continue };
                if places[next as usize].is_some() {
                    continue;
                }
                let place = places[node as usize].expect("nodes in the queue have places");
                let offset = other[node as usize].map(|it| motion.turn * (theirs - it));
                places[next as usize] =
                    Some(offset.map_or_else(|| motion.apply(theirs), |it| place + it));
                queue.push(next);
            }
        }
        // Components that nothing known joins.
        for (place, theirs) in places.iter_mut().zip(other) {
            if place.is_none() {
                *place = theirs.map(|it| motion.apply(it));
            }
        }
    }

    /// The union as a graph, in a pose.
    pub fn graph(&self, positions: Vec<Vec3>) -> SkeletonGraph {
        let nodes = 0..self.n_nodes() as u32;
        let bones = |it: u32| self.neighbors[it as usize].iter().map(move |bone| [it, bone.0]);
        let edges = nodes.flat_map(bones).filter(|it| it[0] < it[1]).collect();
        SkeletonGraph { positions, edges, roots: Vec::new() }
    }
}

/// A rigid motion from pairs of places.
struct Motion {
    turn: nalgebra::UnitQuaternion<f64>,
    centers: [Vec3; 2],
}

impl Motion {
    fn new(pairs: &[(Vec3, Vec3)]) -> Self {
        let n_pairs = pairs.len().max(1) as f64;
        let centers = [0, 1].map(|side| {
            let place = |it: &(Vec3, Vec3)| if side == 0 { it.0 } else { it.1 };
            pairs.iter().map(place).sum::<Vec3>() / n_pairs
        });
        let covariance =
            pairs.iter().map(|(a, b)| (b - centers[1]) * (a - centers[0]).transpose()).sum();
        Self { turn: crate::kernels::geometry::kabsch::best_rotation(&covariance), centers }
    }

    fn apply(&self, place: Vec3) -> Vec3 {
        self.centers[1] + self.turn * (place - self.centers[0])
    }
}

/// The point of a line at a share of its length.
pub fn point_at(points: &[Vec3], along: &[f64], share: f64) -> Vec3 {
    let next = along.partition_point(|&it| it < share).clamp(1, points.len().max(2) - 1);
    if next >= points.len() {
        return points[0];
    }
    let (from, to) = (along[next - 1], along[next]);
    let part = if to > from { ((share - from) / (to - from)).clamp(0.0, 1.0) } else { 1.0 };
    points[next - 1] + (points[next] - points[next - 1]) * part
}
