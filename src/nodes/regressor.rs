//! Kind `regressor`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::exact_regressor::{MaskRule, RegressorOptions, RowReport, exact_regressor};
use crate::kernels::mesh::TriMesh;
use crate::kernels::regressor::Regressor;
use crate::kernels::skeleton::Skeleton;
use crate::kernels::table::{Column, Table};
use crate::kernels::weights::SkinWeights;

/// Computes the joints of a rigged mesh as sums of few vertices around each.
///
/// A joint's vertices are those that it moves together with its parent. Where these are too few, lie
/// in a plane, or would amplify errors, others are taken: lower thresholds, the joint's children, the
/// nearest vertices. The table says which rule fired for which joint.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RegressorNode {
    /// A vertex counts as moved by a joint if its weight exceeds this.
    #[schemars(range(min = 0.0, max = 0.99))]
    pub threshold: f64,
    /// How many vertices are taken where the nearest are.
    #[schemars(range(min = 4))]
    pub n_nearest: usize,
    /// The largest sum of absolute entries of a row that is taken without looking further. It bounds
    /// how far a joint can move if its vertices move by one.
    #[schemars(range(min = 1.0))]
    pub max_amplification: f64,
}

impl Default for RegressorNode {
    fn default() -> Self {
        let RegressorOptions { threshold, n_nearest, max_amplification } =
            RegressorOptions::default();
        Self { threshold, n_nearest, max_amplification }
    }
}

impl RegressorNode {
    const MESH: Input<TriMesh> = Input::new("mesh", "the rigged mesh");
    const SKELETON: Input<Skeleton> = Input::new("skeleton", "its joints");
    const WEIGHTS: Input<SkinWeights> = Input::new("weights", "its skin weights");
    const REGRESSOR: Output<Regressor> = Output::new("regressor", "joints x vertices");
    const RULES: Output<Table> = Output::new("rules", "how each joint's vertices were chosen");
}

impl Node for RegressorNode {
    const SPEC: Spec = Spec {
        kind: "regressor",
        version: 1,
        inputs: &[Self::MESH.port(), Self::SKELETON.port(), Self::WEIGHTS.port()],
        outputs: &[Self::REGRESSOR.port(), Self::RULES.port()],
        cites: &["musoni2021functional"],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.regressor]
kind = "regressor"
mesh = "@body.mesh"
skeleton = "@body.skeleton"
weights = "@body.weights"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let skeleton = io.get(Self::SKELETON);
        let options = RegressorOptions {
            threshold: self.threshold,
            n_nearest: self.n_nearest,
            max_amplification: self.max_amplification,
        };
        let (regressor, reports) =
            exact_regressor(&io.get(Self::MESH), &skeleton, &io.get(Self::WEIGHTS), &options)?;
        io.put(Self::REGRESSOR, regressor);
        io.put(Self::RULES, rules_table(&skeleton, &reports));
        Ok(())
    }
}

fn rules_table(skeleton: &Skeleton, reports: &[RowReport]) -> Table {
    let rule = |report: &RowReport| match report.rule {
        MaskRule::Parent { threshold } => format!("with parent, weights above {threshold}"),
        MaskRule::Child { child } => format!("with child `{}`", skeleton.names()[child]),
        MaskRule::NearestMoved => "nearest of those moved".to_owned(),
        MaskRule::Nearest => "nearest".to_owned(),
    };
    let numbers = |of: fn(&RowReport) -> f64| reports.iter().map(of).collect();
    Table::new(vec![
        Column::texts("joint", skeleton.names().to_vec()),
        Column::texts("rule", reports.iter().map(rule).collect()),
        Column::numbers("vertices", "", numbers(|it| it.n_vertices as f64)),
        Column::numbers("amplification", "", numbers(|it| it.amplification)),
        Column::numbers("residual", "", numbers(|it| it.residual)),
    ])
}
