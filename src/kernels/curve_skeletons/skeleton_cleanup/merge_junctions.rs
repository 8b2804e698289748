//! Bringing junctions to where curves really meet.

use super::super::curve_skeleton::{CurveSkeleton, NO_NODE};
use super::editor::Editor;
use crate::kernels::geometry::mesh::Vec3;

/// Unites junctions with the neighbour from where all vertices of both are at distances that differ
/// least, if they differ less than those of the junction's own vertices: by a factor of at most
/// `share` (Au et al. 2008, section 7). `vertices` are those of the shape.
///
/// # Panics
/// If there is not a label for every vertex.
pub fn merge_junctions(skeleton: &CurveSkeleton, vertices: &[Vec3], share: f64) -> CurveSkeleton {
    assert_eq!(skeleton.node_of_vertex().len(), vertices.len(), "a label for every vertex");
    let mut editor = Editor::new(skeleton);
    let mut groups: Vec<Vec<u32>> = vec![Vec::new(); skeleton.n_nodes()];
    for (vertex, &node) in skeleton.node_of_vertex().iter().enumerate() {
        if node != NO_NODE {
            groups[node as usize].push(vertex as u32);
        }
    }
    let mut again = true;
    while again {
        again = false;
        for node in 0..skeleton.n_nodes() as u32 {
            while editor.is_alive(node) && editor.degree(node) > 2 {
                let Some(target) = better_place(&editor, &groups, vertices, node, share) else {
                    break;
                };
                let own = std::mem::take(&mut groups[node as usize]);
                groups[target as usize].extend(own);
                editor.unite(&[target, node], editor.positions[target as usize]);
                again = true;
            }
        }
    }
    editor.finish()
}

fn better_place(
    editor: &Editor,
    groups: &[Vec<u32>],
    vertices: &[Vec3],
    node: u32,
    share: f64,
) -> Option<u32> {
    let deviation = |at: u32, members: &[&[u32]]| {
        let place = editor.positions[at as usize];
        let all = members.iter().flat_map(|it| it.iter());
        let distances = all.map(|&it| (vertices[it as usize] - place).norm());
        let (n, sum, squares) = distances
            .fold((0.0, 0.0, 0.0), |(n, sum, squares), it| (n + 1.0, sum + it, squares + it * it));
        if n == 0.0 { 0.0 } else { (squares / n - (sum / n) * (sum / n)).max(0.0).sqrt() }
    };
    let own = deviation(node, &[&groups[node as usize]]);
    let neighbors = editor.neighbors[node as usize].iter().copied();
    let best = neighbors
        .map(|it| (deviation(it, &[&groups[it as usize], &groups[node as usize]]), it))
        .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))?;
    (best.0 < share * own).then_some(best.1)
}
