//! The branches of a skeleton in motion, sampled.

use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::rigs::skeleton::Skeleton;

/// A branch from a root or branch node to a branch node or leaf.
#[derive(Debug, Clone, PartialEq)]
pub struct Chain {
    /// The chain that ends where this one begins; none at a root.
    pub before: Option<usize>,
    /// The joints along it, from its start to its end.
    pub joints: Vec<usize>,
    /// The way from the start to every sample, at rest.
    pub ways: Vec<f64>,
    /// At rest.
    pub rest: Vec<Vec3>,
    /// Poses x samples.
    pub poses: Vec<Vec<Vec3>>,
}

impl Chain {
    pub fn length(&self) -> f64 {
        self.ways[self.ways.len() - 1]
    }

    /// The place after a way, in a pose or (`None`) at rest.
    pub fn place(&self, pose: Option<usize>, way: f64) -> Vec3 {
        let points = pose.map_or(&self.rest, |it| &self.poses[it]);
        let next = self.ways.partition_point(|&it| it < way).clamp(1, points.len() - 1);
        let (from, to) = (self.ways[next - 1], self.ways[next]);
        let share = if to > from { ((way - from) / (to - from)).clamp(0.0, 1.0) } else { 1.0 };
        points[next - 1] + (points[next] - points[next - 1]) * share
    }
}

/// Cuts a skeleton into chains, parents first, with samples at all joints and at most `step` apart (0:
/// at the joints only).
///
/// A component whose root has two bones is looked at from the next branch node or end, so that a bend
/// at the root is one like all others.
pub fn chains(skeleton: &Skeleton, poses: &[Vec<Vec3>], step: f64) -> Vec<Chain> {
    let mut neighbors = vec![Vec::new(); skeleton.n_joints()];
    for (parent, child) in skeleton.bones() {
        neighbors[parent].push(child);
        neighbors[child].push(parent);
    }
    let mut chains: Vec<Chain> = Vec::new();
    for root in (0..skeleton.n_joints()).filter(|&it| skeleton.parents()[it].is_none()) {
        let mut stack = vec![(start(root, &neighbors), usize::MAX, None)];
        while let Some((from, back, before)) = stack.pop() {
            for &next in neighbors[from].iter().filter(|it| **it != back) {
                let joints = walk(from, next, &neighbors);
                let (end, last) = (joints[joints.len() - 1], joints[joints.len() - 2]);
                chains.push(sampled(joints, before, skeleton.positions(), poses, step));
                stack.push((end, last, Some(chains.len() - 1)));
            }
        }
    }
    chains
}

fn start(root: usize, neighbors: &[Vec<usize>]) -> usize {
    match neighbors[root][..] {
        [next, _] => *walk(root, next, neighbors).last().expect("a walk has an end"),
        _ => root,
    }
}

fn walk(from: usize, next: usize, neighbors: &[Vec<usize>]) -> Vec<usize> {
    let mut joints = vec![from, next];
    loop {
        let [last, joint] = [joints.len() - 2, joints.len() - 1].map(|it| joints[it]);
        match neighbors[joint][..] {
            [a, b] => joints.push(if a == last { b } else { a }),
            _ => return joints,
        }
    }
}

fn sampled(
    joints: Vec<usize>,
    before: Option<usize>,
    rest: &[Vec3],
    poses: &[Vec<Vec3>],
    step: f64,
) -> Chain {
    let mut places = vec![(joints[0], joints[0], 0.0)];
    let mut ways = vec![0.0];
    for pair in joints.windows(2) {
        let length = (rest[pair[1]] - rest[pair[0]]).norm();
        let n_parts = if step > 0.0 { (length / step).ceil().clamp(1.0, 1e4) } else { 1.0 };
        let start = ways[ways.len() - 1];
        for part in 1..=n_parts as usize {
            let share = part as f64 / n_parts;
            places.push((pair[0], pair[1], share));
            ways.push(start + length * share);
        }
    }
    let at = |points: &[Vec3]| -> Vec<Vec3> {
        let place =
            |&(a, b, share): &(usize, usize, f64)| points[a] + (points[b] - points[a]) * share;
        places.iter().map(place).collect()
    };
    let (rest, poses) = (at(rest), poses.iter().map(|it| at(it)).collect());
    Chain { before, joints, ways, rest, poses }
}
