//! Round holes.

use crate::kernels::{
    geometry::{
        mesh::{TriMesh, Vec3},
        topology::DisjointSets,
    },
    numerics::random::Random,
};

/// Cuts round holes that touch neither each other nor protected vertices, and leave one piece.
///
/// Returns the faces that are left, and how many holes found room.
pub fn cut_holes(
    mesh: &TriMesh,
    protected: &[u32],
    n_holes: usize,
    radius: f64,
    random: &mut Random,
) -> (Vec<[u32; 3]>, usize) {
    let at = |vertex: u32| mesh.vertices()[vertex as usize];
    let marked: Vec<Vec3> = protected.iter().map(|&it| at(it)).collect();
    let n_parts_before = n_parts(mesh.n_vertices(), mesh.faces());
    let mut order: Vec<u32> = (0..mesh.n_vertices() as u32).collect();
    random.shuffle(&mut order);
    let mut centres: Vec<Vec3> = Vec::new();
    let mut faces = mesh.faces().to_vec();
    for centre in order.into_iter().map(at) {
        if centres.len() == n_holes {
            break;
        }
        let apart = |others: &[Vec3], by: f64| others.iter().all(|it| (it - centre).norm() > by);
        if !apart(&centres, 3.0 * radius) || !apart(&marked, 2.0 * radius) {
            continue;
        }
        let outside = |face: &&[u32; 3]| face.iter().all(|&it| (at(it) - centre).norm() > radius);
        let left: Vec<[u32; 3]> = faces.iter().filter(outside).copied().collect();
        if left.len() < faces.len() && n_parts(mesh.n_vertices(), &left) == n_parts_before {
            faces = left;
            centres.push(centre);
        }
    }
    (faces, centres.len())
}

/// The number of connected parts that faces form.
fn n_parts(n_vertices: usize, faces: &[[u32; 3]]) -> usize {
    let mut sets = DisjointSets::new(n_vertices);
    let mut used = vec![false; n_vertices];
    for &[a, b, c] in faces {
        sets.join(a as usize, b as usize);
        sets.join(b as usize, c as usize);
        [a, b, c].into_iter().for_each(|it| used[it as usize] = true);
    }
    (0..n_vertices).filter(|&it| used[it] && sets.find(it) == it).count()
}
