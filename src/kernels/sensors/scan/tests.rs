use super::*;
use crate::kernels::geometry::shapes::{icosphere, moved, union};
use crate::kernels::geometry::triangle_tree::TriangleTree;

fn exact() -> ScanOptions {
    ScanOptions { noise: 0.0, turn_deg: 0.0, shift: 0.0, ..Default::default() }
}

fn true_places(made: &Scan, mesh: &TriMesh) -> Vec<Vec3> {
    let rows = 0..made.cloud.new_from_old.n_rows;
    let place = |row| {
        let shares = made.cloud.new_from_old.row(row);
        shares.map(|(vertex, share)| mesh.vertices()[vertex] * share).sum()
    };
    rows.map(place).collect()
}

#[test]
fn without_errors_points_lie_on_the_surface_all_around() {
    let sphere = moved(&icosphere(4), Vec3::new(3.0, 1.0, 0.0));
    let made = scan(&sphere, &exact()).unwrap();
    let tree = TriangleTree::new(&sphere);
    assert_eq!(made.stations.len(), 6);
    assert_eq!(
        made.stations.iter().map(|it| it.n_points).sum::<usize>(),
        made.station_of_point.len()
    );
    for (point, &station) in made.cloud.mesh.vertices().iter().zip(&made.station_of_point) {
        assert!(tree.nearest(*point).square.sqrt() < 1e-9);
        // A point of a sphere is seen from its own side only.
        let direction = made.stations[station as usize].direction;
        assert!((point - Vec3::new(3.0, 1.0, 0.0)).dot(&direction) > 0.1);
    }
    // Every vertex near the horizon has a point nearby, and functions are carried to the points.
    let heights: Vec<f64> = sphere.vertices().iter().map(|it| it.y).collect();
    for (height, point) in made.cloud.function(&heights).iter().zip(made.cloud.mesh.vertices()) {
        assert!((height - point.y).abs() < 1e-9);
    }
    for (vertex, point) in sphere.vertices().iter().zip(&made.cloud.new_of_old) {
        let gap = (made.cloud.mesh.vertices()[point.unwrap() as usize] - vertex).norm();
        assert!((vertex.y - 1.0).abs() > 0.8 || gap < 0.1, "{gap}");
    }
}

#[test]
fn what_is_hidden_is_not_scanned() {
    let body = icosphere(3);
    let small =
        TriMesh::new(body.vertices().iter().map(|it| it * 0.3).collect(), body.faces().to_vec());
    let nested = union(&body, &small.unwrap());
    let made = scan(&nested, &exact()).unwrap();
    assert!(made.cloud.mesh.vertices().iter().all(|it| it.norm() > 0.9));
}

#[test]
fn noise_and_registration_are_as_large_as_asked() {
    let sphere = icosphere(4);
    let diagonal = 12.0_f64.sqrt();
    let noisy = ScanOptions { noise: 0.004, ..exact() };
    let made = scan(&sphere, &noisy).unwrap();
    let off = made.cloud.mesh.vertices().iter().zip(true_places(&made, &sphere));
    let squares: Vec<f64> = off.map(|(a, b)| (a - b).norm_squared()).collect();
    let deviation = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt() / diagonal;
    assert!((deviation / 0.004 - 1.0).abs() < 0.05, "{deviation}");
    let loose = ScanOptions {
        turn_deg: 2.0,
        shift: 0.01,
        n_stations: 40,
        points_per_station: 50,
        ..exact()
    };
    let made = scan(&sphere, &loose).unwrap();
    let angles = made.stations.iter().map(|it| it.error.rotation.angle().to_degrees().powi(2));
    let deviation = (angles.sum::<f64>() / 40.0 / 3.0).sqrt();
    assert!((1.5..2.5).contains(&deviation), "{deviation}");
    for (point, &station) in made.cloud.mesh.vertices().iter().zip(&made.station_of_point) {
        let back = made.stations[station as usize].error.inverse() * nalgebra::Point3::from(*point);
        assert!((back.coords.norm() - 1.0).abs() < 0.01);
    }
}

#[test]
fn seeds_threads_and_limits() {
    let sphere = icosphere(3);
    let options = ScanOptions { points_per_station: 300, dropped: 0.2, ..Default::default() };
    let run = |seed: u64, n_threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
        pool.install(|| scan(&sphere, &ScanOptions { seed, ..options.clone() }).unwrap())
    };
    assert_eq!(run(1, 1), run(1, 3));
    assert_ne!(run(1, 1), run(2, 1));
    assert!(run(1, 1).stations.iter().all(|it| it.n_points == 300));
    let cloud = TriMesh::from_points(sphere.vertices().to_vec()).unwrap();
    assert!(matches!(scan(&cloud, &options), Err(ScanError::Mesh(_))));
    let none = ScanOptions { dropped: 1.0, ..options.clone() };
    let message = scan(&sphere, &none).unwrap_err().to_string();
    assert_eq!(message, "none of the 6 stations sees anything of the surface");
}
