//! Points of the surface at rest, and the bones they belong to.

use rayon::prelude::*;

use super::parts::{Parts, on_bone};
use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::geometry::triangle_tree::TriangleTree;
use crate::kernels::rigs::skeleton::Skeleton;

/// A point of the surface at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    pub point: Vec3,
    pub normal: Vec3,
    /// The share of the surface that it stands for.
    pub area: f64,
    /// The bone that it belongs to, and the nearest place on it.
    pub bone: usize,
    pub share: f64,
}

/// Takes about `n_samples` vertices of a surface, and gives each the nearest bone that it sees through
/// the inside.
pub fn samples(
    mesh: &TriMesh,
    tree: &TriangleTree,
    skeleton: &Skeleton,
    n_samples: usize,
) -> Vec<Sample> {
    let (normals, areas) = (mesh.vertex_normals(), mesh.vertex_areas());
    let stride = mesh.n_vertices().div_ceil(n_samples.max(1)).max(1);
    let chosen: Vec<usize> =
        (0..mesh.n_vertices()).step_by(stride).filter(|&it| areas[it] > 0.0).collect();
    let total: f64 = chosen.iter().map(|&it| areas[it]).sum();
    let one = |&vertex: &usize| {
        let (point, normal) = (mesh.vertices()[vertex], normals[vertex]);
        let (bone, share) = nearest_bone(skeleton, tree, point, normal)?;
        Some(Sample { point, normal, area: areas[vertex] / total, bone, share })
    };
    chosen.par_iter().filter_map(one).collect()
}

/// The nearest bone that is seen, or the nearest one if none of the first few is.
fn nearest_bone(
    skeleton: &Skeleton,
    tree: &TriangleTree,
    point: Vec3,
    normal: Vec3,
) -> Option<(usize, f64)> {
    const TRIED: usize = 24;
    let positions = skeleton.positions();
    let mut bones: Vec<(f64, usize, f64)> = Vec::with_capacity(skeleton.n_joints());
    for (parent, bone) in skeleton.bones() {
        let (start, along) = (positions[parent], positions[bone] - positions[parent]);
        let square = along.norm_squared();
        let share =
            if square > 0.0 { ((point - start).dot(&along) / square).clamp(0.0, 1.0) } else { 0.0 };
        bones.push(((start + along * share - point).norm(), bone, share));
    }
    bones.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let nearest = *bones.first()?;
    let is_seen = |&&(distance, bone, share): &&(f64, usize, f64)| {
        let place = on_bone(skeleton, positions, bone, share);
        let is_behind = (place - point).dot(&normal) < 0.0;
        let start = point - normal * (1e-3 * distance);
        is_behind && !tree.is_crossed(start, start + (place - start) * 0.98)
    };
    let found = bones.iter().take(TRIED).find(is_seen).copied().unwrap_or(nearest);
    Some((found.1, found.2))
}

/// The part of every sample and how much it counts: little near joints, where skin bends.
pub fn labels(
    samples: &[Sample],
    skeleton: &Skeleton,
    parts: &Parts,
    cuts: &[Vec3],
    ramp: f64,
) -> Vec<(usize, f64)> {
    /// What a point right at a joint counts.
    const LEAST: f64 = 0.02;
    let label = |sample: &Sample| {
        let is_own =
            |it: &&super::parts::Piece| it.bone == sample.bone && sample.share <= it.shares[1];
        let part = parts.pieces.iter().find(is_own).map_or(0, |it| it.part);
        let place = on_bone(skeleton, skeleton.positions(), sample.bone, sample.share);
        let near = parts.sides.iter().zip(cuts).filter(|it| it.0.contains(&part));
        let distance = near.map(|it| (it.1 - place).norm()).fold(f64::INFINITY, f64::min);
        let weight = if ramp > 0.0 { (distance / ramp).clamp(LEAST, 1.0) } else { 1.0 };
        (part, weight * sample.area)
    };
    samples.iter().map(label).collect()
}
