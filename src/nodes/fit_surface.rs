//! Kind `fit_surface`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::maps::fit_surface::{FitSurfaceOptions, Gap, fit_surface, gap};
use crate::kernels::maps::functional_map::PointMap;
use crate::kernels::table::{Column, Table};

/// Lays the source's surface onto the target, beginning with matches of their vertices.
///
/// The surface bends, and parts of it change their size, but neighbours stay together; what matches have
/// wrong here and there is mended, and every vertex of the source has its own place on the target.
/// `transfer` with the mode `surface` takes joints from it. The target may be a mesh or a point cloud, in
/// another pose than the source, and of another unit.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FitSurfaceNode {
    /// About how many nodes carry the surface: more follow smaller shapes, fewer mend larger errors of
    /// the matches.
    #[schemars(range(min = 10, max = 5000))]
    pub nodes: usize,
    /// How much neighbouring nodes keep to one motion in the end; the first rounds are thirty times as
    /// stiff.
    #[schemars(range(min = 1e-6, max = 1e6))]
    pub stiffness: f64,
    /// Rounds of looking for places and moving there, in each of five stages.
    #[schemars(range(min = 1, max = 100))]
    pub rounds: usize,
    /// Vertices of either shape that pull the surface to its place; 0 for all.
    pub samples: usize,
    /// How much a place holds a vertex along the surface, against across it.
    #[schemars(range(min = 1e-6, max = 1.0))]
    pub sliding: f64,
}

impl Default for FitSurfaceNode {
    fn default() -> Self {
        let FitSurfaceOptions { n_nodes, stiffness, rounds, samples, sliding } =
            FitSurfaceOptions::default();
        Self { nodes: n_nodes, stiffness, rounds, samples, sliding }
    }
}

/// If a tenth of the target is farther from the surface, in roots of its area, parts are not reached:
/// good fits of people and animals have 0.002 to 0.004.
const FAR: f64 = 0.01;

impl FitSurfaceNode {
    const SOURCE_MESH: Input<TriMesh> = Input::new("source_mesh", "the surface to lay on");
    const TARGET_MESH: Input<TriMesh> =
        Input::new("target_mesh", "a mesh or points to lay it onto");
    const MATCHES: Input<PointMap> =
        Input::new("matches", "for every source vertex a target vertex, with errors");
    const MESH: Output<TriMesh> = Output::new("mesh", "the source's vertices on the target");
    const HEALTH: Output<Table> = Output::new("health", "how near it lies, one row");
}

impl Node for FitSurfaceNode {
    const SPEC: Spec = Spec {
        kind: "fit_surface",
        version: 2,
        inputs: &[Self::SOURCE_MESH.port(), Self::TARGET_MESH.port(), Self::MATCHES.port()],
        outputs: &[Self::MESH.port(), Self::HEALTH.port()],
        cites: &["sumner2007embedded", "amberg2007optimal", "sorkine2007rigid"],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.other]
kind = "remesh"
mesh = "@body.mesh"
vertices = 800

[nodes.body_operator]
kind = "laplacian"
mesh = "@body.mesh"

[nodes.other_operator]
kind = "laplacian"
mesh = "@other.mesh"

[nodes.body_basis]
kind = "eigs"
operator = "@body_operator"
k = 40

[nodes.other_basis]
kind = "eigs"
operator = "@other_operator"
k = 40

[nodes.body_functions]
kind = "descriptors"
basis = "@body_basis"

[nodes.other_functions]
kind = "descriptors"
basis = "@other_basis"

[nodes.coarse]
kind = "fmap"
source_basis = "@body_basis"
target_basis = "@other_basis"
source_descriptors = "@body_functions"
target_descriptors = "@other_functions"
k = 15

[nodes.fine]
kind = "zoomout"
source_basis = "@body_basis"
target_basis = "@other_basis"
map = "@coarse"
k = 40
step = 5

[nodes.surface]
kind = "fit_surface"
source_mesh = "@body.mesh"
target_mesh = "@other.mesh"
matches = "@fine.matches"
nodes = 200
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (source, target) = (io.get(Self::SOURCE_MESH), io.get(Self::TARGET_MESH));
        let options = FitSurfaceOptions {
            n_nodes: self.nodes,
            stiffness: self.stiffness,
            rounds: self.rounds,
            samples: self.samples,
            sliding: self.sliding,
        };
        let vertices = fit_surface(&source, &target, &io.get(Self::MATCHES), &options)?;
        let fitted = source.with_vertices(vertices)?;
        let Gap { mean, ninth_tenth } = gap(&fitted, &target, self.samples);
        if ninth_tenth > FAR {
            io.note(format!(
                "a tenth of the target is farther than {:.1} % of the root of the area from the \
                 surface: the matches may be wrong",
                100.0 * ninth_tenth
            ));
        }
        let percent = |name: &str, value: f64| Column::numbers(name, "%", vec![100.0 * value]);
        let columns = vec![percent("mean gap", mean), percent("gap of nine tenths", ninth_tenth)];
        io.put(Self::HEALTH, Table::new(columns));
        io.put(Self::MESH, fitted);
        Ok(())
    }
}
