//! Kind `transfer`.

use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::artifact::Artifact;
use crate::engine::node::{Input, Node, NodeError, NodeIo, OptionalInput, Output, Spec};
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::maps::functional_map::{FunctionalMap, PointMap};
use crate::kernels::rigs::skeleton::Skeleton;
use crate::kernels::spectral::basis::Basis;
use crate::kernels::transfer::regressor::{Regressor, SpectralRegressor};
use crate::kernels::transfer::skeleton_transfer::{
    transfer_by_coordinates, transfer_by_functions, transfer_by_points, transfer_by_surface,
};

/// How a skeleton is carried over.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TransferMode {
    /// By functions: needs `spectral_regressor`, `map` and `target_basis`. Smooth, so small errors of
    /// matches average out.
    #[default]
    Functional,
    /// By matched points: needs `regressor` and `matches`. With a regressor of the method `avril`, this
    /// is the skeleton of Avril et al. 2016.
    Pointwise,
    /// By coordinates, FARM's way: the target's geometry is put on the source's connectivity, and the
    /// regressor applied to it. Needs `regressor`, `source_basis`, `map` and `target_basis`. With the same
    /// regressor and map the joints are those of `functional`; FARM has its own, of `farm_map`.
    Coordinates,
    /// By the source's surface laid onto the target: needs `regressor`, and `target_mesh` is the surface of
    /// `fit_surface`. The nearest to the truth, best with a regressor of the method `posed`.
    Surface,
}

/// Carries the source's skeleton to the target.
///
/// The target mesh may be moved and scaled against the one of which the basis was computed.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Transfer {
    /// How the skeleton is carried over, which decides the inputs that are needed.
    #[serde(default)]
    pub mode: TransferMode,
}

impl Transfer {
    const SPECTRAL: OptionalInput<SpectralRegressor> =
        OptionalInput::new("spectral_regressor", "the source's joints from coefficients");
    const MAP: OptionalInput<FunctionalMap> =
        OptionalInput::new("map", "functions on the target to functions on the source");
    const TARGET_BASIS: OptionalInput<Basis> =
        OptionalInput::new("target_basis", "eigenpairs of the target");
    const SOURCE_BASIS: OptionalInput<Basis> =
        OptionalInput::new("source_basis", "eigenpairs of the source");
    const REGRESSOR: OptionalInput<Regressor> =
        OptionalInput::new("regressor", "the source's joints from vertices");
    const MATCHES: OptionalInput<PointMap> =
        OptionalInput::new("matches", "for every source vertex a target vertex");
    const TARGET_MESH: Input<TriMesh> = Input::new("target_mesh", "the shape that gets joints");
    const SKELETON: Output<Skeleton> = Output::new("skeleton", "the target's joints");

    fn by_functions(&self, io: &NodeIo<'_>, mesh: &TriMesh) -> Result<Skeleton, NodeError> {
        let regressor = self.needed(io, Self::SPECTRAL, "spectral_regressor")?;
        let map = self.needed(io, Self::MAP, "map")?;
        let basis = self.needed(io, Self::TARGET_BASIS, "target_basis")?;
        Ok(transfer_by_functions(&regressor, &map, &basis, mesh.vertices())?)
    }

    fn by_points(&self, io: &NodeIo<'_>, mesh: &TriMesh) -> Result<Skeleton, NodeError> {
        let regressor = self.needed(io, Self::REGRESSOR, "regressor")?;
        let matches = self.needed(io, Self::MATCHES, "matches")?;
        Ok(transfer_by_points(&regressor, &matches, mesh.vertices())?)
    }

    fn by_coordinates(&self, io: &NodeIo<'_>, mesh: &TriMesh) -> Result<Skeleton, NodeError> {
        let regressor = self.needed(io, Self::REGRESSOR, "regressor")?;
        let source = self.needed(io, Self::SOURCE_BASIS, "source_basis")?;
        let map = self.needed(io, Self::MAP, "map")?;
        let target = self.needed(io, Self::TARGET_BASIS, "target_basis")?;
        Ok(transfer_by_coordinates(&regressor, &source, &map, &target, mesh.vertices())?)
    }

    fn by_surface(&self, io: &NodeIo<'_>, mesh: &TriMesh) -> Result<Skeleton, NodeError> {
        let regressor = self.needed(io, Self::REGRESSOR, "regressor")?;
        Ok(transfer_by_surface(&regressor, mesh.vertices())?)
    }

    fn needed<T: Artifact>(
        &self,
        io: &NodeIo<'_>,
        port: OptionalInput<T>,
        name: &str,
    ) -> Result<Arc<T>, NodeError> {
        let mode = match self.mode {
            TransferMode::Functional => "functional",
            TransferMode::Pointwise => "pointwise",
            TransferMode::Coordinates => "coordinates",
            TransferMode::Surface => "surface",
        };
        io.get_optional(port)
            .ok_or_else(|| NodeError::failed(format!("mode `{mode}` needs the input `{name}`")))
    }
}

impl Node for Transfer {
    const SPEC: Spec = Spec {
        kind: "transfer",
        version: 1,
        inputs: &[
            Self::SPECTRAL.port(),
            Self::MAP.port(),
            Self::TARGET_BASIS.port(),
            Self::SOURCE_BASIS.port(),
            Self::REGRESSOR.port(),
            Self::MATCHES.port(),
            Self::TARGET_MESH.port(),
        ],
        outputs: &[Self::SKELETON.port()],
        cites: &["musoni2021functional", "marin2020farm", "avril2016animation"],
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

[nodes.joints]
kind = "transfer"
spectral_regressor = "@spectral"
map = "@fine.map"
target_basis = "@basis"
target_mesh = "@body.mesh"

[nodes.joints_by_points]
kind = "transfer"
mode = "pointwise"
regressor = "@regressor.regressor"
matches = "@fine.matches"
target_mesh = "@body.mesh"

[nodes.joints_by_coordinates]
kind = "transfer"
mode = "coordinates"
regressor = "@regressor.regressor"
source_basis = "@basis"
map = "@fine.map"
target_basis = "@basis"
target_mesh = "@body.mesh"

[nodes.surface]
kind = "fit_surface"
source_mesh = "@body.mesh"
target_mesh = "@body.mesh"
matches = "@fine.matches"
nodes = 100

[nodes.joints_by_surface]
kind = "transfer"
mode = "surface"
regressor = "@regressor.regressor"
target_mesh = "@surface.mesh"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let mesh = io.get(Self::TARGET_MESH);
        let skeleton = match self.mode {
            TransferMode::Functional => self.by_functions(io, &mesh)?,
            TransferMode::Pointwise => self.by_points(io, &mesh)?,
            TransferMode::Coordinates => self.by_coordinates(io, &mesh)?,
            TransferMode::Surface => self.by_surface(io, &mesh)?,
        };
        io.put(Self::SKELETON, skeleton);
        Ok(())
    }
}
