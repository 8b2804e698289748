//! Kind `pick_frame`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::geometry::mesh_sequence::MeshSequence;

/// Takes one frame of a mesh sequence.
#[derive(Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PickFrame {
    /// Which frame; negative numbers count from the end.
    pub frame: i64,
    /// Whether camera space (y down, z forward) is turned upright, to +y up and +z towards the camera.
    pub upright: bool,
}

impl PickFrame {
    const SEQUENCE: Input<MeshSequence> = Input::new("sequence", "the mesh in motion");
    const MESH: Output<TriMesh> = Output::new("mesh", "the mesh as it is then");
}

impl Node for PickFrame {
    const SPEC: Spec = Spec {
        kind: "pick_frame",
        version: 1,
        inputs: &[Self::SEQUENCE.port()],
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

[nodes.last]
kind = "pick_frame"
sequence = "@film.truth"
frame = -1
upright = true
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let sequence = io.get(Self::SEQUENCE);
        let n_frames = sequence.n_frames() as i64;
        let frame = if self.frame < 0 { self.frame.saturating_add(n_frames) } else { self.frame };
        if !(0..n_frames).contains(&frame) {
            let asked = self.frame;
            return Err(NodeError::failed(format!("`frame` is {asked} of {n_frames} frames")));
        }
        let mesh = sequence.mesh(frame as usize)?;
        let mesh = match self.upright {
            true => {
                let turned = |it: &Vec3| Vec3::new(it.x, -it.y, -it.z);
                mesh.with_vertices(mesh.vertices().iter().map(turned).collect())?
            }
            false => mesh,
        };
        io.put(Self::MESH, mesh);
        Ok(())
    }
}
