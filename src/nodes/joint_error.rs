//! Kind `joint_error`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::rigs::joint_error::{HeightAxis, JointErrors, joint_errors};
use crate::kernels::rigs::skeleton::Skeleton;
use crate::kernels::table::{Column, Table};

/// Measures how far estimated joints are from the true ones.
///
/// Joints are matched by name; distances are Euclidean, in mesh units and in percent of the mesh's
/// height.
#[derive(Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct JointError {
    /// What counts as the height.
    pub height: HeightAxis,
    /// The unit that tables show, such as `m`.
    pub unit: String,
}

impl JointError {
    const ESTIMATE: Input<Skeleton> = Input::new("estimate", "the joints to be judged");
    const TRUTH: Input<Skeleton> = Input::new("truth", "the true joints of the same shape");
    const MESH: Input<TriMesh> = Input::new("mesh", "the shape, for its height");
    const JOINTS: Output<Table> = Output::new("joints", "one row a joint");
    const SUMMARY: Output<Table> = Output::new("summary", "one row: mean, least, greatest");
}

impl Node for JointError {
    const SPEC: Spec = Spec {
        kind: "joint_error",
        version: 1,
        inputs: &[Self::ESTIMATE.port(), Self::TRUTH.port(), Self::MESH.port()],
        outputs: &[Self::JOINTS.port(), Self::SUMMARY.port()],
        cites: &[],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.score]
kind = "joint_error"
estimate = "@body.skeleton"
truth = "@body.skeleton"
mesh = "@body.mesh"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (estimate, truth) = (io.get(Self::ESTIMATE), io.get(Self::TRUTH));
        let errors = joint_errors(&estimate, &truth, &io.get(Self::MESH), self.height)?;
        for (whose, names) in
            [("the estimate", &errors.only_estimate), ("the truth", &errors.only_truth)]
        {
            if !names.is_empty() {
                io.note(format!("{} joints only in {whose}: {}", names.len(), names.join(", ")));
            }
        }
        io.put(Self::JOINTS, self.joints_table(&errors));
        io.put(Self::SUMMARY, self.summary_table(&errors));
        Ok(())
    }
}

impl JointError {
    fn joints_table(&self, errors: &JointErrors) -> Table {
        let percents = errors.distances.iter().map(|&it| errors.percent(it)).collect();
        Table::new(vec![
            Column::texts("joint", errors.names.clone()),
            Column::numbers("error", &self.unit, errors.distances.clone()),
            Column::numbers("error of height", "%", percents),
        ])
    }

    fn summary_table(&self, errors: &JointErrors) -> Table {
        let square_unit = match self.unit.as_str() {
            "" => String::new(),
            unit => format!("{unit}²"),
        };
        let length = |name, value| Column::numbers(name, &self.unit, vec![value]);
        let percent = |name, value| Column::numbers(name, "%", vec![errors.percent(value)]);
        Table::new(vec![
            Column::numbers("joints", "", vec![errors.names.len() as f64]),
            length("height", errors.height),
            length("mean", errors.mean()),
            length("min", errors.least()),
            length("max", errors.greatest()),
            percent("mean of height", errors.mean()),
            percent("max of height", errors.greatest()),
            Column::numbers("mean squared", &square_unit, vec![errors.mean_squared()]),
        ])
    }
}
