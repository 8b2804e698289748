//! Thinning out crowded nodes.

use super::super::curve_skeleton::CurveSkeleton;
use super::editor::Editor;

/// Unites joined nodes that are closer than a distance, the closest ones first, until there are none.
///
/// A junction or a leaf stays where it is when it takes over an inner node of a curve; other pairs
/// meet in their middle.
pub fn merge_close_nodes(skeleton: &CurveSkeleton, distance: f64) -> CurveSkeleton {
    merge_by(skeleton, distance, &|_| 1.0)
}

/// Unites joined nodes that are closer than a part of the mean of their radii, which follows them
/// when they are united; in the same way as [`merge_close_nodes`].
pub fn merge_crowded_nodes(skeleton: &CurveSkeleton, share: f64) -> CurveSkeleton {
    merge_by(skeleton, share, &|radius| radius)
}

/// Lengths of edges count in means of a unit that belongs to radii.
fn merge_by(skeleton: &CurveSkeleton, limit: f64, unit: &dyn Fn(f64) -> f64) -> CurveSkeleton {
    let mut editor = Editor::new(skeleton);
    while let Some((_, [a, b])) = closest_pair(&editor, limit, unit) {
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

fn closest_pair(editor: &Editor, limit: f64, unit: &dyn Fn(f64) -> f64) -> Option<(f64, [u32; 2])> {
    let length = |from: u32, to: u32| {
        let mean = 0.5 * (unit(editor.radius(from)) + unit(editor.radius(to)));
        editor.length(from, to) / mean.max(f64::MIN_POSITIVE)
    };
    let pairs = editor.alive().flat_map(|from| {
        let larger = editor.neighbors[from as usize].range(from..);
        larger.map(move |&to| (length(from, to), [from, to]))
    });
    pairs.filter(|it| it.0 < limit).min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))
}
