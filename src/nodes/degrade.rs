//! Kind `degrade`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{
    Input, Node, NodeError, NodeIo, OptionalInput, OptionalOutput, Output, Spec,
};
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::synthetic::degrade::{DegradeOptions, degrade};
use crate::kernels::{
    geometry::{landmarks::Landmarks, mesh::TriMesh},
    rigs::weights::SkinWeights,
};

/// Makes a mesh as bad as a scan: clothes, grown-together parts, hidden sides, holes, noise.
///
/// In this order. Landmarks keep their place and their surroundings: clothes stay away from them and
/// holes spare them.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Degrade {
    /// How far clothes stand off the body, over the square root of its area; 0.02 is a wide coat.
    #[schemars(range(min = 0.0, max = 0.2))]
    pub clothes: f64,
    /// The number of places where parts that come near each other are joined by a tube.
    pub bridges: usize,
    /// Directions from the shape to cameras far away; what none of them sees is removed.
    pub visible_from: Vec<[f64; 3]>,
    /// The number of round holes.
    pub holes: usize,
    /// Their radius, over the square root of the area.
    #[schemars(range(min = 0.0, max = 0.5))]
    pub hole_radius: f64,
    /// The standard deviation of displacements along the normals, over the mean length of edges.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub noise: f64,
    /// Decides on folds, places of holes and noise.
    pub seed: u64,
}

impl Default for Degrade {
    fn default() -> Self {
        Self {
            clothes: 0.0,
            bridges: 0,
            visible_from: Vec::new(),
            holes: 0,
            hole_radius: 0.035,
            noise: 0.0,
            seed: 0,
        }
    }
}

impl Degrade {
    const MESH: Input<TriMesh> = Input::new("mesh", "the good mesh");
    const WEIGHTS: OptionalInput<SkinWeights> = OptionalInput::new("weights", "its skin weights");
    const LANDMARKS: OptionalInput<Landmarks> = OptionalInput::new("landmarks", "its landmarks");
    const MADE: Output<TriMesh> = Output::new("mesh", "the bad mesh");
    const NEW_WEIGHTS: OptionalOutput<SkinWeights> =
        OptionalOutput::new("weights", "the skin weights of what is left");
    const NEW_LANDMARKS: OptionalOutput<Landmarks> =
        OptionalOutput::new("landmarks", "the landmarks on what is left");
}

impl Node for Degrade {
    const SPEC: Spec = Spec {
        kind: "degrade",
        version: 2,
        inputs: &[Self::MESH.port(), Self::WEIGHTS.port(), Self::LANDMARKS.port()],
        outputs: &[Self::MADE.port(), Self::NEW_WEIGHTS.port(), Self::NEW_LANDMARKS.port()],
        cites: &[],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 2000

[nodes.scan]
kind = "degrade"
mesh = "@body.mesh"
weights = "@body.weights"
landmarks = "@body.landmarks"
clothes = 0.01
bridges = 1
holes = 2
noise = 0.1
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let landmarks = io.get_optional(Self::LANDMARKS);
        let options = DegradeOptions {
            clothes: self.clothes,
            n_bridges: self.bridges,
            visible_from: self.visible_from.iter().map(|&it| Vec3::from(it)).collect(),
            n_holes: self.holes,
            hole_radius: self.hole_radius,
            noise: self.noise,
            seed: self.seed,
        };
        let protected = landmarks.as_ref().map_or(&[][..], |it| &it.vertices);
        let made = degrade(&io.get(Self::MESH), protected, &options)?;
        let weights = io.get_optional(Self::WEIGHTS).map(|it| made.weights(&it)).transpose()?;
        let landmarks = landmarks.map(|it| made.landmarks(&it)).transpose()?;
        io.put(Self::MADE, made.mesh);
        io.put_optional(Self::NEW_WEIGHTS, weights, "no weights were given");
        io.put_optional(Self::NEW_LANDMARKS, landmarks, "no landmarks were given");
        Ok(())
    }
}
