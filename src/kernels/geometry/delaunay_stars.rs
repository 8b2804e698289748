//! Triangles around every point of a cloud.

use nalgebra::Matrix3;
use rayon::prelude::*;

use super::cloud_sheets::CloudSheets;
use super::mesh::Vec3;
use super::point_tree::PointTree;
use super::star::{Spoke, delaunay_star};

/// Of what the triangles around a point are made.
#[derive(Debug, Clone, Copy)]
pub struct StarOptions<'a> {
    /// The nearest points that are taken.
    pub n_neighbors: usize,
    /// Points of another sheet of the surface are passed over, and planes are those of the sheets.
    /// Without, the plane is fitted to the neighbours.
    pub sheets: Option<&'a CloudSheets>,
}

/// Points that one task works on. Fixed, so that results do not depend on threads.
const TOGETHER: usize = 256;

/// Finds the triangles around every point: of the Delaunay triangulation of its nearest neighbours,
/// projected to the plane that fits them best, those that have the point as a corner.
///
/// The point comes first in its triangles, which are in the order of a ring around it; rings of points
/// that lie near each other follow one another. No two points may be at the same place.
pub fn delaunay_stars(points: &[Vec3], options: &StarOptions<'_>) -> Vec<[u32; 3]> {
    let tree = PointTree::new(points);
    let blocks: Vec<Vec<[u32; 3]>> = tree
        .order()
        .par_chunks(TOGETHER)
        .map(|centers| {
            let mut surroundings = Surroundings::default();
            let mut triangles = Vec::with_capacity(7 * centers.len());
            for &center in centers {
                surroundings.find(points, &tree, center, options);
                surroundings.add_star(points, center, options, &mut triangles);
            }
            triangles
        })
        .collect();
    blocks.concat()
}

/// Room for the work on one point, used again for the next.
#[derive(Default)]
struct Surroundings {
    found: Vec<(f64, u32)>,
    spokes: Vec<Spoke>,
    ring: Vec<Spoke>,
}

/// A neighbour this near in the projection, in parts of the farthest, is moved away from the center.
const PUSH_OUT: f64 = 1e-7;

impl Surroundings {
    /// Finds the point itself and its neighbours.
    fn find(&mut self, points: &[Vec3], tree: &PointTree, center: u32, options: &StarOptions<'_>) {
        let place = points[center as usize];
        // The point itself is the nearest: no two are at the same place.
        let n_wanted = options.n_neighbors + 1;
        match options.sheets {
            None => tree.nearest(place, n_wanted, &mut self.found),
            Some(sheets) => {
                tree.nearest(place, 2 * n_wanted, &mut self.found);
                self.found.retain(|it| it.1 == center || sheets.are_one(points, center, it.1));
                self.found.truncate(n_wanted);
            }
        }
    }

    /// Appends the triangles around a point.
    fn add_star(
        &mut self,
        points: &[Vec3],
        center: u32,
        options: &StarOptions<'_>,
        triangles: &mut Vec<[u32; 3]>,
    ) {
        let place = points[center as usize];
        let neighbors = &self.found[1..];
        let radius = neighbors.last().map_or(0.0, |it| it.0.sqrt());
        let [u, v] = match options.sheets {
            None => tangents(neighbors.iter().map(|it| (points[it.1 as usize] - place) / radius)),
            Some(sheets) => across(&sheets.normals()[center as usize]),
        };
        self.spokes.clear();
        self.spokes.extend(neighbors.iter().map(|&(_, index)| {
            let arm = (points[index as usize] - place) / radius;
            let mut at = [arm.dot(&u), arm.dot(&v)];
            let length = at[0].hypot(at[1]);
            if length < PUSH_OUT {
                at = if length > 0.0 {
                    at.map(|it| it / length * PUSH_OUT)
                } else {
                    [PUSH_OUT, 0.0]
                };
            }
            Spoke::new(index, at, tie_breaker(points[index as usize]))
        }));
        let closed = delaunay_star(&mut self.spokes, tie_breaker(place), &mut self.ring);
        let n_triangles = if closed { self.ring.len() } else { self.ring.len().saturating_sub(1) };
        triangles.extend((0..n_triangles).map(|it| {
            let next = self.ring[(it + 1) % self.ring.len()];
            [center, self.ring[it].index, next.index]
        }));
    }
}

/// Two directions at right angles that span the plane nearest to arms.
fn tangents(arms: impl Iterator<Item = Vec3>) -> [Vec3; 2] {
    let covariance = arms.fold(Matrix3::zeros(), |sum, arm| sum + arm * arm.transpose());
    let eigen = covariance.symmetric_eigen();
    let least = eigen.eigenvalues.imin();
    let column = |it: usize| eigen.eigenvectors.column((least + it) % 3).into_owned();
    [column(1), column(2)]
}

/// Two directions at right angles to a normal and to each other.
fn across(normal: &Vec3) -> [Vec3; 2] {
    let first = normal.cross(&Vec3::ith(normal.iamin(), 1.0)).normalize();
    [first, normal.cross(&first)]
}

/// A number in `[0, 1)` that belongs to a place.
///
/// Four points on a circle have two Delaunay triangulations. Stars of different points must choose the
/// same, or the square between them is covered too often or not often enough; and the choice must not
/// depend on the order of the points.
fn tie_breaker(place: Vec3) -> f64 {
    let hash = place.iter().fold(0_u64, |hash, it| {
        let mixed = (hash ^ (it + 0.0).to_bits()).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        mixed ^ (mixed >> 29)
    });
    (hash.wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 11) as f64 / (1_u64 << 53) as f64
}
