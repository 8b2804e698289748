//! Kind `skin_weights`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::rigs::skeleton::Skeleton;
use crate::kernels::rigs::skin_weights::{Leaves, SkinWeightsOptions, skin_weights};
use crate::kernels::rigs::weights::SkinWeights;

/// Computes skin weights from a mesh and a skeleton inside of it, by the equilibrium of heat.
///
/// Every vertex takes heat from the nearest bone that it sees and shares it with its neighbours
/// (Pinocchio). The mesh may be open or in several parts; a part that no heat reaches follows the
/// nearest bone.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SkinWeightsNode {
    /// How strongly vertices are bound to their nearest bone; larger is stiffer.
    pub heat: f64,
    /// The greatest angle between a vertex's normal and the line from a bone that it sees, in degrees.
    #[schemars(range(min = 1.0, max = 180.0))]
    pub cone_deg: f64,
    /// What joints without children move.
    pub leaves: Leaves,
}

impl Default for SkinWeightsNode {
    fn default() -> Self {
        let SkinWeightsOptions { heat, cone_deg, leaves, .. } = SkinWeightsOptions::default();
        Self { heat, cone_deg, leaves }
    }
}

impl SkinWeightsNode {
    const MESH: Input<TriMesh> = Input::new("mesh", "the surface");
    const SKELETON: Input<Skeleton> = Input::new("skeleton", "joints inside of it");
    const WEIGHTS: Output<SkinWeights> = Output::new("weights", "how joints move vertices");
}

impl Node for SkinWeightsNode {
    const SPEC: Spec = Spec {
        kind: "skin_weights",
        version: 1,
        inputs: &[Self::MESH.port(), Self::SKELETON.port()],
        outputs: &[Self::WEIGHTS.port()],
        cites: &["baran2007automatic"],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.skin]
kind = "skin_weights"
mesh = "@body.mesh"
skeleton = "@body.skeleton"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (mesh, skeleton) = (io.get(Self::MESH), io.get(Self::SKELETON));
        let Self { heat, cone_deg, leaves } = *self;
        let options = SkinWeightsOptions { heat, cone_deg, leaves, ..Default::default() };
        let res = skin_weights(&mesh, &skeleton, &options)?;
        if res.n_cold > 0 {
            io.note(format!(
                "{} of {} vertices belong to parts that see no bone; they follow the nearest one",
                res.n_cold,
                mesh.n_vertices()
            ));
        }
        io.put(Self::WEIGHTS, res.weights);
        Ok(())
    }
}
