use nalgebra::{Rotation3, Vector3};

use super::*;
use crate::kernels::numerics::random::Random;
use crate::kernels::test_shapes::{creature, permuted};

fn options() -> FitSurfaceOptions {
    FitSurfaceOptions { n_nodes: 100, samples: 0, ..FitSurfaceOptions::default() }
}

/// Matches with errors: a step along an edge for most vertices, another vertex altogether for one in ten.
fn bad_matches(mesh: &TriMesh, seed: u64) -> PointMap {
    let n = mesh.n_vertices();
    let mut random = Random::new(seed);
    let mut target_of_source: Vec<u32> = (0..n as u32).collect();
    for face in mesh.faces() {
        target_of_source[face[0] as usize] = face[random.below(3)];
    }
    for matched in &mut target_of_source {
        if random.uniform() < 0.1 {
            *matched = random.below(n) as u32;
        }
    }
    PointMap { target_of_source, n_target: n }
}

fn own_matches(n: usize) -> PointMap {
    PointMap { target_of_source: (0..n as u32).collect(), n_target: n }
}

/// Turns the upper part of a shape about a horizontal axis.
fn bent(mesh: &TriMesh, angle: f64) -> TriMesh {
    let bend = |it: &Vec3| {
        let share = ((it.z - 0.8) / 0.8).clamp(0.0, 1.0);
        Rotation3::from_axis_angle(&Vector3::x_axis(), share * angle) * (it - Vec3::z() * 0.8)
    };
    mesh.with_vertices(mesh.vertices().iter().map(bend).collect()).unwrap()
}

fn mean_distance(a: &[Vec3], b: &[Vec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).norm()).sum::<f64>() / a.len() as f64
}

#[test]
fn a_surface_on_itself_stays() {
    let mesh = creature(0.0);
    let fitted = fit_surface(&mesh, &mesh, &own_matches(mesh.n_vertices()), &options()).unwrap();
    let moved = mean_distance(&fitted, mesh.vertices());
    assert!(moved < 1e-3 * mesh.area().sqrt(), "{moved}");
}

#[test]
fn errors_of_matches_are_mended() {
    let mesh = creature(0.0);
    let others = [creature(0.2), bent(&mesh, 0.6), bent(&creature(-0.2), -0.5)];
    for (seed, target) in (0..).zip(&others) {
        let matches = bad_matches(&mesh, seed);
        let places = |it: &u32| target.vertices()[*it as usize];
        let matched: Vec<Vec3> = matches.target_of_source.iter().map(places).collect();
        let fitted = fit_surface(&mesh, target, &matches, &options()).unwrap();
        let before = mean_distance(&matched, target.vertices());
        let after = mean_distance(&fitted, target.vertices());
        assert!(after < 0.25 * before, "shape {seed}: {after} of {before}");
        let fitted = mesh.with_vertices(fitted).unwrap();
        let near = gap(&fitted, target, 0);
        assert!(near.mean < 0.01 && near.ninth_tenth < 0.02, "shape {seed}: {near:?}");
    }
}

#[test]
fn a_moved_turned_and_scaled_target_gets_the_same_surface() {
    let mesh = creature(0.0);
    let target = bent(&creature(0.1), 0.4);
    let matches = bad_matches(&mesh, 3);
    let fitted = fit_surface(&mesh, &target, &matches, &options()).unwrap();
    let turn = Rotation3::from_euler_angles(0.4, -1.0, 2.0);
    for scale in [1.0, 1e-3, 1e3] {
        let carry = |it: &Vec3| (turn * it + Vec3::new(1.0, -2.0, 0.5)) * scale;
        let carried: Vec<Vec3> = target.vertices().iter().map(carry).collect();
        let other = target.with_vertices(carried).unwrap();
        let found = fit_surface(&mesh, &other, &matches, &options()).unwrap();
        let expected: Vec<Vec3> = fitted.iter().map(carry).collect();
        assert!(mean_distance(&found, &expected) < 1e-4 * scale, "{scale}");
    }
}

#[test]
fn faces_that_look_inwards_and_their_order_do_not_matter() {
    let mesh = creature(0.0);
    let target = bent(&creature(0.1), 0.4);
    let matches = bad_matches(&mesh, 4);
    let fitted = fit_surface(&mesh, &target, &matches, &options()).unwrap();
    let of_inverted = fit_surface(&mesh, &target.inverted(), &matches, &options()).unwrap();
    assert!(mean_distance(&of_inverted, &fitted) < 1e-9);
    let (shuffled, new_of_old) = permuted(&target);
    let target_of_source =
        matches.target_of_source.iter().map(|it| new_of_old[*it as usize]).collect();
    let matches = PointMap { target_of_source, ..matches };
    let found = fit_surface(&mesh, &shuffled, &matches, &options()).unwrap();
    assert!(mean_distance(&found, &fitted) < 1e-4);
}

#[test]
fn points_without_faces_are_as_good_a_target() {
    let mesh = creature(0.0);
    let target = bent(&creature(0.1), 0.4);
    let cloud = TriMesh::from_points(target.vertices().to_vec()).unwrap();
    let fitted = fit_surface(&mesh, &cloud, &bad_matches(&mesh, 5), &options()).unwrap();
    let after = mean_distance(&fitted, target.vertices());
    assert!(after < 0.05 * target.area().sqrt(), "{after}");
}

#[test]
fn what_does_not_belong_together_is_refused() {
    let mesh = creature(0.0);
    let n = mesh.n_vertices();
    let fit = |source: &TriMesh, matches: &PointMap| {
        fit_surface(source, &mesh, matches, &options()).unwrap_err()
    };
    let few = PointMap { target_of_source: vec![0; 3], n_target: n };
    assert_eq!(fit(&mesh, &few), FitSurfaceError::Matches { n_matched: 3, n_source: n });
    let other = PointMap { n_target: 7, ..own_matches(n) };
    assert_eq!(fit(&mesh, &other), FitSurfaceError::Target { n_matched: 7, n_target: n });
    let one = PointMap { target_of_source: vec![5; n], n_target: n };
    assert_eq!(fit(&mesh, &one), FitSurfaceError::OnePlace);
    let cloud = TriMesh::from_points(mesh.vertices().to_vec()).unwrap();
    let error = fit(&cloud, &own_matches(n));
    assert_eq!(error, FitSurfaceError::Mesh(MeshError::PointCloud { n_points: n }));
    let flat = mesh.with_vertices(vec![Vec3::zeros(); n]).unwrap();
    assert_eq!(fit(&flat, &own_matches(n)), FitSurfaceError::NoArea);
}

#[test]
fn a_part_that_nothing_pulls_follows() {
    // Two shapes far from each other, of which the target has one.
    let mesh = creature(0.0);
    let n = mesh.n_vertices();
    let shift = |it: &Vec3| it + Vec3::x() * 20.0;
    let vertices = mesh.vertices().iter().copied().chain(mesh.vertices().iter().map(shift));
    let faces = mesh.faces().iter().copied();
    let second = mesh.faces().iter().map(|it| it.map(|it| it + n as u32));
    let two = TriMesh::new(vertices.collect(), faces.chain(second).collect()).unwrap();
    let target_of_source = (0..2 * n).map(|it| (it % n) as u32).collect();
    let matches = PointMap { target_of_source, n_target: n };
    let fitted = fit_surface(&two, &mesh, &matches, &options()).unwrap();
    assert!(fitted.iter().all(|it| it.norm() < 10.0));
    assert!(mean_distance(&fitted[..n], mesh.vertices()) < 0.1);
}
