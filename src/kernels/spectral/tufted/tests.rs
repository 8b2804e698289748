use super::*;
use crate::kernels::geometry::shapes::{bumpy_sphere, icosphere, rectangle, torus};
use crate::kernels::numerics::random::Random;
use crate::kernels::spectral::eigs::{Disconnected, EigsOptions, eigs};
use crate::kernels::spectral::laplacian::{MassLumping, cotangent_laplacian};
use crate::kernels::test_shapes::permuted;

fn three_faces_on_an_edge() -> TriMesh {
    let vertices = vec![Vec3::zeros(), Vec3::z(), Vec3::x(), Vec3::y(), Vec3::new(-1.0, -0.4, 0.2)];
    TriMesh::new(vertices, vec![[0, 1, 2], [0, 1, 3], [0, 1, 4]]).unwrap()
}

fn moebius_strip(n_around: usize) -> TriMesh {
    let mut vertices = Vec::new();
    for step in 0..n_around {
        let angle = std::f64::consts::TAU * step as f64 / n_around as f64;
        let out = Vec3::new(angle.cos(), angle.sin(), 0.0);
        let across = out * (angle / 2.0).cos() + Vec3::z() * (angle / 2.0).sin();
        vertices.extend([out - across * 0.2, out + across * 0.2]);
    }
    let n = n_around as u32;
    let mut faces = Vec::new();
    for step in 0..n {
        let (a, b) = (2 * step, 2 * step + 1);
        let next = [2 * ((step + 1) % n), 2 * ((step + 1) % n) + 1];
        // After a whole turn, left is right.
        let [c, d] = if step + 1 == n { [next[1], next[0]] } else { next };
        faces.extend([[a, c, b], [b, c, d]]);
    }
    TriMesh::new(vertices, faces).unwrap()
}

fn with_faces(mesh: &TriMesh, more: &[[u32; 3]]) -> TriMesh {
    TriMesh::new(mesh.vertices().to_vec(), [mesh.faces(), more].concat()).unwrap()
}

/// Triangles between random points: everything crosses everything.
fn soup(seed: u64) -> TriMesh {
    let mut random = Random::new(seed);
    let vertices = (0..40).map(|_| Vec3::from_fn(|_, _| random.uniform())).collect();
    let faces = (0..150).map(|_| [0; 3].map(|_| random.below(38) as u32)).collect();
    TriMesh::new(vertices, faces).unwrap()
}

fn meshes() -> Vec<TriMesh> {
    let sphere = icosphere(2);
    let flat = vec![Vec3::zeros(), Vec3::x(), Vec3::x() * 0.5, Vec3::y()];
    vec![
        sphere.clone(),
        bumpy_sphere(7),
        rectangle(9, 3, 5.0, 0.2),
        torus(1.0, 0.3, 20, 9),
        three_faces_on_an_edge(),
        moebius_strip(24),
        with_faces(&sphere, &[sphere.faces()[5]]),
        with_faces(&sphere, &[[3, 3, 8], [0, 50, 100]]),
        TriMesh::new(flat, vec![[0, 1, 2], [0, 1, 3]]).unwrap(),
        soup(1),
        soup(2),
        soup(3),
    ]
}

fn scaled(mesh: &TriMesh, factor: f64) -> TriMesh {
    mesh.with_vertices(mesh.vertices().iter().map(|it| it * factor).collect()).unwrap()
}

fn entry(operator: &Operator, row: usize, column: usize) -> f64 {
    operator.stiffness.row(row).find(|it| it.0 == column).map_or(0.0, |it| it.1)
}

fn check(mesh: &TriMesh) -> (Operator, TuftedReport) {
    let (operator, report) = tufted_laplacian(mesh).unwrap();
    assert_eq!(report.flips.n_left, 0);
    let mut named = vec![false; mesh.n_vertices()];
    for &vertex in mesh.faces().iter().filter(|it| !is_collapsed(it)).flatten() {
        named[vertex as usize] = true;
    }
    let largest = operator.stiffness.values.iter().fold(0.0f64, |max, it| max.max(it.abs()));
    let sums = operator.stiffness.mul_vec(&vec![1.0; mesh.n_vertices()]);
    for (row, sum) in sums.into_iter().enumerate() {
        let expected = if named[row] { 0.0 } else { 1.0 };
        assert!((sum - expected).abs() <= 1e-14 * largest, "row {row} adds up to {sum}");
        for (column, value) in operator.stiffness.row(row) {
            assert!(column == row || value <= 0.0, "{row}, {column}: {value}");
            assert_eq!(entry(&operator, column, row), value, "{row}, {column}");
        }
    }
    assert!(operator.mass.iter().all(|&it| it > 0.0));
    (operator, report)
}

