//! Removing spurs.

use super::super::curve_skeleton::CurveSkeleton;
use super::editor::Editor;

/// Which ends of curves are spurs.
#[derive(Debug, Clone, PartialEq)]
pub struct PruneOptions {
    /// An end of at most so many nodes, from the leaf to the junction, both counted.
    pub max_nodes: usize,
    /// An end shorter than so many radii of its junction, which does not leave the shape around it.
    pub max_radii: f64,
}

impl Default for PruneOptions {
    fn default() -> Self {
        Self { max_nodes: 3, max_radii: 1.2 }
    }
}

/// Removes the shortest end of a curve that is a spur, until there is none; its vertices go to the
/// junction. A component that is one curve stays as it is.
///
/// `radii` tell how far the shape reaches around every node: the skeleton's own, or
/// [`strip_radii`](super::strip_radii) for surfaces that may be open.
///
/// # Panics
/// If there is not a radius for every node.
pub fn prune(skeleton: &CurveSkeleton, radii: &[f64], options: &PruneOptions) -> CurveSkeleton {
    assert_eq!(radii.len(), skeleton.n_nodes(), "a radius for every node");
    let mut editor = Editor::new(skeleton);
    while let Some(spur) = shortest_spur(&editor, radii, options) {
        for &node in &spur.nodes {
            editor.remove(node, spur.junction);
        }
    }
    editor.finish()
}

struct Spur {
    /// From the leaf on, without the junction.
    nodes: Vec<u32>,
    junction: u32,
    length: f64,
}

fn shortest_spur(editor: &Editor, radii: &[f64], options: &PruneOptions) -> Option<Spur> {
    let leaves = editor.alive().filter(|&it| editor.degree(it) == 1);
    leaves
        .filter_map(|leaf| end_of_curve(editor, leaf))
        .filter(|it| {
            let radius = radii[it.junction as usize];
            it.nodes.len() < options.max_nodes || it.length < options.max_radii * radius
        })
        .min_by(|a, b| a.length.total_cmp(&b.length).then(a.nodes[0].cmp(&b.nodes[0])))
}

/// The way from a leaf to the next junction; none if it ends at another leaf.
fn end_of_curve(editor: &Editor, leaf: u32) -> Option<Spur> {
    let (mut nodes, mut length) = (vec![leaf], 0.0);
    let (mut before, mut node) = (leaf, *editor.neighbors[leaf as usize].first()?);
    loop {
        length += editor.length(before, node);
        match editor.degree(node) {
            1 => return None,
            2 => {
                nodes.push(node);
                let next = editor.neighbors[node as usize].iter().find(|it| **it != before);
                (before, node) = (node, *next?);
            }
            _ => return Some(Spur { nodes, junction: node, length }),
        }
    }
}
