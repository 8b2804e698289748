use super::*;
use crate::kernels::geometry::shapes::{moved, outward, torus, union};
use crate::kernels::synthetic::synthesize::{Body, SynthesizeOptions, synthesize};

fn skeleton(positions: &[Vec3]) -> Skeleton {
    let names = (0..positions.len()).map(|it| format!("joint{it}")).collect();
    let parents = (0..positions.len()).map(|it: usize| it.checked_sub(1)).collect();
    Skeleton::new(names, parents, positions.to_vec()).unwrap()
}

/// A closed tube of radius 0.1 along x, from -1 to 1.
fn tube(n_along: usize, n_around: usize) -> TriMesh {
    let mut vertices = vec![Vec3::new(-1.0, 0.0, 0.0)];
    let mut faces = Vec::new();
    let at = |ring: usize, it: usize| (1 + ring * n_around + it % n_around) as u32;
    for ring in 0..=n_along {
        let x = -1.0 + 2.0 * ring as f64 / n_along as f64;
        for it in 0..n_around {
            let angle = std::f64::consts::TAU * it as f64 / n_around as f64;
            vertices.push(Vec3::new(x, 0.1 * angle.cos(), 0.1 * angle.sin()));
            if ring < n_along {
                faces.push([at(ring, it), at(ring + 1, it), at(ring, it + 1)]);
                faces.push([at(ring + 1, it), at(ring + 1, it + 1), at(ring, it + 1)]);
            }
        }
    }
    let last = vertices.len() as u32;
    vertices.push(Vec3::new(1.0, 0.0, 0.0));
    for it in 0..n_around {
        faces.push([0, at(0, it), at(0, it + 1)]);
        faces.push([last, at(n_along, it + 1), at(n_along, it)]);
    }
    outward(TriMesh::new(vertices, faces).unwrap())
}

fn arm() -> Skeleton {
    skeleton(&[Vec3::new(-0.9, 0.0, 0.0), Vec3::zeros(), Vec3::new(0.9, 0.0, 0.0)])
}

fn solve(mesh: &TriMesh, skeleton: &Skeleton) -> SkinWeightsResult {
    let options = SkinWeightsOptions { leaves: Leaves::Ends, ..SkinWeightsOptions::default() };
    skin_weights(mesh, skeleton, &options).unwrap()
}

/// In one dimension the equation is `w'' = 3/2 (w - p) / d^2`... on a tube whose vertices are all at
/// the distance `r` from the axis: `L` integrates `-w''`, so `w = 1 - exp(-sqrt(3) |x| / r) / 2`.
#[test]
fn weights_along_a_tube_are_the_analytic_ones() {
    let mesh = tube(400, 40);
    let weights = solve(&mesh, &arm()).weights;
    for (vertex, place) in mesh.vertices().iter().enumerate() {
        if place.x.abs() > 0.6 {
            continue;
        }
        let far = 0.5 * (-(3f64.sqrt()) * place.x.abs() / 0.1).exp();
        let expected = if place.x < 0.0 { 1.0 - far } else { far };
        let weight = weights.get(vertex, 0);
        assert!((weight - expected).abs() < 0.01, "{}: {weight}, {expected}", place.x);
    }
}

#[test]
fn weights_are_harmonic_where_no_bone_is_seen() {
    // A bone within the left half only sees nothing of a tube's far end through its cone.
    let mesh = tube(60, 24);
    let bent = skeleton(&[Vec3::new(-0.9, 0.0, 0.0), Vec3::new(-0.5, 0.0, 0.0)]);
    let options = SkinWeightsOptions { leaves: Leaves::Ends, least: 0.0, ..Default::default() };
    let two = Skeleton::new(
        vec!["a".into(), "b".into(), "c".into()],
        vec![None, Some(0), Some(1)],
        vec![bent.positions()[0], bent.positions()[1], Vec3::new(0.0, 0.05, 0.0)],
    )
    .unwrap();
    let res = skin_weights(&mesh, &two, &options).unwrap();
    assert!(res.n_blind > 100 && res.n_cold == 0, "{} {}", res.n_blind, res.n_cold);
    let operator = cotangent_laplacian(&mesh, MassLumping::Barycentric).unwrap();
    let column: Vec<f64> = (0..mesh.n_vertices()).map(|it| res.weights.get(it, 0)).collect();
    let image = operator.stiffness.mul_vec(&column);
    // The cap at the end faces the bone again.
    let is_far = |it: usize| (0.5..0.9).contains(&mesh.vertices()[it].x);
    let largest = (0..mesh.n_vertices()).filter(|&it| is_far(it)).map(|it| image[it].abs());
    assert!(largest.fold(0.0, f64::max) < 1e-10);
}

