//! From a curve skeleton to a skeleton with roots and parents.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::curve_skeleton::CurveSkeleton;
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::rigs::skeleton::{Skeleton, SkeletonError};

/// A skeleton with the nodes its joints were made of.
#[derive(Debug, Clone, PartialEq)]
pub struct Rooted {
    pub skeleton: Skeleton,
    /// For every joint the node at its place.
    pub node_of_joint: Vec<u32>,
}

/// Gives a curve skeleton a root and parents: every node becomes a joint, or with `only_branching`
/// every root, junction and leaf.
///
/// The root of a component is the junction that is nearest to the mean of its nodes; without a
/// junction, the node from which the way to the farthest end is shortest. Parents are on the shortest
/// way to the root, so a cycle opens where both ways are equally long. Joints are in depth-first
/// order, components by size.
///
/// # Errors
/// [`SkeletonError::NoJoints`] if there is no node.
pub fn rooted_skeleton(
    skeleton: &CurveSkeleton,
    only_branching: bool,
) -> Result<Rooted, SkeletonError> {
    let neighbors = skeleton.neighbors();
    let mut order: Vec<(u32, Option<u32>)> = vec![];
    for members in components_by_size(skeleton) {
        let root = root(skeleton, &neighbors, &members);
        let parents = shortest_paths(skeleton, &neighbors, root).parents;
        let mut children = vec![vec![]; skeleton.n_nodes()];
        for &node in members.iter().rev().filter(|it| **it != root) {
            children[parents[node as usize] as usize].push(node);
        }
        let mut stack = vec![(root, None)];
        while let Some((node, parent)) = stack.pop() {
            let own = &children[node as usize];
            let is_joint = !only_branching || parent.is_none() || own.len() != 1;
            if is_joint {
                order.push((node, parent));
            }
            let next = if is_joint { Some(node) } else { parent };
            stack.extend(own.iter().map(|&it| (it, next)));
        }
    }
    assemble(skeleton, &order)
}

fn assemble(
    skeleton: &CurveSkeleton,
    order: &[(u32, Option<u32>)],
) -> Result<Rooted, SkeletonError> {
    let mut joint_of_node = vec![usize::MAX; skeleton.n_nodes()];
    for (joint, (node, _)) in order.iter().enumerate() {
        joint_of_node[*node as usize] = joint;
    }
    let n_digits = order.len().saturating_sub(1).to_string().len();
    let names = (0..order.len()).map(|it| format!("joint_{it:0n_digits$}")).collect();
    let parents = order.iter().map(|it| Some(joint_of_node[it.1? as usize])).collect();
    let positions = order.iter().map(|it| skeleton.positions()[it.0 as usize]).collect();
    let skeleton = Skeleton::new(names, parents, positions)?;
    Ok(Rooted { skeleton, node_of_joint: order.iter().map(|it| it.0).collect() })
}

/// The nodes of every component, ascending; the component of the most nodes first.
fn components_by_size(skeleton: &CurveSkeleton) -> Vec<Vec<u32>> {
    let mut members = vec![vec![]; skeleton.n_components()];
    for (node, &component) in skeleton.components().iter().enumerate() {
        members[component as usize].push(node as u32);
    }
    members.sort_by_key(|it| Reverse(it.len()));
    members
}

fn root(skeleton: &CurveSkeleton, neighbors: &[Vec<u32>], members: &[u32]) -> u32 {
    let mean = members.iter().map(|&it| skeleton.positions()[it as usize]).sum::<Vec3>()
        / members.len() as f64;
    let distance = |node: u32| (skeleton.positions()[node as usize] - mean).norm_squared();
    let junctions = members.iter().copied().filter(|&it| neighbors[it as usize].len() > 2);
    if let Some(junction) = junctions.min_by(|&a, &b| distance(a).total_cmp(&distance(b))) {
        return junction;
    }
    let farthest = |node: u32| {
        let distances = shortest_paths(skeleton, neighbors, node).distances;
        members.iter().map(|&it| distances[it as usize]).fold(0.0, f64::max)
    };
    // A path or a cycle: on a path the farthest node is one of its ends.
    let ends: Vec<u32> =
        members.iter().copied().filter(|&it| neighbors[it as usize].len() < 2).collect();
    let Some(&end) = ends.first() else {
        return members[0];
    };
    let from_end = shortest_paths(skeleton, neighbors, end).distances;
    let half = farthest(end) / 2.0;
    let middle = members.iter().copied().min_by(|&a, &b| {
        let [a, b] = [a, b].map(|it| (from_end[it as usize] - half).abs());
        a.total_cmp(&b)
    });
    middle.expect("a component has nodes")
}

