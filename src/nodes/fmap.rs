//! Kind `fmap`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::maps::fmap::{FitOptions, Solver, fit_functional_map};
use crate::kernels::maps::functional_map::FunctionalMap;
use crate::kernels::numerics::adam::AdamOptions;
use crate::kernels::spectral::basis::Basis;
use crate::kernels::spectral::descriptors::Descriptors;

/// How the minimum of the energy is looked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FmapSolver {
    /// By one factorization: the minimum itself.
    #[default]
    Exact,
    /// By steps of Adam from zero, which stop above the minimum: the demo's way.
    Adam,
}

/// Fits a small functional map to the descriptors of two shapes.
///
/// The map carries functions on the target to functions on the source. Its energy weighs preserved
/// descriptors, commutativity with multiplication by descriptors, and commutativity with the
/// Laplacians; being quadratic, it is solved by one factorization. Refine the result with `zoomout`,
/// and with `icp_refine` before.
///
/// The demo of Musoni et al. 2021 is `solver = "adam"`, `commutativity = 0`, `laplacian = 2e-8` and
/// `normalized_gaps = false`.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Fmap {
    /// Eigenfunctions of either shape. The system has about `k` to the fourth entries.
    #[schemars(range(min = 2, max = 60))]
    pub k: usize,
    /// The weight of preserved descriptors.
    #[schemars(range(min = 0.0))]
    pub descriptors: f64,
    /// The weight of commutativity with multiplication by descriptors.
    #[schemars(range(min = 0.0))]
    pub commutativity: f64,
    /// The weight of commutativity with the Laplacians.
    #[schemars(range(min = 0.0))]
    pub laplacian: f64,
    /// Divide the squared gaps between both spectra, which weigh the entries of the map, by their sum.
    /// Without, `laplacian` must be about a billion times smaller.
    pub normalized_gaps: bool,
    /// How the minimum is looked for.
    pub solver: FmapSolver,
    /// With `adam`: the number of steps.
    #[schemars(range(min = 1, max = 1000000))]
    pub steps: usize,
    /// With `adam`: how far an entry goes in the first step.
    #[schemars(range(min = 0.0))]
    pub learning_rate: f64,
}

impl Default for Fmap {
    fn default() -> Self {
        let FitOptions { k, descriptors, commutativity, laplacian, normalized_gaps, .. } =
            FitOptions::default();
        let AdamOptions { n_steps, learning_rate, .. } = AdamOptions::default();
        Self {
            k,
            descriptors,
            commutativity,
            laplacian,
            normalized_gaps,
            solver: FmapSolver::default(),
            steps: n_steps,
            learning_rate,
        }
    }
}

impl Fmap {
    const SOURCE_BASIS: Input<Basis> = Input::new("source_basis", "eigenpairs of the source");
    const TARGET_BASIS: Input<Basis> = Input::new("target_basis", "eigenpairs of the target");
    const SOURCE_DESCRIPTORS: Input<Descriptors> =
        Input::new("source_descriptors", "descriptors of the source");
    const TARGET_DESCRIPTORS: Input<Descriptors> =
        Input::new("target_descriptors", "descriptors of the target, the same ones");
    const MAP: Output<FunctionalMap> =
        Output::new("map", "functions on the target to functions on the source, k x k");
}

impl Node for Fmap {
    const SPEC: Spec = Spec {
        kind: "fmap",
        version: 2,
        inputs: &[
            Self::SOURCE_BASIS.port(),
            Self::TARGET_BASIS.port(),
            Self::SOURCE_DESCRIPTORS.port(),
            Self::TARGET_DESCRIPTORS.port(),
        ],
        outputs: &[Self::MAP.port()],
        cites: &["ovsjanikov2012functional", "nogneng2017informative", "musoni2021functional"],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.operator]
kind = "laplacian"
mesh = "@body.mesh"

[nodes.basis]
kind = "eigs"
operator = "@operator"
k = 40

[nodes.functions]
kind = "descriptors"
basis = "@basis"
landmarks = "@body.landmarks"

[nodes.coarse]
kind = "fmap"
source_basis = "@basis"
target_basis = "@basis"
source_descriptors = "@functions"
target_descriptors = "@functions"
k = 15
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (source, g) = (io.get(Self::SOURCE_BASIS), io.get(Self::SOURCE_DESCRIPTORS));
        let (target, f) = (io.get(Self::TARGET_BASIS), io.get(Self::TARGET_DESCRIPTORS));
        let options = FitOptions {
            k: self.k,
            descriptors: self.descriptors,
            commutativity: self.commutativity,
            laplacian: self.laplacian,
            normalized_gaps: self.normalized_gaps,
            solver: match self.solver {
                FmapSolver::Exact => Solver::Exact,
                FmapSolver::Adam => Solver::Adam(AdamOptions {
                    n_steps: self.steps,
                    learning_rate: self.learning_rate,
                    ..AdamOptions::default()
                }),
            },
        };
        io.put(Self::MAP, fit_functional_map((&source, &g), (&target, &f), &options)?);
        Ok(())
    }
}
