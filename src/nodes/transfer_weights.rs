//! Kind `transfer_weights`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, OptionalInput, Output, Spec};
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::maps::functional_map::FunctionalMap;
use crate::kernels::rigs::weights::SkinWeights;
use crate::kernels::spectral::basis::Basis;
use crate::kernels::transfer::transfer_weights::{
    Matching, TransferWeightsOptions, transfer_weights,
};

/// Gives every target vertex the skin weights of the place on the source that the map puts nearest to
/// it.
///
/// The paper suggests to copy the weights of the nearest vertex in space: `matching = "positions"`,
/// `interpolate = false`, `smoothing = 0`. The defaults tear far fewer edges when the target moves.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TransferWeights {
    /// In which space a vertex looks for its place.
    pub matching: Matching,
    /// Compare with the target's own positions instead of their smooth part.
    pub raw_positions: bool,
    /// Look for places inside of the source's faces, not only for its vertices. Needs `source_mesh`.
    pub interpolate: bool,
    /// Pieces of a joint's influence go that have less than this part of the weight of its largest
    /// piece; 0 keeps all.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub islands: f64,
    /// Steps of diffusion over the target's edges.
    #[schemars(range(max = 1000))]
    pub smoothing: usize,
    /// The joints kept a vertex, the heaviest; 0 for all.
    pub max_influences: usize,
}

impl Default for TransferWeights {
    fn default() -> Self {
        let TransferWeightsOptions {
            matching,
            raw_positions,
            interpolate,
            islands,
            smoothing,
            max_influences,
        } = TransferWeightsOptions::default();
        Self { matching, raw_positions, interpolate, islands, smoothing, max_influences }
    }
}

impl TransferWeights {
    const SOURCE_BASIS: Input<Basis> = Input::new("source_basis", "eigenpairs of the source");
    const SOURCE_WEIGHTS: Input<SkinWeights> =
        Input::new("source_weights", "skin weights of the source");
    const SOURCE_MESH: OptionalInput<TriMesh> =
        OptionalInput::new("source_mesh", "the source, to interpolate on its faces");
    const TARGET_BASIS: Input<Basis> = Input::new("target_basis", "eigenpairs of the target");
    const TARGET_MESH: Input<TriMesh> = Input::new("target_mesh", "the shape that gets weights");
    const MAP: Input<FunctionalMap> =
        Input::new("map", "functions on the target to functions on the source");
    const WEIGHTS: Output<SkinWeights> = Output::new("weights", "skin weights of the target");
}

impl Node for TransferWeights {
    const SPEC: Spec = Spec {
        kind: "transfer_weights",
        version: 2,
        inputs: &[
            Self::SOURCE_BASIS.port(),
            Self::SOURCE_WEIGHTS.port(),
            Self::SOURCE_MESH.port(),
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
source_mesh = "@body.mesh"
target_basis = "@basis"
target_mesh = "@body.mesh"
map = "@fine.map"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (source, target) = (io.get(Self::SOURCE_BASIS), io.get(Self::TARGET_BASIS));
        let (weights, mesh) = (io.get(Self::SOURCE_WEIGHTS), io.get(Self::TARGET_MESH));
        let source_mesh = io.get_optional(Self::SOURCE_MESH);
        if self.interpolate && source_mesh.is_none() {
            io.note("without `source_mesh`, weights of vertices are copied".to_owned());
        }
        let options = TransferWeightsOptions {
            matching: self.matching,
            raw_positions: self.raw_positions,
            interpolate: self.interpolate,
            islands: self.islands,
            smoothing: self.smoothing,
            max_influences: self.max_influences,
        };
        let weights = transfer_weights(
            (&source, &weights, source_mesh.as_deref()),
            (&target, &mesh),
            &io.get(Self::MAP),
            &options,
        )?;
        io.put(Self::WEIGHTS, weights);
        Ok(())
    }
}
