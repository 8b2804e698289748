//! Kind `eigs`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::spectral::eigs::{Disconnected, EigsOptions, eigs};
use crate::kernels::spectral::{basis::Basis, operator::Operator};

/// Computes the smallest eigenpairs of a Laplace-Beltrami operator.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Eigs {
    /// The number of eigenpairs, the constant function included.
    #[serde(default = "default_k")]
    #[schemars(range(min = 1, max = 5000))]
    pub k: usize,
    /// What to do with a shape of several parts, each of which has an eigenvalue zero of its own.
    #[serde(default)]
    pub disconnected: OnDisconnected,
    /// The largest accepted residual, in parts of the largest eigenvalue. Where weights are so uneven
    /// that rounding alone makes more, that much is accepted, up to 1e-6.
    #[serde(default = "default_tolerance")]
    #[schemars(range(min = 1e-13, max = 1e-3))]
    pub tolerance: f64,
}

#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum OnDisconnected {
    /// Refuse it; `clean` keeps the largest part.
    #[default]
    Fail,
    /// Compute the eigenpairs of all parts and merge them.
    Merge,
}

fn default_k() -> usize {
    EigsOptions::default().k
}

fn default_tolerance() -> f64 {
    EigsOptions::default().tolerance
}

impl Eigs {
    const OPERATOR: Input<Operator> = Input::new("operator", "stiffness and masses");
    const BASIS: Output<Basis> = Output::new("basis", "the eigenpairs, ascending");
}

impl Node for Eigs {
    const SPEC: Spec = Spec {
        kind: "eigs",
        version: 1,
        inputs: &[Self::OPERATOR.port()],
        outputs: &[Self::BASIS.port()],
        cites: &["grimes1994shifted"],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.laplacian]
kind = "laplacian"
mesh = "@body.mesh"

[nodes.basis]
kind = "eigs"
operator = "@laplacian"
k = 20
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let options = EigsOptions {
            k: self.k,
            disconnected: match self.disconnected {
                OnDisconnected::Fail => Disconnected::Refuse,
                OnDisconnected::Merge => Disconnected::Merge,
            },
            tolerance: self.tolerance,
        };
        let (basis, _) = eigs(&io.get(Self::OPERATOR), &options)?;
        io.put(Self::BASIS, basis);
        Ok(())
    }
}
