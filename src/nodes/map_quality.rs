//! Kind `map_quality`.

use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, OptionalInput, Output, Spec};
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::maps::chirality::chirality;
use crate::kernels::maps::correspondences::Correspondences;
use crate::kernels::maps::functional_map::{FunctionalMap, PointMap};
use crate::kernels::maps::map_quality::{
    area_under_curve, band_energy, coverage, dirichlet_energy, error_curve, geodesic_errors,
    inverse_geodesic_errors, orthogonality, return_distances, weighted_mean,
};
use crate::kernels::maps::point_map::check;
use crate::kernels::spectral::basis::Basis;
use crate::kernels::table::{Column, Table};

/// Measures how good a map between two shapes is, as far as its inputs tell.
///
/// From the functional map: `orthogonality`, `|C^T C - I| / sqrt(k)`, near 0 for maps that keep areas
/// (0.1 to 0.5 on good real pairs); `band energy`, the part of its squares near the diagonal; and with
/// both meshes `chirality`, from 100 % for maps that keep left and right to -100 % for mirrored ones.
/// From matches: `coverage`, the part of the target's area that is hit; with meshes the `Dirichlet
/// energy`, which is 1 for isometries and above for rough maps. From matches and inverse matches:
/// `return`, how far from home source vertices come back. From the truth: the mean and the greatest
/// geodesic error of the matches, and the area under their error curve. Distances run along the
/// source, in percent of the root of its area; means are weighted by areas.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MapQuality {
    /// Eigenfunctions beside the diagonal that count for the band energy.
    pub band: usize,
    /// Where the error curve ends, in percent of the root of the source's area.
    #[schemars(range(min = 0.001, max = 1000.0))]
    pub curve_end: f64,
    /// Points of the error curve.
    #[schemars(range(min = 2, max = 10000))]
    pub curve_points: usize,
}

impl Default for MapQuality {
    fn default() -> Self {
        Self { band: 5, curve_end: 25.0, curve_points: 51 }
    }
}

impl MapQuality {
    const SOURCE_BASIS: Input<Basis> = Input::new("source_basis", "eigenpairs of the source");
    const TARGET_BASIS: Input<Basis> = Input::new("target_basis", "eigenpairs of the target");
    const MAP: OptionalInput<FunctionalMap> =
        OptionalInput::new("map", "functions on the target to functions on the source");
    const MATCHES: OptionalInput<PointMap> =
        OptionalInput::new("matches", "for every source vertex a target vertex");
    const INVERSE_MATCHES: OptionalInput<PointMap> =
        OptionalInput::new("inverse_matches", "for every target vertex a source vertex");
    const SOURCE_MESH: OptionalInput<TriMesh> = OptionalInput::new("source_mesh", "the source");
    const TARGET_MESH: OptionalInput<TriMesh> = OptionalInput::new("target_mesh", "the target");
    const TRUTH: OptionalInput<Correspondences> =
        OptionalInput::new("truth", "for every target vertex its true place on the source");
    const QUALITY: Output<Table> = Output::new("quality", "one row");
    const CURVE: Output<Table> =
        Output::new("curve", "the part of the matches within every error; empty without truth");
}

