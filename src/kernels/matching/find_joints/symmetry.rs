//! Joints on limbs that are like each other.

use nalgebra::Matrix3;

use super::Joint;
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::matching::map_segments::places_along;
use crate::kernels::matching::skeleton_match::{
    MatchOptions, Partial, SkeletonGraph, SkeletonMatch, match_skeletons,
};
use crate::kernels::matching::union_skeleton::point_at;
use crate::kernels::rigs::skeleton::Skeleton;

/// The images of joints under all symmetries of the skeleton: matches with itself that undo themselves, and take nodes
/// nearly to where a reflection does. Ratings alone would take the front of a horse for its back.
pub fn images(skeleton: &Skeleton, joints: &[Joint], greatest_rating: f64) -> Vec<Joint> {
    const MOST: usize = 64;
    let graph = SkeletonGraph { roots: Vec::new(), ..SkeletonGraph::from(skeleton) };
    let options = MatchOptions {
        tolerance: greatest_rating,
        partial: Partial::Never,
        n_kept: MOST,
        ..Default::default()
    };
    // A skeleton that is too large to be matched has no symmetry that is known.
    let Ok(ranking) = match_skeletons(&graph, &graph, &options) else { return Vec::new() };
    let is_symmetry = |it: &&SkeletonMatch| {
        let back = |pair: &[u32; 2]| it.target_of(pair[1]) == Some(pair[0]);
        it.ratings()[0] < greatest_rating
            && it.nodes().iter().all(back)
            && it.nodes().iter().any(|pair| pair[0] != pair[1])
    };
    let off = |it: &SkeletonMatch| distance_from_mirror(skeleton.positions(), it);
    let symmetries: Vec<(&SkeletonMatch, f64)> =
        ranking.matches.iter().filter(is_symmetry).map(|it| (it, off(it))).collect();
    let least = symmetries.iter().map(|it| it.1).fold(f64::INFINITY, f64::min);
    let nearest = symmetries.iter().filter(|it| it.1 <= OFF * least + NEARLY);
    let of_all = |it: &SkeletonMatch| {
        joints.iter().filter_map(|joint| image(skeleton, it, joint)).collect::<Vec<_>>()
    };
    nearest.flat_map(|it| of_all(it.0)).collect()
}

/// In a pose that is not symmetric, all symmetries are off; those count that are not off by so many times more…
const OFF: f64 = 2.0;

/// … and this share of the size.
const NEARLY: f64 = 0.02;

/// How far nodes are from where a reflection takes those that they are matched with, as a share of the skeleton's
/// size; both as roots of the mean square.
fn distance_from_mirror(positions: &[Vec3], symmetry: &SkeletonMatch) -> f64 {
    let turn = mirror(positions, symmetry);
    let nodes = symmetry.nodes().iter().map(|it| it.map(|node| positions[node as usize]));
    let middle = nodes.clone().map(|it| it[0]).sum::<Vec3>() / symmetry.nodes().len() as f64;
    let (mut off, mut size) = (0.0, 0.0);
    for [from, to] in nodes {
        off += (turn * (from - middle) - (to - middle)).norm_squared();
        size += (from - middle).norm_squared();
    }
    if size > 0.0 { (off / size).sqrt() } else { 0.0 }
}

/// The reflection (or rotation) that takes nodes to those they are matched with.
fn mirror(positions: &[Vec3], symmetry: &SkeletonMatch) -> Matrix3<f64> {
    /// Nodes in a plane do not tell a reflection from a half turn; figures are mirrored.
    const FLAT: f64 = 1e-2;
    let pairs = || symmetry.nodes().iter().map(|it| it.map(|node| positions[node as usize]));
    let middle = pairs().map(|it| it[0]).sum::<Vec3>() / symmetry.nodes().len().max(1) as f64;
    let covariance: Matrix3<f64> =
        pairs().map(|[a, b]| (b - middle) * (a - middle).transpose()).sum();
    let svd = covariance.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return Matrix3::identity() };
    let (least, most) = (svd.singular_values.imin(), svd.singular_values.max());
    let mut signs = Vec3::repeat(1.0);
    if svd.singular_values[least] <= FLAT * most {
        signs[least] = -(u * v_t).determinant().signum();
    }
    u * Matrix3::from_diagonal(&signs) * v_t
}

/// The place of a joint on the branch that its own is matched with.
fn image(skeleton: &Skeleton, symmetry: &SkeletonMatch, joint: &Joint) -> Option<Joint> {
    let positions = skeleton.positions();
    let parent = skeleton.parents()[joint.bone]?;
    let ends = [parent as u32, joint.bone as u32];
    for branch in symmetry.branches() {
        let is_bone = |it: &[u32]| it == ends || [it[1], it[0]] == ends;
        let Some(bone) = branch.source.windows(2).position(is_bone) else { continue };
        let points = |nodes: &[u32]| -> Vec<Vec3> {
            nodes.iter().map(|&it| positions[it as usize]).collect()
        };
        let (own, theirs) = (points(&branch.source), points(&branch.target));
        let places = places_along(&own);
        let is_forward = branch.source[bone] == ends[0];
        let share = if is_forward { joint.share } else { 1.0 - joint.share };
        let place = places[bone] + (places[bone + 1] - places[bone]) * share;
        let along = places_along(&theirs);
        let position = point_at(&theirs, &along, place);
        let next = along.partition_point(|&it| it < place).clamp(1, theirs.len() - 1);
        let [a, b] = [branch.target[next - 1] as usize, branch.target[next] as usize];
        let span = along[next] - along[next - 1];
        let part =
            if span > 0.0 { ((place - along[next - 1]) / span).clamp(0.0, 1.0) } else { 1.0 };
        let (bone, share) = match skeleton.parents()[b] == Some(a) {
            true => (b, part),
            false => (a, 1.0 - part),
        };
        // A joint beside its curve is beside the other one, too.
        let beside = joint.position - point_at(&own, &places, place);
        let position = position + mirror(positions, symmetry) * beside;
        return Some(Joint { bone, share, position, is_mirrored: true, ..joint.clone() });
    }
    None
}
