//! Kind `render_depth`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Node, NodeError, NodeIo, OptionalInput, OptionalOutput, Output, Spec};
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::rigs::skinning::{skin, world_from_joint};
use crate::kernels::sensors::depth::camera::Orbit;
use crate::kernels::sensors::depth::film::{FilmOptions, film, move_sequence};
use crate::kernels::sensors::depth::noise::NoiseModel;
use crate::kernels::sensors::depth::{DepthVideo, Intrinsics};
use crate::kernels::{
    geometry::{mesh::TriMesh, mesh_sequence::MeshSequence},
    rigs::{clip::Clip, skeleton::Skeleton, weights::SkinWeights},
};

/// Films a moving body with a simulated depth camera, and tells what is true in the film.
///
/// The body is a `sequence`, or a `mesh` that a `clip` moves through its `skeleton` and `weights`. The
/// world has +y up; the camera looks at the middle of the first frame. Sensor noise is a model of the
/// first Kinect: quantised disparity, lost edges, grazing dropouts and holes.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RenderDepth {
    /// Pixels.
    #[schemars(range(min = 16, max = 4096))]
    pub width: usize,
    /// Pixels.
    #[schemars(range(min = 16, max = 4096))]
    pub height: usize,
    /// The focal length in pixels; 0 is that of a Kinect, 0.9 times the width.
    #[schemars(range(min = 0.0, max = 100_000.0))]
    pub focal_length: f64,
    /// The diagonal of the body's bounding box in the first filmed frame, in metres, that it is scaled to;
    /// 0 films it as large as it is.
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub diagonal: f64,
    /// Metres from the camera to the middle of the body; 0 fits the body into the picture.
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub distance: f64,
    /// Degrees; 0 is in front of a body that looks along +z, 90 at its left.
    pub azimuth: f64,
    /// Degrees above the horizon.
    #[schemars(range(min = -89.0, max = 89.0))]
    pub elevation: f64,
    /// The first frame that is filmed.
    pub first: usize,
    /// How many frames are filmed at most; 0 for all.
    pub frames: usize,
    /// Only every so many frames are filmed, which makes motion faster.
    #[schemars(range(min = 1))]
    pub every: usize,
    /// How strong the noise of the camera is: 0 for exact depths, 1 for that of a Kinect.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub noise: f64,
    /// Decides on the noise.
    pub seed: u64,
}

impl Default for RenderDepth {
    fn default() -> Self {
        Self {
            width: 640,
            height: 480,
            focal_length: 0.0,
            diagonal: 0.0,
            distance: 0.0,
            azimuth: 0.0,
            elevation: 0.0,
            first: 0,
            frames: 0,
            every: 1,
            noise: 1.0,
            seed: 0,
        }
    }
}

impl RenderDepth {
    const SEQUENCE: OptionalInput<MeshSequence> =
        OptionalInput::new("sequence", "a moving surface, instead of `mesh` and `clip`");
    const MESH: OptionalInput<TriMesh> = OptionalInput::new("mesh", "the body in rest pose");
    const SKELETON: OptionalInput<Skeleton> = OptionalInput::new("skeleton", "its joints");
    const WEIGHTS: OptionalInput<SkinWeights> = OptionalInput::new("weights", "its skin weights");
    const CLIP: OptionalInput<Clip> = OptionalInput::new("clip", "its motion");
    const VIDEO: Output<DepthVideo> = Output::new("video", "the film");
    const TRUTH: Output<MeshSequence> =
        Output::new("truth", "the filmed surface in camera space, frame by frame");
    const JOINTS: OptionalOutput<MeshSequence> =
        OptionalOutput::new("joints", "the true joints in camera space, frame by frame");

    /// The filmed frames of `n`.
    fn chosen(&self, n: usize) -> Result<Vec<usize>, NodeError> {
        let most = if self.frames == 0 { usize::MAX } else { self.frames };
        let chosen: Vec<usize> = (self.first..n).step_by(self.every).take(most).collect();
        match chosen.is_empty() {
            true => Err(NodeError::failed(format!(
                "`first` is {}, but there are {n} frames",
                self.first
            ))),
            false => Ok(chosen),
        }
    }

