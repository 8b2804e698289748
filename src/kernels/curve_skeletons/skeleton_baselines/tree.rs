//! Trees over parts of a surface.

use rayon::prelude::*;

use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::geometry::point_tree::PointTree;

/// The most members of a part whose distances are taken.
const N_MEMBERS: usize = 300;

/// The parents of a tree's nodes, seen from `root`.
///
/// # Panics
/// If the edges do not join all nodes.
pub fn rooted(n: usize, edges: &[(usize, usize)], root: usize) -> Vec<Option<usize>> {
    let mut near = vec![Vec::new(); n];
    for &(a, b) in edges {
        near[a].push(b);
        near[b].push(a);
    }
    let mut parents = vec![None; n];
    let (mut queue, mut next) = (vec![root], 0);
    while next < queue.len() {
        let node = queue[next];
        let above = parents[node];
        for &other in near[node].iter().filter(|it| Some(**it) != above) {
            parents[other] = Some(node);
            queue.push(other);
        }
        next += 1;
    }
    assert_eq!(queue.len(), n, "the tree joins all nodes");
    parents
}

/// Nodes from the roots outward, ring by ring, by ascending index.
pub fn outward(parents: &[Option<usize>]) -> Vec<usize> {
    let depth = |node: usize| std::iter::successors(parents[node], |it| parents[*it]).count();
    let mut order: Vec<(usize, usize)> = (0..parents.len()).map(|it| (depth(it), it)).collect();
    order.sort_unstable();
    order.into_iter().map(|it| it.1).collect()
}

/// For every pair of parts the largest, over all frames, of their least distance between members.
pub fn largest_gaps(
    frames: &[&[Vec3]],
    labels: &[u32],
    n_parts: usize,
) -> Vec<(f64, usize, usize)> {
    let mut members = vec![Vec::new(); n_parts];
    (0_u32..).zip(labels).for_each(|(vertex, label)| members[*label as usize].push(vertex));
    for part in &mut members {
        let step = part.len().div_ceil(N_MEMBERS).max(1);
        *part = part.iter().copied().step_by(step).collect();
    }
    let of_frame = |frame: &&[Vec3]| -> Vec<f64> { gaps(frame, &members) };
    let all: Vec<Vec<f64>> = frames.par_iter().map(of_frame).collect();
    let mut res = Vec::new();
    for a in 0..n_parts {
        for b in a + 1..n_parts {
            let index = res.len();
            res.push((all.iter().map(|it| it[index]).fold(0.0, f64::max), a, b));
        }
    }
    res
}

/// The least distances of all pairs in one frame.
fn gaps(frame: &[Vec3], members: &[Vec<u32>]) -> Vec<f64> {
    let places: Vec<Vec<Vec3>> =
        members.iter().map(|it| it.iter().map(|it| frame[*it as usize]).collect()).collect();
    let trees: Vec<PointTree> = places.iter().map(|it| PointTree::new(it)).collect();
    let mut found = Vec::new();
    let mut res = Vec::new();
    for a in 0..members.len() {
        for tree in &trees[a + 1..] {
            let squares = places[a].iter().map(|place| {
                tree.nearest(*place, 1, &mut found);
                found.first().map_or(f64::INFINITY, |it| it.0)
            });
            res.push(squares.fold(f64::INFINITY, f64::min).sqrt());
        }
    }
    res
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::spanning_tree::spanning_tree;

    #[test]
    fn the_cheapest_tree_is_found_and_rooted() {
        let pairs = vec![(1.0, 0, 1), (5.0, 0, 2), (2.0, 1, 2), (1.0, 2, 3), (9.0, 1, 3)];
        let edges = spanning_tree(4, pairs);
        assert_eq!(edges, [(0, 1), (2, 3), (1, 2)]);
        let parents = rooted(4, &edges, 2);
        assert_eq!(parents, [Some(1), Some(2), None, Some(2)]);
        assert_eq!(outward(&parents), [2, 1, 3, 0]);
    }

    #[test]
    fn gaps_are_the_largest_over_time() {
        let frame = |apart: f64| vec![Vec3::zeros(), Vec3::x(), Vec3::x() * (1.0 + apart)];
        let (a, b) = (frame(0.5), frame(2.0));
        assert_eq!(largest_gaps(&[&a, &b], &[0, 0, 1], 2), [(2.0, 0, 1)]);
    }
}