#[test]
fn no_weight_is_negative_whatever_the_triangles() {
    for mesh in meshes() {
        let (operator, report) = check(&mesh);
        if report.lengthened == 0.0 && report.n_unreferenced == 0 {
            let relative = operator.mass.iter().sum::<f64>() / mesh.area() - 1.0;
            assert!(relative.abs() < 1e-12, "{relative}");
        }
    }
}

#[test]
fn good_meshes_have_their_cotangent_laplacian() {
    for mesh in [icosphere(3), rectangle(8, 5, 8.0, 5.0), torus(3.0, 1.0, 40, 20)] {
        let (operator, report) = check(&mesh);
        let cotan = cotangent_laplacian(&mesh, MassLumping::Barycentric).unwrap();
        assert_eq!((report.flips.n_flips, report.lengthened), (0, 0.0));
        for row in 0..mesh.n_vertices() {
            for (column, value) in cotan.stiffness.row(row) {
                let own = entry(&operator, row, column);
                assert!((own - value).abs() < 1e-12, "{row}, {column}: {own} and {value}");
            }
            assert!((operator.mass[row] / cotan.mass[row] - 1.0).abs() < 1e-12);
        }
    }
}

/// Every face twice is the same surface twice: all of the operator doubles.
#[test]
fn repeated_faces_count_twice() {
    for mesh in [icosphere(2), rectangle(9, 3, 5.0, 0.2)] {
        let (one, _) = check(&mesh);
        let (two, report) = check(&with_faces(&mesh, mesh.inverted().faces()));
        assert!(report.n_nonmanifold_edges > 0);
        let sum = |operator: &Operator| operator.mass.iter().sum::<f64>();
        assert!((sum(&two) / sum(&one) - 2.0).abs() < 1e-12);
        assert_eq!(two.mass.len(), one.mass.len());
    }
}

#[test]
fn the_order_of_vertices_and_faces_does_not_matter() {
    for mesh in [bumpy_sphere(6), moebius_strip(23), soup(4)] {
        let (one, _) = check(&mesh);
        let (other_mesh, order) = permuted(&mesh);
        let turned = other_mesh.faces().iter().rev().map(|&[a, b, c]| [c, a, b]).collect();
        let other_mesh = TriMesh::new(other_mesh.vertices().to_vec(), turned).unwrap();
        let (other, _) = check(&other_mesh);
        for row in 0..mesh.n_vertices() {
            let new_row = order[row] as usize;
            assert!((other.mass[new_row] / one.mass[row] - 1.0).abs() < 1e-12);
            for (column, value) in one.stiffness.row(row) {
                let found = entry(&other, new_row, order[column] as usize);
                assert!((found - value).abs() < 1e-8, "{row}, {column}: {found} and {value}");
            }
        }
    }
}

#[test]
fn scale_leaves_the_stiffness_and_squares_the_mass() {
    for mesh in meshes() {
        let (one, _) = check(&mesh);
        for factor in [1e-6, 1e6] {
            let (other, _) = check(&scaled(&mesh, factor));
            for row in 0..mesh.n_vertices() {
                let square = factor * factor;
                assert!((other.mass[row] / (one.mass[row] * square) - 1.0).abs() < 1e-9);
                for (column, value) in one.stiffness.row(row) {
                    let error = (entry(&other, row, column) - value).abs();
                    assert!(error < 1e-6 * (1.0 + value.abs()), "{row}, {column}: {error}");
                }
            }
        }
    }
}

#[test]
fn stray_vertices_change_nothing_for_the_others() {
    let mesh = icosphere(3);
    let (one, _) = check(&mesh);
    let vertices = [mesh.vertices(), &[Vec3::zeros(), Vec3::x()]].concat();
    let (two, report) = check(&TriMesh::new(vertices, mesh.faces().to_vec()).unwrap());
    assert_eq!(report.n_unreferenced, 2);
    let options = EigsOptions { k: 10, ..Default::default() };
    let (one, _) = eigs(&one, &options).unwrap();
    let (two, stats) = eigs(&two, &options).unwrap();
    assert_eq!(stats.n_components, 1);
    for (a, b) in one.eigenvalues.iter().zip(&two.eigenvalues) {
        assert!((a - b).abs() < 1e-8, "{a} and {b}");
    }
    for column in 0..10 {
        assert_eq!(two.eigenvectors[(mesh.n_vertices(), column)], 0.0);
    }
}

