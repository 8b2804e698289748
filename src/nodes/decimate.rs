//! Kind `decimate`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{
    Input, Node, NodeError, NodeIo, OptionalInput, OptionalOutput, Output, Spec,
};
use crate::kernels::remeshing::decimate::{DecimateOptions, decimate};
use crate::kernels::{
    geometry::{landmarks::Landmarks, mesh::TriMesh},
    rigs::weights::SkinWeights,
};

/// Makes a mesh coarser by collapsing edges in the order of their quadric error.
///
/// Topology and boundaries stay. Landmarks stay where they are; weights are read off the old surface
/// at the closest points.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Decimate {
    /// The number of vertices to reach; a mesh that has fewer stays as it is.
    #[schemars(range(min = 4))]
    pub vertices: usize,
    /// How much dearer it is to leave a boundary than a face.
    #[serde(default = "default_boundary_weight")]
    #[schemars(range(min = 0.0, max = 1e6))]
    pub boundary_weight: f64,
}

fn default_boundary_weight() -> f64 {
    DecimateOptions::default().boundary_weight
}

impl Decimate {
    const MESH: Input<TriMesh> = Input::new("mesh", "the fine mesh");
    const WEIGHTS: OptionalInput<SkinWeights> = OptionalInput::new("weights", "its skin weights");
    const LANDMARKS: OptionalInput<Landmarks> =
        OptionalInput::new("landmarks", "its landmarks, which stay in place");
    const COARSE: Output<TriMesh> = Output::new("mesh", "the coarse mesh");
    const NEW_WEIGHTS: OptionalOutput<SkinWeights> =
        OptionalOutput::new("weights", "the skin weights of the coarse mesh");
    const NEW_LANDMARKS: OptionalOutput<Landmarks> =
        OptionalOutput::new("landmarks", "the landmarks on the coarse mesh");
}

impl Node for Decimate {
    const SPEC: Spec = Spec {
        kind: "decimate",
        version: 1,
        inputs: &[Self::MESH.port(), Self::WEIGHTS.port(), Self::LANDMARKS.port()],
        outputs: &[Self::COARSE.port(), Self::NEW_WEIGHTS.port(), Self::NEW_LANDMARKS.port()],
        cites: &["garland1997surface"],
        example: r#"[nodes.body]
kind = "synthesize"

[nodes.coarse]
kind = "decimate"
mesh = "@body.mesh"
weights = "@body.weights"
landmarks = "@body.landmarks"
vertices = 500
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let mesh = io.get(Self::MESH);
        let old_landmarks = io.get_optional(Self::LANDMARKS);
        let options = DecimateOptions {
            n_vertices: self.vertices,
            boundary_weight: self.boundary_weight,
            fixed: old_landmarks.as_ref().map_or_else(Vec::new, |it| it.vertices.clone()),
        };
        let coarse = decimate(&mesh, &options)?;
        let weights = io.get_optional(Self::WEIGHTS).map(|it| coarse.weights(&it)).transpose()?;
        let landmarks = old_landmarks.map(|it| coarse.landmarks(&it)).transpose()?;
        let n_reached = coarse.mesh.n_vertices();
        if n_reached > self.vertices {
            let n_wanted = self.vertices;
            io.note(format!("{n_reached} vertices instead of {n_wanted}: no edge may collapse"));
        }
        io.put(Self::COARSE, coarse.mesh);
        io.put_optional(Self::NEW_WEIGHTS, weights, "no weights were given");
        io.put_optional(Self::NEW_LANDMARKS, landmarks, "no landmarks were given");
        Ok(())
    }
}
