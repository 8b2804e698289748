use super::*;
use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::geometry::shapes::{bumpy_sphere, geodesic_sphere, moved, rectangle, union};
use crate::kernels::spectral::laplacian::{MassLumping, cotangent_laplacian};
use std::f64::consts::PI;

fn operator(mesh: &TriMesh) -> Operator {
    cotangent_laplacian(mesh, MassLumping::default()).unwrap()
}

fn solve(operator: &Operator, k: usize) -> (Basis, EigsStats) {
    eigs(operator, &EigsOptions { k, ..Default::default() }).unwrap()
}

/// Specification 10.1: the spherical harmonics' `l (l + 1)`, as the mesh has them.
#[test]
fn spectrum_of_the_icosphere() {
    let operator = cotangent_laplacian(&geodesic_sphere(16), MassLumping::Barycentric).unwrap();
    let (basis, stats) = solve(&operator, 30);
    assert!(!stats.dense);
    let mut expected = vec![0.0];
    expected.extend([2.0000; 3]);
    expected.extend([5.9915; 5]);
    expected.extend([11.9565; 4]);
    expected.extend([11.9584; 3]);
    for (found, expected) in basis.eigenvalues.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-4, "{found} instead of {expected}");
    }
    assert!((basis.eigenvalues[16] - 19.8665).abs() < 1e-4, "{}", basis.eigenvalues[16]);
}

/// Specification 10.3: `pi^2 (m^2 / a^2 + n^2 / b^2)`.
#[test]
fn neumann_spectrum_of_a_rectangle() {
    let (width, height) = (2.0, 1.3);
    let (basis, _) = solve(&operator(&rectangle(80, 52, width, height)), 12);
    let mut exact: Vec<f64> = (0..12)
        .flat_map(|m| (0..12).map(move |n| (m as f64 / width, n as f64 / height)))
        .map(|(m, n)| PI * PI * (m * m + n * n))
        .collect();
    exact.sort_by(f64::total_cmp);
    for (found, exact) in basis.eigenvalues.iter().zip(&exact) {
        assert!((found - exact).abs() <= 0.005 * exact, "{found} instead of {exact}");
    }
    assert_eq!(basis.eigenvalues[0], 0.0);
}

/// The first eigenfunction of a rectangle is the cosine along its longer side.
#[test]
fn first_vector_of_a_rectangle_is_a_cosine() {
    let mesh = rectangle(60, 30, 2.0, 1.0);
    let (basis, _) = solve(&operator(&mesh), 4);
    for (vertex, position) in mesh.vertices().iter().enumerate() {
        let cosine = (PI * position.x / 2.0).cos();
        let value = basis.eigenvectors[(vertex, 1)];
        assert!((value - cosine).abs() < 2e-3, "{value} instead of {cosine}");
        assert!((basis.eigenvectors[(vertex, 0)] - 0.5f64.sqrt()).abs() < 1e-10);
    }
}

#[test]
fn vectors_are_orthonormal_and_pairs_accurate_at_three_scales() {
    let mesh = bumpy_sphere(12);
    let (one, _) = solve(&operator(&mesh), 60);
    for scale in [1.0, 1e8, 1e-8] {
        let scaled =
            mesh.with_vertices(mesh.vertices().iter().map(|it| it * scale).collect()).unwrap();
        let (basis, stats) = solve(&operator(&scaled), 60);
        assert!(stats.orthogonality < 1e-10 && stats.residual < 1e-10, "{stats:?}");
        for (found, expected) in basis.eigenvalues.iter().zip(&one.eigenvalues) {
            let error = (found * scale * scale - expected).abs();
            assert!(error <= 1e-9 * one.eigenvalues[59], "{found}, {expected} at {scale}");
        }
    }
}

#[test]
fn both_solvers_agree() {
    for mesh in [bumpy_sphere(9), rectangle(31, 23, 1.0, 2.0), geodesic_sphere(9)] {
        let operator = operator(&mesh);
        let (basis, stats) = solve(&operator, 40);
        let dense = dense::solve(&operator, 40).unwrap();
        assert!(!stats.dense);
        for (one, other) in basis.eigenvalues.iter().zip(&dense.eigenvalues) {
            assert!((one - other).abs() < 1e-9 * basis.eigenvalues[39], "{one} and {other}");
        }
    }
}

