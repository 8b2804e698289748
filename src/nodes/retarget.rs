//! Kind `retarget`.

use nalgebra::UnitQuaternion;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, OptionalInput, Output, Spec};
use crate::kernels::geometry::kabsch::best_rotation;
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::motion::retarget_bones::{
    BoneMotion, RetargetOptions, RootMotion, retarget_bones,
};
use crate::kernels::rigs::clip::Clip;
use crate::kernels::rigs::skeleton::Skeleton;

/// Moves a skeleton like another one, from where the other's joints are.
///
/// Bones are matched by the names of their ends (as `embed` keeps them). Lengths of the target's bones
/// stay; twist about bones is lost. A `rig` takes the clip as it is with `fit_clip = false`.
#[derive(Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RetargetNode {
    /// How bones are turned; Transfer4D writes `absolute`.
    pub bones: BoneMotion,
    /// How the root moves.
    pub root: RootMotion,
}

impl RetargetNode {
    const SOURCE: Input<Skeleton> = Input::new("source_skeleton", "the joints that the clip moves");
    const CLIP: Input<Clip> = Input::new("clip", "the motion of the source");
    const TARGET: Input<Skeleton> = Input::new("target_skeleton", "the joints to be moved");
    const TURNED: OptionalInput<Skeleton> = OptionalInput::new(
        "turned",
        "the source's joints as `embed` turned them to fit the target: the motion is turned alike",
    );
    const RESULT: Output<Clip> = Output::new("clip", "the motion of the target");
}

impl Node for RetargetNode {
    const SPEC: Spec = Spec {
        kind: "retarget",
        version: 1,
        inputs: &[Self::SOURCE.port(), Self::CLIP.port(), Self::TARGET.port(), Self::TURNED.port()],
        outputs: &[Self::RESULT.port()],
        cites: &["maheshwari2023transfer4d"],
        example: r#"[nodes.adult]
kind = "synthesize"
n_vertices = 1000

[nodes.other]
kind = "synthesize"
n_vertices = 1000
seed = 1

[nodes.walk]
kind = "retarget"
source_skeleton = "@adult.skeleton"
clip = "@adult.clip"
target_skeleton = "@other.skeleton"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (source, clip) = (io.get(Self::SOURCE), io.get(Self::CLIP));
        let target = io.get(Self::TARGET);
        let (source, clip) = match io.get_optional(Self::TURNED) {
            Some(turned) => {
                let clip = clip.turned(&rotation_between(&source, &turned)?);
                (turned, std::sync::Arc::new(clip))
            }
            None => (source, clip),
        };
        let options = RetargetOptions { bones: self.bones, root: self.root };
        let res = retarget_bones(&source, &clip, &target, &options)?;
        if !res.without_source.is_empty() {
            io.note(format!(
                "{} joints of the target are none of the source's and follow their parents: {}",
                res.without_source.len(),
                res.without_source.join(", ")
            ));
        }
        io.put(Self::RESULT, res.clip);
        Ok(())
    }
}

/// How a skeleton was turned.
fn rotation_between(given: &Skeleton, turned: &Skeleton) -> Result<UnitQuaternion<f64>, NodeError> {
    if given.names() != turned.names() {
        return Err(NodeError::failed(format!(
            "`turned` has {} joints and `source_skeleton` {}, or other names",
            turned.n_joints(),
            given.n_joints()
        )));
    }
    let mean = |it: &Skeleton| it.positions().iter().sum::<Vec3>() / it.n_joints() as f64;
    let (a, b) = (mean(given), mean(turned));
    let pairs = given.positions().iter().zip(turned.positions());
    Ok(best_rotation(&pairs.map(|(from, to)| (to - b) * (from - a).transpose()).sum()))
}
