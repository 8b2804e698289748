//! Kind `weights_error`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::rigs::weights::SkinWeights;
use crate::kernels::rigs::weights_error::weight_errors;
use crate::kernels::table::{Column, Table, percentile};

/// Measures how far skin weights are from the true ones of the same mesh and joints.
///
/// A vertex's error is the share of its weight that is at other joints than in truth.
#[derive(Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct WeightsErrorNode {}

impl WeightsErrorNode {
    const ESTIMATE: Input<SkinWeights> = Input::new("estimate", "the weights to be judged");
    const TRUTH: Input<SkinWeights> = Input::new("truth", "the true ones");
    const SUMMARY: Output<Table> = Output::new("summary", "one row: errors of all vertices");
}

impl Node for WeightsErrorNode {
    const SPEC: Spec = Spec {
        kind: "weights_error",
        version: 1,
        inputs: &[Self::ESTIMATE.port(), Self::TRUTH.port()],
        outputs: &[Self::SUMMARY.port()],
        cites: &[],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.skin]
kind = "skin_weights"
mesh = "@body.mesh"
skeleton = "@body.skeleton"

[nodes.error]
kind = "weights_error"
estimate = "@skin"
truth = "@body.weights"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let res = weight_errors(&io.get(Self::ESTIMATE), &io.get(Self::TRUTH))?;
        let n_vertices = res.misplaced.len() as f64;
        let percents: Vec<f64> = res.misplaced.iter().map(|it| 100.0 * it).collect();
        let column = |name, unit, value| Column::numbers(name, unit, vec![value]);
        let summary = Table::new(vec![
            column("vertices", "", n_vertices),
            column("misplaced", "%", percents.iter().sum::<f64>() / n_vertices),
            column("misplaced, 95th percentile", "%", percentile(&percents, 95.0)),
            column("same heaviest joint", "%", 100.0 * res.n_same_heaviest as f64 / n_vertices),
        ]);
        io.put(Self::SUMMARY, summary);
        Ok(())
    }
}