#[test]
fn the_number_of_threads_does_not_change_a_bit() {
    let operator = operator(&bumpy_sphere(22));
    let with_threads = |n_threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
        pool.install(|| solve(&operator, 50).0)
    };
    let one = with_threads(1);
    for n_threads in [2, 3] {
        let other = with_threads(n_threads);
        assert_eq!(one.eigenvalues, other.eigenvalues);
        assert!(one.eigenvectors == other.eigenvectors, "{n_threads} threads");
    }
}

#[test]
fn largest_entries_are_positive() {
    let (basis, _) = solve(&operator(&bumpy_sphere(8)), 20);
    for column in basis.eigenvectors.col_iter() {
        let largest =
            column.iter().copied().fold(0.0, |a: f64, b| if b.abs() > a.abs() { b } else { a });
        assert!(largest > 0.0);
    }
}

#[test]
fn nearly_all_pairs_are_those_of_the_dense_solver() {
    let operator = operator(&geodesic_sphere(3));
    let (basis, stats) = solve(&operator, 92);
    assert!(stats.dense && stats.orthogonality < 1e-12, "{stats:?}");
    assert_eq!(basis.k(), 92);
}

#[test]
fn components_are_refused_or_merged() {
    let (near, far) = (bumpy_sphere(8), moved(&geodesic_sphere(7), Vec3::new(9.0, 0.0, 0.0)));
    let both = operator(&union(&near, &far));
    let error = eigs(&both, &EigsOptions { k: 12, ..Default::default() }).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the operator has 2 connected components (of 642, 492 vertices), each of which has an \
         eigenvalue zero of its own"
    );
    let options = EigsOptions { k: 12, disconnected: Disconnected::Merge, ..Default::default() };
    let (basis, stats) = eigs(&both, &options).unwrap();
    assert_eq!(stats.n_components, 2);
    assert_eq!(basis.eigenvalues.iter().filter(|&&it| it == 0.0).count(), 2);
    let alone = [solve(&operator(&near), 12).0, solve(&operator(&far), 12).0];
    let mut expected: Vec<f64> = alone.iter().flat_map(|it| it.eigenvalues.clone()).collect();
    expected.sort_by(f64::total_cmp);
    for (found, expected) in basis.eigenvalues.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-9 * basis.eigenvalues[11], "{found}, {expected}");
    }
}

#[test]
fn bad_operators_are_refused_with_their_facts() {
    let good = operator(&geodesic_sphere(6));
    let check = |operator: &Operator, k: usize, expected: &str| {
        let options = EigsOptions { k, ..Default::default() };
        assert_eq!(eigs(operator, &options).unwrap_err().to_string(), expected);
    };
    check(&good, 0, "the number of eigenpairs is zero");
    check(&good, 363, "363 eigenpairs are wanted of an operator with 362 vertices");
    let mut bad = good.clone();
    bad.stiffness.values[8] = f64::NAN;
    let row = bad.stiffness.offsets.partition_point(|&it| it <= 8) - 1;
    let column = bad.stiffness.columns[8];
    check(&bad, 5, &format!("the stiffness has the value NaN in row {row}, column {column}"));
    let mut bad = good.clone();
    bad.mass[7] = 0.0;
    check(&bad, 5, "vertex 7 has the mass 0, which is not positive and finite");
    bad.mass.pop();
    check(
        &bad,
        5,
        "the stiffness is 362 x 362, but there are 361 masses: both belong to the same vertices",
    );
}

#[test]
fn an_indefinite_operator_is_refused() {
    let mut operator = operator(&geodesic_sphere(8));
    operator.stiffness.values.iter_mut().for_each(|it| *it = -*it);
    let error = eigs(&operator, &EigsOptions { k: 10, ..Default::default() }).unwrap_err();
    assert!(matches!(error, EigsError::NotPositive { n_vertices: 642, .. }), "{error}");
    assert!(error.to_string().starts_with("the operator is not positive semi-definite"), "{error}");
}
