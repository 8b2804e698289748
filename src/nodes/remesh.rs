//! Kind `remesh`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{
    Input, Node, NodeError, NodeIo, OptionalInput, OptionalOutput, Output, Spec,
};
use crate::kernels::remeshing::remesh_surface::{
    self as kernel, RemeshSurfaceOptions, remesh_surface,
};
use crate::kernels::{
    geometry::{landmarks::Landmarks, mesh::TriMesh},
    rigs::weights::SkinWeights,
};

/// Covers a closed surface with other triangles, in random order: independent connectivity.
///
/// Edges are shorter than `sizing` says where the surface bends to a smaller radius, as at fingers.
/// Weights are read off the old surface at the closest points; landmarks go to the nearest new
/// vertices. `clean` with `fill_holes` closes what is open.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Remesh {
    /// The number of vertices.
    #[schemars(range(min = 4, max = 1_000_000))]
    pub vertices: usize,
    /// How edge lengths vary.
    #[serde(default)]
    pub sizing: Sizing,
    /// Decides on the order of vertices and on irregular lengths.
    #[serde(default)]
    pub seed: u64,
}

/// How edge lengths vary over a surface.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Sizing {
    /// One length everywhere.
    #[default]
    Isotropic,
    /// Shorter where the surface bends.
    Adaptive,
    /// Lengths that change without reason, by a factor of about three.
    Irregular,
}

impl Remesh {
    const MESH: Input<TriMesh> = Input::new("mesh", "a closed surface");
    const WEIGHTS: OptionalInput<SkinWeights> = OptionalInput::new("weights", "its skin weights");
    const LANDMARKS: OptionalInput<Landmarks> = OptionalInput::new("landmarks", "its landmarks");
    const MADE: Output<TriMesh> = Output::new("mesh", "the new mesh");
    const NEW_WEIGHTS: OptionalOutput<SkinWeights> =
        OptionalOutput::new("weights", "the skin weights of the new mesh");
    const NEW_LANDMARKS: OptionalOutput<Landmarks> =
        OptionalOutput::new("landmarks", "the landmarks on the new mesh");
}

impl Node for Remesh {
    const SPEC: Spec = Spec {
        kind: "remesh",
        version: 2,
        inputs: &[Self::MESH.port(), Self::WEIGHTS.port(), Self::LANDMARKS.port()],
        outputs: &[Self::MADE.port(), Self::NEW_WEIGHTS.port(), Self::NEW_LANDMARKS.port()],
        cites: &["botsch2004remeshing"],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.other]
kind = "remesh"
mesh = "@body.mesh"
weights = "@body.weights"
landmarks = "@body.landmarks"
vertices = 700
sizing = "irregular"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let sizing = match self.sizing {
            Sizing::Isotropic => kernel::Sizing::Isotropic,
            Sizing::Adaptive => kernel::Sizing::Adaptive,
            Sizing::Irregular => kernel::Sizing::Irregular,
        };
        let options = RemeshSurfaceOptions { n_vertices: self.vertices, sizing, seed: self.seed };
        let made = remesh_surface(&io.get(Self::MESH), &options)?;
        let weights = io.get_optional(Self::WEIGHTS).map(|it| made.weights(&it)).transpose()?;
        let landmarks = io.get_optional(Self::LANDMARKS).map(|it| made.landmarks(&it));
        let landmarks = landmarks.transpose()?;
        let n_reached = made.mesh.n_vertices();
        if n_reached != self.vertices {
            io.note(format!("{n_reached} vertices instead of {}", self.vertices));
        }
        io.put(Self::MADE, made.mesh);
        io.put_optional(Self::NEW_WEIGHTS, weights, "no weights were given");
        io.put_optional(Self::NEW_LANDMARKS, landmarks, "no landmarks were given");
        Ok(())
    }
}
