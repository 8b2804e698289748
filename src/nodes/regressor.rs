//! Kind `regressor`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::exact_regressor::{MaskRule, RegressorOptions, RowReport, exact_regressor};
use crate::kernels::mesh::TriMesh;
use crate::kernels::pose_regressor::{PoseRegressorOptions, pose_regressor};
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
    /// Which vertices make a joint, and how.
    pub method: Method,
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
    /// With `posed`: how much errors in other poses count against noise of the vertices.
    #[schemars(range(min = 0.0))]
    pub stiffness: f64,
}

/// How a joint is computed from vertices.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// From those that the joint and its parent move, by the row of least norm (the paper's).
    LeastNorm,
    /// From those around the joint, so that it stays right while the rig is posed.
    #[default]
    Posed,
}

impl Default for RegressorNode {
    fn default() -> Self {
        let RegressorOptions { threshold, n_nearest, max_amplification } =
            RegressorOptions::default();
        let stiffness = PoseRegressorOptions::default().stiffness;
        Self { method: Method::default(), threshold, n_nearest, max_amplification, stiffness }
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
        version: 2,
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
        let (mesh, weights) = (io.get(Self::MESH), io.get(Self::WEIGHTS));
        let (regressor, reports) = match self.method {
            Method::LeastNorm => {
                let options = RegressorOptions {
                    threshold: self.threshold,
                    n_nearest: self.n_nearest,
                    max_amplification: self.max_amplification,
                };
                exact_regressor(&mesh, &skeleton, &weights, &options)?
            }
            Method::Posed => {
                let options = PoseRegressorOptions {
                    stiffness: self.stiffness,
                    max_amplification: self.max_amplification,
                    ..PoseRegressorOptions::default()
                };
                pose_regressor(&mesh, &skeleton, &weights, &options)?
            }
        };
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
        MaskRule::Posed => "around the joint, for all poses".to_owned(),
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
