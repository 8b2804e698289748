//! Kind `zoomout`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, OptionalInput, Output, Spec};
use crate::kernels::basis::Basis;
use crate::kernels::functional_map::{FunctionalMap, PointMap};
use crate::kernels::mesh::TriMesh;
use crate::kernels::table::{Column, Table};
use crate::kernels::zoomout::{ZoomOutOptions, map_health, zoomout};

/// Refines a functional map by matching points and adding eigenfunctions in turns.
///
/// Writes the refined map, the matches that belong to it, and signs of its health: `orthogonality`
/// is near 0 for maps that keep areas (0.1 to 0.5 on good real pairs); `coverage` is the part of the
/// target's area whose vertices are matched; `chirality` is the part of the source's area whose
/// orientation survives, near 1 for a good map and below a half for a mirrored one.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ZoomOut {
    /// Eigenfunctions of the refined map.
    #[schemars(range(min = 2, max = 1000))]
    pub k: usize,
    /// Eigenfunctions added at a time.
    #[schemars(range(min = 1))]
    pub step: usize,
    /// Vertices of either shape that take part in all but the last matching; 0 for all. About 1000
    /// make dense meshes fast.
    pub samples: usize,
}

impl Default for ZoomOut {
    fn default() -> Self {
        let ZoomOutOptions { k, step, samples } = ZoomOutOptions::default();
        Self { k, step, samples }
    }
}

impl ZoomOut {
    const SOURCE_BASIS: Input<Basis> = Input::new("source_basis", "eigenpairs of the source");
    const TARGET_BASIS: Input<Basis> = Input::new("target_basis", "eigenpairs of the target");
    const COARSE: Input<FunctionalMap> = Input::new("map", "the map to refine");
    const SOURCE_MESH: OptionalInput<TriMesh> =
        OptionalInput::new("source_mesh", "the source: spreads samples, tells mirrored maps");
    const TARGET_MESH: OptionalInput<TriMesh> =
        OptionalInput::new("target_mesh", "the target, for the same");
    const MAP: Output<FunctionalMap> =
        Output::new("map", "functions on the target to functions on the source, k x k");
    const MATCHES: Output<PointMap> =
        Output::new("matches", "for every source vertex the target vertex that the map finds");
    const HEALTH: Output<Table> = Output::new("health", "signs of a good or a bad map, one row");
}

impl Node for ZoomOut {
    const SPEC: Spec = Spec {
        kind: "zoomout",
        version: 1,
        inputs: &[
            Self::SOURCE_BASIS.port(),
            Self::TARGET_BASIS.port(),
            Self::COARSE.port(),
            Self::SOURCE_MESH.port(),
            Self::TARGET_MESH.port(),
        ],
        outputs: &[Self::MAP.port(), Self::MATCHES.port(), Self::HEALTH.port()],
        cites: &["melzi2019zoomout", "musoni2021functional"],
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
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (source, target) = (io.get(Self::SOURCE_BASIS), io.get(Self::TARGET_BASIS));
        let meshes = (io.get_optional(Self::SOURCE_MESH), io.get_optional(Self::TARGET_MESH));
        let (source_mesh, target_mesh) = (meshes.0.as_deref(), meshes.1.as_deref());
        for (side, mesh, basis) in
            [("source", source_mesh, &source), ("target", target_mesh, &target)]
        {
            if let Some(mesh) = mesh.filter(|it| it.n_vertices() != basis.n_vertices()) {
                return Err(NodeError::failed(format!(
                    "`{side}_mesh` has {} vertices, but `{side}_basis` belongs to {}",
                    mesh.n_vertices(),
                    basis.n_vertices()
                )));
            }
        }
        let options = ZoomOutOptions { k: self.k, step: self.step, samples: self.samples };
        let (map, matches) = zoomout(
            (&source, source_mesh.map(TriMesh::vertices)),
            (&target, target_mesh.map(TriMesh::vertices)),
            &io.get(Self::COARSE),
            &options,
        )?;
        let health = map_health(&map, &matches, &target, source_mesh.zip(target_mesh));
        if health.chirality < 0.5 {
            io.note(format!(
                "only {:.0} % of the source keeps its orientation: left and right, or front and \
                 back, are probably swapped",
                100.0 * health.chirality
            ));
        }
        io.put(
            Self::HEALTH,
            Table::new(vec![
                Column::numbers("orthogonality", "", vec![health.orthogonality]),
                Column::numbers("coverage", "%", vec![100.0 * health.coverage]),
                Column::numbers("chirality", "%", vec![100.0 * health.chirality]),
            ]),
        );
        io.put(Self::MAP, map);
        io.put(Self::MATCHES, matches);
        Ok(())
    }
}
