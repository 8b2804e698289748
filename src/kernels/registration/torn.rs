//! Parts of a surface that only touched in the frame that showed it.

use crate::kernels::mesh::TriMesh;
use crate::kernels::mesh_sequence::MeshSequence;

/// In so many frames a face is stretched if it is torn.
const N_FRAMES: usize = 2;

/// Drops the faces of a tracked surface that some frames stretch to more than `stretch` times their
/// length, and the vertices that no face holds then; `None` if there are none.
///
/// A hand on a thigh is one surface with it in a depth picture. When it leaves, what seemed to be
/// between them is stretched as no skin is.
pub fn without_torn(mesh: &TriMesh, tracked: &MeshSequence, stretch: f64) -> Option<TriMesh> {
    let stays: Vec<[u32; 3]> = (mesh.faces().iter())
        .filter(|face| !is_torn(mesh, tracked, face, stretch))
        .copied()
        .collect();
    if stays.len() == mesh.n_faces() || stays.is_empty() {
        return None;
    }
    let mut new_of_old = vec![u32::MAX; mesh.n_vertices()];
    stays.iter().flatten().for_each(|it| new_of_old[*it as usize] = 0);
    let mut vertices = Vec::new();
    for (new, place) in new_of_old.iter_mut().zip(mesh.vertices()).filter(|it| *it.0 == 0) {
        *new = vertices.len() as u32;
        vertices.push(*place);
    }
    let faces = stays.iter().map(|it| it.map(|it| new_of_old[it as usize])).collect();
    Some(TriMesh::new(vertices, faces).expect("a part of a mesh"))
}

/// Whether some edge of a face is too long in [`N_FRAMES`] frames.
fn is_torn(mesh: &TriMesh, tracked: &MeshSequence, face: &[u32; 3], stretch: f64) -> bool {
    let length = |places: &[crate::kernels::mesh::Vec3], edge: usize| {
        let [a, b] = [face[edge], face[(edge + 1) % 3]].map(|it| places[it as usize]);
        (b - a).norm()
    };
    let rest = [0, 1, 2].map(|it| length(mesh.vertices(), it));
    let is_long = |frame: &usize| {
        let places = tracked.frame(*frame);
        (0..3).any(|it| length(places, it) > stretch * rest[it])
    };
    (0..tracked.n_frames()).filter(is_long).take(N_FRAMES).count() == N_FRAMES
}
