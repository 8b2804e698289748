//! Where the nodes of a curve skeleton are over time.

use super::JointMotion;
use crate::kernels::curve_skeletons::curve_skeleton::{CurveSkeleton, NO_NODE};
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::rigs::weights::SkinWeights;
use nalgebra::{Isometry3, Point3};

/// Moves every node by the mean displacement of its vertices from `rest`, frame by frame.
///
/// A node without vertices takes those of the nearest nodes along edges that have some; where there are
/// none at all, nodes stay.
pub fn mean_places(skeleton: &CurveSkeleton, frames: &[&[Vec3]], rest: &[Vec3]) -> Vec<Vec<Vec3>> {
    let sets = vertex_sets(skeleton);
    let mean = |set: &[u32], frame: &[Vec3]| {
        let sum: Vec3 = set.iter().map(|&it| frame[it as usize] - rest[it as usize]).sum();
        sum / set.len().max(1) as f64
    };
    let place = |frame: &[Vec3]| {
        let nodes = skeleton.positions().iter().zip(&sets);
        nodes.map(|(at, set)| at + mean(set, frame)).collect()
    };
    frames.iter().map(|it| place(it)).collect()
}

/// As the option says: by the mean displacement of the skinned vertices (`AM`), or by the motions of bones
/// themselves, with the mean weights of the node's vertices.
pub fn node_places(
    skeleton: &CurveSkeleton,
    rest: &[Vec3],
    weights: &SkinWeights,
    motions: &[Isometry3<f64>],
    how: JointMotion,
) -> Vec<Vec<Vec3>> {
    let n_bones = weights.n_joints();
    let of_frames = motions.chunks_exact(n_bones);
    match how {
        JointMotion::Surface => {
            let skinned: Vec<Vec<Vec3>> = of_frames.map(|it| skin(rest, weights, it)).collect();
            let frames: Vec<&[Vec3]> = skinned.iter().map(Vec::as_slice).collect();
            mean_places(skeleton, &frames, rest)
        }
        JointMotion::Bones => {
            let rows: Vec<Vec<(u32, f64)>> =
                vertex_sets(skeleton).iter().map(|it| mean_row(weights, it)).collect();
            let place = |motions: &[Isometry3<f64>]| {
                let nodes = skeleton.positions().iter().zip(&rows);
                nodes.map(|(at, row)| blend(*at, row, motions)).collect()
            };
            of_frames.map(place).collect()
        }
    }
}

fn skin(rest: &[Vec3], weights: &SkinWeights, motions: &[Isometry3<f64>]) -> Vec<Vec3> {
    let place = |(vertex, at): (usize, &Vec3)| {
        let moved = |(bone, weight): (u32, f64)| {
            (motions[bone as usize] * Point3::from(*at)).coords * weight
        };
        weights.row(vertex).map(moved).sum()
    };
    rest.iter().enumerate().map(place).collect()
}

fn blend(at: Vec3, row: &[(u32, f64)], motions: &[Isometry3<f64>]) -> Vec3 {
    if row.is_empty() {
        return at;
    }
    row.iter()
        .map(|&(bone, weight)| (motions[bone as usize] * Point3::from(at)).coords * weight)
        .sum()
}

fn mean_row(weights: &SkinWeights, set: &[u32]) -> Vec<(u32, f64)> {
    let mut sums = vec![0.0; weights.n_joints()];
    for &vertex in set {
        weights.row(vertex as usize).for_each(|(bone, weight)| sums[bone as usize] += weight);
    }
    let total: f64 = sums.iter().sum();
    let row = (0_u32..).zip(sums).filter(|it| it.1 > 0.0);
    row.map(|(bone, weight)| (bone, weight / total)).collect()
}

/// The vertices of every node, or those of its nearest nodes along edges that have any.
fn vertex_sets(skeleton: &CurveSkeleton) -> Vec<Vec<u32>> {
    let own = skeleton.vertices_of_nodes();
    let neighbors = skeleton.neighbors();
    let widen = |node: usize| {
        let mut is_seen = vec![false; own.len()];
        is_seen[node] = true;
        let mut ring = vec![node as u32];
        loop {
            let set: Vec<u32> = ring.iter().flat_map(|&it| own[it as usize].clone()).collect();
            if !set.is_empty() || ring.is_empty() {
                return set;
            }
            let mut next = vec![];
            for &near in ring.iter().flat_map(|&it| &neighbors[it as usize]) {
                if !std::mem::replace(&mut is_seen[near as usize], true) {
                    next.push(near);
                }
            }
            ring = next;
        }
    };
    (0..own.len()).map(widen).collect()
}

/// Labels every vertex with a node that is no junction: those of junctions, or without a node, with the
/// label of the nearest other vertex.
pub fn full_labels(skeleton: &CurveSkeleton, vertices: &[Vec3]) -> Vec<u32> {
    let labels = skeleton.node_of_vertex();
    let degrees = skeleton.degrees();
    let is_free = |label: u32| label != NO_NODE && degrees[label as usize] <= 2;
    let is_any = labels.iter().any(|&it| is_free(it));
    let is_good = |label: u32| if is_any { is_free(label) } else { label != NO_NODE };
    let good: Vec<usize> = (0..labels.len()).filter(|&it| is_good(labels[it])).collect();
    let places: Vec<Vec3> = good.iter().map(|&it| vertices[it]).collect();
    let tree = crate::kernels::geometry::point_tree::PointTree::new(&places);
    let mut found = vec![];
    let mut label = |vertex: usize| {
        if is_good(labels[vertex]) {
            return labels[vertex];
        }
        tree.nearest(vertices[vertex], 1, &mut found);
        found.first().map_or(0, |it| labels[good[it.1 as usize]])
    };
    (0..labels.len()).map(&mut label).collect()
}
