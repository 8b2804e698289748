//! Kind `zoomout`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{
    Input, Node, NodeError, NodeIo, OptionalInput, OptionalOutput, Output, Spec,
};
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::maps::chirality::chirality;
use crate::kernels::maps::functional_map::{FunctionalMap, PointMap};
use crate::kernels::maps::map_quality::{coverage, orthogonality};
use crate::kernels::maps::point_map::point_map;
use crate::kernels::maps::zoomout::{ZoomOutOptions, refine};
use crate::kernels::spectral::basis::Basis;
use crate::kernels::table::{Column, Table};

/// Refines a functional map by matching points and adding eigenfunctions in turns.
///
/// Writes the refined map, the matches that belong to it, and signs of its health: `orthogonality`
/// is near 0 for maps that keep areas (0.1 to 0.5 on good real pairs); `coverage` is the part of the
/// target's area whose vertices are matched; `chirality` is near 100 % for a map that keeps left and
/// right, negative for a mirrored one, and near 0 if that cannot be told. The kind `map_quality`
/// measures more.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ZoomOut {
    /// Eigenfunctions of the refined map.
    #[schemars(range(min = 2, max = 1000))]
    pub k: usize,
    /// Eigenfunctions added at a time.
    #[schemars(range(min = 1))]
    pub step: usize,
    /// Vertices of either shape that take part while eigenfunctions are added; 0 for all. The
    /// default costs a hundredth of the accuracy, and all vertices most of the time on dense meshes.
    pub samples: usize,
    /// Matchings of all vertices at the full `k` that follow those of samples.
    pub final_rounds: usize,
    /// Weigh vertices by their areas when the map follows from matches, so that uneven sampling does
    /// not matter. The paper's demo does not.
    pub mass_weighted: bool,
    /// Match all vertices in the end. Functional transfer needs the map alone, and matching takes most
    /// of the time on dense meshes.
    pub matches: bool,
}

/// Maps of a lower chirality are called mirrored.
const MIRRORED: f64 = -0.2;

impl Default for ZoomOut {
    fn default() -> Self {
        let ZoomOutOptions { k, step, samples, final_rounds, mass_weighted } =
            ZoomOutOptions::default();
        Self { k, step, samples, final_rounds, mass_weighted, matches: true }
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
    const MATCHES: OptionalOutput<PointMap> = OptionalOutput::new(
        "matches",
        "for every source vertex the target vertex that the map finds",
    );
    const HEALTH: Output<Table> = Output::new("health", "signs of a good or a bad map, one row");
}

impl Node for ZoomOut {
    const SPEC: Spec = Spec {
        kind: "zoomout",
        version: 2,
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
        let options = ZoomOutOptions {
            k: self.k,
            step: self.step,
            samples: self.samples,
            final_rounds: self.final_rounds,
            mass_weighted: self.mass_weighted,
        };
        let map = refine(
            (&source, source_mesh.map(TriMesh::vertices)),
            (&target, target_mesh.map(TriMesh::vertices)),
            &io.get(Self::COARSE),
            &options,
        )?;
        let matches = self.matches.then(|| point_map(&source, &target, &map));
        let meshes = source_mesh.zip(target_mesh);
        let kept = meshes.and_then(|(m, n)| chirality((&source, m), (&target, n), &map));
        if let Some(kept) = kept.filter(|it| *it < MIRRORED) {
            io.note(format!(
                "the map mirrors the shape (chirality {:.0} %): left and right, or front and back, \
                 are swapped",
                100.0 * kept
            ));
        }
        let percent = |name: &str, value: f64| Column::numbers(name, "%", vec![100.0 * value]);
        let orthogonality = orthogonality(map.source_from_target.as_ref());
        io.put(
            Self::HEALTH,
            Table::new(vec![
                Column::numbers("orthogonality", "", vec![orthogonality]),
                percent(
                    "coverage",
                    matches.as_ref().map_or(f64::NAN, |it| coverage(it, &target.mass)),
                ),
                percent("chirality", kept.unwrap_or(f64::NAN)),
            ]),
        );
        io.put(Self::MAP, map);
        io.put_optional(Self::MATCHES, matches, "the parameter `matches` is false");
        Ok(())
    }
}
