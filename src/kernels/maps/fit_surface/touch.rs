//! Where a surface and its target touch.

use faer::Mat;

use super::pulls::{Pull, Samples, trust};
use crate::kernels::geometry::cloud_sheets::CloudSheets;
use crate::kernels::geometry::cloud_sides::sided_normals;
use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::maps::functional_map::PointMap;
use crate::kernels::maps::nearest::nearest_rows;

/// How far apart two places count that have opposite normals, in roots of the area: half of this is
/// about the radius of a leg.
const NORMAL_LENGTH: f64 = 0.13;

/// Points of a cloud that share a plane.
const N_NEIGHBORS: usize = 16;

/// A target with normals, for finding which of its vertices belong to which of the surface's.
pub struct Touch<'a> {
    target: &'a TriMesh,
    normals: Vec<Vec3>,
    samples: Samples,
    /// The length that stands for a unit of normals.
    normal_length: f64,
    /// The distance between nodes, once laid onto the target.
    spacing: f64,
    rows: Mat<f64>,
}

impl<'a> Touch<'a> {
    /// Prepares a target onto which a surface has been laid roughly, by matches.
    pub fn new(
        roughly: &TriMesh,
        target: &'a TriMesh,
        matches: &PointMap,
        samples: usize,
        n_nodes: usize,
    ) -> Self {
        let normals = oriented_normals(roughly, target, matches);
        let root = roughly.area().sqrt();
        let normal_length = 0.5 * NORMAL_LENGTH * root;
        let rows = rows(target.vertices().iter().zip(&normals), normal_length);
        let samples = Samples::of(target, samples, n_nodes);
        let spacing = root / (n_nodes as f64).sqrt();
        Self { target, normals, samples, normal_length, spacing, rows }
    }

    /// Draws samples of the surface to the target's nearest vertices, and the surface's nearest vertices
    /// to samples of the target. `reach` is in spacings of nodes.
    pub fn pulls(
        &self,
        samples: &Samples,
        vertices: &[Vec3],
        normals: &[Vec3],
        reach: f64,
        hold: f64,
    ) -> Vec<Pull> {
        let reach = reach * self.spacing;
        let there = |it: u32| (self.target.vertices()[it as usize], self.normals[it as usize]);
        let here = |it: u32| (vertices[it as usize], normals[it as usize]);
        let pull = |vertex: u32, other: u32, weight: f64| {
            let ((place, normal), (from, own)) = (there(other), here(vertex));
            let weight =
                weight * normal.dot(&own).clamp(0.0, 1.0) * trust((place - from).norm(), reach);
            Pull { vertex, place, normal, weight, hold }
        };
        let length = self.normal_length;
        let own =
            samples.vertices.iter().map(|&it| (&vertices[it as usize], &normals[it as usize]));
        let found = nearest_rows(rows(own, length).as_ref(), self.rows.as_ref());
        let mut res: Vec<Pull> =
            samples.iter().zip(&found).map(|((it, w), other)| pull(it, *other, w)).collect();
        let theirs = self.samples.vertices.iter().map(|&it| it as usize);
        let theirs = theirs.map(|it| (&self.target.vertices()[it], &self.normals[it]));
        let all = rows(vertices.iter().zip(normals), length);
        let found = nearest_rows(rows(theirs, length).as_ref(), all.as_ref());
        res.extend(self.samples.iter().zip(&found).map(|((it, w), vertex)| pull(*vertex, it, w)));
        res.retain(|it| it.weight > 0.0);
        res
    }
}

/// Places and normals side by side: near rows are near each other and look the same way.
fn rows<'a>(
    of: impl ExactSizeIterator<Item = (&'a Vec3, &'a Vec3)>,
    normal_length: f64,
) -> Mat<f64> {
    let mut res = Mat::zeros(of.len(), 6);
    for (row, (place, normal)) in of.enumerate() {
        for axis in 0..3 {
            res[(row, axis)] = place[axis];
            res[(row, axis + 3)] = normal_length * normal[axis];
        }
    }
    res
}

/// The target's normals, on the side on which the surface has its own, as matched vertices say.
///
/// What hangs together is turned as a whole, in a cloud as in a mesh: matches take the front of a limb for
/// its back now and then.
fn oriented_normals(roughly: &TriMesh, target: &TriMesh, matches: &PointMap) -> Vec<Vec3> {
    let sheets = target.is_point_cloud().then(|| CloudSheets::new(target.vertices(), N_NEIGHBORS));
    let normals = match &sheets {
        Some(sheets) => sheets.normals().to_vec(),
        None => target.vertex_normals(),
    };
    let mut votes = vec![0.0; normals.len()];
    let own = roughly.vertex_normals().into_iter().zip(roughly.vertex_areas());
    for ((normal, area), &at) in own.zip(&matches.target_of_source) {
        votes[at as usize] += area * normal.dot(&normals[at as usize]);
    }
    match sheets {
        Some(sheets) => sided_normals(target.vertices(), &sheets, N_NEIGHBORS, &votes),
        None => {
            let side = if votes.iter().sum::<f64>() < 0.0 { -1.0 } else { 1.0 };
            normals.into_iter().map(|it| it * side).collect()
        }
    }
}
