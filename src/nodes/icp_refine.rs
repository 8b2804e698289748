//! Kind `icp_refine`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::maps::functional_map::{FunctionalMap, PointMap};
use crate::kernels::maps::icp_refine::{IcpOptions, icp_refine};
use crate::kernels::spectral::basis::Basis;
use crate::kernels::table::{Column, Table};

/// Makes a functional map orthogonal, by matching points and solving for the map in turns.
///
/// The paper's demo does five rounds between `fmap` and `zoomout`. The size of the map stays; it need
/// not be square.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct IcpRefine {
    /// Rounds of matching and solving.
    #[schemars(range(min = 1, max = 1000))]
    pub rounds: usize,
    /// Weigh vertices by their areas, so that uneven sampling does not matter. The demo does not.
    pub mass_weighted: bool,
}

impl Default for IcpRefine {
    fn default() -> Self {
        let IcpOptions { rounds, mass_weighted } = IcpOptions::default();
        Self { rounds, mass_weighted }
    }
}

impl IcpRefine {
    const SOURCE_BASIS: Input<Basis> = Input::new("source_basis", "eigenpairs of the source");
    const TARGET_BASIS: Input<Basis> = Input::new("target_basis", "eigenpairs of the target");
    const COARSE: Input<FunctionalMap> = Input::new("map", "the map to refine");
    const MAP: Output<FunctionalMap> =
        Output::new("map", "functions on the target to functions on the source, orthogonal");
    const MATCHES: Output<PointMap> =
        Output::new("matches", "for every source vertex the target vertex that the map finds");
    const ROUNDS: Output<Table> =
        Output::new("rounds", "one row a round: the part of the matches that it changed");
}

impl Node for IcpRefine {
    const SPEC: Spec = Spec {
        kind: "icp_refine",
        version: 1,
        inputs: &[Self::SOURCE_BASIS.port(), Self::TARGET_BASIS.port(), Self::COARSE.port()],
        outputs: &[Self::MAP.port(), Self::MATCHES.port(), Self::ROUNDS.port()],
        cites: &["ovsjanikov2012functional", "musoni2021functional"],
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

[nodes.refined]
kind = "icp_refine"
source_basis = "@basis"
target_basis = "@basis"
map = "@coarse"
rounds = 3
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (source, target) = (io.get(Self::SOURCE_BASIS), io.get(Self::TARGET_BASIS));
        let options = IcpOptions { rounds: self.rounds, mass_weighted: self.mass_weighted };
        let (map, matches, report) = icp_refine(&source, &target, &io.get(Self::COARSE), &options)?;
        let rounds = (1..=report.changed.len()).map(|it| it as f64).collect();
        let changed = report.changed.iter().map(|it| 100.0 * it).collect();
        io.put(
            Self::ROUNDS,
            Table::new(vec![
                Column::numbers("round", "", rounds),
                Column::numbers("changed matches", "%", changed),
            ]),
        );
        io.put(Self::MAP, map);
        io.put(Self::MATCHES, matches);
        Ok(())
    }
}
