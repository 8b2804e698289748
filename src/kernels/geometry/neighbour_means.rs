//! Values at vertices, smoothed over the faces.

use std::ops::{AddAssign, Mul};

use super::mesh::TriMesh;

/// Replaces every value by the mean of itself and of its neighbours, as often as asked.
///
/// A neighbour counts once for each face in which it follows the vertex: once, where the mesh is closed.
pub fn neighbour_means<T>(mesh: &TriMesh, mut values: Vec<T>, rounds: usize) -> Vec<T>
where
    T: Copy + AddAssign + Mul<f64, Output = T>,
{
    for _ in 0..rounds {
        let mut sums = values.clone();
        let mut counts = vec![1.0; values.len()];
        for face in mesh.faces() {
            for corner in 0..3 {
                let (to, from) = (face[corner] as usize, face[(corner + 1) % 3] as usize);
                sums[to] += values[from];
                counts[to] += 1.0;
            }
        }
        values = sums.into_iter().zip(counts).map(|(sum, count)| sum * (1.0 / count)).collect();
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::mesh::Vec3;
    use crate::kernels::geometry::shapes::icosphere;

    #[test]
    fn constants_stay_and_peaks_flatten() {
        let sphere = icosphere(2);
        let ones = neighbour_means(&sphere, vec![Vec3::x(); sphere.n_vertices()], 3);
        assert!(ones.iter().all(|it| (it - Vec3::x()).norm() < 1e-12));
        let mut peak = vec![0.0; sphere.n_vertices()];
        peak[0] = 1.0;
        // The first vertex has five neighbours.
        assert!((neighbour_means(&sphere, peak.clone(), 1)[0] - 1.0 / 6.0).abs() < 1e-12);
        assert_eq!(neighbour_means(&sphere, peak.clone(), 0), peak);
    }
}
