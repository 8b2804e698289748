//! From a curve skeleton in a tracked surface to one whose joints are where the surface bends.

mod connect;
mod moments;
mod paths;
mod split;
#[cfg(test)]
mod tests;
mod tree;

use nalgebra::{Isometry3, UnitQuaternion};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::curve_skeleton::CurveSkeleton;
use super::skeleton_cleanup::{PruneOptions, prune};
use crate::kernels::geometry::kabsch::shortest_arc;
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::rigs::clip::Clip;
use crate::kernels::rigs::skeleton::{Skeleton, SkeletonError};
use crate::kernels::rigs::ssdr::{Ssdr, SsdrError, SsdrOptions, ssdr};
use crate::kernels::rigs::weights::SkinWeights;

use connect::connect_over_time;
use moments::Moments;
use paths::{full_labels, node_places};
use split::{Bones, split_bones};
use tree::{JointTree, curves, joint_tree, without_cycles};

/// How joints follow the surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum JointMotion {
    /// By the mean displacement of their skinned vertices (Transfer4D, equation 14, as a mean). Joints
    /// inside of a limb that turns are moved like its visible side.
    Surface,
    /// By the motions of bones themselves, blended by the mean weights of their vertices.
    #[default]
    Bones,
}

/// How a motion skeleton is made.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionSkeletonOptions {
    /// Bones are cut if that lowers their squared error by more than this share.
    pub threshold: f64,
    /// The least number of vertices of a bone that is cut, and of both sides.
    pub min_vertices: usize,
    pub min_side: usize,
    pub max_bones: usize,
    pub rounds: usize,
    /// Bones with less error than this share of the bounding box's diagonal are rigid.
    pub least_error: f64,
    /// Ends of curves shorter than this share of the bounding box's diagonal are no limbs.
    pub least_limb: f64,
    /// The length of a link between components may change by less than this factor over time.
    pub max_variation: f64,
    pub joints: JointMotion,
    pub ssdr: SsdrOptions,
}

impl Default for MotionSkeletonOptions {
    fn default() -> Self {
        Self {
            threshold: 0.4,
            min_vertices: 20,
            min_side: 10,
            max_bones: 30,
            rounds: 3,
            least_error: 1e-7,
            least_limb: 0.07,
            max_variation: 4.0,
            joints: JointMotion::default(),
            ssdr: SsdrOptions {
                max_iterations: 5,
                tolerance: 1e-2,
                patience: 1,
                // Joints are where bones meet, so bones must not leave their vertices.
                affinity: 10.0,
                ..SsdrOptions::default()
            },
        }
    }
}

/// A skeleton in motion, and how it moves the surface that it was made from.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionSkeleton {
    pub skeleton: Skeleton,
    /// Joints turn like the bone that leads to them; the root does not turn.
    pub clip: Clip,
    /// `V x Q`: a vertex moves like the joint at the outer end of its bone.
    pub weights: SkinWeights,
    pub n_bones: usize,
    pub n_splits: usize,
    /// Links between components of the curve skeleton.
    pub n_links: usize,
    /// The root of the mean squared distance that curves leave as rigid bones, in mesh units…
    pub curves_rmse: f64,
    /// … the bones that they were split into…
    pub rigid_rmse: f64,
    /// … and these bones with skin weights.
    pub rmse: f64,
}

