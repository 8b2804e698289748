//! A skinned body in groups of faces, one for every joint.

use std::collections::BTreeSet;

use nalgebra::{Matrix3, Matrix3x4, UnitQuaternion};
use rayon::prelude::*;

use super::group_tree::{Bounds, GroupTree, are_crossing, n_crossings};
use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::rigs::skeleton::Skeleton;
use crate::kernels::rigs::weights::SkinWeights;

/// The groups of a body and which of them should not meet.
pub struct Body<'a> {
    pub skeleton: &'a Skeleton,
    weights: &'a SkinWeights,
    rest: &'a [Vec3],
    /// By joint: the faces that it moves most.
    groups: Vec<Group>,
    /// Groups that are no neighbours and do not cross at rest, ascending.
    pub pairs: Vec<[usize; 2]>,
    /// How many pairs are left out because they cross at rest.
    pub n_crossing_at_rest: usize,
}

struct Group {
    /// Of the mesh.
    vertices: Vec<u32>,
    /// Joints that move any of them, ascending.
    joints: Vec<u32>,
    tree: GroupTree,
}

/// Where a group is in some pose.
#[derive(Clone, Default)]
pub struct GroupPose {
    points: Vec<Vec3>,
    bounds: Vec<Bounds>,
}

impl<'a> Body<'a> {
    pub fn new(mesh: &'a TriMesh, skeleton: &'a Skeleton, weights: &'a SkinWeights) -> Self {
        let heaviest: Vec<u32> = (0..mesh.n_vertices()).map(|it| heaviest(weights, it)).collect();
        let mut faces: Vec<Vec<[u32; 3]>> = vec![Vec::new(); skeleton.n_joints()];
        let mut touching = BTreeSet::new();
        for face in mesh.faces() {
            let mut joints = face.map(|it| heaviest[it as usize]);
            joints.sort_unstable();
            // The joint of most corners is in the middle.
            faces[joints[1] as usize].push(*face);
            for (a, b) in [(0, 1), (1, 2), (0, 2)] {
                touching.insert([joints[a] as usize, joints[b] as usize]);
            }
        }
        let groups = faces.iter().map(|it| Group::new(it, mesh.vertices(), weights)).collect();
        let pairs = Vec::new();
        let rest = mesh.vertices();
        let mut body = Self { skeleton, weights, rest, groups, pairs, n_crossing_at_rest: 0 };
        let (free, crossing) = body.candidate_pairs(&touching);
        body.pairs = free;
        body.n_crossing_at_rest = crossing;
        body
    }

    /// Pairs of groups that are no neighbours and are apart at rest, and how many others cross there.
    fn candidate_pairs(&self, touching: &BTreeSet<[usize; 2]>) -> (Vec<[usize; 2]>, usize) {
        let nodes = merged_joints(self.skeleton);
        let neighbours = node_neighbours(self.skeleton, &nodes);
        let is_branch = |node: &usize| neighbours[*node].len() > 2;
        let poses = self.pose(&vec![UnitQuaternion::identity(); nodes.len()], &self.offsets());
        let (mut free, mut n_crossing) = (Vec::new(), 0);
        for a in 0..nodes.len() {
            for b in a + 1..nodes.len() {
                let (p, q) = (nodes[a], nodes[b]);
                let are_near = p == q || neighbours[p].contains(&q);
                let share_branch = neighbours[p].intersection(&neighbours[q]).any(is_branch);
                let is_empty =
                    self.groups[a].vertices.is_empty() || self.groups[b].vertices.is_empty();
                if are_near || share_branch || is_empty || touching.contains(&[a, b]) {
                    continue;
                }
                if self.crosses([a, b], &poses) {
                    n_crossing += 1;
                } else {
                    free.push([a, b]);
                }
            }
        }
        (free, n_crossing)
    }

    /// Offsets from the parents, at rest.
    pub fn offsets(&self) -> Vec<Vec3> {
        let places = self.skeleton.positions();
        let parents = self.skeleton.parents().iter().zip(places);
        parents.map(|(parent, at)| at - parent.map_or(Vec3::zeros(), |it| places[it])).collect()
    }

    /// All groups, posed by the joints' rotations and offsets from their parents.
    pub fn pose(&self, rotations: &[UnitQuaternion<f64>], offsets: &[Vec3]) -> Vec<GroupPose> {
        let transforms = self.world_from_rest(rotations, offsets);
        let mut poses = vec![GroupPose::default(); self.groups.len()];
        let groups = poses.par_iter_mut().enumerate();
        groups.for_each(|(joint, pose)| self.pose_group(joint, &transforms, pose));
        poses
    }

    /// One group in a pose.
    pub fn pose_group(&self, joint: usize, transforms: &[Matrix3x4<f64>], pose: &mut GroupPose) {
        let group = &self.groups[joint];
        pose.points.clear();
        pose.points.extend(group.vertices.iter().map(|&vertex| {
            let blended: Matrix3x4<f64> = (self.weights.row(vertex as usize))
                .map(|(joint, weight)| transforms[joint as usize] * weight)
                .sum();
            blended * self.rest[vertex as usize].push(1.0)
        }));
        group.tree.refit(&pose.points, &mut pose.bounds);
    }

