//! What a scanner brings home of a body: points from several stations, not quite fitted together.

mod station;
#[cfg(test)]
mod tests;

use nalgebra::Isometry3;
use rayon::prelude::*;

use crate::kernels::geometry::mesh::{MeshError, TriMesh, Vec3};
use crate::kernels::geometry::point_tree::PointTree;
use crate::kernels::numerics::random::Random;
use crate::kernels::numerics::sparse::CsrMatrix;
use crate::kernels::remeshing::resampled::Resampled;

use station::{Shot, registration_error, shoot, stand};

/// The scanner and how it is used.
#[derive(Debug, Clone, PartialEq)]
pub struct ScanOptions {
    /// Stations around the shape, evenly but for some chance.
    pub n_stations: usize,
    /// The most degrees that stations stand above and below the horizon.
    pub elevation_deg: f64,
    /// From the middle of the shape, in diagonals of its box.
    pub distance: f64,
    /// Pixels along the sides of a station's picture.
    pub resolution: usize,
    /// The most points of a station; chosen at random if it sees more.
    pub points_per_station: usize,
    /// The deviation along the rays, in diagonals of the shape's box.
    pub noise: f64,
    /// Surfaces seen under a flatter angle are not measured.
    pub grazing_deg: f64,
    /// The share of points that are lost, at random.
    pub dropped: f64,
    /// The deviation of the turn of a station's points about each axis.
    pub turn_deg: f64,
    /// The deviation of the shift of a station's points along each axis, in diagonals of the box.
    pub shift: f64,
    pub seed: u64,
}

impl Default for ScanOptions {
    fn default() -> Self {
        Self {
            n_stations: 6,
            elevation_deg: 20.0,
            distance: 2.0,
            resolution: 320,
            points_per_station: 5000,
            noise: 0.001,
            grazing_deg: 10.0,
            dropped: 0.0,
            turn_deg: 0.1,
            shift: 0.0005,
            seed: 0,
        }
    }
}

/// Points of all stations.
#[derive(Debug, Clone, PartialEq)]
pub struct Scan {
    /// The points, those of the first station first, and where they lie on the surface. Every vertex
    /// has the nearest point, as seen from where points should be.
    pub cloud: Resampled,
    pub station_of_point: Vec<u32>,
    pub stations: Vec<Station>,
}

/// Where a station stood and how well its points were fitted to the others.
#[derive(Debug, Clone, PartialEq)]
pub struct Station {
    /// From the shape to the station.
    pub direction: Vec3,
    /// Takes the points from where they are to where the station was thought to see them.
    pub error: Isometry3<f64>,
    pub n_points: usize,
}

/// Why there is no scan.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ScanError {
    #[error("none of the {n_stations} stations sees anything of the surface")]
    NothingSeen { n_stations: usize },
    #[error("a scan needs a station")]
    NoStations,
    #[error(transparent)]
    Mesh(#[from] MeshError),
}

/// Simulates a scan of a mesh from stations around it (the axis is +y): what each sees by a depth
/// buffer, with noise along the rays, moved a little as registration leaves it, all in one cloud.
///
/// # Errors
/// See [`ScanError`].
pub fn scan(mesh: &TriMesh, options: &ScanOptions) -> Result<Scan, ScanError> {
    mesh.check_has_faces()?;
    if options.n_stations == 0 {
        return Err(ScanError::NoStations);
    }
    let (low, high) = mesh.bounds();
    let (middle, diagonal) = (0.5 * (low + high), (high - low).norm());
    let visit = |index: usize| {
        let mut random = Random::stream(options.seed, &format!("station {index}"));
        let direction = stand(index, options, &mut random);
        let error = registration_error(&middle, diagonal, options, &mut random);
        (direction, error, shoot(mesh, direction, diagonal, options, &mut random))
    };
    let visits: Vec<_> = (0..options.n_stations).into_par_iter().map(visit).collect();
    let (mut stations, mut station_of_point) = (Vec::new(), Vec::new());
    let (mut true_places, mut places, mut triplets) = (Vec::new(), Vec::new(), Vec::new());
    for (station, (direction, error, shots)) in visits.into_iter().enumerate() {
        let n_points = shots.len();
        for Shot { place, measured, corners, shares } in shots {
            let row = places.len() as u32;
            triplets
                .extend((0..3).map(|it| (row, corners[it], shares[it])).filter(|it| it.2 > 0.0));
            true_places.push(place);
            places.push((error * nalgebra::Point3::from(measured)).coords);
            station_of_point.push(station as u32);
        }
        stations.push(Station { direction: direction.into_inner(), error, n_points });
    }
    if places.is_empty() {
        return Err(ScanError::NothingSeen { n_stations: options.n_stations });
    }
    let new_from_old = CsrMatrix::from_triplets(places.len(), mesh.n_vertices(), &triplets);
    let new_of_old = nearest_points(mesh.vertices(), &true_places);
    let cloud = Resampled { mesh: TriMesh::from_points(places)?, new_from_old, new_of_old };
    Ok(Scan { cloud, station_of_point, stations })
}

fn nearest_points(vertices: &[Vec3], points: &[Vec3]) -> Vec<Option<u32>> {
    let tree = PointTree::new(points);
    let nearest = |vertex: &Vec3| {
        let mut found = Vec::new();
        tree.nearest(*vertex, 1, &mut found);
        found.first().map(|it| it.1)
    };
    vertices.par_iter().map(nearest).collect()
}
