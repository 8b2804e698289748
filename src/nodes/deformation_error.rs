//! Kind `deformation_error`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::geometry::mesh_sequence::MeshSequence;
use crate::kernels::motion::deformation_error::{FrameError, deformation_errors, height};
use crate::kernels::rigs::joint_error::HeightAxis;
use crate::kernels::table::{Column, Table};

/// Measures how far an animation is from the same mesh animated by its true rig.
///
/// Distances of vertices are in percent of the mesh's height at rest. An edge is torn if it is longer or
/// shorter than in truth by more than a factor.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DeformationErrorNode {
    /// What counts as the height.
    pub height: HeightAxis,
    /// The factor above which an edge counts as torn.
    #[schemars(range(min = 1.0))]
    pub max_stretch: f64,
}

impl Default for DeformationErrorNode {
    fn default() -> Self {
        Self { height: HeightAxis::default(), max_stretch: 1.5 }
    }
}

impl DeformationErrorNode {
    const ESTIMATE: Input<MeshSequence> = Input::new("estimate", "the animation to be judged");
    const TRUTH: Input<MeshSequence> = Input::new("truth", "the same mesh, moved by its true rig");
    const MESH: Input<TriMesh> = Input::new("mesh", "the mesh at rest");
    const FRAMES: Output<Table> = Output::new("frames", "one row a frame");
    const SUMMARY: Output<Table> = Output::new("summary", "one row for all frames");
}

impl Node for DeformationErrorNode {
    const SPEC: Spec = Spec {
        kind: "deformation_error",
        version: 1,
        inputs: &[Self::ESTIMATE.port(), Self::TRUTH.port(), Self::MESH.port()],
        outputs: &[Self::FRAMES.port(), Self::SUMMARY.port()],
        cites: &[],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.linear]
kind = "animate"
mesh = "@body.mesh"
skeleton = "@body.skeleton"
weights = "@body.weights"
clip = "@body.clip"
frames = [0, 5, 10]

[nodes.dual]
kind = "animate"
mesh = "@body.mesh"
skeleton = "@body.skeleton"
weights = "@body.weights"
clip = "@body.clip"
frames = [0, 5, 10]
blending = "dual_quaternion"

[nodes.error]
kind = "deformation_error"
estimate = "@dual.sequence"
truth = "@linear.sequence"
mesh = "@body.mesh"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let mesh = io.get(Self::MESH);
        let (estimate, truth) = (io.get(Self::ESTIMATE), io.get(Self::TRUTH));
        let errors = deformation_errors(&estimate, &truth, &mesh, self.max_stretch)?;
        let height = height(&mesh, self.height)?;
        io.put(Self::FRAMES, frames_table(&errors, height));
        io.put(Self::SUMMARY, summary_table(&errors, height));
        Ok(())
    }
}

fn frames_table(errors: &[FrameError], height: f64) -> Table {
    let numbers = |of: &dyn Fn(&FrameError) -> f64| errors.iter().map(of).collect();
    Table::new(vec![
        Column::numbers("frame", "", (0..errors.len()).map(|it| it as f64).collect()),
        Column::numbers("mean", "%", numbers(&|it| 100.0 * it.mean / height)),
        Column::numbers("max", "%", numbers(&|it| 100.0 * it.largest / height)),
        Column::numbers("torn edges", "%", numbers(&|it| 100.0 * it.outliers)),
        Column::numbers("max stretch", "", numbers(&|it| it.stretch)),
    ])
}

fn summary_table(errors: &[FrameError], height: f64) -> Table {
    let mean =
        |of: fn(&FrameError) -> f64| errors.iter().map(of).sum::<f64>() / errors.len() as f64;
    let greatest = |of: fn(&FrameError) -> f64| errors.iter().map(of).fold(0.0, f64::max);
    let column = |name, unit, value| Column::numbers(name, unit, vec![value]);
    Table::new(vec![
        column("frames", "", errors.len() as f64),
        column("mean", "%", 100.0 * mean(|it| it.mean) / height),
        column("max", "%", 100.0 * greatest(|it| it.largest) / height),
        column("torn edges", "%", 100.0 * mean(|it| it.outliers)),
        column("max stretch", "", greatest(|it| it.stretch)),
    ])
}
