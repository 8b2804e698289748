//! Point clouds as things to draw: a bead for every point.

use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::geometry::point_tree::PointTree;

use super::colors::Color;
use super::raster::Soup;

/// A bead for every point, so large that beads of neighbours touch.
pub fn beads(cloud: &TriMesh, colors: &[Color]) -> Soup {
    let radius = bead_radius(cloud);
    let mut soup = Soup::default();
    for (&center, &color) in cloud.vertices().iter().zip(colors) {
        add_bead(&mut soup, center, radius, color);
    }
    soup
}

/// Neighbours whose distance tells how dense a cloud is.
const NEIGHBORS: usize = 6;
/// Points whose neighbours are looked at.
const PROBES: usize = 1000;

/// Half the usual distance of neighbours; a small share of the box for lone points.
pub fn bead_radius(cloud: &TriMesh) -> f64 {
    let points = cloud.vertices();
    let (low, high) = cloud.bounds();
    let most = 0.02 * (high - low).norm();
    let tree = PointTree::new(points);
    let mut found = Vec::new();
    let step = points.len().div_ceil(PROBES);
    let mut distances: Vec<f64> = points
        .iter()
        .step_by(step)
        .map(|&point| {
            tree.nearest(point, NEIGHBORS + 1, &mut found);
            found.iter().map(|it| it.0.sqrt()).sum::<f64>() / NEIGHBORS as f64
        })
        .collect();
    distances.sort_by(f64::total_cmp);
    (0.5 * distances[distances.len() / 2]).min(most)
}

/// An octahedron that is shaded as a ball.
fn add_bead(soup: &mut Soup, center: Vec3, radius: f64, color: Color) {
    let first = soup.points.len() as u32;
    for axis in 0..3 {
        for sign in [1.0, -1.0] {
            let normal = Vec3::ith(axis, sign);
            soup.push(center + normal * radius, normal, color);
        }
    }
    // Corners are +x, -x, +y, -y, +z, -z.
    for x in [0, 1] {
        for y in [2, 3] {
            soup.triangles.extend([4, 5].map(|z| [first + x, first + y, first + z]));
        }
    }
}