/// Weights of faces whose vertices coincide are a hundred thousand times those of others.
#[test]
fn faces_without_area_do_not_spoil_eigenpairs() {
    let mesh = icosphere(4);
    let (one, _) = check(&mesh);
    let mut vertices = mesh.vertices().to_vec();
    for &[a, b, _] in mesh.faces().iter().step_by(400) {
        vertices[a as usize] = vertices[b as usize];
    }
    let (other, report) = check(&mesh.with_vertices(vertices).unwrap());
    assert!(report.lengthened > 0.0);
    let options = EigsOptions { k: 9, ..Default::default() };
    let (one, _) = eigs(&one, &options).unwrap();
    let (other, _) = eigs(&other, &options).unwrap();
    for (a, b) in one.eigenvalues.iter().zip(&other.eigenvalues) {
        assert!((a - b).abs() < 0.02 * (1.0 + a), "{a} and {b}");
    }
}

#[test]
fn two_parts_have_two_zeros() {
    let sphere = icosphere(2);
    let n = sphere.n_vertices() as u32;
    let apart = sphere.vertices().iter().map(|it| it * 0.5 + Vec3::x() * 4.0);
    let vertices = sphere.vertices().iter().copied().chain(apart).collect();
    let shifted = sphere.faces().iter().map(|it| it.map(|it| it + n));
    let faces = sphere.faces().iter().copied().chain(shifted).collect();
    let (operator, _) = check(&TriMesh::new(vertices, faces).unwrap());
    let options = EigsOptions { k: 6, disconnected: Disconnected::Merge, ..Default::default() };
    let (basis, _) = eigs(&operator, &options).unwrap();
    assert_eq!(basis.eigenvalues[..2], [0.0, 0.0]);
    assert!(basis.eigenvalues[2] > 1.0);
}

#[test]
fn eigenvalues_of_the_sphere() {
    let (operator, _) = check(&icosphere(4));
    let total: f64 = operator.mass.iter().sum();
    assert!((total - 12.5514).abs() < 5e-5, "{total}");
    let (basis, _) = eigs(&operator, &EigsOptions { k: 17, ..Default::default() }).unwrap();
    let expected = [(1..4, 2.0, 5e-5), (4..9, 5.9915, 5e-5), (9..13, 11.9565, 5e-5)];
    for (range, expected, tolerance) in expected {
        for found in &basis.eigenvalues[range] {
            assert!((found - expected).abs() < tolerance, "{found} for {expected}");
        }
    }
    for found in &basis.eigenvalues[13..16] {
        assert!((found - 11.9584).abs() < 5e-5, "{found}");
    }
    assert!((basis.eigenvalues[16] - 19.8665).abs() < 1e-2, "{}", basis.eigenvalues[16]);
}

/// Free edges: `pi^2 (m^2 / a^2 + n^2 / b^2)`.
#[test]
fn eigenvalues_of_a_rectangle() {
    let (a, b) = (2.0, 1.3);
    let mesh = rectangle(80, 52, a, b);
    let (operator, report) = check(&mesh);
    assert_eq!(report.n_boundary_edges, 2 * (80 + 52));
    let (basis, _) = eigs(&operator, &EigsOptions { k: 12, ..Default::default() }).unwrap();
    let mode = |m: usize, n: usize| {
        let square = |count: usize, side: f64| (count as f64 / side).powi(2);
        std::f64::consts::PI.powi(2) * (square(m, a) + square(n, b))
    };
    let mut expected: Vec<f64> = (0..6).flat_map(|m| (0..6).map(move |n| mode(m, n))).collect();
    expected.sort_by(f64::total_cmp);
    for (found, expected) in basis.eigenvalues.iter().zip(&expected).skip(1) {
        assert!((found / expected - 1.0).abs() < 3e-3, "{found} for {expected}");
    }
}

#[test]
fn what_has_no_triangle_is_refused() {
    let points = vec![Vec3::zeros(), Vec3::x(), Vec3::y()];
    let message = |mesh: &TriMesh| tufted_laplacian(mesh).unwrap_err().to_string();
    let cloud = TriMesh::from_points(points.clone()).unwrap();
    assert!(message(&cloud).starts_with("there are 3 points but no faces"));
    let collapsed = TriMesh::new(points.clone(), vec![[0, 0, 1], [1, 2, 1]]).unwrap();
    assert_eq!(message(&collapsed), "each of the 2 faces names a vertex twice");
    let mesh = TriMesh::new(points, vec![[0, 1, 2]]).unwrap();
    for factor in [0.0, 1e-170, 1e170] {
        let message = message(&scaled(&mesh, factor));
        assert!(message.starts_with("the edges of the 1 faces have a mean length of"));
    }
}