    /// The moving surface, and its joints.
    fn scene(&self, io: &NodeIo<'_>) -> Result<(MeshSequence, Option<MeshSequence>), NodeError> {
        let parts = (
            io.get_optional(Self::MESH),
            io.get_optional(Self::SKELETON),
            io.get_optional(Self::WEIGHTS),
            io.get_optional(Self::CLIP),
        );
        match (io.get_optional(Self::SEQUENCE), parts) {
            (Some(sequence), (None, None, None, None)) => {
                let chosen = self.chosen(sequence.n_frames())?;
                let frames = chosen.iter().map(|it| sequence.frame(*it).to_vec()).collect();
                let rate = sequence.frames_per_second() / self.every as f64;
                Ok((MeshSequence::from_frames(frames, sequence.faces().to_vec(), rate)?, None))
            }
            (None, (Some(mesh), Some(skeleton), Some(weights), Some(clip))) => {
                let chosen = self.chosen(clip.n_frames())?;
                let rate = clip.frames_per_second / self.every as f64;
                let (mut frames, mut joints) = (Vec::new(), Vec::new());
                for &frame in &chosen {
                    frames.push(skin(&mesh, &skeleton, &weights, &clip, frame)?);
                    let world = world_from_joint(&skeleton, &clip, frame)?;
                    joints.push(world.iter().map(|it| it.translation.vector).collect());
                }
                let sequence = MeshSequence::from_frames(frames, mesh.faces().to_vec(), rate)?;
                Ok((sequence, Some(MeshSequence::from_frames(joints, Vec::new(), rate)?)))
            }
            _ => Err(NodeError::failed(
                "wire either `sequence`, or all of `mesh`, `skeleton`, `weights` and `clip`",
            )),
        }
    }

    /// The surface and its joints in the wanted size.
    fn scaled(
        &self,
        (sequence, joints): (MeshSequence, Option<MeshSequence>),
    ) -> Result<(MeshSequence, Option<MeshSequence>), NodeError> {
        let (low, high) = sequence.mesh(0)?.bounds();
        let own = (high - low).norm();
        if self.diagonal == 0.0 || own == 0.0 {
            return Ok((sequence, joints));
        }
        let scaled = |it: MeshSequence| {
            let places = it.positions().iter().map(|it| it * (self.diagonal / own)).collect();
            MeshSequence::new(it.frames_per_second(), it.n_vertices(), it.faces().to_vec(), places)
        };
        Ok((scaled(sequence)?, joints.map(scaled).transpose()?))
    }

    fn options(&self, sequence: &MeshSequence) -> FilmOptions {
        let focal = match self.focal_length {
            0.0 => 0.9 * self.width as f64,
            focal => focal,
        };
        let (low, high) = sequence.mesh(0).expect("a sequence has a frame").bounds();
        let half: Vec3 = (high - low) / 2.0;
        // The box fits from all sides, with a margin for the motion.
        let fitting = 1.25 * half.norm() * 2.0 * focal / self.width.min(self.height) as f64;
        let noise = NoiseModel::default();
        FilmOptions {
            width: self.width,
            height: self.height,
            intrinsics: Intrinsics {
                fx: focal,
                fy: focal,
                cx: (self.width as f64 - 1.0) / 2.0,
                cy: (self.height as f64 - 1.0) / 2.0,
            },
            orbit: Orbit {
                distance: if self.distance == 0.0 { fitting } else { self.distance },
                azimuth_deg: self.azimuth,
                elevation_deg: self.elevation,
            },
            noise: (self.noise > 0.0).then(|| NoiseModel {
                disparity_step: noise.disparity_step * self.noise,
                disparity_noise: noise.disparity_noise * self.noise,
                edge_loss: (noise.edge_loss * self.noise).min(1.0),
                holes: noise.holes * self.noise,
                ..noise
            }),
            seed: self.seed,
        }
    }
}

impl Node for RenderDepth {
    const SPEC: Spec = Spec {
        kind: "render_depth",
        version: 1,
        inputs: &[
            Self::SEQUENCE.port(),
            Self::MESH.port(),
            Self::SKELETON.port(),
            Self::WEIGHTS.port(),
            Self::CLIP.port(),
        ],
        outputs: &[Self::VIDEO.port(), Self::TRUTH.port(), Self::JOINTS.port()],
        cites: &[],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.film]
kind = "render_depth"
mesh = "@body.mesh"
skeleton = "@body.skeleton"
weights = "@body.weights"
clip = "@body.clip"
frames = 3
width = 160
height = 120
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (sequence, joints) = self.scaled(self.scene(io)?)?;
        let film = film(&sequence, &self.options(&sequence))?;
        let joints = joints.map(|it| move_sequence(&it, &film.camera_from_world)).transpose()?;
        let n_empty = (0..film.video.n_frames())
            .filter(|it| film.video.frame(*it).iter().all(|it| *it == 0.0))
            .count();
        if n_empty > 0 {
            io.note(format!("the subject is out of view in {n_empty} frames"));
        }
        io.put(Self::VIDEO, film.video);
        io.put(Self::TRUTH, film.truth);
        io.put_optional(Self::JOINTS, joints, "a sequence has no joints");
        Ok(())
    }
}