#[test]
fn rows_sum_to_one_and_do_not_depend_on_unit_orientation_or_seams() {
    let mesh = tube(50, 16);
    let expected = solve(&mesh, &arm()).weights;
    let close = |other: &SkinWeights, of: &dyn Fn(usize) -> usize| {
        for vertex in 0..mesh.n_vertices() {
            let sum: f64 = other.row(of(vertex)).map(|it| it.1).sum();
            assert!((sum - 1.0).abs() < 1e-12);
            let difference = expected.get(vertex, 0) - other.get(of(vertex), 0);
            assert!(difference.abs() < 1e-9, "{difference}");
        }
    };
    for scale in [1e8, 1e-8] {
        let scaled = |it: &Vec3| it * scale;
        let big = mesh.with_vertices(mesh.vertices().iter().map(scaled).collect()).unwrap();
        let joints = skeleton(&arm().positions().iter().map(scaled).collect::<Vec<_>>());
        close(&solve(&big, &joints).weights, &|it| it);
    }
    close(&solve(&mesh.inverted(), &arm()).weights, &|it| it);
    // Every face with corners of its own.
    let corners = mesh.faces().iter().flatten().map(|&it| mesh.vertices()[it as usize]).collect();
    let faces = (0..mesh.n_faces() as u32).map(|it| [3 * it, 3 * it + 1, 3 * it + 2]).collect();
    let soup = solve(&TriMesh::new(corners, faces).unwrap(), &arm()).weights;
    let corner_of: Vec<usize> = (0..mesh.n_vertices())
        .map(|vertex| mesh.faces().iter().flatten().position(|&it| it as usize == vertex).unwrap())
        .collect();
    close(&soup, &|it| corner_of[it]);
}

#[test]
fn parts_without_a_bone_follow_the_nearest_one() {
    let far = moved(&torus(0.2, 0.05, 12, 8), Vec3::new(1.0, 3.0, 0.0));
    let tube = tube(30, 12);
    let res = solve(&union(&tube, &far), &arm());
    assert_eq!(res.n_cold, far.n_vertices());
    for vertex in tube.n_vertices()..tube.n_vertices() + far.n_vertices() {
        assert_eq!(res.weights.row(vertex).collect::<Vec<_>>(), [(1, 1.0)]);
    }
}

#[test]
fn poor_input_gets_weights_or_a_reason() {
    let mesh = tube(20, 12);
    let one = skeleton(&[Vec3::new(0.2, 0.0, 0.0)]);
    let weights = solve(&mesh, &one).weights;
    assert!((0..mesh.n_vertices()).all(|it| weights.get(it, 0) == 1.0));
    let zero = skeleton(&[Vec3::zeros(), Vec3::zeros(), Vec3::x() * 0.5]);
    assert_eq!(solve(&mesh, &zero).weights.n_joints(), 3);
    let mut vertices = mesh.vertices().to_vec();
    vertices.push(Vec3::new(9.0, 9.0, 9.0));
    let loose = TriMesh::new(vertices, mesh.faces().to_vec()).unwrap();
    assert_eq!(solve(&loose, &arm()).n_cold, 1);
    let flat = TriMesh::new(vec![Vec3::x(); 3], vec![[0, 1, 2]]).unwrap();
    assert_eq!(solve(&flat, &arm()).n_cold, 3);
    let cloud = TriMesh::from_points(vec![Vec3::zeros()]).unwrap();
    assert!(skin_weights(&cloud, &one, &SkinWeightsOptions::default()).is_err());
    let options = SkinWeightsOptions { heat: f64::NAN, ..Default::default() };
    let error = skin_weights(&mesh, &one, &options).unwrap_err();
    assert_eq!(error.to_string(), "the option `heat` is NaN, but must be a positive number");
}

/// True weights of synthesized bodies follow other rules, but are not far.
#[test]
fn weights_of_synthesized_bodies_are_close_to_the_true_ones() {
    for body in [Body::Biped, Body::Quadruped] {
        let options = SynthesizeOptions { body, n_vertices: 3000, ..Default::default() };
        let it = synthesize(&options).unwrap();
        let res = skin_weights(&it.mesh, &it.skeleton, &SkinWeightsOptions::default()).unwrap();
        let error = mean_difference(&res.weights, &it.weights);
        println!("{body:?}: mean difference {error:.3}, blind {}", res.n_blind);
        assert!(error < 0.35, "{body:?}: {error}");
        assert_eq!(res.n_cold, 0);
    }
}

/// Half the sum of the absolute differences of a vertex's weights: 0 equal, 1 disjoint.
fn mean_difference(a: &SkinWeights, b: &SkinWeights) -> f64 {
    let of_vertex = |vertex: usize| {
        (0..a.n_joints()).map(|it| (a.get(vertex, it) - b.get(vertex, it)).abs()).sum::<f64>() / 2.0
    };
    (0..a.n_vertices()).map(of_vertex).sum::<f64>() / a.n_vertices() as f64
}
