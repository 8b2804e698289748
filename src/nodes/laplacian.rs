//! Kind `laplacian`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::laplacian::{MassLumping, cotangent_laplacian};
use crate::kernels::{mesh::TriMesh, operator::Operator};

/// Assembles the cotangent Laplace-Beltrami operator of a mesh.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Laplacian {
    /// How the area of the faces is shared out among the vertices.
    #[serde(default)]
    pub mass: Mass,
}

#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Mass {
    /// Voronoi cells, safe at obtuse triangles (Meyer et al. 2003).
    #[default]
    Voronoi,
    /// A third of every face to each of its corners.
    Barycentric,
}

impl Laplacian {
    const MESH: Input<TriMesh> = Input::new("mesh", "the surface");
    const OPERATOR: Output<Operator> = Output::new("operator", "stiffness and lumped masses");
}

impl Node for Laplacian {
    const SPEC: Spec = Spec {
        kind: "laplacian",
        version: 1,
        inputs: &[Self::MESH.port()],
        outputs: &[Self::OPERATOR.port()],
        cites: &["pinkall1993computing", "meyer2003discrete"],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.laplacian]
kind = "laplacian"
mesh = "@body.mesh"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let lumping = match self.mass {
            Mass::Voronoi => MassLumping::MixedVoronoi,
            Mass::Barycentric => MassLumping::Barycentric,
        };
        let operator = cotangent_laplacian(&io.get(Self::MESH), lumping)?;
        io.put(Self::OPERATOR, operator);
        Ok(())
    }
}
