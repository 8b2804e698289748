//! Kind `regressor`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::rigs::skeleton::Skeleton;
use crate::kernels::rigs::weights::SkinWeights;
use crate::kernels::table::{Column, Table};
use crate::kernels::transfer::adam_regressor::{RegressorEnergy, adam_regressor};
use crate::kernels::transfer::avril_regressor::avril_regressor;
use crate::kernels::transfer::convex_regressor::convex_regressor;
use crate::kernels::transfer::exact_regressor::exact_regressor;
use crate::kernels::transfer::pose_regressor::{PoseRegressorOptions, pose_regressor};
use crate::kernels::transfer::regressor::Regressor;
use crate::kernels::transfer::regressor_masks::{MaskRule, RegressorOptions, RootRule, RowReport};

/// How rows are computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RegressorMethod {
    /// The row of least norm that meets the joint, in closed form.
    #[default]
    Exact,
    /// From those around the joint, so that it stays right while the rig is posed, in closed form. Better
    /// than `exact` where matches are exact, as good where they are not.
    Posed,
    /// The paper's: 1000 steps of Adam from zero. All vertices take part, those outside of the mask at a
    /// cost. `energy` says at which.
    Adam,
    /// Rows without negative entries: joints stay inside of the hull of their vertices.
    Convex,
    /// From all vertices that a joint moves, the near ones before the far, after Avril et al. 2016.
    Avril,
}

/// The weights of the energy that `adam` minimizes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum EnergyWeights {
    /// As the paper prints them.
    #[default]
    Paper,
    /// As the paper's demo has them.
    Demo,
}

/// Computes the joints of a rigged mesh as sums of few vertices around each.
///
/// With `posed`, these are the nearest of those that the joint or its parent moves. With the other
/// methods, they are those that it moves together with its parent; where these are too few, lie in a
/// plane, or would amplify errors, others are taken: lower thresholds, the joint's children, the
/// nearest vertices. The table says which rule chose them, and after how many others.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RegressorNode {
    /// How rows are computed.
    pub method: RegressorMethod,
    /// A vertex counts as moved by a joint if its weight exceeds this. The paper says 0, its demo 0.1.
    #[schemars(range(min = 0.0, max = 0.99))]
    pub threshold: f64,
    /// What stands for the parent of a root.
    pub root: RootRule,
    /// How many vertices are taken where the nearest are.
    #[schemars(range(min = 4))]
    pub n_nearest: usize,
    /// With `posed` and `exact`, the largest sum of absolute entries of a row that is taken without looking further.
    /// It bounds how far a joint can move if its vertices move by one.
    #[schemars(range(min = 1.0))]
    pub max_amplification: f64,
    /// With `posed`: how much errors in other poses count against noise of the vertices.
    #[schemars(range(min = 0.0))]
    pub stiffness: f64,
    /// The weights that `adam` works with.
    pub energy: EnergyWeights,
    /// How much `avril` keeps far vertices down.
    #[schemars(range(min = 1e-12))]
    pub damping: f64,
}

impl Default for RegressorNode {
    fn default() -> Self {
        let RegressorOptions { threshold, root, n_nearest, max_amplification } =
            RegressorOptions::default();
        Self {
            method: RegressorMethod::default(),
            threshold,
            root,
            n_nearest,
            max_amplification,
            stiffness: PoseRegressorOptions::default().stiffness,
            energy: EnergyWeights::default(),
            damping: 1e-3,
        }
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
        cites: &["musoni2021functional", "avril2016animation"],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.regressor]
kind = "regressor"
mesh = "@body.mesh"
skeleton = "@body.skeleton"
weights = "@body.weights"

[nodes.convex]
kind = "regressor"
method = "convex"
root = "children"
mesh = "@body.mesh"
skeleton = "@body.skeleton"
weights = "@body.weights"

[nodes.avril]
kind = "regressor"
method = "avril"
mesh = "@body.mesh"
skeleton = "@body.skeleton"
weights = "@body.weights"

[nodes.adam]
kind = "regressor"
method = "adam"
mesh = "@body.mesh"
skeleton = "@body.skeleton"
weights = "@body.weights"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (mesh, skeleton) = (io.get(Self::MESH), io.get(Self::SKELETON));
        let weights = io.get(Self::WEIGHTS);
        let options = RegressorOptions {
            threshold: self.threshold,
            root: self.root,
            n_nearest: self.n_nearest,
            max_amplification: self.max_amplification,
        };
        let (regressor, reports) = match self.method {
            RegressorMethod::Posed => {
                let options = PoseRegressorOptions {
                    stiffness: self.stiffness,
                    max_amplification: self.max_amplification,
                    ..PoseRegressorOptions::default()
                };
                pose_regressor(&mesh, &skeleton, &weights, &options)?
            }
            RegressorMethod::Exact => exact_regressor(&mesh, &skeleton, &weights, &options)?,
            RegressorMethod::Convex => convex_regressor(&mesh, &skeleton, &weights, &options)?,
            RegressorMethod::Avril => {
                avril_regressor(&mesh, &skeleton, &weights, &options, self.damping)?
            }
            RegressorMethod::Adam => {
                let energy = match self.energy {
                    EnergyWeights::Paper => RegressorEnergy::PAPER,
                    EnergyWeights::Demo => RegressorEnergy::DEMO,
                };
                adam_regressor(&mesh, &skeleton, &weights, &options, &energy)?
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
        MaskRule::Root { threshold } => format!("root, weights above {threshold}"),
        MaskRule::RootAndChildren { threshold } => {
            format!("root with children, weights above {threshold}")
        }
        MaskRule::Moved { threshold } => format!("moved, weights above {threshold}"),
        MaskRule::Child { child } => format!("with child `{}`", skeleton.names()[child]),
        MaskRule::NearestMoved => "nearest of those moved".to_owned(),
        MaskRule::Nearest => "nearest".to_owned(),
        MaskRule::Posed => "around the joint, for all poses".to_owned(),
    };
    let numbers = |of: fn(&RowReport) -> f64| reports.iter().map(of).collect();
    Table::new(vec![
        Column::texts("joint", skeleton.names().to_vec()),
        Column::texts("rule", reports.iter().map(rule).collect()),
        Column::numbers("fallbacks", "", numbers(|it| it.n_fallbacks as f64)),
        Column::numbers("vertices", "", numbers(|it| it.n_vertices as f64)),
        Column::numbers("amplification", "", numbers(|it| it.amplification)),
        Column::numbers("sum", "", numbers(|it| it.sum)),
        Column::numbers("residual", "", numbers(|it| it.residual)),
    ])
}
