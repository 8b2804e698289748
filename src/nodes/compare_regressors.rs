//! Kind `compare_regressors`.

use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Inputs, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::maps::functional_map::FunctionalMap;
use crate::kernels::table::{Column, Table};
use crate::kernels::transfer::regressor::SpectralRegressor;
use crate::kernels::transfer::regressor_bands::{
    PairDifference, bands, carried_regressor, compare_regressors,
};

/// Compares the regressors that maps carry over to different targets, by bands of frequencies.
///
/// For every pair, the Frobenius norm of the difference of squared entries. Regressors of one person in
/// two poses should differ less than those of two people, above all at low frequencies.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CompareRegressors {
    /// Who every target is, in the order of `maps`.
    #[schemars(length(min = 2))]
    pub identities: Vec<String>,
    /// The number of bands.
    #[serde(default = "default_bands")]
    #[schemars(range(min = 1, max = 1000))]
    pub bands: usize,
}

fn default_bands() -> usize {
    6
}

impl CompareRegressors {
    const REGRESSOR: Input<SpectralRegressor> =
        Input::new("regressor", "the source's joints from coefficients");
    const MAPS: Inputs<FunctionalMap> =
        Inputs::new("maps", "functions on every target to functions on the source");
    const PAIRS: Output<Table> = Output::new("pairs", "one row a pair and band");
    const SUMMARY: Output<Table> =
        Output::new("summary", "one row a band: means of equal and of different identities");
}

impl Node for CompareRegressors {
    const SPEC: Spec = Spec {
        kind: "compare_regressors",
        version: 1,
        inputs: &[Self::REGRESSOR.port(), Self::MAPS.port()],
        outputs: &[Self::PAIRS.port(), Self::SUMMARY.port()],
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
k = 30

[nodes.functions]
kind = "descriptors"
basis = "@basis"
landmarks = "@body.landmarks"

[nodes.with_landmarks]
kind = "fmap"
source_basis = "@basis"
target_basis = "@basis"
source_descriptors = "@functions"
target_descriptors = "@functions"
k = 15

[nodes.without_commutativity]
kind = "fmap"
source_basis = "@basis"
target_basis = "@basis"
source_descriptors = "@functions"
target_descriptors = "@functions"
k = 15
commutativity = 0.0

[nodes.regressor]
kind = "regressor"
mesh = "@body.mesh"
skeleton = "@body.skeleton"
weights = "@body.weights"

[nodes.spectral]
kind = "spectral_regressor"
regressor = "@regressor.regressor"
source_basis = "@basis"
k = 30

[nodes.differences]
kind = "compare_regressors"
regressor = "@spectral"
maps = ["@with_landmarks", "@without_commutativity", "@with_landmarks"]
identities = ["a", "b", "a"]
bands = 3
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let own = io.get(Self::REGRESSOR);
        let maps: Vec<Arc<FunctionalMap>> = io.get_all(Self::MAPS);
        let carried =
            maps.iter().map(|it| carried_regressor(&own, it)).collect::<Result<Vec<_>, _>>()?;
        let all: Vec<&SpectralRegressor> = carried.iter().collect();
        let pairs = compare_regressors(&all, &self.identities, self.bands)?;
        let names: Vec<String> = bands(carried[0].matrix.ncols(), self.bands)
            .iter()
            .map(|it| format!("{} to {}", it.start, it.end - 1))
            .collect();
        io.put(Self::PAIRS, self.pairs_table(&pairs, &names));
        io.put(Self::SUMMARY, summary_table(&pairs, &names));
        Ok(())
    }
}

impl CompareRegressors {
    fn pairs_table(&self, pairs: &[PairDifference], names: &[String]) -> Table {
        let cells = || pairs.iter().flat_map(|pair| (0..names.len()).map(move |band| (pair, band)));
        let texts = |of: &dyn Fn(&PairDifference, usize) -> String| {
            cells().map(|(pair, band)| of(pair, band)).collect()
        };
        let identity = |it: usize| self.identities[it].clone();
        Table::new(vec![
            Column::texts("first", texts(&|pair, _| identity(pair.first))),
            Column::texts("second", texts(&|pair, _| identity(pair.second))),
            Column::texts("identity", texts(&|pair, _| relation(pair.same).to_owned())),
            Column::texts("band", texts(&|_, band| names[band].clone())),
            Column::numbers("difference", "", cells().map(|(pair, it)| pair.bands[it]).collect()),
        ])
    }
}

fn relation(same: bool) -> &'static str {
    if same { "same" } else { "different" }
}

fn summary_table(pairs: &[PairDifference], names: &[String]) -> Table {
    let mean = |same: bool, band: usize| {
        let values: Vec<f64> =
            pairs.iter().filter(|it| it.same == same).map(|it| it.bands[band]).collect();
        values.iter().sum::<f64>() / values.len() as f64
    };
    let means = |same| (0..names.len()).map(|band| mean(same, band)).collect::<Vec<f64>>();
    let (same, different) = (means(true), means(false));
    let ratio = same.iter().zip(&different).map(|(same, different)| same / different).collect();
    Table::new(vec![
        Column::texts("eigenfunctions", names.to_vec()),
        Column::numbers("same identity", "", same),
        Column::numbers("different identity", "", different),
        Column::numbers("ratio", "", ratio),
    ])
}
