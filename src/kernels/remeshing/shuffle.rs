//! The same mesh in another order.

use crate::kernels::{geometry::mesh::TriMesh, numerics::random::Random};

/// The same mesh with vertices, faces and the corners of faces in random order.
pub fn shuffled(mesh: &TriMesh, random: &mut Random) -> TriMesh {
    let mut old_from_new: Vec<u32> = (0..mesh.n_vertices() as u32).collect();
    random.shuffle(&mut old_from_new);
    let mut new_from_old = vec![0; mesh.n_vertices()];
    for (new, &old) in old_from_new.iter().enumerate() {
        new_from_old[old as usize] = new as u32;
    }
    let vertices = old_from_new.iter().map(|&it| mesh.vertices()[it as usize]).collect();
    let mut faces: Vec<[u32; 3]> =
        mesh.faces().iter().map(|it| it.map(|vertex| new_from_old[vertex as usize])).collect();
    random.shuffle(&mut faces);
    for face in &mut faces {
        face.rotate_left(random.below(3));
    }
    TriMesh::new(vertices, faces).expect("a permutation keeps a mesh a mesh")
}
