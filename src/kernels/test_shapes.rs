//! Small shapes without symmetry, and their bases, for the tests of maps.

use faer::{Mat, Side};

use crate::kernels::{
    geometry::{
        mesh::{TriMesh, Vec3},
        shapes::geodesic_sphere,
    },
    spectral::{
        basis::Basis,
        descriptors::{DescriptorOptions, Descriptors, descriptors},
        laplacian::{MassLumping, cotangent_laplacian},
    },
};

/// Vertices that are spread over [`creature`].
pub const LANDMARKS: [u32; 5] = [0, 3, 5, 8, 100];

/// A body with three unequal limbs, 362 vertices; `change` lengthens them by different amounts.
pub fn creature(change: f64) -> TriMesh {
    let limbs = [
        (Vec3::new(0.0, 0.0, 1.0), 1.5 + change, 6.0),
        (Vec3::new(0.9, 0.0, -0.5), 1.0 - 0.3 * change, 9.0),
        (Vec3::new(-0.3, 0.9, -0.2), 0.7 + 0.5 * change, 12.0),
    ];
    let sphere = geodesic_sphere(6);
    let grow = |p: &Vec3| {
        let limb = |(axis, length, sharpness): &(Vec3, f64, f64)| {
            length * (sharpness * (p.dot(&axis.normalize()) - 1.0)).exp()
        };
        let body = 1.0 + limbs.iter().map(limb).sum::<f64>();
        p.component_mul(&Vec3::new(1.0, 0.8, 0.65)) * body
    };
    sphere.with_vertices(sphere.vertices().iter().map(grow).collect()).expect("finite")
}

/// The same shape with its vertices in another order, and the new index of every vertex.
pub fn permuted(mesh: &TriMesh) -> (TriMesh, Vec<u32>) {
    let n = mesh.n_vertices();
    // A step that shares no factor with the count visits every vertex once.
    let step = (n / 3..).find(|step| gcd(*step, n) == 1).expect("there is a prime");
    let order: Vec<u32> = (0..n).map(|it| ((it * step + 1) % n) as u32).collect();
    let mut vertices = vec![Vec3::zeros(); n];
    for (old, &new) in order.iter().enumerate() {
        vertices[new as usize] = mesh.vertices()[old];
    }
    let faces = mesh.faces().iter().map(|face| face.map(|it| order[it as usize])).collect();
    (TriMesh::new(vertices, faces).expect("the same mesh"), order)
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// Landmarks named `l0`, `l1`, ….
pub fn landmarks(vertices: &[u32]) -> Vec<(String, u32)> {
    vertices.iter().enumerate().map(|(index, &vertex)| (format!("l{index}"), vertex)).collect()
}

/// The usual descriptors, with landmarks at some vertices.
pub fn described(basis: &Basis, vertices: &[u32]) -> Descriptors {
    descriptors(basis, &landmarks(vertices), &DescriptorOptions::default())
        .expect("landmarks are vertices")
}

/// The `k` smallest eigenpairs of a small mesh, by a dense solver.
pub fn basis_of(mesh: &TriMesh, k: usize) -> Basis {
    let operator = cotangent_laplacian(mesh, MassLumping::MixedVoronoi).expect("a clean mesh");
    let n = mesh.n_vertices();
    let roots: Vec<f64> = operator.mass.iter().map(|it| it.sqrt()).collect();
    let mut dense = Mat::zeros(n, n);
    for row in 0..n {
        for (column, value) in operator.stiffness.row(row) {
            dense[(row, column)] = value / (roots[row] * roots[column]);
        }
    }
    // The solver's tolerances are absolute.
    let scale = dense.norm_max();
    dense *= faer::Scale(1.0 / scale);
    let eigen = dense.self_adjoint_eigen(Side::Lower).expect("symmetric");
    let mut eigenvalues: Vec<f64> =
        eigen.S().column_vector().iter().take(k).map(|it| it * scale).collect();
    eigenvalues[0] = 0.0;
    let eigenvectors = Mat::from_fn(n, k, |row, column| eigen.U()[(row, column)] / roots[row]);
    Basis { eigenvalues, eigenvectors, mass: operator.mass }
}
