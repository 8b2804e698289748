//! A rig: what an animator opens.

use crate::engine::artifact::{Artifact, ArtifactType, DecodeError, Decoder, Encoder, Format};
use crate::kernels::io::glb::{GlbRig, GlbScene, write_glb};
use crate::kernels::{
    geometry::mesh::TriMesh,
    rigs::{clip::Clip, skeleton::Skeleton, weights::SkinWeights},
};

/// A skinned mesh, with motion if there is any.
#[derive(Debug, Clone, PartialEq)]
pub struct Rig {
    pub mesh: TriMesh,
    pub skeleton: Skeleton,
    pub weights: SkinWeights,
    pub clips: Vec<Clip>,
}

impl Artifact for Rig {
    const TYPE: ArtifactType = ArtifactType {
        name: "rig",
        version: 1,
        doc: "Skinned mesh: the arrays of a mesh, a skeleton, weights and any number of clips.",
    };

    const FORMATS: &'static [Format] = &[Format {
        extension: "glb",
        doc: "glTF with skin and clips: single precision, every joint's +Y towards its child.",
    }];

    fn encode<'a>(&'a self, to: &mut Encoder<'a>) {
        to.part("mesh", |to| self.mesh.encode(to));
        to.part("skeleton", |to| self.skeleton.encode(to));
        to.part("weights", |to| self.weights.encode(to));
        for (index, clip) in self.clips.iter().enumerate() {
            to.part(&format!("clip{index}"), |to| clip.encode(to));
        }
        to.text("n_clips", self.clips.len().to_string());
    }

    fn decode(from: &Decoder<'_>) -> Result<Self, DecodeError> {
        let n_clips: usize = from
            .text("n_clips")?
            .parse()
            .map_err(|_| DecodeError::new("`n_clips` is no number"))?;
        let clips = (0..n_clips).map(|index| Clip::decode(&from.part(&format!("clip{index}"))));
        let rig = Self {
            mesh: TriMesh::decode(&from.part("mesh"))?,
            skeleton: Skeleton::decode(&from.part("skeleton"))?,
            weights: SkinWeights::decode(&from.part("weights"))?,
            clips: clips.collect::<Result<_, _>>()?,
        };
        rig.check().map_err(DecodeError)?;
        Ok(rig)
    }

    fn export(&self, extension: &str) -> Result<Vec<u8>, String> {
        if extension != "glb" {
            return Err(format!("a rig cannot be written as .{extension}"));
        }
        let rig =
            GlbRig { skeleton: &self.skeleton, weights: Some(&self.weights), clips: &self.clips };
        let scene = GlbScene { mesh: &self.mesh, colours: None, rig: Some(rig), max_influences: 4 };
        Ok(write_glb(scene).bytes)
    }

    fn summary(&self) -> Vec<(String, String)> {
        let clips = self.clips.iter().map(|it| format!("{} ({} frames)", it.name, it.n_frames()));
        vec![
            ("vertices".to_owned(), self.mesh.n_vertices().to_string()),
            ("faces".to_owned(), self.mesh.n_faces().to_string()),
            ("joints".to_owned(), self.skeleton.n_joints().to_string()),
            ("influences a vertex".to_owned(), format!("max {}", self.weights.max_influences())),
            ("clips".to_owned(), clips.collect::<Vec<_>>().join(", ")),
        ]
    }
}

impl Rig {
    /// Checks that the counts of the parts agree.
    ///
    /// # Errors
    /// With both counts.
    pub fn check(&self) -> Result<(), String> {
        let (n_vertices, n_joints) = (self.mesh.n_vertices(), self.skeleton.n_joints());
        if self.weights.n_vertices() != n_vertices {
            let n_rows = self.weights.n_vertices();
            return Err(format!("weights of {n_rows} vertices for a mesh of {n_vertices}"));
        }
        if self.weights.n_joints() != n_joints {
            let n_columns = self.weights.n_joints();
            return Err(format!("weights of {n_columns} joints for a skeleton of {n_joints}"));
        }
        match self.clips.iter().find(|it| it.n_joints != n_joints) {
            Some(clip) => Err(format!(
                "clip `{}` moves {} joints, but the skeleton has {n_joints}",
                clip.name, clip.n_joints
            )),
            None => Ok(()),
        }
    }
}
