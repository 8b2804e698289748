//! Kind `pose`.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, OptionalInput, Output, Spec};
use crate::kernels::motion::fit_clip::world_positions;
use crate::kernels::motion::pose::{Turn, TurnRange, pose, random_turns};
use crate::kernels::rigs::skinning::{SkinningError, skin};
use crate::kernels::{
    geometry::mesh::TriMesh,
    rigs::{clip::Clip, skeleton::Skeleton, weights::SkinWeights},
};

/// Poses a rigged mesh by the angles of its joints, or as in a frame of a clip.
///
/// Linear blend skinning. A joint turns against its parent, about the world's Z, then Y, then X axis
/// through its place at rest. Drawn turns, given turns and a clip's frame add up, in this order from
/// the outside.
#[derive(Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PoseNode {
    /// Turns in degrees about X, Y and Z by the names of joints: `{ LeftArm = [0, 0, -30] }`.
    pub turns: BTreeMap<String, Turn>,
    /// Ranges from which turns are drawn, in degrees: `{ LeftArm = [[-40, 20], [0, 0], [-30, 30]] }`.
    pub ranges: BTreeMap<String, TurnRange>,
    /// Decides on the drawn turns.
    pub seed: u64,
    /// With a clip: the frame, from 0.
    pub frame: usize,
}

impl PoseNode {
    const MESH: Input<TriMesh> = Input::new("mesh", "the surface at rest");
    const SKELETON: Input<Skeleton> = Input::new("skeleton", "its joints at rest");
    const WEIGHTS: Input<SkinWeights> = Input::new("weights", "how joints move vertices");
    const CLIP: OptionalInput<Clip> = OptionalInput::new("clip", "a motion of these joints");
    const POSED: Output<TriMesh> = Output::new("mesh", "the posed surface");
    const MOVED: Output<Skeleton> = Output::new("skeleton", "where its joints are then");
    const FRAME: Output<Clip> = Output::new("clip", "the pose, as a clip of one frame");
}

impl Node for PoseNode {
    const SPEC: Spec = Spec {
        kind: "pose",
        version: 1,
        inputs: &[
            Self::MESH.port(),
            Self::SKELETON.port(),
            Self::WEIGHTS.port(),
            Self::CLIP.port(),
        ],
        outputs: &[Self::POSED.port(), Self::MOVED.port(), Self::FRAME.port()],
        cites: &[],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.waving]
kind = "pose"
mesh = "@body.mesh"
skeleton = "@body.skeleton"
weights = "@body.weights"
turns = { left_arm = [0, 0, 60] }
ranges = { right_leg = [[0, 50], [0, 0], [0, 0]] }
seed = 3
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (mesh, skeleton) = (io.get(Self::MESH), io.get(Self::SKELETON));
        let clip = io.get_optional(Self::CLIP);
        if let Some(clip) = &clip {
            self.check(clip, &skeleton)?;
        }
        let base = clip.as_ref().map(|it| (&**it, self.frame));
        let given = pose(&skeleton, &self.turns, base)?;
        let posed = pose(&skeleton, &random_turns(&self.ranges, self.seed)?, Some((&given, 0)))?;
        let vertices = skin(&mesh, &skeleton, &io.get(Self::WEIGHTS), &posed, 0)?;
        let joints = world_positions(&posed, 0, skeleton.parents());
        io.put(Self::POSED, mesh.with_vertices(vertices)?);
        io.put(Self::MOVED, skeleton.with_positions(joints)?);
        io.put(Self::FRAME, posed);
        Ok(())
    }
}

impl PoseNode {
    fn check(&self, clip: &Clip, skeleton: &Skeleton) -> Result<(), SkinningError> {
        let (frame, n_frames, joints) = (self.frame, clip.n_frames(), skeleton.n_joints());
        if clip.n_joints != joints {
            let clip = clip.n_joints;
            return Err(SkinningError::Joints { skeleton: joints, weights: joints, clip });
        }
        if frame >= n_frames {
            return Err(SkinningError::Frame { frame, n_frames });
        }
        Ok(())
    }
}