/// Why there is no motion skeleton.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MotionSkeletonError {
    #[error("the curve skeleton has no nodes")]
    NoNodes,
    #[error(
        "the curve skeleton has labels for {n_labels} vertices, but the surface has {n_vertices}"
    )]
    Labels { n_labels: usize, n_vertices: usize },
    #[error("no vertex belongs to a node of the curve skeleton ({n_nodes} nodes)")]
    NoLabels { n_nodes: usize },
    #[error("the option `{name}` is {value}, but must be {wanted}")]
    Option { name: &'static str, value: f64, wanted: &'static str },
    #[error(transparent)]
    Ssdr(#[from] SsdrError),
    #[error(transparent)]
    Skeleton(#[from] SkeletonError),
}

/// Makes a skeleton in motion from a tracked surface and its curve skeleton (Maheshwari et al. 2023,
/// section 3.3).
///
/// Components are joined, curves between junctions are split where two rigid motions fit much better than
/// one, and the parts are refined by SSDR. The ends of the parts are joints. `rest` is the pose
/// of the curve skeleton, whose labels belong to its vertices; `frames` have the same vertices.
///
/// # Errors
/// See [`MotionSkeletonError`].
pub fn motion_skeleton(
    rest: &[Vec3],
    faces: &[[u32; 3]],
    frames: &[&[Vec3]],
    frames_per_second: f64,
    curve_skeleton: &CurveSkeleton,
    options: &MotionSkeletonOptions,
) -> Result<MotionSkeleton, MotionSkeletonError> {
    check(rest, frames, curve_skeleton, options)?;
    let moving = Moving::new(rest, frames);
    let curve_skeleton = without_cycles(curve_skeleton);
    let (joined, n_links) = connect_over_time(&curve_skeleton, &moving, options.max_variation);
    let limbs = without_spurs(&joined, options.least_limb * moving.diagonal);
    let skeleton = relabelled(&limbs, full_labels(&limbs, rest));
    let moments: Vec<Moments> =
        skeleton.vertices_of_nodes().iter().map(|it| Moments::of(&moving, it)).collect();
    let mut bones = Bones::new(skeleton.n_nodes(), curves(&skeleton));
    let curves_rmse = rigid_rmse(&moving, &moments, &bones);
    split_bones(&moving, &moments, &mut bones, options);
    let rigid_rmse = rigid_rmse(&moving, &moments, &bones);
    let bone_of_vertex = skeleton.node_of_vertex().iter().map(|&node| {
        let bone = bones.bone_of_node[node as usize];
        // A skeleton of one node has no bone, and moves all.
        if bone == u32::MAX { 0 } else { bone }
    });
    let labels: Vec<u32> = bone_of_vertex.collect();
    let skin = ssdr(rest, faces, frames, Some(&labels), &options.ssdr)?;
    let places = node_places(&skeleton, rest, &skin.weights, &skin.motions, options.joints);
    let tree = joint_tree(&skeleton, &bones);
    let joints = named(&skeleton, &tree)?;
    let clip = clip(&tree, &joints, &skin, &places, frames_per_second);
    Ok(MotionSkeleton {
        weights: joint_weights(&tree, &skin),
        skeleton: joints,
        clip,
        n_bones: bones.paths.len(),
        n_splits: bones.n_splits,
        n_links,
        curves_rmse,
        rigid_rmse,
        rmse: skin.rmse,
    })
}

fn check(
    rest: &[Vec3],
    frames: &[&[Vec3]],
    skeleton: &CurveSkeleton,
    options: &MotionSkeletonOptions,
) -> Result<(), MotionSkeletonError> {
    let (n_nodes, n_vertices) = (skeleton.n_nodes(), rest.len());
    let labels = skeleton.node_of_vertex();
    if n_nodes == 0 {
        return Err(MotionSkeletonError::NoNodes);
    }
    if labels.len() != n_vertices {
        return Err(MotionSkeletonError::Labels { n_labels: labels.len(), n_vertices });
    }
    if labels.iter().all(|&it| it as usize >= n_nodes) {
        return Err(MotionSkeletonError::NoLabels { n_nodes });
    }
    if frames.is_empty() {
        return Err(SsdrError::Nothing { n_vertices, n_frames: 0 }.into());
    }
    if let Some(frame) = frames.iter().position(|it| it.len() != n_vertices) {
        let n_points = frames[frame].len();
        return Err(SsdrError::Count { frame, n_points, n_vertices }.into());
    }
    let MotionSkeletonOptions { threshold, least_error, least_limb, max_variation, .. } = *options;
    for (name, value) in
        [("threshold", threshold), ("least_error", least_error), ("least_limb", least_limb)]
    {
        if !(value >= 0.0 && value.is_finite()) {
            return Err(MotionSkeletonError::Option { name, value, wanted: "a number from 0" });
        }
    }
    if !(max_variation > 1.0) {
        let (name, wanted) = ("max_variation", "above 1");
        return Err(MotionSkeletonError::Option { name, value: max_variation, wanted });
    }
    Ok(())
}

/// The surface in motion. Sums are taken about its middle in every frame, which keeps them exact.
pub struct Moving<'a> {
    rest: &'a [Vec3],
    frames: &'a [&'a [Vec3]],
    rest_center: Vec3,
    centers: Vec<Vec3>,
    /// That of the bounding box at rest.
    diagonal: f64,
}

impl<'a> Moving<'a> {
    fn new(rest: &'a [Vec3], frames: &'a [&'a [Vec3]]) -> Self {
        let center = |points: &[Vec3]| points.iter().sum::<Vec3>() / points.len() as f64;
        let first = rest[0];
        let (low, high) = rest.iter().fold((first, first), |(l, h), it| (l.inf(it), h.sup(it)));
        let centers = frames.iter().map(|it| center(it)).collect();
        Self { rest, frames, rest_center: center(rest), centers, diagonal: (high - low).norm() }
    }

    fn n_frames(&self) -> usize {
        self.frames.len()
    }

    fn frames(&self) -> &[&'a [Vec3]] {
        self.frames
    }

    fn rest_places(&self) -> &'a [Vec3] {
        self.rest
    }

    fn rest(&self, vertex: u32) -> Vec3 {
        self.rest[vertex as usize] - self.rest_center
    }

    fn place(&self, frame: usize, vertex: u32) -> Vec3 {
        self.frames[frame][vertex as usize] - self.centers[frame]
    }
}

