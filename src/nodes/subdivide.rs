//! Kind `subdivide`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{
    Input, Node, NodeError, NodeIo, OptionalInput, OptionalOutput, Output, Spec,
};
use crate::kernels::remeshing::subdivide::{Scheme, subdivide};
use crate::kernels::{
    geometry::{landmarks::Landmarks, mesh::TriMesh},
    rigs::weights::SkinWeights,
};

/// Makes a mesh finer: every triangle becomes four, once a level.
///
/// Old vertices keep their numbers, so landmarks stay valid; weights are refined by the same masks as
/// positions.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Subdivide {
    /// Where the new vertices lie.
    #[serde(default)]
    pub scheme: Scheme,
    /// How often every triangle is cut into four.
    #[serde(default = "one")]
    #[schemars(range(min = 1, max = 8))]
    pub levels: usize,
}

fn one() -> usize {
    1
}

impl Subdivide {
    const MESH: Input<TriMesh> = Input::new("mesh", "the coarse mesh");
    const WEIGHTS: OptionalInput<SkinWeights> = OptionalInput::new("weights", "its skin weights");
    const LANDMARKS: OptionalInput<Landmarks> = OptionalInput::new("landmarks", "its landmarks");
    const FINE: Output<TriMesh> = Output::new("mesh", "the fine mesh");
    const NEW_WEIGHTS: OptionalOutput<SkinWeights> =
        OptionalOutput::new("weights", "the skin weights of the fine mesh");
    const NEW_LANDMARKS: OptionalOutput<Landmarks> =
        OptionalOutput::new("landmarks", "the landmarks on the fine mesh");
}

impl Node for Subdivide {
    const SPEC: Spec = Spec {
        kind: "subdivide",
        version: 1,
        inputs: &[Self::MESH.port(), Self::WEIGHTS.port(), Self::LANDMARKS.port()],
        outputs: &[Self::FINE.port(), Self::NEW_WEIGHTS.port(), Self::NEW_LANDMARKS.port()],
        cites: &["loop1987smooth"],
        example: r#"[nodes.body]
kind = "synthesize"

[nodes.fine]
kind = "subdivide"
mesh = "@body.mesh"
weights = "@body.weights"
scheme = "midpoint"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let fine = subdivide(&io.get(Self::MESH), self.scheme, self.levels)?;
        let weights = io.get_optional(Self::WEIGHTS).map(|it| fine.weights(&it)).transpose()?;
        let landmarks =
            io.get_optional(Self::LANDMARKS).map(|it| fine.landmarks(&it)).transpose()?;
        io.put(Self::FINE, fine.mesh);
        io.put_optional(Self::NEW_WEIGHTS, weights, "no weights were given");
        io.put_optional(Self::NEW_LANDMARKS, landmarks, "no landmarks were given");
        Ok(())
    }
}
