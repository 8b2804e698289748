//! Which bone every vertex of a surface is unrolled around.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use rayon::prelude::*;

use super::bones::Bone;
use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::geometry::triangle_tree::TriangleTree;

/// The bones of vertices.
pub struct Assignment {
    pub bone_of_vertex: Vec<u32>,
    /// Vertices that see a bone.
    pub n_covered: usize,
}

/// How many of the nearest bones a vertex looks for.
const N_CANDIDATES: usize = 8;

/// How much of the way from a bone the surface must be free: the vertex's own faces end there.
const FREE: f64 = 1.0 - 1e-6;

/// Assigns every vertex to the nearest bone that it sees; one that sees none of the nearest eight to
/// that of the nearest vertex along edges that does.
///
/// At a joint, vertices that are nearest to the joint itself are shared out among its bones by the planes
/// that bisect them.
pub fn assign(mesh: &TriMesh, tree: &TriangleTree, bones: &[Bone]) -> Assignment {
    let seen: Vec<Option<u32>> =
        mesh.vertices().par_iter().map(|&it| seen_bone(it, tree, bones)).collect();
    let n_covered = seen.iter().flatten().count();
    let spread = spread(mesh, seen);
    let nearest = |(vertex, bone): (usize, Option<u32>)| {
        bone.unwrap_or_else(|| ranked(mesh.vertices()[vertex], bones)[0])
    };
    let bone_of_vertex = spread.into_iter().enumerate().map(nearest).collect();
    Assignment { bone_of_vertex, n_covered }
}

fn seen_bone(place: Vec3, tree: &TriangleTree, bones: &[Bone]) -> Option<u32> {
    let is_seen = |bone: &u32| {
        let from = bones[*bone as usize].closest(place);
        tree.first_hit(from, place - from, [0.0, FREE]).is_none()
    };
    ranked(place, bones).into_iter().take(N_CANDIDATES).find(is_seen)
}

/// All bones, nearest first; of those whose common joint is nearest, the one that leads from there
/// towards the place.
fn ranked(place: Vec3, bones: &[Bone]) -> Vec<u32> {
    let rank = |bone: &Bone| {
        let nearest = bone.closest(place);
        let away = place - nearest;
        let towards = if nearest == bone.to { -bone.direction } else { bone.direction };
        (away.norm_squared(), -away.dot(&towards))
    };
    let ranks: Vec<(f64, f64)> = bones.iter().map(rank).collect();
    let mut order: Vec<u32> = (0..bones.len() as u32).collect();
    order.sort_by(|&a, &b| {
        let (x, y) = (ranks[a as usize], ranks[b as usize]);
        x.0.total_cmp(&y.0).then(x.1.total_cmp(&y.1)).then(a.cmp(&b))
    });
    order
}

/// Non-negative numbers in order.
#[derive(PartialEq)]
struct Distance(f64);

impl Eq for Distance {}

impl PartialOrd for Distance {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Distance {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

/// Labels of the nearest labelled vertices along edges (Dijkstra); `None` in parts without any.
fn spread(mesh: &TriMesh, mut labels: Vec<Option<u32>>) -> Vec<Option<u32>> {
    let mut neighbours: Vec<Vec<u32>> = vec![Vec::new(); mesh.n_vertices()];
    for face in mesh.faces() {
        for it in 0..3 {
            let (a, b) = (face[it], face[(it + 1) % 3]);
            neighbours[a as usize].push(b);
            neighbours[b as usize].push(a);
        }
    }
    let known = (0..labels.len() as u32).filter_map(|it| Some((it, labels[it as usize]?)));
    let mut heap: BinaryHeap<Reverse<(Distance, u32, u32)>> =
        known.map(|(vertex, label)| Reverse((Distance(0.0), vertex, label))).collect();
    let mut done = vec![false; labels.len()];
    while let Some(Reverse((Distance(distance), vertex, label))) = heap.pop() {
        if std::mem::replace(&mut done[vertex as usize], true) {
            continue;
        }
        labels[vertex as usize] = Some(label);
        for &next in neighbours[vertex as usize].iter().filter(|&&it| !done[it as usize]) {
            let edge = mesh.vertices()[next as usize] - mesh.vertices()[vertex as usize];
            heap.push(Reverse((Distance(distance + edge.norm()), next, label)));
        }
    }
    labels
}