    /// Whether any of a group moves when some joints turn.
    pub fn follows(&self, joint: usize, turned: &[usize]) -> bool {
        let parents = self.skeleton.parents();
        let is_below = |&it: &u32| {
            std::iter::successors(Some(it as usize), |&it| parents[it])
                .any(|it| turned.contains(&it))
        };
        self.groups[joint].joints.iter().any(is_below)
    }

    /// The motions of all joints from rest.
    pub fn world_from_rest(
        &self,
        rotations: &[UnitQuaternion<f64>],
        offsets: &[Vec3],
    ) -> Vec<Matrix3x4<f64>> {
        let mut turns: Vec<Matrix3<f64>> = Vec::with_capacity(rotations.len());
        let mut places: Vec<Vec3> = Vec::with_capacity(rotations.len());
        for (joint, parent) in self.skeleton.parents().iter().enumerate() {
            let own = rotations[joint].to_rotation_matrix().into_inner();
            let (turn, place) = match *parent {
                Some(it) => (turns[it] * own, places[it] + turns[it] * offsets[joint]),
                None => (own, offsets[joint]),
            };
            turns.push(turn);
            places.push(place);
        }
        let rest = self.skeleton.positions();
        let of = |joint: usize| {
            let moved = places[joint] - turns[joint] * rest[joint];
            let [x, y, z] = [0, 1, 2].map(|it| turns[joint].column(it).into_owned());
            Matrix3x4::from_columns(&[x, y, z, moved])
        };
        (0..rotations.len()).map(of).collect()
    }

    /// Whether the faces of two groups cross.
    pub fn crosses(&self, [a, b]: [usize; 2], poses: &[GroupPose]) -> bool {
        are_crossing(self.side(a, &poses[a]), self.side(b, &poses[b]))
    }

    /// The same for poses of these two alone.
    pub fn pair_crosses(&self, [a, b]: [usize; 2], poses: &[GroupPose; 2]) -> bool {
        are_crossing(self.side(a, &poses[0]), self.side(b, &poses[1]))
    }

    /// Pairs that cross, and how many of their faces do.
    pub fn crossings(&self, poses: &[GroupPose]) -> Vec<(usize, usize)> {
        let count = |(index, &[a, b]): (usize, &[usize; 2])| {
            let count = n_crossings(self.side(a, &poses[a]), self.side(b, &poses[b]));
            (count > 0).then_some((index, count))
        };
        self.pairs.par_iter().enumerate().filter_map(count).collect()
    }

    fn side<'b>(
        &'b self,
        joint: usize,
        pose: &'b GroupPose,
    ) -> (&'b GroupTree, &'b [Vec3], &'b [Bounds]) {
        (&self.groups[joint].tree, &pose.points, &pose.bounds)
    }
}

impl Group {
    fn new(faces: &[[u32; 3]], places: &[Vec3], weights: &SkinWeights) -> Self {
        let mut vertices: Vec<u32> = faces.iter().flatten().copied().collect();
        vertices.sort_unstable();
        vertices.dedup();
        let local = |it: u32| vertices.binary_search(&it).expect("all are listed") as u32;
        let faces: Vec<[u32; 3]> = faces.iter().map(|it| it.map(local)).collect();
        let points: Vec<Vec3> = vertices.iter().map(|&it| places[it as usize]).collect();
        let joints: BTreeSet<u32> =
            vertices.iter().flat_map(|&it| weights.row(it as usize).map(|it| it.0)).collect();
        let joints = joints.into_iter().collect();
        Self { tree: GroupTree::new(faces, &points), vertices, joints }
    }
}

/// How far points of a group are apart in two poses, at most.
pub fn largest_move(a: &GroupPose, b: &GroupPose) -> f64 {
    let squares = a.points.iter().zip(&b.points).map(|(a, b)| (a - b).norm_squared());
    squares.fold(0.0, f64::max).sqrt()
}

/// The joint that moves a vertex most; of equal ones the first.
fn heaviest(weights: &SkinWeights, vertex: usize) -> u32 {
    let mut best = (0, f64::NEG_INFINITY);
    for (joint, weight) in weights.row(vertex) {
        if weight > best.1 {
            best = (joint, weight);
        }
    }
    best.0
}

/// Joints at the same place are one node, named by the first of them.
fn merged_joints(skeleton: &Skeleton) -> Vec<usize> {
    let places = skeleton.positions();
    let mut nodes: Vec<usize> = Vec::with_capacity(places.len());
    for (joint, parent) in skeleton.parents().iter().enumerate() {
        let same = parent.filter(|&it| places[it] == places[joint]);
        nodes.push(same.map_or(joint, |it| nodes[it]));
    }
    nodes
}

fn node_neighbours(skeleton: &Skeleton, nodes: &[usize]) -> Vec<BTreeSet<usize>> {
    let mut res = vec![BTreeSet::new(); nodes.len()];
    for (parent, child) in skeleton.bones() {
        let (a, b) = (nodes[parent], nodes[child]);
        if a != b {
            res[a].insert(b);
            res[b].insert(a);
        }
    }
    res
}
