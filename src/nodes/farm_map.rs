//! Kind `farm_map`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::maps::farm_map::{FarmOptions, farm_map};
use crate::kernels::maps::fmap::FitOptions;
use crate::kernels::maps::functional_map::FunctionalMap;
use crate::kernels::spectral::basis::Basis;
use crate::kernels::spectral::descriptors::Descriptors;
use crate::kernels::table::{Column, Table};

/// Fits the functional map of FARM, a baseline: few eigenfunctions, and more of the source than of the
/// target.
///
/// An exact fit to descriptors, rounds of iterated closest points, and robust fits to matches of
/// vertices that are spread over the source. With `transfer` in the mode `coordinates` and a regressor,
/// this is FARM's skeleton.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FarmMap {
    /// Eigenfunctions of the source, no fewer than of the target.
    #[schemars(range(min = 2, max = 80))]
    pub k_source: usize,
    /// Eigenfunctions of the target.
    #[schemars(range(min = 2, max = 80))]
    pub k_target: usize,
    /// The first fit's weight of preserved descriptors.
    #[schemars(range(min = 0.0))]
    pub descriptors: f64,
    /// The first fit's weight of commutativity with multiplication by descriptors.
    #[schemars(range(min = 0.0))]
    pub commutativity: f64,
    /// The first fit's weight of commutativity with the Laplacians.
    #[schemars(range(min = 0.0))]
    pub laplacian: f64,
    /// Rounds of iterated closest points.
    #[schemars(range(max = 100))]
    pub icp_rounds: usize,
    /// How many matches every robust fit takes.
    #[schemars(length(max = 20))]
    pub boosts: Vec<usize>,
    /// The weight that robust fits give to orthogonality, for every match.
    #[schemars(range(min = 1e-9))]
    pub orthogonality: f64,
}

impl Default for FarmMap {
    fn default() -> Self {
        let FarmOptions { k_source, k_target, fit, icp_rounds, boosts, orthogonality } =
            FarmOptions::default();
        let FitOptions { descriptors, commutativity, laplacian, .. } = fit;
        Self {
            k_source,
            k_target,
            descriptors,
            commutativity,
            laplacian,
            icp_rounds,
            boosts,
            orthogonality,
        }
    }
}

impl FarmMap {
    const SOURCE_BASIS: Input<Basis> = Input::new("source_basis", "eigenpairs of the source");
    const TARGET_BASIS: Input<Basis> = Input::new("target_basis", "eigenpairs of the target");
    const SOURCE_DESCRIPTORS: Input<Descriptors> =
        Input::new("source_descriptors", "descriptors of the source");
    const TARGET_DESCRIPTORS: Input<Descriptors> =
        Input::new("target_descriptors", "descriptors of the target, the same ones");
    const SOURCE_MESH: Input<TriMesh> =
        Input::new("source_mesh", "the source, over which matches are spread");
    const MAP: Output<FunctionalMap> =
        Output::new("map", "functions on the target to functions on the source");
    const BOOSTS: Output<Table> =
        Output::new("boosts", "how far matches are from each other, before and after each boost");

    fn options(&self) -> FarmOptions {
        let k = self.k_target;
        let FarmMap { descriptors, commutativity, laplacian, .. } = *self;
        FarmOptions {
            k_source: self.k_source,
            k_target: self.k_target,
            fit: FitOptions { k, descriptors, commutativity, laplacian, ..FitOptions::default() },
            icp_rounds: self.icp_rounds,
            boosts: self.boosts.clone(),
            orthogonality: self.orthogonality,
        }
    }
}

impl Node for FarmMap {
    const SPEC: Spec = Spec {
        kind: "farm_map",
        version: 2,
        inputs: &[
            Self::SOURCE_BASIS.port(),
            Self::TARGET_BASIS.port(),
            Self::SOURCE_DESCRIPTORS.port(),
            Self::TARGET_DESCRIPTORS.port(),
            Self::SOURCE_MESH.port(),
        ],
        outputs: &[Self::MAP.port(), Self::BOOSTS.port()],
        cites: &["marin2020farm"],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.operator]
kind = "laplacian"
mesh = "@body.mesh"

[nodes.basis]
kind = "eigs"
operator = "@operator"
k = 30

[nodes.functions]
kind = "descriptors"
basis = "@basis"
landmarks = "@body.landmarks"

[nodes.farm]
kind = "farm_map"
source_basis = "@basis"
target_basis = "@basis"
source_descriptors = "@functions"
target_descriptors = "@functions"
source_mesh = "@body.mesh"
k_source = 20
k_target = 12
boosts = [100]
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (source, target) = (io.get(Self::SOURCE_BASIS), io.get(Self::TARGET_BASIS));
        let g = io.get(Self::SOURCE_DESCRIPTORS);
        let f = io.get(Self::TARGET_DESCRIPTORS);
        let mesh = io.get(Self::SOURCE_MESH);
        let options = self.options();
        let (map, report) = farm_map((&source, &g, mesh.vertices()), (&target, &f), &options)?;
        let column = |of: fn(&[f64; 2]) -> f64| report.distances.iter().map(of).collect();
        io.put(Self::MAP, map);
        io.put(
            Self::BOOSTS,
            Table::new(vec![
                Column::numbers("matches", "", self.boosts.iter().map(|&it| it as f64).collect()),
                Column::numbers("before", "", column(|it| it[0])),
                Column::numbers("after", "", column(|it| it[1])),
            ]),
        );
        Ok(())
    }
}
