//! Kind `motion_error`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, OptionalInput, Output, Spec};
use crate::kernels::geometry::mesh_sequence::MeshSequence;
use crate::kernels::motion::motion_error::{MotionErrors, motion_errors};
use crate::kernels::table::{Column, Table};

/// Measures how far a transferred motion is from the true one, and how many joints found a place.
///
/// The reconstruction error is the root of the mean squared distance of vertices, the local pose error
/// the same after the best rigid motion of every frame: in the unit of the truth, and with the
/// character scaled so that its bounding box at first has a diagonal of 2, as Transfer4D gives them.
#[derive(Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MotionErrorNode {}

impl MotionErrorNode {
    const ESTIMATE: Input<MeshSequence> = Input::new("estimate", "the mesh moved by a transfer");
    const TRUTH: Input<MeshSequence> =
        Input::new("truth", "how it should move: the same vertices and frames");
    const JOINTS: OptionalInput<Table> = OptionalInput::new(
        "joints",
        "the table of `embed`, with a row a joint and a column `matched`",
    );
    const FRAMES: Output<Table> = Output::new("frames", "one row a frame");
    const SUMMARY: Output<Table> = Output::new("summary", "one row over all frames");
}

impl Node for MotionErrorNode {
    const SPEC: Spec = Spec {
        kind: "motion_error",
        version: 1,
        inputs: &[Self::ESTIMATE.port(), Self::TRUTH.port(), Self::JOINTS.port()],
        outputs: &[Self::FRAMES.port(), Self::SUMMARY.port()],
        cites: &["maheshwari2023transfer4d"],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.linear]
kind = "animate"
mesh = "@body.mesh"
skeleton = "@body.skeleton"
weights = "@body.weights"
clip = "@body.clip"
every = 8

[nodes.quaternions]
kind = "animate"
mesh = "@body.mesh"
skeleton = "@body.skeleton"
weights = "@body.weights"
clip = "@body.clip"
every = 8
blending = "dual_quaternion"

[nodes.error]
kind = "motion_error"
estimate = "@linear.sequence"
truth = "@quaternions.sequence"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let errors = motion_errors(&io.get(Self::ESTIMATE), &io.get(Self::TRUTH))?;
        let both = [
            ("reconstruction error", &errors.reconstruction),
            ("local pose error", &errors.local_pose),
        ];
        let scaled = |it: &[f64]| it.iter().map(|it| it * errors.scale).collect::<Vec<f64>>();
        let n_frames = errors.reconstruction.len();
        let mut frames =
            vec![Column::numbers("frame", "", (0..n_frames).map(|it| it as f64).collect())];
        let mut summary = vec![];
        if let Some(joints) = io.get_optional(Self::JOINTS) {
            let matched = joints.numbers("matched", "the share of matched joints")?;
            let n_matched = matched.iter().filter(|it| **it > 0.0).count() as f64;
            let share = 100.0 * n_matched / matched.len() as f64;
            summary.push(Column::numbers("joints", "", vec![matched.len() as f64]));
            summary.push(Column::numbers("embedded", "%", vec![share]));
        }
        for (name, values) in both {
            frames.push(Column::numbers(name, "", values.clone()));
            summary.push(Column::numbers(name, "", vec![MotionErrors::overall(values)]));
        }
        for (name, values) in both {
            let (name, values) = (format!("{name} at diagonal 2"), scaled(values));
            summary.push(Column::numbers(&name, "", vec![MotionErrors::overall(&values)]));
            frames.push(Column::numbers(&name, "", values));
        }
        io.put(Self::FRAMES, Table::new(frames));
        io.put(Self::SUMMARY, Table::new(summary));
        Ok(())
    }
}
