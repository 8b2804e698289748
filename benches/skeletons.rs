//! CPU time of curve skeletons.
//!
//! `cargo bench --bench skeletons -- [runs=3] [threads=1] [sizes=5000,10000,30000] [plain=10000]
//! [file=A.ply] [write=FOLDER]`: a mesh (or an uneven closed surface) is subdivided and decimated to every
//! size, and its curve skeleton extracted by multi-scale local separators; up to `plain` vertices by
//! plain ones, too. The least of several runs, in CPU seconds of the process. `write` leaves the
//! meshes for `benches/peers/skeletons.py`, which prints the same lines for PyGEL3D.

use std::path::Path;
use std::time::Instant;

use sinew::kernels::curve_skeleton::CurveSkeleton;
use sinew::kernels::decimate::{DecimateOptions, decimate};
use sinew::kernels::io::gltf::GltfOptions;
use sinew::kernels::io::{obj, read::read_character};
use sinew::kernels::local_separators::{
    LocalSeparatorsOptions, SpatialGraph, Variant, local_separators,
};
use sinew::kernels::mesh::TriMesh;
use sinew::kernels::shapes::bumpy_sphere;
use sinew::kernels::subdivide::{Scheme, subdivide};

fn main() {
    let arguments = Arguments::parse();
    let threads = arguments.number("threads", 1);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
    pool.install(|| measure_all(&arguments));
}

fn measure_all(arguments: &Arguments) {
    let mesh = arguments.mesh();
    let sizes = arguments.text("sizes").unwrap_or("5000,10000,30000");
    for size in sizes.split(',').map(|it| it.parse().expect("a number of vertices")) {
        let mesh = resized(&mesh, size);
        if let Some(folder) = arguments.text("write") {
            let path = Path::new(folder).join(format!("{size}.obj"));
            std::fs::write(path, obj::write_obj(&mesh)).expect("a writable folder");
        }
        measure("multiscale", &mesh, Variant::Multiscale, arguments);
        if size <= arguments.number("plain", 10_000) {
            measure("plain", &mesh, Variant::Plain, arguments);
        }
    }
}

fn measure(name: &str, mesh: &TriMesh, variant: Variant, arguments: &Arguments) {
    let options = LocalSeparatorsOptions { variant, ..Default::default() };
    let (mut cpu, mut wall) = (f64::INFINITY, f64::INFINITY);
    let mut made = CurveSkeleton::default();
    for _ in 0..arguments.number("runs", 3).max(1) {
        let (clock, start) = (Instant::now(), cpu_secs());
        made = local_separators(&SpatialGraph::of_mesh(mesh), &options);
        cpu = cpu.min(cpu_secs() - start);
        wall = wall.min(clock.elapsed().as_secs_f64());
    }
    println!(
        "{name:10} n={} threads={} cpu={cpu:.3}s wall={wall:.3}s nodes={} leaves={} junctions={} \
         cycles={}",
        mesh.n_vertices(),
        rayon::current_num_threads(),
        made.n_nodes(),
        made.leaves().len(),
        made.junctions().len(),
        made.n_cycles(),
    );
}

/// The same shape with so many vertices.
fn resized(mesh: &TriMesh, n_vertices: usize) -> TriMesh {
    let mut levels = 0;
    while mesh.n_vertices() << (2 * levels) < n_vertices {
        levels += 1;
    }
    let fine = subdivide(mesh, Scheme::Loop, levels).expect("a surface").mesh;
    let options = DecimateOptions { n_vertices, ..Default::default() };
    decimate(&fine, &options).expect("a surface").mesh
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

    /// The given file, or an uneven closed surface.
    fn mesh(&self) -> TriMesh {
        let Some(file) = self.text("file") else {
            return bumpy_sphere(20);
        };
        let path = Path::new(file);
        let bytes = std::fs::read(path).expect("a readable file");
        let extension = path.extension().unwrap_or_default().to_string_lossy();
        let character = read_character(&extension, &bytes, &|_| None, GltfOptions::default());
        character.expect("a mesh").mesh
    }
}

/// CPU seconds of this process, all threads.
fn cpu_secs() -> f64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: the pointer is to a `timespec` that outlives the call.
    unsafe { libc::clock_gettime(libc::CLOCK_PROCESS_CPUTIME_ID, &mut time) };
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}
