//! Rigged meshes in motion.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::kernels::{
    geometry::{
        mesh::{TriMesh, Vec3},
        mesh_sequence::{MeshSequence, SequenceError},
    },
    rigs::{
        clip::Clip,
        dual_quaternion::blend_dual_quaternions,
        skeleton::Skeleton,
        skinning::{SkinningError, blend, world_from_joint},
        weights::SkinWeights,
    },
};

/// How the motions of joints are blended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Blending {
    /// Linearly, as game engines do.
    #[default]
    Linear,
    /// As dual quaternions: twists keep their volume, bends bulge a little.
    DualQuaternion,
}

/// Why there is no animation.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AnimateError {
    #[error(transparent)]
    Skinning(#[from] SkinningError),
    #[error(transparent)]
    Sequence(#[from] SequenceError),
}

/// Poses a mesh in some frames of a clip, in the order in which they are given.
///
/// The mesh must be in the skeleton's rest pose. The rate of the sequence is `frames_per_second`.
///
/// # Errors
/// See [`AnimateError`].
pub fn animate(
    mesh: &TriMesh,
    skeleton: &Skeleton,
    weights: &SkinWeights,
    (clip, frames, frames_per_second): (&Clip, &[usize], f64),
    blending: Blending,
) -> Result<MeshSequence, AnimateError> {
    let (n_vertices, n_rows) = (mesh.n_vertices(), weights.n_vertices());
    if n_vertices != n_rows {
        return Err(SkinningError::Vertices { n_vertices, n_rows }.into());
    }
    if weights.n_joints() != skeleton.n_joints() {
        let (skeleton, weights, clip) = (skeleton.n_joints(), weights.n_joints(), clip.n_joints);
        return Err(SkinningError::Joints { skeleton, weights, clip }.into());
    }
    let mut positions: Vec<Vec3> = Vec::with_capacity(frames.len() * n_vertices);
    for &frame in frames {
        let motions = world_from_joint(skeleton, clip, frame)?;
        positions.extend(match blending {
            Blending::Linear => blend(mesh.vertices(), skeleton, weights, &motions),
            Blending::DualQuaternion => {
                blend_dual_quaternions(mesh.vertices(), skeleton, weights, &motions)
            }
        });
    }
    Ok(MeshSequence::new(frames_per_second, n_vertices, mesh.faces().to_vec(), positions)?)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, PI};

    use nalgebra::UnitQuaternion;

    use super::*;
    use crate::kernels::geometry::shapes::{geodesic_sphere, signed_volume};

    /// A capsule along +Y of two bones, jointed in the middle; weights blend over a part of it.
    fn capsule() -> (TriMesh, Skeleton, SkinWeights) {
        let sphere = geodesic_sphere(12);
        let stretched = |it: &Vec3| Vec3::new(it.x, 3.0 * it.y, it.z);
        let mesh = sphere.with_vertices(sphere.vertices().iter().map(stretched).collect()).unwrap();
        let names = vec!["lower".to_owned(), "upper".to_owned()];
        let positions = vec![Vec3::new(0.0, -3.0, 0.0), Vec3::zeros()];
        let skeleton = Skeleton::new(names, vec![None, Some(0)], positions).unwrap();
        let row = |it: &Vec3| {
            let upper = (0.5 + it.y / 2.0).clamp(0.0, 1.0);
            vec![(0, 1.0 - upper), (1, upper)]
        };
        let rows: Vec<_> = mesh.vertices().iter().map(row).collect();
        (mesh, skeleton, SkinWeights::from_rows(2, &rows).unwrap())
    }

    /// Rest, and a turn of the upper bone.
    fn clip(turn: UnitQuaternion<f64>) -> Clip {
        let identity = UnitQuaternion::identity();
        let (root, upper) = (Vec3::new(0.0, -3.0, 0.0), Vec3::new(0.0, 3.0, 0.0));
        Clip {
            name: "turn".to_owned(),
            frames_per_second: 30.0,
            n_joints: 2,
            rotations: vec![identity, identity, identity, turn],
            translations: vec![root, upper, root, upper],
        }
    }

    fn animated(turn: UnitQuaternion<f64>, blending: Blending) -> MeshSequence {
        let (mesh, skeleton, weights) = capsule();
        animate(&mesh, &skeleton, &weights, (&clip(turn), &[0, 1], 30.0), blending).unwrap()
    }

    #[test]
    fn rest_is_the_identity() {
        let (mesh, ..) = capsule();
        for blending in [Blending::Linear, Blending::DualQuaternion] {
            let sequence = animated(UnitQuaternion::identity(), blending);
            for (posed, rest) in sequence.frame(1).iter().zip(mesh.vertices()) {
                assert!((posed - rest).norm() < 1e-14);
            }
        }
    }

    /// A right angle about z: the upper tip goes to -x, the lower one stays; the points that both bones
    /// move by halves go to the mean of rest and turned (linear), or turn by 45 degrees (dual).
    #[test]
    fn a_right_angle_by_hand() {
        let turn = UnitQuaternion::from_axis_angle(&Vec3::z_axis(), FRAC_PI_2);
        let (mesh, ..) = capsule();
        let linear = animated(turn, Blending::Linear);
        let dual = animated(turn, Blending::DualQuaternion);
        for (vertex, rest) in mesh.vertices().iter().enumerate() {
            let (linear, dual) = (linear.frame(1)[vertex], dual.frame(1)[vertex]);
            let turned = Vec3::new(-rest.y, rest.x, rest.z);
            if rest.y >= 1.0 || rest.y <= -1.0 {
                let expected = if rest.y > 0.0 { turned } else { *rest };
                assert!((linear - expected).norm() < 1e-12 && (dual - expected).norm() < 1e-12);
            }
            if rest.y == 0.0 {
                assert!((linear - (rest + turned) / 2.0).norm() < 1e-12);
                let half = UnitQuaternion::from_axis_angle(&Vec3::z_axis(), FRAC_PI_2 / 2.0);
                assert!((dual - half * rest).norm() < 1e-12);
            }
        }
    }

    #[test]
    fn a_twist_keeps_its_volume_with_dual_quaternions_and_not_without() {
        let turn = UnitQuaternion::from_axis_angle(&Vec3::y_axis(), 0.9 * PI);
        let (mesh, ..) = capsule();
        let volume = signed_volume(&mesh);
        let kept = |blending| signed_volume(&animated(turn, blending).mesh(1).unwrap()) / volume;
        let (linear, dual) = (kept(Blending::Linear), kept(Blending::DualQuaternion));
        assert!(linear < 0.75, "{linear}");
        assert!((dual - 1.0).abs() < 0.03, "{dual}");
    }

    #[test]
    fn parts_that_do_not_belong_together_are_refused() {
        let (mesh, skeleton, weights) = capsule();
        let still = clip(UnitQuaternion::identity());
        let run = |frames: &[usize]| {
            let motion = (&still, frames, 30.0);
            animate(&mesh, &skeleton, &weights, motion, Blending::Linear).unwrap_err().to_string()
        };
        assert_eq!(run(&[2]), "frame 2 was asked for, but the clip has 2 frames");
        assert_eq!(run(&[]), "a sequence needs a frame");
    }
}
