//! Kind `scan`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{
    Input, Node, NodeError, NodeIo, OptionalInput, OptionalOutput, Output, Spec,
};
use crate::kernels::sensors::scan::{self, ScanOptions, Station};
use crate::kernels::table::{Column, Table};
use crate::kernels::{
    geometry::{landmarks::Landmarks, mesh::TriMesh},
    rigs::weights::SkinWeights,
};

/// Simulates a scan of a mesh: points seen from stations around it, merged to one cloud.
///
/// Every station sees what its depth picture shows, with noise along the rays; its points are moved a
/// little, as registration leaves them. The axis is +y. The cloud is a mesh without faces: sides that
/// no station sees are missing, and parts that overlap do not quite fit. Joints need nothing carried
/// over: the points lie where the mesh does.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Scan {
    /// How many stations stand around the shape, evenly but for some chance.
    #[schemars(range(min = 1, max = 1000))]
    pub stations: usize,
    /// The most degrees that they stand above and below the horizon.
    #[schemars(range(min = 0.0, max = 89.0))]
    pub elevation: f64,
    /// Their distance from the middle, in diagonals of the shape's box.
    #[schemars(range(min = 1.5, max = 100.0))]
    pub distance: f64,
    /// Pixels along the sides of a station's picture.
    #[schemars(range(min = 8, max = 4096))]
    pub resolution: usize,
    /// The most points of a station; chosen at random if it sees more.
    #[schemars(range(min = 1))]
    pub points_per_station: usize,
    /// The deviation along the rays, in diagonals of the shape's box.
    #[schemars(range(min = 0.0, max = 0.1))]
    pub noise: f64,
    /// Surfaces that are seen under a flatter angle, in degrees, are not measured.
    #[schemars(range(min = 0.0, max = 89.0))]
    pub grazing: f64,
    /// The share of points that are lost, at random.
    #[schemars(range(min = 0.0, max = 0.99))]
    pub dropped: f64,
    /// How far a station's points are turned about each axis, in degrees: the deviation.
    #[schemars(range(min = 0.0, max = 45.0))]
    pub turn: f64,
    /// How far they are shifted along each axis, in diagonals of the box: the deviation.
    #[schemars(range(min = 0.0, max = 0.1))]
    pub shift: f64,
    /// Another seed gives other stations and other errors.
    pub seed: u64,
}

impl Default for Scan {
    fn default() -> Self {
        let it = ScanOptions::default();
        Self {
            stations: it.n_stations,
            elevation: it.elevation_deg,
            distance: it.distance,
            resolution: it.resolution,
            points_per_station: it.points_per_station,
            noise: it.noise,
            grazing: it.grazing_deg,
            dropped: it.dropped,
            turn: it.turn_deg,
            shift: it.shift,
            seed: it.seed,
        }
    }
}

impl Scan {
    const MESH: Input<TriMesh> = Input::new("mesh", "the surface");
    const WEIGHTS: OptionalInput<SkinWeights> = OptionalInput::new("weights", "its skin weights");
    const LANDMARKS: OptionalInput<Landmarks> = OptionalInput::new("landmarks", "its landmarks");
    const CLOUD: Output<TriMesh> = Output::new("mesh", "the points of all stations");
    const STATIONS: Output<Table> =
        Output::new("stations", "one row a station: place, error, points");
    const NEW_WEIGHTS: OptionalOutput<SkinWeights> =
        OptionalOutput::new("weights", "the skin weights of the points");
    const NEW_LANDMARKS: OptionalOutput<Landmarks> =
        OptionalOutput::new("landmarks", "the points nearest to the landmarks");

    fn options(&self) -> ScanOptions {
        ScanOptions {
            n_stations: self.stations,
            elevation_deg: self.elevation,
            distance: self.distance,
            resolution: self.resolution,
            points_per_station: self.points_per_station,
            noise: self.noise,
            grazing_deg: self.grazing,
            dropped: self.dropped,
            turn_deg: self.turn,
            shift: self.shift,
            seed: self.seed,
        }
    }
}

impl Node for Scan {
    const SPEC: Spec = Spec {
        kind: "scan",
        version: 1,
        inputs: &[Self::MESH.port(), Self::WEIGHTS.port(), Self::LANDMARKS.port()],
        outputs: &[
            Self::CLOUD.port(),
            Self::STATIONS.port(),
            Self::NEW_WEIGHTS.port(),
            Self::NEW_LANDMARKS.port(),
        ],
        cites: &[],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.scan]
kind = "scan"
mesh = "@body.mesh"
weights = "@body.weights"
landmarks = "@body.landmarks"
stations = 4
points_per_station = 400
resolution = 160
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let made = scan::scan(&io.get(Self::MESH), &self.options())?;
        let blind = made.stations.iter().filter(|it| it.n_points == 0).count();
        if blind > 0 {
            io.note(format!("{blind} of {} stations see nothing", made.stations.len()));
        }
        let weights = io.get_optional(Self::WEIGHTS);
        let weights = weights.map(|it| made.cloud.weights(&it)).transpose()?;
        let landmarks = io.get_optional(Self::LANDMARKS);
        let landmarks = landmarks.map(|it| made.cloud.landmarks(&it)).transpose()?;
        io.put(Self::STATIONS, stations_table(&made.stations));
        io.put(Self::CLOUD, made.cloud.mesh);
        io.put_optional(Self::NEW_WEIGHTS, weights, "no weights were given");
        io.put_optional(Self::NEW_LANDMARKS, landmarks, "no landmarks were given");
        Ok(())
    }
}

fn stations_table(stations: &[Station]) -> Table {
    let column = |name, unit, of: &dyn Fn(&Station) -> f64| {
        Column::numbers(name, unit, stations.iter().map(of).collect())
    };
    Table::new(vec![
        Column::numbers("station", "", (0..stations.len()).map(|it| it as f64).collect()),
        column("azimuth", "°", &|it| it.direction.x.atan2(it.direction.z).to_degrees()),
        column("elevation", "°", &|it| it.direction.y.asin().to_degrees()),
        column("turn", "°", &|it| it.error.rotation.angle().to_degrees()),
        column("points", "", &|it| it.n_points as f64),
    ])
}