impl Node for MapQuality {
    const SPEC: Spec = Spec {
        kind: "map_quality",
        version: 1,
        inputs: &[
            Self::SOURCE_BASIS.port(),
            Self::TARGET_BASIS.port(),
            Self::MAP.port(),
            Self::MATCHES.port(),
            Self::INVERSE_MATCHES.port(),
            Self::SOURCE_MESH.port(),
            Self::TARGET_MESH.port(),
            Self::TRUTH.port(),
        ],
        outputs: &[Self::QUALITY.port(), Self::CURVE.port()],
        cites: &["kim2011blended", "ren2018continuous", "ovsjanikov2012functional"],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.coarse]
kind = "decimate"
mesh = "@body.mesh"
landmarks = "@body.landmarks"
vertices = 600

[nodes.source_operator]
kind = "laplacian"
mesh = "@body.mesh"

[nodes.source_basis]
kind = "eigs"
operator = "@source_operator"
k = 40

[nodes.target_operator]
kind = "laplacian"
mesh = "@coarse.mesh"

[nodes.target_basis]
kind = "eigs"
operator = "@target_operator"
k = 40

[nodes.source_functions]
kind = "descriptors"
basis = "@source_basis"
landmarks = "@body.landmarks"

[nodes.target_functions]
kind = "descriptors"
basis = "@target_basis"
landmarks = "@coarse.landmarks"

[nodes.first]
kind = "fmap"
source_basis = "@source_basis"
target_basis = "@target_basis"
source_descriptors = "@source_functions"
target_descriptors = "@target_functions"
k = 15

[nodes.fine]
kind = "zoomout"
source_basis = "@source_basis"
target_basis = "@target_basis"
map = "@first"
k = 40

[nodes.back]
kind = "point_map"
source_basis = "@source_basis"
target_basis = "@target_basis"
map = "@fine.map"
direction = "source_of_target"

[nodes.truth]
kind = "correspondences"
mesh = "@coarse.mesh"
reference = "@body.mesh"

[nodes.judged]
kind = "map_quality"
source_basis = "@source_basis"
target_basis = "@target_basis"
map = "@fine.map"
matches = "@fine.matches"
inverse_matches = "@back"
source_mesh = "@body.mesh"
target_mesh = "@coarse.mesh"
truth = "@truth"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let judged = Judged::new(io)?;
        let errors = judged.errors();
        io.put(Self::QUALITY, self.quality(&judged, &errors));
        io.put(Self::CURVE, self.curve(&errors));
        Ok(())
    }
}

/// All inputs, of sizes that fit.
struct Judged {
    source: Arc<Basis>,
    target: Arc<Basis>,
    map: Option<Arc<FunctionalMap>>,
    forth: Option<Arc<PointMap>>,
    back: Option<Arc<PointMap>>,
    source_mesh: Option<Arc<TriMesh>>,
    target_mesh: Option<Arc<TriMesh>>,
    truth: Option<Arc<Correspondences>>,
}

/// Geodesic errors of both maps, in parts of the root of the source's area.
struct Errors {
    forth: Option<Vec<f64>>,
    back: Option<Vec<f64>>,
}

impl Judged {
    fn new(io: &NodeIo<'_>) -> Result<Self, NodeError> {
        let res = Self {
            source: io.get(MapQuality::SOURCE_BASIS),
            target: io.get(MapQuality::TARGET_BASIS),
            map: io.get_optional(MapQuality::MAP),
            forth: io.get_optional(MapQuality::MATCHES),
            back: io.get_optional(MapQuality::INVERSE_MATCHES),
            source_mesh: io.get_optional(MapQuality::SOURCE_MESH),
            target_mesh: io.get_optional(MapQuality::TARGET_MESH),
            truth: io.get_optional(MapQuality::TRUTH),
        };
        if let Some(map) = &res.map {
            check(&res.source, &res.target, map)?;
        }
        res.check_sizes()?;
        Ok(res)
    }

    fn check_sizes(&self) -> Result<(), NodeError> {
        let (m, n) = (self.source.n_vertices(), self.target.n_vertices());
        let size = |map: &Option<Arc<PointMap>>| {
            map.as_ref().map(|it| (it.target_of_source.len(), it.n_target))
        };
        let mesh = |mesh: &Option<Arc<TriMesh>>| mesh.as_ref().map(|it| it.n_vertices());
        let (forth, back) = (size(&self.forth), size(&self.back));
        for (input, found, expected, basis) in [
            ("matches", forth.map(|it| it.0), m, "source"),
            ("matches", forth.map(|it| it.1), n, "target"),
            ("inverse_matches", back.map(|it| it.0), n, "target"),
            ("inverse_matches", back.map(|it| it.1), m, "source"),
            ("source_mesh", mesh(&self.source_mesh), m, "source"),
            ("target_mesh", mesh(&self.target_mesh), n, "target"),
            ("truth", self.truth.as_ref().map(|it| it.faces.len()), n, "target"),
        ] {
            if let Some(found) = found.filter(|it| *it != expected) {
                return Err(NodeError::failed(format!(
                    "`{input}` has {found} vertices where the {basis} basis has {expected}"
                )));
            }
        }
        let Some(truth) = &self.truth else { return Ok(()) };
        let Some(mesh) = &self.source_mesh else {
            return Err(NodeError::failed("with `truth`, the input `source_mesh` is needed"));
        };
        match truth.n_faces == mesh.n_faces() {
            true => Ok(()),
            false => Err(NodeError::failed(format!(
                "`truth` refers to a reference of {} faces, but `source_mesh` has {}",
                truth.n_faces,
                mesh.n_faces()
            ))),
        }
    }

