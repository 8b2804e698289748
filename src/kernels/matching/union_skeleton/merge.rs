//! Merging one more skeleton into the union.

use super::tree::UnionTree;
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::matching::map_segments::places_along;
use crate::kernels::matching::skeleton_match::SkeletonMatch;
use crate::kernels::rigs::skeleton::Skeleton;

/// Merges a skeleton: nodes at like places of matched branches are one, others are new, and what is not
/// matched is grafted on.
///
/// `matched` leads from the union to the skeleton. Nodes are at like places if each is the other's
/// nearest and they are closer than `threshold` of the mean bone of the branch, on the side of the
/// longer bones.
pub fn merge(
    tree: &mut UnionTree,
    skeleton: &Skeleton,
    index: usize,
    matched: &SkeletonMatch,
    threshold: f64,
) {
    tree.begin_pose(index);
    let positions = skeleton.positions();
    let degrees = degrees(skeleton);
    let mut node_of_joint: Vec<Option<u32>> = vec![None; skeleton.n_joints()];
    for &[node, joint] in matched.nodes() {
        node_of_joint[joint as usize] = Some(node);
        tree.counts[node as usize] += 1;
        tree.add_line([node; 2], vec![positions[joint as usize]]);
    }
    let mut is_on_branch = vec![false; skeleton.n_joints()];
    for branch in matched.branches() {
        let joints = &branch.target;
        for &joint in joints {
            is_on_branch[joint as usize] = true;
        }
        let nodes = unite(tree, &branch.source, joints, positions, threshold);
        // The line is parted where something may be grafted on.
        let mut first = 0;
        for last in 1..joints.len() {
            let is_end = last + 1 == joints.len();
            if !is_end && degrees[joints[last] as usize] == 2 {
                continue;
            }
            node_of_joint[joints[last] as usize] = Some(nodes[last]);
            let points = joints[first..=last].iter().map(|&it| positions[it as usize]).collect();
            tree.add_line([nodes[first], nodes[last]], points);
            first = last;
        }
    }
    graft(tree, skeleton, &is_on_branch, &mut node_of_joint);
}

fn degrees(skeleton: &Skeleton) -> Vec<usize> {
    let mut degrees = vec![0; skeleton.n_joints()];
    for (parent, child) in skeleton.bones() {
        degrees[parent] += 1;
        degrees[child] += 1;
    }
    degrees
}

/// Gives every joint along a branch a node of the union's branch, a new one if none is at its place.
fn unite(
    tree: &mut UnionTree,
    nodes: &[u32],
    joints: &[u32],
    positions: &[Vec3],
    threshold: f64,
) -> Vec<u32> {
    let points: Vec<Vec3> = joints.iter().map(|&it| positions[it as usize]).collect();
    let places = places_along(&points);
    // Ends are matched already, and nodes may lie between the ends that the match does not list.
    let way = tree.way(nodes[0], nodes[nodes.len() - 1]);
    let shares = tree.shares(&way);
    let longest = 1.0 / (places.len().min(way.len()) - 1).max(1) as f64;
    let (own, theirs) = (&shares[1..way.len() - 1], &places[1..places.len() - 1]);
    let pairs = mutual_nearest(own, theirs, threshold * longest);
    let mut res = vec![way[0]];
    let mut inner = own.iter().zip(&way[1..]).peekable();
    let (mut last, mut last_share) = (way[0], 0.0);
    for (index, &place) in theirs.iter().enumerate() {
        let partner = pairs[index].map(|it| way[it + 1]);
        let limit = pairs[index].map_or(place, |it| own[it]);
        while let Some((share, node)) =
            inner.peek().map(|it| (*it.0, *it.1)).filter(|it| it.0 <= limit)
        {
            (last, last_share) = (node, share);
            inner.next();
        }
        if let Some(node) = partner {
            tree.counts[node as usize] += 1;
            res.push(node);
            continue;
        }
        let (next, next_share) =
            inner.peek().map_or((way[way.len() - 1], 1.0), |(share, node)| (**node, **share));
        let span: f64 = next_share - last_share;
        let part = if span > 0.0 { ((place - last_share) / span).clamp(0.0, 1.0) } else { 0.5 };
        last = tree.split(last, next, part);
        last_share = place;
        res.push(last);
    }
    res.push(way[way.len() - 1]);
    res
}

/// For every place of the second list the index of one of the first, where each is the nearest of the
/// other. Both ascend, and so do the pairs.
fn mutual_nearest(own: &[f64], theirs: &[f64], limit: f64) -> Vec<Option<usize>> {
    let nearest = |of: f64, among: &[f64]| {
        let distance = |it: &usize| (among[*it] - of).abs();
        (0..among.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)))
    };
    let partner = |(index, &place): (usize, &f64)| {
        let found = nearest(place, own).filter(|&it| (own[it] - place).abs() < limit)?;
        (nearest(own[found], theirs) == Some(index)).then_some(found)
    };
    theirs.iter().enumerate().map(partner).collect()
}

/// Adds all bones that are on no matched branch.
fn graft(
    tree: &mut UnionTree,
    skeleton: &Skeleton,
    is_on_branch: &[bool],
    node_of_joint: &mut [Option<u32>],
) {
    let positions = skeleton.positions();
    let mut neighbors = vec![Vec::new(); skeleton.n_joints()];
    for (parent, child) in skeleton.bones() {
        neighbors[parent].push(child);
        neighbors[child].push(parent);
    }
    let known = |nodes: &[Option<u32>]| -> Vec<usize> {
        (0..nodes.len()).filter(|&it| nodes[it].is_some()).collect()
    };
    let mut stack = known(node_of_joint);
    let mut firsts = 0..skeleton.n_joints();
    loop {
        while let Some(joint) = stack.pop() {
            let node = node_of_joint[joint].expect("joints on the stack have nodes");
            for &next in &neighbors[joint] {
                if node_of_joint[next].is_some() || is_on_branch[next] {
                    continue;
                }
                let new = tree.add_node();
                node_of_joint[next] = Some(new);
                let ends = [positions[joint], positions[next]];
                tree.join([node, new], (ends[0] - ends[1]).norm());
                tree.add_line([node, new], ends.to_vec());
                stack.push(next);
            }
        }
        let Some(first) = firsts.find(|&it| node_of_joint[it].is_none() && !is_on_branch[it])
        else {
            return;
        };
        // A component of its own.
        let new = tree.add_node();
        node_of_joint[first] = Some(new);
        tree.roots.push(new);
        tree.add_line([new; 2], vec![positions[first]]);
        stack.push(first);
    }
}
