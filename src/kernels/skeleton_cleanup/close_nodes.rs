//! Thinning out crowded nodes.

use super::super::curve_skeleton::CurveSkeleton;
use super::editor::Editor;

/// Unites joined nodes that are closer than a distance, the closest ones first, until there are none.
///
/// A junction or a leaf stays where it is when it takes over an inner node of a curve; other pairs
/// meet in their middle.
pub fn merge_close_nodes(skeleton: &CurveSkeleton, distance: f64) -> CurveSkeleton {
    let mut editor = Editor::new(skeleton);
    while let Some((_, [a, b])) = closest_pair(&editor, distance) {
        let [from, to] = [a, b].map(|it| editor.positions[it as usize]);
        let position = match [a, b].map(|it| editor.degree(it) == 2) {
            [true, false] => to,
            [false, true] => from,
            _ => (from + to) * 0.5,
        };
        editor.unite(&[a, b], position);
    }
    editor.finish()
}

fn closest_pair(editor: &Editor, distance: f64) -> Option<(f64, [u32; 2])> {
    let pairs = editor.alive().flat_map(|from| {
        let larger = editor.neighbors[from as usize].range(from..);
        larger.map(move |&to| (editor.length(from, to), [from, to]))
    });
    pairs.filter(|it| it.0 < distance).min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))
}
