//! CPU time of the operators of meshes and point clouds.
//!
//! `cargo bench --bench operators -- [runs=5] [threads=1] files=A.off,B.off`: for every mesh the
//! cotangent and the tufted operator, and that of its vertices as a point cloud. The least of several
//! runs, in CPU seconds of the process; `wall` beside it says what more threads are good for.
//! `benches/peers/robust.py` prints the same lines for `robust_laplacian`, libigl and pyFM, with the
//! eigenvalues that `eigenvalues=1` adds here.

use std::path::Path;

use sinew::kernels::geometry::mesh::TriMesh;
use sinew::kernels::geometry::shapes::bumpy_sphere;
use sinew::kernels::io::gltf::GltfOptions;
use sinew::kernels::io::read::read_character;
use sinew::kernels::spectral::cloud_laplacian::{CloudOptions, cloud_laplacian};
use sinew::kernels::spectral::eigs::{Disconnected, EigsOptions, eigs};
use sinew::kernels::spectral::laplacian::{MassLumping, cotangent_laplacian};
use sinew::kernels::spectral::operator::Operator;
use sinew::kernels::spectral::tufted::tufted_laplacian;

fn main() {
    let arguments = Arguments::parse();
    let threads = arguments.number("threads", 1);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
    for (name, mesh) in arguments.meshes() {
        pool.install(|| measure_all(&name, &mesh, &arguments));
    }
}

fn measure_all(name: &str, mesh: &TriMesh, arguments: &Arguments) {
    let cotan = || cotangent_laplacian(mesh, MassLumping::default()).expect("a clean mesh");
    let tufted = || tufted_laplacian(mesh).expect("faces").0;
    let points = mesh.vertices();
    let cloud = || cloud_laplacian(points, &CloudOptions::default()).expect("a surface").0;
    measure("cotan", name, arguments, &cotan);
    measure("tufted", name, arguments, &tufted);
    measure("cloud", name, arguments, &cloud);
}

fn measure(operator: &str, name: &str, arguments: &Arguments, make: &dyn Fn() -> Operator) {
    let (mut cpu, mut wall) = (f64::INFINITY, f64::INFINITY);
    let mut made = None;
    for _ in 0..arguments.number("runs", 5).max(1) {
        let (clock, start) = (std::time::Instant::now(), cpu_secs());
        let result = make();
        cpu = cpu.min(cpu_secs() - start);
        wall = wall.min(clock.elapsed().as_secs_f64());
        made = Some(result);
    }
    let made = made.expect("at least one run");
    let off_diagonal = (0..made.mass.len()).map(|row| {
        made.stiffness.row(row).filter(|&(column, value)| column != row && value > 1e-12).count()
    });
    let n_negative: usize = off_diagonal.sum();
    println!(
        "{operator:6} {name} n={} threads={} cpu={cpu:.4}s wall={wall:.4}s stored={} \
         negative_weights={n_negative} area={:.9}",
        made.mass.len(),
        rayon::current_num_threads(),
        made.stiffness.n_stored(),
        made.mass.iter().sum::<f64>(),
    );
    if arguments.number("eigenvalues", 0) > 0 {
        let options =
            EigsOptions { k: 50, disconnected: Disconnected::Merge, ..Default::default() };
        let (basis, _) = eigs(&made, &options).expect("eigenpairs");
        let shown = [1, 2, 5, 10, 20, 49].map(|it| format!("{:.9}", basis.eigenvalues[it]));
        println!("       eigenvalues 1, 2, 5, 10, 20, 49: {}", shown.join(" "));
    }
}

/// `name=value` words; `cargo bench` adds `--bench`, which is skipped.
struct Arguments(Vec<String>);

impl Arguments {
    fn parse() -> Self {
        Self(std::env::args().skip(1).filter(|it| it.contains('=')).collect())
    }

    fn text(&self, name: &str) -> Option<&str> {
        self.0.iter().find_map(|it| it.strip_prefix(name)?.strip_prefix('='))
    }

    fn number(&self, name: &str, default: usize) -> usize {
        self.text(name).map_or(default, |it| it.parse().expect("a number"))
    }

    /// The given files, or an uneven closed surface.
    fn meshes(&self) -> Vec<(String, TriMesh)> {
        let Some(files) = self.text("files") else {
            return vec![("bumpy_sphere".to_owned(), bumpy_sphere(55))];
        };
        let read = |file: &str| {
            let path = Path::new(file);
            let bytes = std::fs::read(path).expect("a readable file");
            let part = |it: Option<&std::ffi::OsStr>| {
                it.map(|it| it.to_string_lossy().into_owned()).unwrap_or_default()
            };
            let (name, extension) = (part(path.file_stem()), part(path.extension()));
            let options = GltfOptions::default();
            let character = read_character(&extension, &bytes, &|_| None, options);
            (name, character.expect("a mesh").mesh)
        };
        files.split(',').map(read).collect()
    }
}

/// CPU seconds of this process, all threads.
fn cpu_secs() -> f64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: the pointer is to a `timespec` that outlives the call.
    unsafe { libc::clock_gettime(libc::CLOCK_PROCESS_CPUTIME_ID, &mut time) };
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}
