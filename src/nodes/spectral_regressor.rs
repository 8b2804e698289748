//! Kind `spectral_regressor`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::spectral::basis::Basis;
use crate::kernels::transfer::regressor::{Regressor, SpectralRegressor};
use crate::kernels::transfer::skeleton_transfer::spectral_regressor;

/// Converts a regressor of vertices into one of spectral coefficients.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SpectralRegressorNode {
    /// Eigenfunctions; at least as many as the functional map has.
    #[schemars(range(min = 1))]
    pub k: usize,
}

impl Default for SpectralRegressorNode {
    fn default() -> Self {
        Self { k: 120 }
    }
}

impl SpectralRegressorNode {
    const REGRESSOR: Input<Regressor> = Input::new("regressor", "joints x vertices");
    const SOURCE_BASIS: Input<Basis> =
        Input::new("source_basis", "eigenpairs of the regressor's mesh");
    const SPECTRAL: Output<SpectralRegressor> = Output::new("regressor", "joints x eigenfunctions");
}

impl Node for SpectralRegressorNode {
    const SPEC: Spec = Spec {
        kind: "spectral_regressor",
        version: 2,
        inputs: &[Self::REGRESSOR.port(), Self::SOURCE_BASIS.port()],
        outputs: &[Self::SPECTRAL.port()],
        cites: &["musoni2021functional"],
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

[nodes.regressor]
kind = "regressor"
mesh = "@body.mesh"
skeleton = "@body.skeleton"
weights = "@body.weights"

[nodes.spectral]
kind = "spectral_regressor"
regressor = "@regressor.regressor"
source_basis = "@basis"
k = 40
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (regressor, basis) = (io.get(Self::REGRESSOR), io.get(Self::SOURCE_BASIS));
        io.put(Self::SPECTRAL, spectral_regressor(&regressor, &basis, self.k)?);
        Ok(())
    }
}