struct ShortestPaths {
    parents: Vec<u32>,
    distances: Vec<f64>,
}

/// Dijkstra's algorithm along edges.
fn shortest_paths(skeleton: &CurveSkeleton, neighbors: &[Vec<u32>], from: u32) -> ShortestPaths {
    let n_nodes = skeleton.n_nodes();
    let mut res =
        ShortestPaths { parents: vec![u32::MAX; n_nodes], distances: vec![f64::INFINITY; n_nodes] };
    res.distances[from as usize] = 0.0;
    let mut heap = BinaryHeap::from([Reverse((0_u64, from))]);
    while let Some(Reverse((bits, node))) = heap.pop() {
        let distance = f64::from_bits(bits);
        if distance > res.distances[node as usize] {
            continue;
        }
        for &next in &neighbors[node as usize] {
            let [a, b] = [node, next].map(|it| skeleton.positions()[it as usize]);
            let length = distance + (a - b).norm();
            if length < res.distances[next as usize] {
                res.distances[next as usize] = length;
                res.parents[next as usize] = node;
                heap.push(Reverse((length.to_bits(), next)));
            }
        }
    }
    res
}

#[cfg(test)]
mod tests {
    use super::*;

    fn skeleton(points: &[[f64; 2]], edges: &[[u32; 2]]) -> CurveSkeleton {
        let positions: Vec<Vec3> = points.iter().map(|&[x, y]| Vec3::new(x, y, 0.0)).collect();
        let radii = vec![0.0; positions.len()];
        CurveSkeleton::new(positions, radii, edges.to_vec(), vec![]).unwrap()
    }

    #[test]
    fn the_root_is_the_middle_junction() {
        // Two junctions, 1 and 4; the second is nearer to the mean. Node 3 lies between them.
        let points =
            [[0., 0.], [1., 0.], [1., 1.], [2., 0.], [3., 0.], [4., 1.], [4., -1.], [5., 2.]];
        let edges = [[0, 1], [1, 2], [1, 3], [3, 4], [4, 5], [4, 6], [5, 7]];
        let rooted = rooted_skeleton(&skeleton(&points, &edges), false).unwrap();
        assert_eq!(rooted.node_of_joint, [4, 3, 1, 0, 2, 5, 7, 6]);
        let parents = [None, Some(0), Some(1), Some(2), Some(2), Some(0), Some(5), Some(0)];
        assert_eq!(rooted.skeleton.parents(), parents);
        let branching = rooted_skeleton(&skeleton(&points, &edges), true).unwrap();
        assert_eq!(branching.node_of_joint, [4, 1, 0, 2, 7, 6]);
        let parents = [None, Some(0), Some(1), Some(1), Some(0), Some(0)];
        assert_eq!(branching.skeleton.parents(), parents);
    }

    #[test]
    fn a_path_has_its_root_in_the_middle_and_a_cycle_opens_opposite_its_root() {
        let path = skeleton(
            &[[0., 0.], [1., 0.], [2., 0.], [3., 0.], [4., 0.]],
            &[[0, 1], [1, 2], [2, 3], [3, 4]],
        );
        assert_eq!(rooted_skeleton(&path, true).unwrap().node_of_joint, [2, 0, 4]);
        let square =
            skeleton(&[[0., 0.], [1., 0.], [1., 1.], [0., 1.]], &[[0, 1], [1, 2], [2, 3], [0, 3]]);
        let rooted = rooted_skeleton(&square, false).unwrap();
        assert_eq!(rooted.skeleton.bones().count(), 3);
        let two = skeleton(&[[0., 0.], [1., 0.], [5., 5.]], &[[0, 1]]);
        let roots = rooted_skeleton(&two, false).unwrap();
        assert_eq!(roots.skeleton.parents(), [None, Some(0), None]);
        assert!(rooted_skeleton(&skeleton(&[], &[]), false).is_err());
    }
}
