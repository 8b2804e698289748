//! Motions in which a body does not pass through itself.

mod body;
mod free_pair;
mod group_tree;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use nalgebra::UnitQuaternion;
use rayon::prelude::*;

use self::body::Body;
use self::free_pair::Key;
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::rigs::clip::Clip;
use crate::kernels::rigs::skeleton::Skeleton;
use crate::kernels::rigs::skinning::SkinningError;
use crate::kernels::rigs::weights::SkinWeights;

/// What [`resolve_penetration`] does.
#[derive(Debug, Clone, PartialEq)]
pub struct ResolvePenetrationOptions {
    /// How often all pairs of groups are gone through in a key at most.
    pub max_sweeps: usize,
    /// The largest angle of a joint's own rotation, in radians, by joint.
    pub limits_rad: BTreeMap<usize, f64>,
    /// Rotations that are set and not changed any more, by frame and joint.
    pub overrides: BTreeMap<(usize, usize), UnitQuaternion<f64>>,
}

impl Default for ResolvePenetrationOptions {
    fn default() -> Self {
        Self { max_sweeps: 10, limits_rad: BTreeMap::new(), overrides: BTreeMap::new() }
    }
}

/// What a key was like, and became.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct KeyReport {
    /// Pairs of groups that cross, and pairs of their faces that do.
    pub before: Crossings,
    pub after: Crossings,
    pub n_sweeps: usize,
    /// The largest angle by which a joint was turned, in radians.
    pub largest_turn_rad: f64,
    /// The joints of the groups that still cross.
    pub unresolved: Vec<[usize; 2]>,
}

/// How much of a body passes through itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Crossings {
    pub n_pairs: usize,
    pub n_faces: usize,
}

/// A motion without what could be resolved.
#[derive(Debug, Clone, PartialEq)]
pub struct ResolvedPenetration {
    pub clip: Clip,
    /// One a frame.
    pub keys: Vec<KeyReport>,
    /// Pairs of groups that are watched.
    pub n_pairs: usize,
    /// Pairs that are not, because they cross at rest.
    pub n_crossing_at_rest: usize,
}

/// Turns joints back until groups of faces do not pass through each other (Madaras et al. 2014,
/// section 5.1).
///
/// Every face belongs to the joint that moves it most. Watched are pairs of groups that are no
/// neighbours: neither their joints are joined, or joined to the same branch, nor do they share an edge
/// of the surface, nor do they cross at rest. In every frame, a pair that crosses is freed by turning a
/// joint on the way from their last common joint to either group, or all on that way, towards the frame
/// before, as far as needed by bisection; the way that moves the groups least is taken. If that does
/// not help, joints turn towards the rest pose. What one pair gains another may lose, so this is
/// repeated.
///
/// Uses the threads of the pool it is called in; results do not depend on their number.
///
/// # Errors
/// [`SkinningError`] if the parts do not belong together.
pub fn resolve_penetration(
    mesh: &TriMesh,
    skeleton: &Skeleton,
    weights: &SkinWeights,
    clip: &Clip,
    options: &ResolvePenetrationOptions,
) -> Result<ResolvedPenetration, SkinningError> {
    check(mesh, skeleton, weights, clip)?;
    let body = Body::new(mesh, skeleton, weights);
    let mut res = clip.clone();
    let n_joints = clip.n_joints;
    for (index, rotation) in res.rotations.iter_mut().enumerate() {
        *rotation = preset(*rotation, index / n_joints, index % n_joints, options);
    }
    let is_free = free_frames(&body, &res);
    let mut keys: Vec<KeyReport> = Vec::with_capacity(is_free.len());
    let mut safe = vec![UnitQuaternion::identity(); n_joints];
    for (frame, &is_free) in is_free.iter().enumerate() {
        let range = frame * n_joints..(frame + 1) * n_joints;
        if is_free {
            keys.push(KeyReport::default());
        } else {
            let offsets = &res.translations[range.clone()];
            let fixed = (0..n_joints).map(|it| options.overrides.contains_key(&(frame, it)));
            let key = Key { body: &body, offsets, safe: &safe, fixed: fixed.collect() };
            keys.push(resolve_key(&key, &mut res.rotations[range.clone()], options.max_sweeps));
        }
        safe.copy_from_slice(&res.rotations[range]);
    }
    let (n_pairs, n_crossing_at_rest) = (body.pairs.len(), body.n_crossing_at_rest);
    Ok(ResolvedPenetration { clip: res, keys, n_pairs, n_crossing_at_rest })
}

fn check(
    mesh: &TriMesh,
    skeleton: &Skeleton,
    weights: &SkinWeights,
    clip: &Clip,
) -> Result<(), SkinningError> {
    let (n_vertices, n_rows) = (mesh.n_vertices(), weights.n_vertices());
    if n_vertices != n_rows {
        return Err(SkinningError::Vertices { n_vertices, n_rows });
    }
    let (skeleton, weights, clip) = (skeleton.n_joints(), weights.n_joints(), clip.n_joints);
    match skeleton == weights && skeleton == clip {
        true => Ok(()),
        false => Err(SkinningError::Joints { skeleton, weights, clip }),
    }
}

/// The rotation of a joint after the user's wishes.
fn preset(
    rotation: UnitQuaternion<f64>,
    frame: usize,
    joint: usize,
    options: &ResolvePenetrationOptions,
) -> UnitQuaternion<f64> {
    if let Some(&it) = options.overrides.get(&(frame, joint)) {
        return it;
    }
    match options.limits_rad.get(&joint) {
        Some(&limit) if rotation.angle() > limit => {
            UnitQuaternion::from_scaled_axis(rotation.scaled_axis() * (limit / rotation.angle()))
        }
        _ => rotation,
    }
}

/// Whether nothing crosses, by frame.
fn free_frames(body: &Body<'_>, clip: &Clip) -> Vec<bool> {
    let n_joints = clip.n_joints;
    let is_free = |frame: usize| {
        let range = frame * n_joints..(frame + 1) * n_joints;
        let poses = body.pose(&clip.rotations[range.clone()], &clip.translations[range]);
        !body.pairs.iter().any(|&it| body.crosses(it, &poses))
    };
    (0..clip.n_frames()).into_par_iter().map(is_free).collect()
}

fn resolve_key(
    key: &Key<'_>,
    rotations: &mut [UnitQuaternion<f64>],
    max_sweeps: usize,
) -> KeyReport {
    let body = key.body;
    let before = rotations.to_vec();
    let mut crossings = body.crossings(&body.pose(rotations, key.offsets));
    let mut report = KeyReport { before: total(&crossings), ..Default::default() };
    while !crossings.is_empty() && report.n_sweeps < max_sweeps {
        report.n_sweeps += 1;
        let mut changed = false;
        for &(pair, _) in &crossings {
            changed |= key.free_pair(body.pairs[pair], rotations);
        }
        if !changed {
            break;
        }
        crossings = body.crossings(&body.pose(rotations, key.offsets));
    }
    report.after = total(&crossings);
    report.unresolved = crossings.iter().map(|it| body.pairs[it.0]).collect();
    let turns = before.iter().zip(rotations.iter()).map(|(a, b)| a.angle_to(b));
    report.largest_turn_rad = turns.fold(0.0, f64::max);
    report
}

fn total(crossings: &[(usize, usize)]) -> Crossings {
    Crossings { n_pairs: crossings.len(), n_faces: crossings.iter().map(|it| it.1).sum() }
}
