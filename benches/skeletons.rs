//! CPU time of curve skeletons.
//!
//! `cargo bench --bench skeletons -- [runs=3] [threads=1] [sizes=5000,10000,30000] [plain=10000]
//! [file=A.ply] [write=FOLDER] [judge=FOLDER]`: a mesh (or an uneven closed surface) is subdivided and decimated to every
//! size, and its curve skeleton extracted by multi-scale local separators, up to `plain` vertices by
//! plain ones, too; and by contraction, of the mesh and of its vertices alone, as it is and by way of
//! 6000 points, the default of `contract`. The least of several runs, in CPU seconds of the process; how
//! much of the skeleton is inside and how far off the middle. `write` leaves the meshes for `benches/peers/skeletons.py`,
//! which times PyGEL3D, skeletor, pc-skeletor and CGAL, and leaves their skeletons, which
//! `judge=FOLDER` measures in the same way.

use std::path::Path;
use std::time::Instant;

use sinew::kernels::curve_skeletons::contract::{
    ContractOptions, FinishOptions, coarse_contraction, finish,
};
use sinew::kernels::curve_skeletons::curve_skeleton::CurveSkeleton;
use sinew::kernels::curve_skeletons::local_separators::{
    LocalSeparatorsOptions, SpatialGraph, Variant, local_separators,
};
use sinew::kernels::curve_skeletons::skeleton_error::fit_of;
use sinew::kernels::geometry::mesh::{TriMesh, Vec3};
use sinew::kernels::geometry::shapes::bumpy_sphere;
use sinew::kernels::io::gltf::GltfOptions;
use sinew::kernels::io::{obj, read::read_character};
use sinew::kernels::remeshing::decimate::{DecimateOptions, decimate};
use sinew::kernels::remeshing::subdivide::{Scheme, subdivide};

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
        let separators = |variant| {
            let options = LocalSeparatorsOptions { variant, ..Default::default() };
            local_separators(&SpatialGraph::of_mesh(&mesh), &options)
        };
        measure("multiscale", &mesh, arguments, &|| separators(Variant::Multiscale));
        if size <= arguments.number("plain", 10_000) {
            measure("plain", &mesh, arguments, &|| separators(Variant::Plain));
        }
        let cloud = TriMesh::from_points(mesh.vertices().to_vec()).expect("finite points");
        for (name, shape) in [("contract", &mesh), ("contract_cloud", &cloud)] {
            measure(name, &mesh, arguments, &|| contracted(shape, usize::MAX));
            measure(&format!("{name}_6000"), &mesh, arguments, &|| contracted(shape, 6000));
        }
        if let Some(folder) = arguments.text("judge") {
            judge(folder, size, &mesh);
        }
    }
}

fn contracted(shape: &TriMesh, simplify_to: usize) -> CurveSkeleton {
    let found = coarse_contraction(shape, simplify_to, &ContractOptions::default());
    finish(&found.expect("a shape"), shape, &FinishOptions::default()).expect("labels and normals")
}

fn measure(name: &str, mesh: &TriMesh, arguments: &Arguments, extract: &dyn Fn() -> CurveSkeleton) {
    let (mut cpu, mut wall) = (f64::INFINITY, f64::INFINITY);
    let mut made = CurveSkeleton::default();
    for _ in 0..arguments.number("runs", 3).max(1) {
        let (clock, start) = (Instant::now(), cpu_secs());
        made = extract();
        cpu = cpu.min(cpu_secs() - start);
        wall = wall.min(clock.elapsed().as_secs_f64());
    }
    let n_threads = rayon::current_num_threads();
    println!(
        "{name:20} n={} threads={n_threads} cpu={cpu:.3}s wall={wall:.3}s {}",
        mesh.n_vertices(),
        quality(&made, mesh)
    );
}

fn quality(skeleton: &CurveSkeleton, mesh: &TriMesh) -> String {
    let fit = fit_of(skeleton, mesh);
    format!(
        "nodes={} leaves={} junctions={} cycles={} inside={:.1}% off_center={:.3}",
        skeleton.n_nodes(),
        skeleton.leaves().len(),
        skeleton.junctions().len(),
        skeleton.n_cycles(),
        100.0 * fit.inside,
        fit.off_center,
    )
}

/// Measures skeletons that other programs left as lines `v x y z` and `l from to`.
fn judge(folder: &str, size: usize, mesh: &TriMesh) {
    let mut files: Vec<_> = std::fs::read_dir(folder).expect("a folder").flatten().collect();
    files.sort_by_key(std::fs::DirEntry::file_name);
    for file in files {
        let name = file.file_name().to_string_lossy().into_owned();
        if let Some(who) = name.strip_suffix(&format!("_{size}.obj")) {
            let text = std::fs::read_to_string(file.path()).expect("a readable file");
            println!("{who:20} n={size} {}", quality(&read_curves(&text), mesh));
        }
    }
}

fn read_curves(text: &str) -> CurveSkeleton {
    let (mut positions, mut edges) = (Vec::new(), Vec::new());
    for line in text.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["v", x, y, z] => {
                let [x, y, z] = [x, y, z].map(|it| it.parse().expect("a number"));
                positions.push(Vec3::new(x, y, z));
            }
            ["l", from, to] => {
                edges.push([from, to].map(|it| it.parse::<u32>().expect("a node") - 1));
            }
            _ => {}
        }
    }
    edges.retain(|it: &[u32; 2]| it[0] != it[1]);
    let radii = vec![0.0; positions.len()];
    CurveSkeleton::new(positions, radii, edges, Vec::new()).expect("a graph")
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
