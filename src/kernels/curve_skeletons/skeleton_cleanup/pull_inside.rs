//! Bringing nodes back into the shape.

use rayon::prelude::*;

use super::super::curve_skeleton::CurveSkeleton;
use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::geometry::shapes::signed_volume;
use crate::kernels::geometry::triangle::closest_on_triangle;

/// Moves the nodes outside of a mesh into it: to the middle between the closest point of the surface
/// and the point behind it. Small holes do not matter; nodes of open surfaces stay where they are.
///
/// Which side a node is on is told by the winding number (Jacobson et al. 2013). It is computed for
/// nodes that some of their own vertices see from outside, and for those without vertices.
pub fn pull_inside(skeleton: &CurveSkeleton, mesh: &TriMesh) -> CurveSkeleton {
    if !is_nearly_closed(mesh) {
        return skeleton.clone();
    }
    let normals = mesh.vertex_normals();
    let sign = signed_volume(mesh).signum();
    let vertices_of_nodes = skeleton.vertices_of_nodes();
    let is_doubtful = |node: usize| {
        let position = skeleton.positions()[node];
        let vertices = &vertices_of_nodes[node];
        let n_behind = vertices.iter().filter(|it| {
            let vertex = **it as usize;
            sign * (mesh.vertices()[vertex] - position).dot(&normals[vertex]) > 0.0
        });
        (n_behind.count() as f64) <= CERTAIN * vertices.len() as f64
    };
    let pull = |node: usize| {
        let position = skeleton.positions()[node];
        if is_doubtful(node) && sign * winding_number(mesh, &position) < 0.5 {
            middle_behind_surface(mesh, &position).unwrap_or(position)
        } else {
            position
        }
    };
    let positions = (0..skeleton.n_nodes()).into_par_iter().map(pull).collect();
    skeleton.with_positions(positions).expect("places in a finite mesh are finite")
}

/// A node is inside if more than this share of its vertices turn their backs to it.
const CERTAIN: f64 = 0.95;

/// Whether holes are small: area vectors add up to nothing over a closed surface.
pub(super) fn is_nearly_closed(mesh: &TriMesh) -> bool {
    let sum: Vec3 = (0..mesh.n_faces()).map(|it| mesh.area_vector(it)).sum();
    mesh.n_faces() > 0 && sum.norm() <= OPEN * mesh.area()
}

/// A surface is open if its area vectors add up to more than this share of its area.
const OPEN: f64 = 0.05;

/// How many times the surface winds around a place: 1 inside, 0 outside (Van Oosterom & Strackee
/// 1983).
fn winding_number(mesh: &TriMesh, place: &Vec3) -> f64 {
    let solid_angle = |face: usize| {
        let [a, b, c] = mesh.corners(face).map(|it| it - place);
        let [la, lb, lc] = [a, b, c].map(|it| it.norm());
        let divisor = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
        2.0 * a.dot(&b.cross(&c)).atan2(divisor)
    };
    (0..mesh.n_faces()).map(solid_angle).sum::<f64>() / (4.0 * std::f64::consts::PI)
}

/// From the closest point of the surface, half the way straight on to where the surface is met again.
fn middle_behind_surface(mesh: &TriMesh, place: &Vec3) -> Option<Vec3> {
    let closest = |face: usize| {
        let corners = mesh.corners(face);
        let weights = closest_on_triangle(place, &corners);
        let point = corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2];
        ((point - place).norm_squared(), point)
    };
    let (_, point) = (0..mesh.n_faces()).map(closest).min_by(|a, b| a.0.total_cmp(&b.0))?;
    let direction = (point - place).try_normalize(0.0)?;
    let (low, high) = mesh.bounds();
    let least = 1e-6 * (high - low).norm();
    let hits = (0..mesh.n_faces()).filter_map(|it| hit(&mesh.corners(it), &point, &direction));
    let distance = hits.filter(|it| *it > least).min_by(f64::total_cmp)?;
    Some(point + direction * (0.5 * distance))
}

/// How far a ray goes until it hits a triangle (Möller & Trumbore 1997).
fn hit(&[a, b, c]: &[Vec3; 3], from: &Vec3, direction: &Vec3) -> Option<f64> {
    let (ab, ac, offset) = (b - a, c - a, from - a);
    let across = direction.cross(&ac);
    let determinant = ab.dot(&across);
    let u = offset.dot(&across) / determinant;
    let along = offset.cross(&ab);
    let v = direction.dot(&along) / determinant;
    // A ray in the triangle's plane has no finite `u`, and does not hit.
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0).then(|| ac.dot(&along) / determinant)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes::{torus, tube};

    #[test]
    fn nodes_outside_a_ring_come_to_the_middle_of_its_tube() {
        let mesh = torus(1.0, 0.3, 96, 48);
        let positions = vec![Vec3::zeros(), Vec3::x() * 0.4, Vec3::x() * 1.1, Vec3::z() * 2.0];
        let skeleton = CurveSkeleton::new(positions, vec![0.1; 4], vec![[0, 1]], vec![]).unwrap();
        let res = pull_inside(&skeleton, &mesh);
        assert_eq!(res.positions()[2], Vec3::x() * 1.1, "it is inside");
        for (node, expected) in [(1, Vec3::x()), (3, Vec3::z())] {
            let found = res.positions()[node];
            assert!((found - expected).norm() < 0.03, "{found} instead of {expected}");
        }
        assert!((res.positions()[0].norm() - 1.0).abs() < 0.03);
        // Inside out, the same.
        let again = pull_inside(&skeleton, &mesh.inverted());
        assert!((again.positions()[3] - Vec3::z()).norm() < 0.03);
    }

    #[test]
    fn open_surfaces_have_no_inside() {
        let positions = vec![Vec3::x() * 3.0];
        let skeleton = CurveSkeleton::new(positions, vec![0.1], vec![], vec![]).unwrap();
        assert_eq!(pull_inside(&skeleton, &tube(0.1, 1.0, 8, 8, 0.5)), skeleton);
    }
}
