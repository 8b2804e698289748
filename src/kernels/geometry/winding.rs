//! Generalized winding numbers: whether a place is inside a surface, also an imperfect one.

use std::f64::consts::PI;

use super::mesh::Vec3;
use super::triangle_tree::TriangleTree;

/// A surface whose winding number can be asked for anywhere.
///
/// The winding number is the sum of the signed solid angles of all faces over `4 pi` (Jacobson et
/// al. 2013): one inside a closed outward mesh, zero outside; with holes it changes smoothly between
/// the two, where parts overlap it adds up. Faces far away count together as dipoles (Barill et al.
/// 2018), which costs some hundredths at most; near faces are exact.
#[derive(Debug, Clone)]
pub struct Winding {
    /// For every node of the tree.
    dipoles: Vec<Dipole>,
}

#[derive(Debug, Clone, Copy)]
struct Dipole {
    /// The mean of the faces' centres by area.
    center: Vec3,
    /// The sum of the faces' area vectors.
    moment: Vec3,
    /// No corner is farther from the centre, squared.
    square_radius: f64,
}

/// Nodes count as one dipole at this many of their radii.
const FAR: f64 = 3.0;

impl Winding {
    /// Adds up the faces of every node.
    pub fn new(tree: &TriangleTree) -> Self {
        let dipoles = tree.nodes.iter().map(|node| {
            let triangles = &tree.triangles[node.begin as usize..node.end as usize];
            Dipole::of(triangles)
        });
        Self { dipoles: dipoles.collect() }
    }

    /// The winding number of a place. `tree` must be the one that `self` was made from.
    pub fn number(&self, tree: &TriangleTree, place: Vec3) -> f64 {
        let mut sum = 0.0;
        let mut index = 0;
        let mut stack = [0usize; 64];
        let mut height = 0;
        loop {
            let (node, dipole) = (&tree.nodes[index], &self.dipoles[index]);
            let offset = dipole.center - place;
            let square = offset.norm_squared();
            if square > FAR * FAR * dipole.square_radius {
                sum += offset.dot(&dipole.moment) / (square * square.sqrt());
            } else if node.upper == 0 {
                let triangles = &tree.triangles[node.begin as usize..node.end as usize];
                sum += triangles.iter().map(|it| solid_angle(it, &place)).sum::<f64>();
            } else {
                stack[height] = node.upper as usize;
                height += 1;
                index += 1;
                continue;
            }
            if height == 0 {
                return sum / (4.0 * PI);
            }
            height -= 1;
            index = stack[height];
        }
    }
}

impl Dipole {
    fn of(triangles: &[[Vec3; 3]]) -> Self {
        let (mut area, mut weighted, mut moment) = (0.0, Vec3::zeros(), Vec3::zeros());
        for [a, b, c] in triangles {
            let area_vector = (b - a).cross(&(c - a)) * 0.5;
            let own = area_vector.norm();
            area += own;
            moment += area_vector;
            weighted += (a + b + c) * (own / 3.0);
        }
        let center = if area > 0.0 { weighted / area } else { triangles[0][0] };
        let squares = triangles.iter().flatten().map(|it| (it - center).norm_squared());
        Self { center, moment, square_radius: squares.fold(0.0, f64::max) }
    }
}

/// The solid angle of a triangle as seen from a place (van Oosterom & Strackee 1983), positive where
/// the triangle shows its back.
fn solid_angle(triangle: &[Vec3; 3], place: &Vec3) -> f64 {
    let [a, b, c] = triangle.map(|it| it - place);
    let [la, lb, lc] = [a, b, c].map(|it| it.norm());
    let volume = a.dot(&b.cross(&c));
    let denominator = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
    2.0 * volume.atan2(denominator)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::mesh::TriMesh;
    use crate::kernels::geometry::shapes::{icosphere, moved, torus, union};
    use crate::kernels::numerics::random::Random;

    fn number(mesh: &TriMesh, place: Vec3) -> f64 {
        let tree = TriangleTree::new(mesh);
        Winding::new(&tree).number(&tree, place)
    }

    #[test]
    fn closed_surfaces_have_whole_numbers() {
        let mesh = torus(1.0, 0.4, 60, 40);
        let tree = TriangleTree::new(&mesh);
        let winding = Winding::new(&tree);
        let mut random = Random::new(2);
        let mut largest = 0.0f64;
        for _ in 0..2000 {
            let place = Vec3::from_fn(|_, _| random.between(-1.6, 1.6));
            let from_axis = (place.x.hypot(place.z) - 1.0).hypot(place.y);
            // The polyhedron lies up to a hundredth inside of the true torus.
            if (from_axis - 0.4).abs() < 0.01 {
                continue;
            }
            let expected = if from_axis < 0.4 { 1.0 } else { 0.0 };
            largest = largest.max((winding.number(&tree, place) - expected).abs());
        }
        assert!(largest < 0.05, "{largest}");
    }

    #[test]
    fn overlaps_count_twice_and_half_a_sphere_by_half() {
        let sphere = icosphere(3);
        let two = union(&sphere, &moved(&sphere, Vec3::x()));
        assert!((number(&two, Vec3::x() * 0.5) - 2.0).abs() < 0.05);
        assert!((number(&two, Vec3::x() * -0.5) - 1.0).abs() < 0.05);
        let upper = sphere.faces().iter().copied().filter(|face| {
            let middle: f64 = face.iter().map(|&it| sphere.vertices()[it as usize].y).sum();
            middle > 0.0
        });
        let half = TriMesh::new(sphere.vertices().to_vec(), upper.collect()).unwrap();
        assert!((number(&half, Vec3::zeros()) - 0.5).abs() < 0.05);
    }
}
