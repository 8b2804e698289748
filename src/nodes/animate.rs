//! Kind `animate`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, OptionalInput, Output, Spec};
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::geometry::mesh_sequence::MeshSequence;
use crate::kernels::motion::animate::{Blending, animate};
use crate::kernels::motion::fit_clip::fit_clip;
use crate::kernels::motion::retarget::retarget;
use crate::kernels::rigs::clip::Clip;
use crate::kernels::rigs::skeleton::Skeleton;
use crate::kernels::rigs::weights::SkinWeights;

/// Moves a rigged mesh by a clip.
///
/// The clip may be another skeleton's, as long as joints have the same names: they turn as there, bones
/// keep their own lengths, and the root's path is scaled by the ratio of the heights. With
/// `clip_skeleton` joints are matched by name, without it the clip must have the same joints in the same
/// order. The rest poses should be alike.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Animate {
    /// How the motions of joints are blended.
    #[serde(default)]
    pub blending: Blending,
    /// Whether the clip is made to fit the skeleton; otherwise it is taken as it is.
    #[serde(default = "yes")]
    pub fit: bool,
    /// The frames of the clip that are taken, in this order; all if it is left out.
    #[serde(default)]
    #[schemars(length(max = 100_000))]
    pub frames: Vec<usize>,
    /// Of these, only every so many, from the first on.
    #[serde(default = "one")]
    #[schemars(range(min = 1))]
    pub every: usize,
}

fn yes() -> bool {
    true
}

fn one() -> usize {
    1
}

impl Animate {
    const MESH: Input<TriMesh> = Input::new("mesh", "the surface at rest");
    const SKELETON: Input<Skeleton> = Input::new("skeleton", "its joints");
    const WEIGHTS: Input<SkinWeights> = Input::new("weights", "how joints move vertices");
    const CLIP: Input<Clip> = Input::new("clip", "the motion");
    const CLIP_SKELETON: OptionalInput<Skeleton> =
        OptionalInput::new("clip_skeleton", "the skeleton that the clip was made for");
    const SEQUENCE: Output<MeshSequence> = Output::new("sequence", "the mesh in motion");
    const POSED: Output<TriMesh> = Output::new("mesh", "the mesh in the first frame taken");
    const FITTED: Output<Clip> = Output::new("clip", "all frames of the motion as it was played");

    fn fitted(&self, io: &NodeIo<'_>, skeleton: &Skeleton) -> Result<(Clip, String), NodeError> {
        let clip = io.get(Self::CLIP);
        if !self.fit {
            return Ok(((*clip).clone(), String::new()));
        }
        if let Some(theirs) = io.get_optional(Self::CLIP_SKELETON) {
            let found = retarget(&clip, &theirs, skeleton)?;
            let mut note = Vec::new();
            for (names, what) in [
                (&found.unmoved, "are not in the clip and move with their parents"),
                (&found.unused, "of the clip are not in the skeleton"),
            ] {
                if !names.is_empty() {
                    note.push(format!("{} joints {what}: {}", names.len(), names.join(", ")));
                }
            }
            return Ok((found.clip, note.join("; ")));
        }
        if clip.n_joints != skeleton.n_joints() {
            return Err(NodeError::failed(format!(
                "the clip moves {} joints, but the skeleton has {}: wire `clip_skeleton` to match \
                 joints by name",
                clip.n_joints,
                skeleton.n_joints()
            )));
        }
        Ok((fit_clip(&clip, skeleton), String::new()))
    }
}

impl Node for Animate {
    const SPEC: Spec = Spec {
        kind: "animate",
        version: 1,
        inputs: &[
            Self::MESH.port(),
            Self::SKELETON.port(),
            Self::WEIGHTS.port(),
            Self::CLIP.port(),
            Self::CLIP_SKELETON.port(),
        ],
        outputs: &[Self::SEQUENCE.port(), Self::POSED.port(), Self::FITTED.port()],
        cites: &["kavan2007skinning"],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.walk]
kind = "animate"
mesh = "@body.mesh"
skeleton = "@body.skeleton"
weights = "@body.weights"
clip = "@body.clip"
clip_skeleton = "@body.skeleton"
blending = "dual_quaternion"
every = 5
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (mesh, skeleton) = (io.get(Self::MESH), io.get(Self::SKELETON));
        let weights = io.get(Self::WEIGHTS);
        let (clip, note) = self.fitted(io, &skeleton)?;
        if !note.is_empty() {
            io.note(note);
        }
        let all = if self.frames.is_empty() {
            (0..clip.n_frames()).collect()
        } else {
            self.frames.clone()
        };
        let frames: Vec<usize> = all.into_iter().step_by(self.every).collect();
        let rate = clip.frames_per_second / self.every as f64;
        let motion = (&clip, &frames[..], rate);
        let sequence = animate(&mesh, &skeleton, &weights, motion, self.blending)?;
        io.put(Self::POSED, sequence.mesh(0)?);
        io.put(Self::SEQUENCE, sequence);
        io.put(Self::FITTED, clip);
        Ok(())
    }
}
