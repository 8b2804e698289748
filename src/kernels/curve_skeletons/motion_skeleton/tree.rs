//! From bones between nodes to a tree of joints.

use std::collections::BTreeMap;

use super::split::Bones;
use crate::kernels::curve_skeletons::curve_skeleton::CurveSkeleton;
use crate::kernels::geometry::mesh::Vec3;

/// The curves of a forest: paths between nodes that are no inner nodes of curves.
pub fn curves(skeleton: &CurveSkeleton) -> Vec<Vec<u32>> {
    let neighbors = skeleton.neighbors();
    let is_end = |node: u32| neighbors[node as usize].len() != 2;
    let mut paths = vec![];
    for first in (0..skeleton.n_nodes() as u32).filter(|&it| is_end(it)) {
        for &second in &neighbors[first as usize] {
            let mut path = vec![first, second];
            while let [.., before, last] = path[..]
                && !is_end(last)
            {
                let next = neighbors[last as usize].iter().find(|&&it| it != before);
                path.push(*next.expect("an inner node has two neighbours"));
            }
            if first < path[path.len() - 1] {
                paths.push(path);
            }
        }
    }
    paths
}

/// Drops the edges that close cycles: those farthest from the first node of their component, counted in
/// edges.
pub fn without_cycles(skeleton: &CurveSkeleton) -> CurveSkeleton {
    let neighbors = skeleton.neighbors();
    let mut is_seen = vec![false; skeleton.n_nodes()];
    let mut edges = vec![];
    for first in 0..skeleton.n_nodes() as u32 {
        if std::mem::replace(&mut is_seen[first as usize], true) {
            continue;
        }
        let mut queue = std::collections::VecDeque::from([first]);
        while let Some(node) = queue.pop_front() {
            for &next in &neighbors[node as usize] {
                if !std::mem::replace(&mut is_seen[next as usize], true) {
                    edges.push([node, next]);
                    queue.push_back(next);
                }
            }
        }
    }
    let (positions, radii) = (skeleton.positions().to_vec(), skeleton.radii().to_vec());
    CurveSkeleton::new(positions, radii, edges, skeleton.node_of_vertex().to_vec())
        .expect("a part of the edges")
}

/// Joints at the ends of bones, as a tree.
#[derive(Debug, Clone, PartialEq)]
pub struct JointTree {
    /// Parents first, depth first.
    pub nodes: Vec<u32>,
    pub parents: Vec<Option<usize>>,
    /// The bone that leads to every joint; none for the root.
    pub bones: Vec<Option<usize>>,
}

/// Makes joints of the ends of all bones.
///
/// The root is the branching joint that is nearest to the mean of all nodes; without any, the joint that
/// is nearest to the middle of the path. A skeleton of one node has one joint.
pub fn joint_tree(skeleton: &CurveSkeleton, bones: &Bones) -> JointTree {
    let mut ends: BTreeMap<u32, Vec<(u32, usize)>> = BTreeMap::new();
    for (bone, path) in bones.paths.iter().enumerate() {
        let (first, last) = (path[0], path[path.len() - 1]);
        ends.entry(first).or_default().push((last, bone));
        ends.entry(last).or_default().push((first, bone));
    }
    let mut res = JointTree { nodes: vec![], parents: vec![], bones: vec![] };
    let root = match ends.is_empty() {
        true => 0,
        false => root(skeleton, &ends),
    };
    let mut stack = vec![(root, None, None)];
    while let Some((node, parent, bone)) = stack.pop() {
        let joint = res.nodes.len();
        res.nodes.push(node);
        res.parents.push(parent);
        res.bones.push(bone);
        for &(next, other) in ends.get(&node).into_iter().flatten().rev() {
            if bone != Some(other) {
                stack.push((next, Some(joint), Some(other)));
            }
        }
    }
    res
}

fn root(skeleton: &CurveSkeleton, ends: &BTreeMap<u32, Vec<(u32, usize)>>) -> u32 {
    let mean = skeleton.positions().iter().sum::<Vec3>() / skeleton.n_nodes() as f64;
    let distance = |node: u32| (skeleton.positions()[node as usize] - mean).norm_squared();
    let branching = ends.iter().filter(|it| it.1.len() > 2).map(|it| *it.0);
    if let Some(node) = branching.min_by(|&a, &b| distance(a).total_cmp(&distance(b))) {
        return node;
    }
    let first = ends.iter().find(|it| it.1.len() == 1).expect("a tree has leaves");
    let (mut along, mut order) = (0.0, vec![(*first.0, 0.0)]);
    let (mut node, mut came_by) = (*first.0, None);
    while let Some(&(next, bone)) = ends[&node].iter().find(|it| Some(it.1) != came_by) {
        let places = [node, next].map(|it| skeleton.positions()[it as usize]);
        along += (places[1] - places[0]).norm();
        order.push((next, along));
        (node, came_by) = (next, Some(bone));
    }
    let off = |it: &(u32, f64)| (it.1 - along / 2.0).abs();
    order.iter().min_by(|a, b| off(a).total_cmp(&off(b))).expect("there are ends").0
}
