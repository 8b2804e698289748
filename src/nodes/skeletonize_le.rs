//! Kind `skeletonize_le`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, OptionalInput, Output, Spec};
use crate::kernels::curve_skeletons::skeleton_baselines::Moving;
use crate::kernels::curve_skeletons::skeleton_baselines::le::{LeOptions, skeletonize_le};
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::geometry::mesh_sequence::MeshSequence;
use crate::kernels::rigs::clip::Clip;
use crate::kernels::rigs::skeleton::Skeleton;
use crate::kernels::rigs::weights::SkinWeights;
use crate::kernels::table::Table;

/// Finds a skeleton in a moving surface by joining the bones of a skinning decomposition.
///
/// A baseline of Transfer4D's Table 1 (Le & Deng 2014): bones as `ssdr` finds them, fewer and fewer,
/// and joints where two bones that share vertices turn about a common place. A joint without weights
/// ends every outer bone.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SkeletonizeLe {
    /// How many bones stay at most. There are more joints: every outer bone has one at its end.
    #[schemars(range(min = 1, max = 1000))]
    pub n_bones: usize,
    /// How many bones there are at first.
    #[schemars(range(min = 1, max = 1000))]
    pub first_bones: usize,
    /// Bones with less than this share of the largest sum of squared weights go.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub least_share: f64,
    /// How strongly joints are pulled to the middle of the border of their bones.
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub pull: f64,
    /// The most rounds of the first decomposition.
    #[schemars(range(min = 1, max = 10_000))]
    pub iterations: usize,
    /// Rounds after each bone that was removed.
    #[schemars(range(min = 1, max = 10_000))]
    pub refits: usize,
}

impl Default for SkeletonizeLe {
    fn default() -> Self {
        let it = LeOptions::default();
        Self {
            n_bones: it.n_bones,
            first_bones: it.first_bones,
            least_share: it.least_share,
            pull: it.pull,
            iterations: it.iterations,
            refits: it.refits,
        }
    }
}

impl SkeletonizeLe {
    const SEQUENCE: Input<MeshSequence> = Input::new("sequence", "the tracked surface in motion");
    const REST: OptionalInput<TriMesh> =
        OptionalInput::new("rest", "its rest pose; without it the first frame");
    const SKELETON: Output<Skeleton> = Output::new("skeleton", "the joints at rest");
    const CLIP: Output<Clip> =
        Output::new("clip", "where the joints go; only positions, rotations are the identity");
    const WEIGHTS: Output<SkinWeights> =
        Output::new("weights", "how bones move vertices, each at the joint above it");
    const SUMMARY: Output<Table> = Output::new("summary", "one row: joints, error");
}

impl Node for SkeletonizeLe {
    const SPEC: Spec = Spec {
        kind: "skeletonize_le",
        version: 2,
        inputs: &[Self::SEQUENCE.port(), Self::REST.port()],
        outputs: &[
            Self::SKELETON.port(),
            Self::CLIP.port(),
            Self::WEIGHTS.port(),
            Self::SUMMARY.port(),
        ],
        cites: &["le2014robust", "maheshwari2023transfer4d"],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.walk]
kind = "animate"
mesh = "@body.mesh"
skeleton = "@body.skeleton"
weights = "@body.weights"
clip = "@body.clip"
every = 6

[nodes.bones]
kind = "skeletonize_le"
sequence = "@walk.sequence"
rest = "@body.mesh"
n_bones = 8
first_bones = 12
iterations = 2
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (sequence, rest) = (io.get(Self::SEQUENCE), io.get_optional(Self::REST));
        let options = LeOptions {
            n_bones: self.n_bones,
            first_bones: self.first_bones,
            least_share: self.least_share,
            pull: self.pull,
            iterations: self.iterations,
            refits: self.refits,
        };
        let found = skeletonize_le(&Moving::new(&sequence, rest.as_deref())?, &options)?;
        io.put(Self::SUMMARY, found.summary());
        io.put(Self::SKELETON, found.skeleton);
        io.put(Self::CLIP, found.clip);
        io.put(Self::WEIGHTS, found.weights);
        Ok(())
    }
}
