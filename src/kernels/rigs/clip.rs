//! Animation clips: a skeleton in motion.

use nalgebra::UnitQuaternion;

use crate::kernels::geometry::mesh::Vec3;

/// `T` frames of `Q` joints, sampled at a constant rate.
///
/// Frames are aligned with the world at rest (see [`super::skeleton::Skeleton`]): in frame `t`,
/// `world_from_joint[q] = world_from_joint[parent] * [rotation | translation]`, with
/// `translation` the joint's offset from its parent (a root's position in the world). At rest all
/// rotations are the identity and every translation is the difference of two rest positions.
#[derive(Debug, Clone, PartialEq)]
pub struct Clip {
    pub name: String,
    pub frames_per_second: f64,
    pub n_joints: usize,
    /// `T * Q` rotations, frame by frame.
    pub rotations: Vec<UnitQuaternion<f64>>,
    /// `T * Q` offsets from the parent, frame by frame, in mesh units.
    pub translations: Vec<Vec3>,
}

impl Clip {
    pub fn n_frames(&self) -> usize {
        self.rotations.len().checked_div(self.n_joints).unwrap_or(0)
    }

    /// The same motion of joints whose rest pose is turned, in a world that is turned with it.
    pub fn turned(&self, rotation: &UnitQuaternion<f64>) -> Self {
        let back = rotation.inverse();
        Self {
            rotations: self.rotations.iter().map(|it| rotation * it * back).collect(),
            translations: self.translations.iter().map(|it| rotation * it).collect(),
            ..self.clone()
        }
    }

    pub fn duration_secs(&self) -> f64 {
        self.n_frames().saturating_sub(1) as f64 / self.frames_per_second
    }
}
