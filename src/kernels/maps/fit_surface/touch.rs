//! Where a surface and its target touch.

use faer::Mat;

use super::pulls::{Pull, Samples, trust};
use crate::kernels::geometry::cloud_sheets::CloudSheets;
use crate::kernels::geometry::cloud_sides::sided_normals;
use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::geometry::point_tree::PointTree;
use crate::kernels::maps::nearest::nearest_rows;

/// How far apart two places count that have opposite normals, in roots of the area: half of this is
/// about the radius of a leg.
const NORMAL_LENGTH: f64 = 0.13;

/// Points of a cloud that share a plane.
const N_NEIGHBORS: usize = 16;

/// A target with normals, for finding which of its vertices belong to which of the surface's.
pub struct Touch<'a> {
    target: &'a TriMesh,
    /// Of a point cloud.
    sheets: Option<CloudSheets>,
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
    pub fn new(laid: &TriMesh, target: &'a TriMesh, samples: usize, n_nodes: usize) -> Self {
        let points = target.vertices();
        let sheets = target.is_point_cloud().then(|| CloudSheets::new(points, N_NEIGHBORS));
        let normals = match &sheets {
            Some(sheets) => sheets.normals().to_vec(),
            None => target.vertex_normals(),
        };
        let root = laid.area().sqrt();
        let normal_length = 0.5 * NORMAL_LENGTH * root;
        let samples = Samples::of(target, samples, n_nodes);
        let spacing = root / (n_nodes as f64).sqrt();
        let rows = Mat::zeros(0, 6);
        let mut res = Self { target, sheets, normals, samples, normal_length, spacing, rows };
        res.turn_sides(laid);
        res
    }

    /// Turns the target's normals to the side on which the surface has its own, where it lies now.
    ///
    /// A mesh is turned as a whole. Normals of a cloud have no side: a limb that the matches laid askew, or
    /// between two others, gets its sides better when it lies better.
    pub fn turn_sides(&mut self, laid: &TriMesh) {
        let points = self.target.vertices();
        let votes = votes(laid, points, &self.normals);
        match &self.sheets {
            Some(sheets) => {
                // Votes are for normals as they are, sides for those of the sheets.
                let own = sheets.normals().iter().zip(&self.normals);
                let votes = own.zip(votes).map(|((sheet, own), it)| it * sheet.dot(own));
                let votes: Vec<f64> = votes.collect();
                self.normals = sided_normals(points, sheets, N_NEIGHBORS, &votes);
            }
            None if votes.iter().sum::<f64>() < 0.0 => {
                self.normals.iter_mut().for_each(|it| *it = -*it);
            }
            None => {}
        }
        self.rows = rows(points.iter().zip(&self.normals), self.normal_length);
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

/// For every target vertex how much speaks for its own normal: those of the surface at the nearest places of
/// either.
fn votes(laid: &TriMesh, points: &[Vec3], normals: &[Vec3]) -> Vec<f64> {
    let own = laid.vertex_normals();
    let mut found = Vec::new();
    let tree = PointTree::new(laid.vertices());
    let mut vote = |(place, normal): (&Vec3, &Vec3)| {
        tree.nearest(*place, 1, &mut found);
        own[found[0].1 as usize].dot(normal)
    };
    let mut votes: Vec<f64> = points.iter().zip(normals).map(&mut vote).collect();
    let tree = PointTree::new(points);
    for (place, normal) in laid.vertices().iter().zip(&own) {
        tree.nearest(*place, 1, &mut found);
        let at = found[0].1 as usize;
        votes[at] += normal.dot(&normals[at]);
    }
    votes
}
