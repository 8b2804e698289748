//! Kind `normalize`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{
    Input, Node, NodeError, NodeIo, OptionalInput, OptionalOutput, Output, Spec,
};
use crate::kernels::remeshing::normalize::{UnitSize, normalize};
use crate::kernels::{geometry::mesh::TriMesh, rigs::skeleton::Skeleton};

/// Moves a mesh's area centroid to the origin and scales it to a unit size.
///
/// A skeleton that is given moves with it.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Normalize {
    /// What becomes one.
    #[serde(default)]
    pub unit: UnitSize,
}

impl Normalize {
    const MESH: Input<TriMesh> = Input::new("mesh", "the mesh to move and scale");
    const SKELETON: OptionalInput<Skeleton> = OptionalInput::new("skeleton", "its skeleton");
    const NORMALIZED: Output<TriMesh> = Output::new("mesh", "the mesh, centred and of unit size");
    const MOVED: OptionalOutput<Skeleton> =
        OptionalOutput::new("skeleton", "the skeleton, moved and scaled alike");
}

impl Node for Normalize {
    const SPEC: Spec = Spec {
        kind: "normalize",
        version: 1,
        inputs: &[Self::MESH.port(), Self::SKELETON.port()],
        outputs: &[Self::NORMALIZED.port(), Self::MOVED.port()],
        cites: &[],
        example: r#"[nodes.body]
kind = "synthesize"

[nodes.unit]
kind = "normalize"
mesh = "@body.mesh"
skeleton = "@body.skeleton"
unit = "height"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (mesh, similarity) = normalize(&io.get(Self::MESH), self.unit)?;
        let moved = |skeleton: &Skeleton| {
            let positions = skeleton.positions().iter().map(|it| similarity.apply(it));
            skeleton.with_positions(positions.collect())
        };
        let skeleton = io.get_optional(Self::SKELETON).map(|it| moved(&it)).transpose()?;
        let offset = similarity.offset;
        io.note(format!(
            "scaled by {:.6}, then moved by {:.6} {:.6} {:.6}",
            similarity.scale, offset.x, offset.y, offset.z
        ));
        io.put(Self::NORMALIZED, mesh);
        io.put_optional(Self::MOVED, skeleton, "no skeleton was given");
        Ok(())
    }
}