/// Removes ends of curves that are shorter than a length; their vertices go to the junction.
fn without_spurs(skeleton: &CurveSkeleton, least: f64) -> CurveSkeleton {
    let units = vec![1.0; skeleton.n_nodes()];
    prune(skeleton, &units, &PruneOptions { max_nodes: 0, max_radii: least })
}

fn relabelled(skeleton: &CurveSkeleton, labels: Vec<u32>) -> CurveSkeleton {
    let (positions, radii) = (skeleton.positions().to_vec(), skeleton.radii().to_vec());
    CurveSkeleton::new(positions, radii, skeleton.edges().to_vec(), labels)
        .expect("labels of nodes there are")
}

/// The root of the mean squared distance if every bone moves its vertices rigidly.
fn rigid_rmse(moving: &Moving<'_>, moments: &[Moments], bones: &Bones) -> f64 {
    let n_bones = bones.paths.len().max(1);
    let mut sums = vec![Moments::none(moving.n_frames()); n_bones];
    for (node, moments) in moments.iter().enumerate() {
        let bone = bones.bone_of_node[node] as usize;
        sums[if bone < n_bones { bone } else { 0 }].add(moments);
    }
    let cost: f64 = sums.iter().map(Moments::rigid_cost).sum();
    (cost / (moving.rest.len() * moving.n_frames()) as f64).sqrt()
}

fn named(skeleton: &CurveSkeleton, tree: &JointTree) -> Result<Skeleton, SkeletonError> {
    let n_joints = tree.nodes.len();
    let n_digits = n_joints.saturating_sub(1).to_string().len();
    let names = (0..n_joints).map(|it| format!("joint_{it:0n_digits$}")).collect();
    let positions = tree.nodes.iter().map(|&it| skeleton.positions()[it as usize]).collect();
    Skeleton::new(names, tree.parents.clone(), positions)
}

/// The column of the weights, and of the motions, of every joint's bone; none for a bone that moves nothing.
fn columns(tree: &JointTree, skin: &Ssdr) -> Vec<Option<usize>> {
    let column = |bone: &Option<usize>| {
        let label = bone.unwrap_or(0) as u32;
        // The root has no bone, except where it is all there is.
        if bone.is_none() && tree.nodes.len() > 1 {
            return None;
        }
        skin.label_of_bone.binary_search(&label).ok()
    };
    tree.bones.iter().map(column).collect()
}

fn joint_weights(tree: &JointTree, skin: &Ssdr) -> SkinWeights {
    let mut joint_of_column = vec![0; skin.label_of_bone.len()];
    for (joint, column) in columns(tree, skin).into_iter().enumerate() {
        if let Some(column) = column {
            joint_of_column[column] = joint as u32;
        }
    }
    let rows: Vec<Vec<(u32, f64)>> = (0..skin.weights.n_vertices())
        .map(|it| skin.weights.row(it).map(|(b, w)| (joint_of_column[b as usize], w)).collect())
        .collect();
    SkinWeights::from_rows(tree.nodes.len(), &rows).expect("every bone has a joint")
}

/// Joints where `places` say (frames by nodes); each turns as its bone, or as little as its bone's ends ask
/// for where that moves nothing.
fn clip(
    tree: &JointTree,
    skeleton: &Skeleton,
    skin: &Ssdr,
    places: &[Vec<Vec3>],
    frames_per_second: f64,
) -> Clip {
    let n_joints = skeleton.n_joints();
    let n_bones = skin.label_of_bone.len();
    let columns = columns(tree, skin);
    let mut res = Clip {
        name: "motion".to_owned(),
        frames_per_second,
        n_joints,
        rotations: Vec::with_capacity(places.len() * n_joints),
        translations: Vec::with_capacity(places.len() * n_joints),
    };
    for (frame, nodes) in places.iter().enumerate() {
        let motions: &[Isometry3<f64>] = &skin.motions[frame * n_bones..(frame + 1) * n_bones];
        let at: Vec<Vec3> = tree.nodes.iter().map(|&it| nodes[it as usize]).collect();
        let mut turns: Vec<UnitQuaternion<f64>> = Vec::with_capacity(n_joints);
        for (joint, parent) in skeleton.parents().iter().enumerate() {
            let turn = match (columns[joint], *parent) {
                (Some(column), _) => motions[column].rotation,
                (None, Some(parent)) => {
                    let rest = skeleton.positions()[joint] - skeleton.positions()[parent];
                    shortest_arc(rest, at[joint] - at[parent])
                }
                (None, None) => UnitQuaternion::identity(),
            };
            turns.push(turn);
            let (back, origin) = match *parent {
                Some(parent) => (turns[parent].inverse(), at[parent]),
                None => (UnitQuaternion::identity(), Vec3::zeros()),
            };
            res.rotations.push(back * turn);
            res.translations.push(back * (at[joint] - origin));
        }
    }
    res
}
