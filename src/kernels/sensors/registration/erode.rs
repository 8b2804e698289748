//! Eroding the rim of a surface, where depths are least certain.

/// Whether each face stays after rounds that drop faces with a corner on too few faces.
///
/// A round drops all faces of which some corner belongs to fewer than `least` faces that stayed so
/// far (Transfer4D: one round with 3 for registration, three rounds with 4 before skeletons).
pub fn erode(n_vertices: usize, faces: &[[u32; 3]], rounds: usize, least: usize) -> Vec<bool> {
    let mut stays = vec![true; faces.len()];
    for _ in 0..rounds {
        let mut counts = vec![0_usize; n_vertices];
        for (face, _) in faces.iter().zip(&stays).filter(|it| *it.1) {
            face.iter().for_each(|it| counts[*it as usize] += 1);
        }
        for (face, stays) in faces.iter().zip(&mut stays) {
            *stays &= face.iter().all(|it| counts[*it as usize] >= least);
        }
    }
    stays
}

/// Whether each vertex belongs to a face that stayed.
pub fn on_faces(n_vertices: usize, faces: &[[u32; 3]], stays: &[bool]) -> Vec<bool> {
    let mut res = vec![false; n_vertices];
    for (face, _) in faces.iter().zip(stays).filter(|it| *it.1) {
        face.iter().for_each(|it| res[*it as usize] = true);
    }
    res
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes;

    #[test]
    fn only_the_rim_goes() {
        let grid = shapes::rectangle(10, 8, 1.0, 0.8);
        // Two of the corners lie on one face, two on two: their faces go.
        let stays = erode(grid.n_vertices(), grid.faces(), 1, 3);
        let n_dropped = stays.iter().filter(|it| !**it).count();
        assert_eq!(n_dropped, 6);
        // With 4, every vertex of the rim is on too few faces.
        let stays = erode(grid.n_vertices(), grid.faces(), 1, 4);
        assert_eq!(stays.iter().filter(|it| **it).count(), 2 * 8 * 6);
        let closed = shapes::icosphere(2);
        assert!(erode(closed.n_vertices(), closed.faces(), 5, 4).iter().all(|it| *it));
    }
}
