//! Nearest rows among eigenfunctions, against the rate of matrix products of the same size.
//!
//! `cargo bench --bench nearest -- [runs=3] [vertices=6000] [k=120] [random=0]`: two uneven spheres of
//! so many vertices, matched in the coordinates of their first `k` eigenfunctions, on one thread.
//! `product` is faer's single-precision product of as many numbers, `queries x k` by `k x points`, and
//! its rate; the search's rate is that of a product of all queries and all points in its time, which
//! it may exceed, since it passes over points. `random=1` takes random points instead, of which none
//! can be passed over.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par};
use sinew::kernels::geometry::mesh::Vec3;
use sinew::kernels::geometry::shapes::bumpy_sphere;
use sinew::kernels::maps::nearest::nearest_rows;
use sinew::kernels::numerics::random::Random;
use sinew::kernels::spectral::eigs::{EigsOptions, eigs};
use sinew::kernels::spectral::laplacian::{MassLumping, cotangent_laplacian};

fn main() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
    pool.install(measure);
}

fn measure() {
    let (runs, n, k) = (number("runs", 3), number("vertices", 6000), number("k", 120));
    let (queries, points) = match number("random", 0) {
        0 => (eigenfunctions(n, k, 1.0), eigenfunctions(n, k, 1.03)),
        _ => (random_points(n, k, 1), random_points(n, k, 2)),
    };
    let work = 2.0 * (queries.nrows() * points.nrows() * k) as f64;
    let product = product_rate(k, runs);
    let found = least(runs, || drop(nearest_rows(queries.as_ref(), points.as_ref())));
    println!(
        "nearest {} x {} in {k} dimensions: {found:.4} s CPU, {:.1} GFlop/s; product {product:.1} \
         GFlop/s; {:.0} % of it",
        queries.nrows(),
        points.nrows(),
        work / found * 1e-9,
        100.0 * work / found * 1e-9 / product,
    );
}

/// GFlop/s of single-precision products of `4096 x k` by `k x 1024`.
fn product_rate(k: usize, runs: usize) -> f64 {
    let entry = |i: usize, j: usize| ((i * 7 + j * 3) % 11) as f32 - 5.0;
    let (a, b) = (Mat::from_fn(k, 4096, entry), Mat::from_fn(k, 1024, entry));
    let mut c = Mat::<f32>::zeros(4096, 1024);
    let mut multiply = || {
        matmul(c.as_mut(), Accum::Replace, a.transpose(), b.as_ref(), 1.0, Par::Seq);
    };
    multiply();
    2.0 * (4096 * 1024 * k) as f64 / least(runs.max(3), multiply) * 1e-9
}

/// Eigenfunctions of a sphere with bumps, stretched along one axis.
fn eigenfunctions(n_vertices: usize, k: usize, stretch: f64) -> Mat<f64> {
    let frequency = (n_vertices as f64 / 10.0).sqrt().round() as usize;
    let mesh = bumpy_sphere(frequency);
    let axes = Vec3::new(stretch, 1.0, 1.2);
    let stretched = mesh.vertices().iter().map(|p| p.component_mul(&axes));
    let mesh = mesh.with_vertices(stretched.collect()).expect("finite");
    let operator = cotangent_laplacian(&mesh, MassLumping::default()).expect("a clean mesh");
    let options = EigsOptions { k, ..EigsOptions::default() };
    let basis = eigs(&operator, &options).expect("eigenpairs").0;
    let area = basis.area().sqrt();
    // Signs are arbitrary: make both shapes agree where they are alike.
    Mat::from_fn(basis.n_vertices(), k, |row, column| {
        let first = basis.eigenvectors.col(column).iter().find(|it| it.abs() * area > 0.5);
        area * basis.eigenvectors[(row, column)] * first.map_or(1.0, |it| it.signum())
    })
}

fn random_points(n: usize, k: usize, seed: u64) -> Mat<f64> {
    let mut random = Random::new(seed);
    Mat::from_fn(n, k, |_, _| random.normal())
}

/// The least CPU seconds of several runs.
fn least(runs: usize, mut work: impl FnMut()) -> f64 {
    let mut best = f64::INFINITY;
    for _ in 0..runs.max(1) {
        let start = cpu_secs();
        work();
        best = best.min(cpu_secs() - start);
    }
    best
}

/// A `name=value` word; `cargo bench` adds `--bench`, which is skipped.
fn number(name: &str, default: usize) -> usize {
    let words = std::env::args().skip(1);
    let mut value =
        words.filter_map(|it| Some(it.strip_prefix(name)?.strip_prefix('=')?.to_owned()));
    value.next_back().map_or(default, |it| it.parse().expect("a number"))
}

/// CPU seconds of this process, all threads.
fn cpu_secs() -> f64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: the pointer is to a `timespec` that outlives the call.
    unsafe { libc::clock_gettime(libc::CLOCK_PROCESS_CPUTIME_ID, &mut time) };
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}
