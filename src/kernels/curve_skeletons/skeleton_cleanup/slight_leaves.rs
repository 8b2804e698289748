//! Ends of curves that stand for hardly anything.

use super::super::curve_skeleton::CurveSkeleton;
use super::editor::Editor;

/// Removes leaves that have less than a part of the vertices of the next node, unless that is a
/// junction or a leaf; their vertices go there. The few vertices are on one side of the tip as a rule, and
/// their mean is no middle.
pub fn drop_slight_leaves(skeleton: &CurveSkeleton, share: f64) -> CurveSkeleton {
    let mut editor = Editor::new(skeleton);
    while let Some((leaf, next)) = slight_leaf(&editor, share) {
        editor.remove(leaf, next);
    }
    editor.finish()
}

fn slight_leaf(editor: &Editor, share: f64) -> Option<(u32, u32)> {
    let leaves = editor.alive().filter(|&it| editor.degree(it) == 1);
    let pairs = leaves.filter_map(|it| Some((it, *editor.neighbors[it as usize].first()?)));
    let count = |it: u32| editor.n_vertices(it) as f64;
    let mut slight =
        pairs.filter(|&(leaf, next)| editor.degree(next) == 2 && count(leaf) < share * count(next));
    slight.next()
}
