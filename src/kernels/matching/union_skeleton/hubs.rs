//! Branch nodes that are near each other made one.

use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::matching::skeleton_match::{SkeletonGraph, collapse};
use crate::kernels::rigs::skeleton::Skeleton;

/// Unites branch nodes whose way to each other is shorter than `share` of the longest way in the skeleton.
///
/// Where several limbs leave a trunk, noise and poses decide in which order they do, and no match of nodes
/// can change an order: limbs would be taken for others, or for new ones. A united node lies at the mean
/// of its branch nodes.
pub fn with_hubs(skeleton: &Skeleton, share: f64) -> Skeleton {
    let graph = SkeletonGraph::from(skeleton);
    let collapsed = collapse(&graph);
    let least = share * longest_way(skeleton);
    // The joint that stands for a joint: the first of its hub.
    let mut hub: Vec<usize> = (0..skeleton.n_joints()).collect();
    for branch in &collapsed.branches {
        if branch.length >= least || branch.ends.iter().any(|&it| collapsed.degree(it as usize) < 3)
        {
            continue;
        }
        for node in branch.ends.map(|it| collapsed.nodes[it as usize]).iter().chain(&branch.inner) {
            let ends = [*node, collapsed.nodes[branch.ends[0] as usize]];
            let [a, b] = ends.map(|it| first_of(&hub, it as usize));
            hub[a.max(b)] = a.min(b);
        }
    }
    let of: Vec<usize> = (0..hub.len()).map(|it| first_of(&hub, it)).collect();
    united(skeleton, &of, &collapsed.nodes)
}

fn first_of(hub: &[usize], joint: usize) -> usize {
    let mut at = joint;
    while hub[at] != at {
        at = hub[at];
    }
    at
}

/// The skeleton with one joint for all that have the same in `of`, at the mean of those among `nodes`.
fn united(skeleton: &Skeleton, of: &[usize], nodes: &[u32]) -> Skeleton {
    let mut sums = vec![(Vec3::zeros(), 0.0); of.len()];
    for &node in nodes {
        let sum = &mut sums[of[node as usize]];
        *sum = (sum.0 + skeleton.positions()[node as usize], sum.1 + 1.0);
    }
    let kept: Vec<usize> = (0..of.len()).filter(|&it| of[it] == it).collect();
    let new = |old: usize| kept.binary_search(&of[old]).expect("what stands for others is kept");
    // The joints of a hub hang together, so its first one has the only parent outside of it.
    let parents = kept.iter().map(|&it| skeleton.parents()[it].map(new)).collect();
    let place = |it: &usize| match sums[*it] {
        (sum, n) if n > 1.0 => sum / n,
        _ => skeleton.positions()[*it],
    };
    let names = kept.iter().map(|&it| skeleton.names()[it].clone()).collect();
    Skeleton::new(names, parents, kept.iter().map(place).collect())
        .expect("joints stay in their order")
}

/// The length of the longest way between two joints.
fn longest_way(skeleton: &Skeleton) -> f64 {
    let mut below = vec![0.0_f64; skeleton.n_joints()];
    let mut longest = 0.0_f64;
    // Children come after their parents.
    for joint in (0..skeleton.n_joints()).rev() {
        let Some(parent) = skeleton.parents()[joint] else { continue };
        let length = (skeleton.positions()[joint] - skeleton.positions()[parent]).norm();
        let way = below[joint] + length;
        longest = longest.max(below[parent] + way);
        below[parent] = below[parent].max(way);
    }
    longest
}
