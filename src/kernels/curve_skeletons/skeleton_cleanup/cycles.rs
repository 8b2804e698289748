//! Removing cycles.

use std::collections::VecDeque;

use super::super::curve_skeleton::CurveSkeleton;
use super::editor::Editor;
use crate::kernels::geometry::mesh::Vec3;

/// Replaces every cycle by one node at the mean of its nodes, cycles of few nodes first.
///
/// False cycles appear where four and more curves meet in one place; those of true handles (a hand on
/// the hip) collapse, too, and what is left is a forest.
pub fn collapse_cycles(skeleton: &CurveSkeleton) -> CurveSkeleton {
    collapse_short_cycles(skeleton, usize::MAX)
}

/// As [`collapse_cycles`], but only cycles of at most `max_nodes` nodes; longer ones stay.
pub fn collapse_short_cycles(skeleton: &CurveSkeleton, max_nodes: usize) -> CurveSkeleton {
    if skeleton.n_cycles() == 0 {
        return skeleton.clone();
    }
    let mut editor = Editor::new(skeleton);
    while let Some(cycle) = shortest_cycle(&editor).filter(|it| it.len() <= max_nodes) {
        let sum: Vec3 = cycle.iter().map(|&it| editor.positions[it as usize]).sum();
        editor.unite(&cycle, sum / cycle.len() as f64);
    }
    editor.finish()
}

/// The nodes of a cycle of the fewest nodes, in ascending order; of several the first that is met from
/// the smallest node.
fn shortest_cycle(editor: &Editor) -> Option<Vec<u32>> {
    let core = core(editor);
    let mut best: Option<Vec<u32>> = None;
    for root in (0..core.len() as u32).filter(|&it| core[it as usize]) {
        let limit = best.as_ref().map_or(usize::MAX, Vec::len);
        if let Some(cycle) = shortest_cycle_through(editor, &core, root, limit) {
            best = Some(cycle);
        }
    }
    best.map(|mut cycle| {
        cycle.sort_unstable();
        cycle
    })
}

/// The nodes that are left when ends are taken off again and again.
fn core(editor: &Editor) -> Vec<bool> {
    let mut degrees: Vec<usize> =
        (0..editor.positions.len() as u32).map(|it| editor.degree(it)).collect();
    let mut is_core: Vec<bool> = degrees.iter().map(|&it| it > 1).collect();
    let mut ends: Vec<u32> =
        (0..degrees.len() as u32).filter(|&it| degrees[it as usize] == 1).collect();
    while let Some(end) = ends.pop() {
        for &next in &editor.neighbors[end as usize] {
            degrees[next as usize] -= 1;
            if degrees[next as usize] == 1 && is_core[next as usize] {
                is_core[next as usize] = false;
                ends.push(next);
            }
        }
    }
    is_core
}

/// A breadth-first search that stops at the first edge between two branches: for the root of the
/// smallest such cycle of all, that is a cycle.
fn shortest_cycle_through(
    editor: &Editor,
    core: &[bool],
    root: u32,
    limit: usize,
) -> Option<Vec<u32>> {
    const NONE: u32 = u32::MAX;
    let mut parents = vec![NONE; core.len()];
    let mut depths = vec![usize::MAX; core.len()];
    depths[root as usize] = 0;
    let mut queue = VecDeque::from([root]);
    let mut best: Option<(usize, [u32; 2])> = None;
    while let Some(node) = queue.pop_front() {
        let depth = depths[node as usize];
        // No cycle that is met from here on has fewer nodes.
        if 2 * depth + 1 >= best.map_or(limit, |it| it.0) {
            break;
        }
        for &next in editor.neighbors[node as usize].iter().filter(|it| core[**it as usize]) {
            if depths[next as usize] == usize::MAX {
                depths[next as usize] = depth + 1;
                parents[next as usize] = node;
                queue.push_back(next);
            } else if parents[node as usize] != next {
                let n_nodes = depth + depths[next as usize] + 1;
                if n_nodes < best.map_or(limit, |it| it.0) {
                    best = Some((n_nodes, [node, next]));
                }
            }
        }
    }
    let (n_nodes, ends) = best?;
    let mut cycle = vec![];
    for end in ends {
        let mut node = end;
        while node != NONE && !cycle.contains(&node) {
            cycle.push(node);
            node = parents[node as usize];
        }
    }
    // Both ways back may share their last part: then the cycle does not go through the root.
    (cycle.len() == n_nodes && branches_apart(&parents, root, ends)).then_some(cycle)
}

/// Whether the ways from two nodes back to the root only meet there.
fn branches_apart(parents: &[u32], root: u32, ends: [u32; 2]) -> bool {
    let first_step = |mut node: u32| {
        while node != root && parents[node as usize] != root {
            node = parents[node as usize];
        }
        node
    };
    first_step(ends[0]) != first_step(ends[1])
}
