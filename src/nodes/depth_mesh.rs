//! Kind `depth_mesh`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::sensors::depth::DepthVideo;
use crate::kernels::sensors::depth::mesh::depth_mesh;

/// Makes the surface that a frame of a depth video shows: neighbouring pixels joined to triangles.
///
/// In camera space (x right, y down, z forward), normals towards the camera.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DepthMesh {
    /// Which frame.
    pub frame: usize,
    /// The longest edge, in metres; longer ones are steps in depth.
    #[schemars(range(min = 0.0))]
    pub max_edge: f64,
    /// Only every so many columns and rows are used.
    #[schemars(range(min = 1, max = 64))]
    pub stride: usize,
}

impl Default for DepthMesh {
    fn default() -> Self {
        Self { frame: 0, max_edge: 0.05, stride: 1 }
    }
}

impl DepthMesh {
    const VIDEO: Input<DepthVideo> = Input::new("video", "the video, cut out");
    const MESH: Output<TriMesh> = Output::new("mesh", "the visible surface");
}

impl Node for DepthMesh {
    const SPEC: Spec = Spec {
        kind: "depth_mesh",
        version: 1,
        inputs: &[Self::VIDEO.port()],
        outputs: &[Self::MESH.port()],
        cites: &[],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.film]
kind = "render_depth"
mesh = "@body.mesh"
skeleton = "@body.skeleton"
weights = "@body.weights"
clip = "@body.clip"
frames = 3
width = 160
height = 120

[nodes.surface]
kind = "depth_mesh"
video = "@film.video"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let video = io.get(Self::VIDEO);
        let (mesh, _) = depth_mesh(&video, self.frame, self.max_edge, self.stride)?;
        io.put(Self::MESH, mesh);
        Ok(())
    }
}
