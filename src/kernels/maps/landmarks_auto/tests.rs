use super::*;
use crate::kernels::geometry::shapes::{icosphere, moved, torus, union};
use crate::kernels::synthetic::synthesize::{
    self, Character, Stance, SynthesizeOptions, synthesize,
};
use nalgebra::Rotation3;

const BIPED: FindOptions = FindOptions { plan: BodyPlan::Biped, front: None };
const QUADRUPED: FindOptions = FindOptions { plan: BodyPlan::Quadruped, front: None };

fn character(body: synthesize::Body, seed: u64, stance: Stance) -> Character {
    let options =
        SynthesizeOptions { body, seed, stance, n_vertices: 1500, ..SynthesizeOptions::default() };
    synthesize(&options).unwrap()
}

/// The distance of every landmark from the true one, over the extent of the body.
fn errors(found: &Landmarks, truth: &Landmarks, mesh: &TriMesh) -> Vec<f64> {
    assert_eq!(found.names, truth.names);
    let (low, high) = mesh.bounds();
    let at = |it: &u32| mesh.vertices()[*it as usize];
    let pairs = found.vertices.iter().zip(&truth.vertices);
    pairs.map(|(a, b)| (at(a) - at(b)).norm() / (high - low).norm()).collect()
}

#[test]
fn bipeds_are_found_in_all_poses_and_turned_in_any_way() {
    for seed in 0..3 {
        for stance in [Stance::T, Stance::Walk(0.3), Stance::Random(0.7)] {
            let it = character(synthesize::Body::Biped, seed, stance);
            let turn = Rotation3::from_euler_angles(seed as f64, 2.0, 0.7 * seed as f64);
            let turned = it.mesh.vertices().iter().map(|it| turn * it).collect();
            let mesh = it.mesh.with_vertices(turned).unwrap();
            let found = find_landmarks(&mesh, BIPED).unwrap();
            let errors = errors(&found.landmarks, &it.landmarks, &mesh);
            assert!(errors.iter().all(|&it| it < 0.12), "seed {seed}, {stance:?}: {errors:.3?}");
        }
    }
}

#[test]
fn quadrupeds_are_found() {
    for seed in 0..3 {
        let it = character(synthesize::Body::Quadruped, seed, Stance::Walk(0.1 * seed as f64));
        let found = find_landmarks(&it.mesh, QUADRUPED).unwrap();
        let errors = errors(&found.landmarks, &it.landmarks, &it.mesh);
        // The truth has the chest's front at the breast bone, not below the withers.
        for (error, name) in errors.iter().zip(&found.landmarks.names) {
            let most = if name.starts_with("chest") || name == "head_top" { 0.25 } else { 0.06 };
            assert!(*error < most, "seed {seed}, {name}: {error}");
        }
    }
}

#[test]
fn mirrored_and_inside_out_surfaces_are_refused_and_both_at_once_is_another_body() {
    let it = character(synthesize::Body::Biped, 1, Stance::Rest);
    let mirror = |mesh: &TriMesh| {
        let vertices = mesh.vertices().iter().map(|it| Vec3::new(-it.x, it.y, it.z)).collect();
        mesh.with_vertices(vertices).unwrap()
    };
    for mesh in [mirror(&it.mesh), it.mesh.inverted()] {
        assert!(matches!(find_landmarks(&mesh, BIPED), Err(FindError::InsideOut { .. })));
    }
    // The mirror image is as good a body, whose left hand is the right one of the first.
    let plain = find_landmarks(&it.mesh, BIPED).unwrap().landmarks;
    let mirrored = find_landmarks(&mirror(&it.mesh).inverted(), BIPED).unwrap().landmarks;
    assert_eq!(mirrored.vertices[1..5], [2, 1, 4, 3].map(|it| plain.vertices[it]));
}

#[test]
fn a_given_front_decides() {
    let it = character(synthesize::Body::Biped, 2, Stance::Rest);
    let with = |front: Vec3| find_landmarks(&it.mesh, FindOptions { front: Some(front), ..BIPED });
    let ahead = with(Vec3::new(0.5, 0.0, 3.0)).unwrap().landmarks;
    assert_eq!(ahead, find_landmarks(&it.mesh, BIPED).unwrap().landmarks);
    let behind = with(-Vec3::z()).unwrap().landmarks;
    assert_eq!(behind.vertices[..5], [0, 2, 1, 4, 3].map(|it| ahead.vertices[it]));
    assert!(matches!(with(Vec3::x()), Err(FindError::FrontAside { .. })));
    assert!(matches!(with(Vec3::zeros()), Err(FindError::FrontAside { .. })));
}

#[test]
fn what_is_no_body_is_refused() {
    let far = union(&icosphere(2), &moved(&icosphere(2), Vec3::x() * 9.0));
    let check = |mesh: &TriMesh, expected: &str| {
        for options in [BIPED, QUADRUPED] {
            let error = find_landmarks(mesh, options).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    };
    check(&far, "2 parts too far from each other");
    let cloud = TriMesh::from_points(icosphere(2).vertices().to_vec()).unwrap();
    check(&cloud, "a surface is needed");
    for mesh in [icosphere(3), torus(2.0, 0.5, 40, 20)] {
        for options in [BIPED, QUADRUPED] {
            assert!(find_landmarks(&mesh, options).is_err());
        }
    }
    let triangle = TriMesh::new(vec![Vec3::zeros(), Vec3::x(), Vec3::y()], vec![[0, 1, 2]]);
    check(&triangle.unwrap(), "stick");
    let biped = character(synthesize::Body::Biped, 3, Stance::Rest);
    assert!(find_landmarks(&biped.mesh, QUADRUPED).is_err());
    let point = biped.mesh.with_vertices(vec![Vec3::zeros(); biped.mesh.n_vertices()]).unwrap();
    assert!(find_landmarks(&point, BIPED).is_err());
}

#[test]
fn a_body_without_an_arm_is_refused() {
    let it = character(synthesize::Body::Biped, 4, Stance::T);
    let hand = it.mesh.vertices()[it.landmarks.vertices[1] as usize];
    // All that is farther to the left than the shoulder.
    let faces: Vec<[u32; 3]> = it
        .mesh
        .faces()
        .iter()
        .copied()
        .filter(|face| face.iter().all(|&v| it.mesh.vertices()[v as usize].x < 0.3 * hand.x))
        .collect();
    let mut kept: Vec<u32> = faces.iter().flatten().copied().collect();
    kept.sort_unstable();
    kept.dedup();
    let number = |v: u32| kept.binary_search(&v).unwrap() as u32;
    let vertices = kept.iter().map(|&v| it.mesh.vertices()[v as usize]).collect();
    let mesh = TriMesh::new(vertices, faces.iter().map(|f| f.map(number)).collect()).unwrap();
    assert!(find_landmarks(&mesh, BIPED).is_err());
}
