//! Kind `transfer_weights`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::basis::Basis;
use crate::kernels::functional_map::FunctionalMap;
use crate::kernels::mesh::TriMesh;
use crate::kernels::transfer_weights::{TransferWeightsOptions, transfer_weights};
use crate::kernels::weights::SkinWeights;

/// Gives every target vertex the skin weights of the source vertex that the map puts nearest to it.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TransferWeights {
    /// Compare with the target's own positions instead of their smooth part.
    pub raw_positions: bool,
    /// The joints kept a vertex, the heaviest; 0 for all.
    pub max_influences: usize,
}

impl Default for TransferWeights {
    fn default() -> Self {
        let TransferWeightsOptions { raw_positions, max_influences } =
            TransferWeightsOptions::default();
        Self { raw_positions, max_influences }
    }
}

impl TransferWeights {
    const SOURCE_BASIS: Input<Basis> = Input::new("source_basis", "eigenpairs of the source");
    const SOURCE_WEIGHTS: Input<SkinWeights> =
        Input::new("source_weights", "skin weights of the source");
    const TARGET_BASIS: Input<Basis> = Input::new("target_basis", "eigenpairs of the target");
    const TARGET_MESH: Input<TriMesh> = Input::new("target_mesh", "the shape that gets weights");
    const MAP: Input<FunctionalMap> =
        Input::new("map", "functions on the target to functions on the source");
    const WEIGHTS: Output<SkinWeights> = Output::new("weights", "skin weights of the target");
}

impl Node for TransferWeights {
    const SPEC: Spec = Spec {
        kind: "transfer_weights",
        version: 1,
        inputs: &[
            Self::SOURCE_BASIS.port(),
            Self::SOURCE_WEIGHTS.port(),
            Self::TARGET_BASIS.port(),
            Self::TARGET_MESH.port(),
            Self::MAP.port(),
        ],
        outputs: &[Self::WEIGHTS.port()],
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

[nodes.fine]
kind = "zoomout"
source_basis = "@basis"
target_basis = "@basis"
map = "@coarse"
k = 40
step = 5

[nodes.skin]
kind = "transfer_weights"
source_basis = "@basis"
source_weights = "@body.weights"
target_basis = "@basis"
target_mesh = "@body.mesh"
map = "@fine.map"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (source, target) = (io.get(Self::SOURCE_BASIS), io.get(Self::TARGET_BASIS));
        let (weights, mesh) = (io.get(Self::SOURCE_WEIGHTS), io.get(Self::TARGET_MESH));
        let options = TransferWeightsOptions {
            raw_positions: self.raw_positions,
            max_influences: self.max_influences,
        };
        let weights = transfer_weights(
            (&source, &weights),
            (&target, mesh.vertices()),
            &io.get(Self::MAP),
            &options,
        )?;
        io.put(Self::WEIGHTS, weights);
        Ok(())
    }
}
