//! Kind `simplify_skeleton`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{
    Input, Node, NodeError, NodeIo, OptionalInput, OptionalOutput, Output, Spec,
};
use crate::kernels::rigs::clip::Clip;
use crate::kernels::rigs::simplify_skeleton::{JointChoice, simplify_skeleton};
use crate::kernels::rigs::skeleton::Skeleton;
use crate::kernels::rigs::weights::SkinWeights;

/// Leaves joints out of a rig.
///
/// What hangs on a joint that goes is hung on the nearest ancestor that stays, which also takes over
/// its skin weights. In a clip, the joints that stay move as before. Joints are chosen by their names,
/// or by patterns with `*`, `?` and `[…]`.
#[derive(Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SimplifySkeleton {
    /// The joints that stay; all if it is left out.
    pub keep: Vec<String>,
    /// The joints that go, among those.
    pub remove: Vec<String>,
}

impl SimplifySkeleton {
    const SKELETON: Input<Skeleton> = Input::new("skeleton", "all joints");
    const WEIGHTS: OptionalInput<SkinWeights> =
        OptionalInput::new("weights", "how they move a mesh");
    const CLIP: OptionalInput<Clip> = OptionalInput::new("clip", "a motion of all joints");
    const FEWER: Output<Skeleton> = Output::new("skeleton", "the joints that stay");
    const FEWER_WEIGHTS: OptionalOutput<SkinWeights> =
        OptionalOutput::new("weights", "how they move the mesh");
    const FEWER_CLIP: OptionalOutput<Clip> =
        OptionalOutput::new("clip", "the motion of the joints that stay");
}

impl Node for SimplifySkeleton {
    const SPEC: Spec = Spec {
        kind: "simplify_skeleton",
        version: 1,
        inputs: &[Self::SKELETON.port(), Self::WEIGHTS.port(), Self::CLIP.port()],
        outputs: &[Self::FEWER.port(), Self::FEWER_WEIGHTS.port(), Self::FEWER_CLIP.port()],
        cites: &[],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.simple]
kind = "simplify_skeleton"
skeleton = "@body.skeleton"
weights = "@body.weights"
clip = "@body.clip"
remove = ["*hand*", "*foot*"]
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let skeleton = io.get(Self::SKELETON);
        let choice = JointChoice { keep: self.keep.clone(), remove: self.remove.clone() };
        let simple = simplify_skeleton(&skeleton, &choice)?;
        let weights = io.get_optional(Self::WEIGHTS);
        let weights = weights.map(|it| simple.weights(&it)).transpose()?;
        let clip = io.get_optional(Self::CLIP).map(|it| simple.clip(&it)).transpose()?;
        io.put_optional(Self::FEWER_WEIGHTS, weights, "no `weights` are wired");
        io.put_optional(Self::FEWER_CLIP, clip, "no `clip` is wired");
        io.put(Self::FEWER, simple.skeleton);
        Ok(())
    }
}
