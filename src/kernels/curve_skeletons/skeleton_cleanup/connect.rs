//! One skeleton of several parts.

use super::super::curve_skeleton::{CurveSkeleton, NO_NODE};
use super::editor::Editor;
use crate::kernels::geometry::topology::DisjointSets;

/// Removes the components of fewer than `min_nodes` nodes; their vertices belong to no node then. The
/// largest component stays in any case.
pub fn drop_small_components(skeleton: &CurveSkeleton, min_nodes: usize) -> CurveSkeleton {
    let components = skeleton.components();
    let mut sizes = vec![0; skeleton.n_components()];
    components.iter().for_each(|&it| sizes[it as usize] += 1);
    let Some(&largest) = sizes.iter().max() else {
        return skeleton.clone();
    };
    let mut editor = Editor::new(skeleton);
    for (node, &component) in components.iter().enumerate() {
        if sizes[component as usize] < min_nodes.min(largest) {
            editor.remove(node as u32, NO_NODE);
        }
    }
    editor.finish()
}

/// Joins components by the shortest edges between their nodes, less the radii of both nodes, until
/// there is one (Kruskal 1956).
pub fn connect_components(skeleton: &CurveSkeleton) -> CurveSkeleton {
    let mut editor = Editor::new(skeleton);
    let components = skeleton.components();
    let n_nodes = skeleton.n_nodes() as u32;
    let mut best: std::collections::BTreeMap<[u32; 2], (f64, [u32; 2])> = Default::default();
    for a in 0..n_nodes {
        for b in a + 1..n_nodes {
            let pair = [components[a as usize], components[b as usize]];
            if pair[0] == pair[1] {
                continue;
            }
            let gap = editor.length(a, b) - editor.radius(a) - editor.radius(b);
            let pair = [pair[0].min(pair[1]), pair[0].max(pair[1])];
            let found = best.entry(pair).or_insert((gap, [a, b]));
            if gap < found.0 {
                *found = (gap, [a, b]);
            }
        }
    }
    let mut links: Vec<_> = best.into_iter().collect();
    links.sort_by(|a, b| a.1.0.total_cmp(&b.1.0).then(a.0.cmp(&b.0)));
    let mut sets = DisjointSets::new(skeleton.n_components());
    for ([one, other], (_, [a, b])) in links {
        let (one, other) = (one as usize, other as usize);
        if sets.find(one) != sets.find(other) {
            sets.join(one, other);
            editor.join(a, b);
        }
    }
    editor.finish()
}
