//! Kind `landmark_error`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::geometry::landmarks::Landmarks;
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::maps::landmark_error::{LandmarkErrors, landmark_errors};
use crate::kernels::rigs::joint_error::HeightAxis;
use crate::kernels::table::{Column, Table};

/// Measures how far landmarks are from the true ones, and whether left and right (or front and back)
/// are swapped.
///
/// Landmarks are matched by name; distances are Euclidean, in mesh units and in percent of the mesh's
/// height. A landmark counts as swapped if the true place of its counterpart is nearer than its own.
#[derive(Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LandmarkError {
    /// What counts as the height.
    pub height: HeightAxis,
    /// The unit that tables show, such as `m`.
    pub unit: String,
}

impl LandmarkError {
    const ESTIMATE: Input<Landmarks> = Input::new("estimate", "the landmarks to be judged");
    const TRUTH: Input<Landmarks> = Input::new("truth", "the true landmarks of the same mesh");
    const MESH: Input<TriMesh> = Input::new("mesh", "the mesh that both lie on");
    const LANDMARKS: Output<Table> = Output::new("landmarks", "one row a landmark");
    const SUMMARY: Output<Table> = Output::new("summary", "one row: mean, greatest, swaps");
}

impl Node for LandmarkError {
    const SPEC: Spec = Spec {
        kind: "landmark_error",
        version: 1,
        inputs: &[Self::ESTIMATE.port(), Self::TRUTH.port(), Self::MESH.port()],
        outputs: &[Self::LANDMARKS.port(), Self::SUMMARY.port()],
        cites: &[],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.found]
kind = "landmarks_auto"
mesh = "@body.mesh"

[nodes.score]
kind = "landmark_error"
estimate = "@found.landmarks"
truth = "@body.landmarks"
mesh = "@body.mesh"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (estimate, truth) = (io.get(Self::ESTIMATE), io.get(Self::TRUTH));
        let errors = landmark_errors(&estimate, &truth, &io.get(Self::MESH), self.height)?;
        if !errors.unmatched.is_empty() {
            io.note(format!("without a counterpart: {}", errors.unmatched.join(", ")));
        }
        io.put(Self::LANDMARKS, self.landmarks_table(&errors));
        io.put(Self::SUMMARY, self.summary_table(&errors));
        Ok(())
    }
}

impl LandmarkError {
    fn landmarks_table(&self, errors: &LandmarkErrors) -> Table {
        let percents = errors.distances.iter().map(|it| 100.0 * it / errors.height).collect();
        let swaps = errors.is_swapped.iter().map(|&it| f64::from(u8::from(it))).collect();
        Table::new(vec![
            Column::texts("landmark", errors.names.clone()),
            Column::numbers("error", &self.unit, errors.distances.clone()),
            Column::numbers("error of height", "%", percents),
            Column::numbers("swapped", "", swaps),
        ])
    }

    fn summary_table(&self, errors: &LandmarkErrors) -> Table {
        let count = errors.distances.len() as f64;
        let mean = errors.distances.iter().sum::<f64>() / count;
        let greatest = errors.distances.iter().fold(0.0_f64, |a, &b| a.max(b));
        let swaps = errors.is_swapped.iter().filter(|it| **it).count() as f64;
        let length = |name, value| Column::numbers(name, &self.unit, vec![value]);
        let percent =
            |name, value: f64| Column::numbers(name, "%", vec![100.0 * value / errors.height]);
        Table::new(vec![
            Column::numbers("landmarks", "", vec![count]),
            length("mean", mean),
            length("max", greatest),
            percent("mean of height", mean),
            percent("max of height", greatest),
            Column::numbers("swaps", "", vec![swaps]),
        ])
    }
}