    /// The source, if distances can be measured on it.
    fn surface(&self) -> Option<&TriMesh> {
        self.source_mesh.as_deref().filter(|it| !it.is_point_cloud())
    }

    fn errors(&self) -> Errors {
        let truth = self.surface().zip(self.truth.as_deref());
        Errors {
            forth: truth
                .zip(self.forth.as_ref())
                .map(|((mesh, truth), matches)| geodesic_errors(mesh, matches, truth)),
            back: truth
                .zip(self.back.as_ref())
                .map(|((mesh, truth), matches)| inverse_geodesic_errors(mesh, matches, truth)),
        }
    }

    /// From 1 for maps that keep left and right to -1 for mirrored ones.
    fn chirality(&self) -> Option<f64> {
        let (source, target) = self.source_mesh.as_deref().zip(self.target_mesh.as_deref())?;
        chirality((&self.source, source), (&self.target, target), self.map.as_deref()?)
    }
}

impl MapQuality {
    fn quality(&self, judged: &Judged, errors: &Errors) -> Table {
        let map = judged.map.as_ref().map(|it| it.source_from_target.as_ref());
        let number = |name: &str, unit: &str, value: Option<f64>| {
            Column::numbers(name, unit, vec![value.unwrap_or(f64::NAN)])
        };
        let percent =
            |name: &str, value: Option<f64>| number(name, "%", value.map(|it| 100.0 * it));
        let returns = judged.surface().zip(judged.forth.as_ref()).zip(judged.back.as_ref());
        let returns = returns.map(|((mesh, forth), back)| return_distances(mesh, forth, back));
        let meshes = judged.surface().zip(judged.target_mesh.as_deref());
        let dirichlet = meshes.zip(judged.forth.as_deref());
        let hit =
            |map: &Option<Arc<PointMap>>, mass: &[f64]| map.as_ref().map(|it| coverage(it, mass));
        let (source_mass, target_mass) = (&judged.source.mass, &judged.target.mass);
        let mean = |errors: &Option<Vec<f64>>, mass: &[f64]| {
            errors.as_ref().map(|it| weighted_mean(it, mass))
        };
        let greatest = |errors: &Option<Vec<f64>>| {
            errors.as_ref().map(|it| it.iter().fold(0.0, |a: f64, b| a.max(*b)))
        };
        let under = |errors: &Option<Vec<f64>>| {
            errors.as_ref().map(|it| area_under_curve(it, self.curve_end / 100.0))
        };
        Table::new(vec![
            number("orthogonality", "", map.map(orthogonality)),
            percent("band energy", map.map(|it| band_energy(it, self.band))),
            percent("chirality", judged.chirality()),
            percent("coverage", hit(&judged.forth, target_mass)),
            percent("inverse coverage", hit(&judged.back, source_mass)),
            number(
                "Dirichlet energy",
                "",
                dirichlet.map(|((source, target), it)| dirichlet_energy(source, it, target)),
            ),
            percent("return", mean(&returns, source_mass)),
            percent("error", mean(&errors.forth, source_mass)),
            percent("greatest error", greatest(&errors.forth)),
            percent("area under curve", under(&errors.forth)),
            percent("inverse error", mean(&errors.back, target_mass)),
            percent("greatest inverse error", greatest(&errors.back)),
            percent("inverse area under curve", under(&errors.back)),
        ])
    }

    fn curve(&self, errors: &Errors) -> Table {
        let known = errors.forth.is_some() || errors.back.is_some();
        let n_points = if known { self.curve_points } else { 0 };
        let percents: Vec<f64> = (0..n_points)
            .map(|it| self.curve_end * it as f64 / (self.curve_points - 1) as f64)
            .collect();
        let thresholds: Vec<f64> = percents.iter().map(|it| it / 100.0).collect();
        let curve = |name: &str, errors: &Option<Vec<f64>>| {
            let parts = errors.as_ref().map(|it| error_curve(it, &thresholds));
            let parts = parts.unwrap_or_else(|| vec![f64::NAN; n_points]);
            Column::numbers(name, "%", parts.iter().map(|it| 100.0 * it).collect())
        };
        Table::new(vec![
            Column::numbers("error", "%", percents),
            curve("matches", &errors.forth),
            curve("inverse matches", &errors.back),
        ])
    }
}
