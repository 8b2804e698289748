//! Kind `rooted_skeleton`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::curve_skeletons::curve_skeleton::CurveSkeleton;
use crate::kernels::curve_skeletons::rooted_skeleton::rooted_skeleton;
use crate::kernels::rigs::skeleton::Skeleton;

/// Makes a skeleton of named joints from a curve skeleton: with a root and parents.
///
/// The root is the junction that is nearest to the mean of all nodes, or the middle of a curve without
/// junctions. Every component gets a root; cycles open opposite to theirs.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RootedSkeleton {
    /// Which nodes become joints.
    #[serde(default)]
    pub joints: Joints,
}

/// Which nodes become joints.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Joints {
    #[default]
    All,
    /// Roots, junctions and leaves.
    Branching,
}

impl RootedSkeleton {
    const CURVES: Input<CurveSkeleton> = Input::new("curves", "a curve skeleton");
    const SKELETON: Output<Skeleton> = Output::new("skeleton", "its joints, parents first");
}

impl Node for RootedSkeleton {
    const SPEC: Spec = Spec {
        kind: "rooted_skeleton",
        version: 1,
        inputs: &[Self::CURVES.port()],
        outputs: &[Self::SKELETON.port()],
        cites: &[],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1500

[nodes.skeletonize]
kind = "skeletonize"
mesh = "@body.mesh"

[nodes.skeleton]
kind = "rooted_skeleton"
curves = "@skeletonize.curves"
joints = "branching"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let curves = io.get(Self::CURVES);
        let rooted = rooted_skeleton(&curves, matches!(self.joints, Joints::Branching))?;
        io.put(Self::SKELETON, rooted.skeleton);
        Ok(())
    }
}
