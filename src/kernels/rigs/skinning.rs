//! Linear blend skinning.

use nalgebra::{Isometry3, Translation3};
use rayon::prelude::*;

use super::{clip::Clip, skeleton::Skeleton, weights::SkinWeights};
use crate::kernels::geometry::mesh::{TriMesh, Vec3};

/// Why a mesh cannot be posed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SkinningError {
    #[error("the mesh has {n_vertices} vertices, but the weights have {n_rows} rows")]
    Vertices { n_vertices: usize, n_rows: usize },
    #[error("the skeleton has {skeleton} joints, the weights {weights}, the clip {clip}")]
    Joints { skeleton: usize, weights: usize, clip: usize },
    #[error("frame {frame} was asked for, but the clip has {n_frames} frames")]
    Frame { frame: usize, n_frames: usize },
}

/// Poses a mesh as in a frame of a clip: `v' = sum_q w_q G'_q v`, in the order of the vertices.
///
/// `G'_q = world_from_joint[q] * rest_from_world[q]`; the mesh must be in the skeleton's rest pose.
///
/// # Errors
/// [`SkinningError`] if the parts do not belong together.
pub fn skin(
    mesh: &TriMesh,
    skeleton: &Skeleton,
    weights: &SkinWeights,
    clip: &Clip,
    frame: usize,
) -> Result<Vec<Vec3>, SkinningError> {
    let (n_vertices, n_rows) = (mesh.n_vertices(), weights.n_vertices());
    if n_vertices != n_rows {
        return Err(SkinningError::Vertices { n_vertices, n_rows });
    }
    if weights.n_joints() != skeleton.n_joints() {
        let (skeleton, weights, clip) = (skeleton.n_joints(), weights.n_joints(), clip.n_joints);
        return Err(SkinningError::Joints { skeleton, weights, clip });
    }
    let world_from_joint = world_from_joint(skeleton, clip, frame)?;
    Ok(blend(mesh.vertices(), skeleton, weights, &world_from_joint))
}

/// The transforms of all joints in a frame, from joint coordinates to the world.
///
/// # Errors
/// [`SkinningError::Joints`] or [`SkinningError::Frame`].
pub fn world_from_joint(
    skeleton: &Skeleton,
    clip: &Clip,
    frame: usize,
) -> Result<Vec<Isometry3<f64>>, SkinningError> {
    let n_joints = skeleton.n_joints();
    if clip.n_joints != n_joints {
        let (skeleton, weights, clip) = (n_joints, n_joints, clip.n_joints);
        return Err(SkinningError::Joints { skeleton, weights, clip });
    }
    let n_frames = clip.n_frames();
    if frame >= n_frames {
        return Err(SkinningError::Frame { frame, n_frames });
    }
    let mut transforms: Vec<Isometry3<f64>> = Vec::with_capacity(n_joints);
    for (joint, parent) in skeleton.parents().iter().enumerate() {
        let at = frame * n_joints + joint;
        let translation = Translation3::from(clip.translations[at]);
        let parent_from_joint = Isometry3::from_parts(translation, clip.rotations[at]);
        transforms.push(match parent {
            Some(parent) => transforms[*parent] * parent_from_joint,
            None => parent_from_joint,
        });
    }
    Ok(transforms)
}

/// Moves points by the weighted transforms of the joints.
pub fn blend(
    points: &[Vec3],
    skeleton: &Skeleton,
    weights: &SkinWeights,
    world_from_joint: &[Isometry3<f64>],
) -> Vec<Vec3> {
    let world_from_rest: Vec<Isometry3<f64>> = world_from_joint
        .iter()
        .zip(skeleton.positions())
        .map(|(it, rest)| it * Translation3::from(-rest))
        .collect();
    let moved = |vertex: usize| -> Vec3 {
        let point = nalgebra::Point3::from(points[vertex]);
        weights
            .row(vertex)
            .map(|(joint, weight)| (world_from_rest[joint as usize] * point).coords * weight)
            .sum()
    };
    (0..points.len()).into_par_iter().map(moved).collect()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use nalgebra::UnitQuaternion;

    use super::*;

    /// A bar of two unit bones along +X, jointed at the origin and at (1, 0, 0).
    fn bar() -> (TriMesh, Skeleton, SkinWeights) {
        let points = [[0.5, 0.2, 0.0], [1.0, 0.2, 0.0], [1.0, -0.2, 0.0], [2.0, 0.2, 0.0]];
        let mesh = TriMesh::new(points.map(Vec3::from).to_vec(), vec![[0, 1, 2], [1, 2, 3]]);
        let names = vec!["upper".to_owned(), "lower".to_owned()];
        let positions = vec![Vec3::zeros(), Vec3::x()];
        let skeleton = Skeleton::new(names, vec![None, Some(0)], positions).unwrap();
        let half = vec![(0, 0.5), (1, 0.5)];
        let rows = vec![vec![(0, 1.0)], half.clone(), half, vec![(1, 1.0)]];
        (mesh.unwrap(), skeleton, SkinWeights::from_rows(2, &rows).unwrap())
    }

    fn clip(angle_rad: f64) -> Clip {
        let bend = UnitQuaternion::from_axis_angle(&Vec3::z_axis(), angle_rad);
        Clip {
            name: "bend".to_owned(),
            frames_per_second: 30.0,
            n_joints: 2,
            rotations: vec![UnitQuaternion::identity(), bend],
            translations: vec![Vec3::zeros(), Vec3::x()],
        }
    }

    #[test]
    fn rest_is_the_identity() {
        let (mesh, skeleton, weights) = bar();
        let posed = skin(&mesh, &skeleton, &weights, &clip(0.0), 0).unwrap();
        assert_eq!(posed, mesh.vertices());
    }

    #[test]
    fn a_right_angle_by_hand() {
        let (mesh, skeleton, weights) = bar();
        let posed = skin(&mesh, &skeleton, &weights, &clip(FRAC_PI_2), 0).unwrap();
        // Around (1, 0), (0, 0.2) turns to (-0.2, 0) and (1, 0.2) to (-0.2, 1); halves are averaged.
        let expected = [[0.5, 0.2, 0.0], [0.9, 0.1, 0.0], [1.1, -0.1, 0.0], [0.8, 1.0, 0.0]];
        for (posed, expected) in posed.iter().zip(expected.map(Vec3::from)) {
            assert!((posed - expected).norm() < 1e-15, "{posed} is not {expected}");
        }
    }

    #[test]
    fn parts_that_do_not_belong_together_are_told_apart() {
        let (mesh, skeleton, weights) = bar();
        let error = skin(&mesh, &skeleton, &weights, &clip(0.0), 7).unwrap_err();
        assert_eq!(error, SkinningError::Frame { frame: 7, n_frames: 1 });
        let one = SkinWeights::from_rows(2, &[vec![(0, 1.0)]]).unwrap();
        let error = skin(&mesh, &skeleton, &one, &clip(0.0), 0).unwrap_err();
        assert_eq!(error, SkinningError::Vertices { n_vertices: 4, n_rows: 1 });
        let other = Clip { n_joints: 1, ..clip(0.0) };
        let error = skin(&mesh, &skeleton, &weights, &other, 0).unwrap_err();
        assert_eq!(error, SkinningError::Joints { skeleton: 2, weights: 2, clip: 1 });
    }
}
