//! Pairs of surface vertices and target points.

use rayon::prelude::*;

use super::target::{Pixel, Target};
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::geometry::point_tree::PointTree;
use crate::kernels::sensors::depth::raster::ZBuffer;

/// A vertex and the point on the target that it should reach.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pair {
    /// Which sample it is.
    pub sample: u32,
    pub point: Vec3,
    pub normal: Vec3,
    /// A factor on its weight.
    pub weight: f64,
}

/// When a pair is refused.
#[derive(Debug, Clone, Copy)]
pub struct Limits {
    pub distance: f64,
    pub cosine: f64,
    /// How far behind the nearest surface a vertex counts as hidden.
    pub occlusion: f64,
}

/// The moved surface as the camera sees it.
pub struct Seen {
    pub buffer: ZBuffer,
    pub normals: Vec<Vec3>,
}

impl Seen {
    pub fn new(target: &Target, vertices: &[Vec3], faces: &[[u32; 3]]) -> Self {
        let size = [target.width, target.height];
        let buffer = ZBuffer::draw(size, &target.camera, vertices, faces);
        Self { buffer, normals: vertex_normals(vertices, faces) }
    }

    /// Whether a vertex faces the camera and nothing is before it.
    pub fn sees(&self, target: &Target, vertex: usize, place: &Vec3, occlusion: f64) -> bool {
        if self.normals[vertex].dot(place) > -0.1 * place.norm() {
            return false;
        }
        target.pixel_of(place).is_some_and(|pixel| {
            let depth = f64::from(self.buffer.depths[pixel]);
            depth == 0.0 || place.z <= depth + occlusion
        })
    }
}

pub fn vertex_normals(vertices: &[Vec3], faces: &[[u32; 3]]) -> Vec<Vec3> {
    let mut normals = vec![Vec3::zeros(); vertices.len()];
    for face in faces {
        let [a, b, c] = face.map(|it| vertices[it as usize]);
        let area_vector = (b - a).cross(&(c - a));
        face.iter().for_each(|it| normals[*it as usize] += area_vector);
    }
    normals.iter_mut().for_each(|it| *it = it.try_normalize(0.0).unwrap_or_default());
    normals
}

/// Samples that face the camera unhidden: their numbers, their vertices, and where these are.
pub fn visible(
    target: &Target,
    seen: &Seen,
    places: &[(u32, Vec3)],
    limits: &Limits,
) -> Vec<(u32, u32, Vec3)> {
    (0_u32..)
        .zip(places)
        .filter(|(_, (vertex, place))| seen.sees(target, *vertex as usize, place, limits.occlusion))
        .map(|(sample, (vertex, place))| (sample, *vertex, *place))
        .collect()
}

/// Finds for every visible sample its place on the target: first around its projection, then, if that
/// is too far, anywhere. Pairs at steps in depth, too far, or with normals that differ are refused.
pub fn source_to_target(
    target: &Target,
    seen: &Seen,
    visible: &[(u32, u32, Vec3)],
    limits: &Limits,
) -> Vec<Pair> {
    let find = |&(sample, vertex, place): &(u32, u32, Vec3)| -> Option<Pair> {
        let vertex = vertex as usize;
        let near = target.nearest_in_window(&place).filter(|it| it.0 <= limits.distance);
        let found = near.or_else(|| target.nearest(&place, &mut Vec::new()));
        let (distance, pixel) = found?;
        let normal = target.normals[pixel];
        let is_good = distance <= limits.distance
            && target.pixels[pixel] == Pixel::Surface
            && normal.dot(&seen.normals[vertex]) >= limits.cosine;
        let point = target.points[pixel];
        is_good.then_some(Pair { sample, point, normal, weight: 1.0 })
    };
    let found: Vec<Option<Pair>> = visible.par_iter().with_min_len(256).map(find).collect();
    found.into_iter().flatten().collect()
}

/// Finds for target points that the moved surface leaves bare the nearest visible sample.
///
/// At most `most` evenly chosen target pixels are looked at. Also returns the share of them that is
/// covered.
pub fn target_to_source(
    target: &Target,
    seen: &Seen,
    visible: &[(u32, u32, Vec3)],
    limits: &Limits,
    weight: f64,
    most: usize,
) -> (Vec<Pair>, f64) {
    let tree = PointTree::new(&visible.iter().map(|it| it.2).collect::<Vec<_>>());
    let step = target.measured.len().div_ceil(most.max(1)).max(1);
    let looked: Vec<u32> = target.measured.iter().copied().step_by(step).collect();
    let find = |pixel: &u32| -> Option<Option<Pair>> {
        let pixel = *pixel as usize;
        let (point, normal) = (target.points[pixel], target.normals[pixel]);
        let depth = f64::from(seen.buffer.depths[pixel]);
        if depth > 0.0 && (depth - point.z).abs() <= limits.occlusion * 2.0 {
            return None;
        }
        if target.pixels[pixel] != Pixel::Surface {
            return Some(None);
        }
        let mut found = Vec::new();
        tree.nearest(point, 1, &mut found);
        let Some(&(square, index)) = found.first() else { return Some(None) };
        let (sample, vertex, _) = visible[index as usize];
        let is_good = square.sqrt() <= limits.distance
            && normal.dot(&seen.normals[vertex as usize]) >= limits.cosine;
        Some(is_good.then_some(Pair { sample, point, normal, weight }))
    };
    let found: Vec<Option<Option<Pair>>> = looked.par_iter().with_min_len(256).map(find).collect();
    let n_bare = found.iter().filter(|it| it.is_some()).count();
    let coverage = 1.0 - n_bare as f64 / looked.len().max(1) as f64;
    (found.into_iter().flatten().flatten().collect(), coverage)
}
