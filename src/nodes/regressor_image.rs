//! Kind `regressor_image`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, OptionalInput, Output, Spec};
use crate::kernels::image::Image;
use crate::kernels::maps::functional_map::FunctionalMap;
use crate::kernels::pictures::matrix_image::{MatrixImageOptions, matrix_image};
use crate::kernels::transfer::regressor::SpectralRegressor;
use crate::kernels::transfer::regressor_bands::carried_regressor;

/// Draws a spectral regressor: a row a joint, a column an eigenfunction, entries squared.
///
/// With a map, it is the regressor that the map carries over to its target. Colours tell orders of
/// magnitude apart.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RegressorImage {
    /// Above the picture.
    pub title: String,
    /// Pixels of a cell, across.
    #[schemars(range(min = 1, max = 100))]
    pub cell_width: usize,
    /// Pixels of a cell, downwards.
    #[schemars(range(min = 4, max = 100))]
    pub cell_height: usize,
    /// Orders of magnitude below the largest entry that are told apart.
    #[schemars(range(min = 0.1, max = 30.0))]
    pub decades: f64,
}

impl Default for RegressorImage {
    fn default() -> Self {
        Self { title: String::new(), cell_width: 8, cell_height: 14, decades: 4.0 }
    }
}

impl RegressorImage {
    const REGRESSOR: Input<SpectralRegressor> =
        Input::new("regressor", "the source's joints from coefficients");
    const MAP: OptionalInput<FunctionalMap> =
        OptionalInput::new("map", "carries the regressor over to its target");
    const IMAGE: Output<Image> = Output::new("image", "the picture");
}

impl Node for RegressorImage {
    const SPEC: Spec = Spec {
        kind: "regressor_image",
        version: 1,
        inputs: &[Self::REGRESSOR.port(), Self::MAP.port()],
        outputs: &[Self::IMAGE.port()],
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

[nodes.picture]
kind = "regressor_image"
regressor = "@spectral"
title = "a body"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let own = io.get(Self::REGRESSOR);
        let carried = match io.get_optional(Self::MAP) {
            Some(map) => carried_regressor(&own, &map)?,
            None => (*own).clone(),
        };
        let matrix = &carried.matrix;
        let squared = faer::Mat::from_fn(matrix.nrows(), matrix.ncols(), |row, column| {
            matrix[(row, column)].powi(2)
        });
        let options = MatrixImageOptions {
            cell: [self.cell_width, self.cell_height],
            rows: carried.names.clone(),
            x_label: "eigenfunction".to_owned(),
            title: self.title.clone(),
            decades: self.decades,
        };
        io.put(Self::IMAGE, matrix_image(squared.as_ref(), &options));
        Ok(())
    }
}
