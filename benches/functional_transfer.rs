//! CPU time of every step of the functional skeleton transfer, from two meshes to a skeleton.
//!
//! `cargo bench --bench functional_transfer -- source=A.glb target=B.glb landmarks=A.json,B.json
//! [vertices=5000,30000,…] [k=120] [pairs=200] [samples=3000] [final_rounds=0] [threads=1]`: both meshes
//! are subdivided and decimated to each number of vertices, which is not timed; 0 leaves them as they
//! are. `source` is rigged. `all` is the sum; the matches of all vertices, which pointwise transfer
//! needs, come after it.

use std::path::Path;

use sinew::kernels::geometry::mesh::TriMesh;
use sinew::kernels::io::character::Character;
use sinew::kernels::io::gltf::GltfOptions;
use sinew::kernels::io::read::read_character;
use sinew::kernels::maps::fmap::{FitOptions, fit_functional_map};
use sinew::kernels::maps::landmark_files::read_landmarks;
use sinew::kernels::maps::point_map::point_map;
use sinew::kernels::maps::zoomout::{ZoomOutOptions, refine};
use sinew::kernels::remeshing::decimate::{DecimateOptions, decimate};
use sinew::kernels::remeshing::subdivide::{Scheme, subdivide};
use sinew::kernels::rigs::weights::SkinWeights;
use sinew::kernels::spectral::basis::Basis;
use sinew::kernels::spectral::descriptors::{DescriptorOptions, Descriptors, descriptors};
use sinew::kernels::spectral::eigs::{EigsOptions, eigs};
use sinew::kernels::spectral::laplacian::{MassLumping, cotangent_laplacian};
use sinew::kernels::transfer::exact_regressor::{RegressorOptions, exact_regressor};
use sinew::kernels::transfer::skeleton_transfer::{spectral_regressor, transfer_by_functions};

fn main() {
    let arguments = Arguments::parse();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(arguments.number("threads", 1));
    pool.build().expect("a pool").install(|| {
        for size in arguments.text("vertices").unwrap_or("0").split(',') {
            measure(&arguments, size.parse().expect("a number of vertices"));
        }
    });
}

fn measure(arguments: &Arguments, n_vertices: usize) {
    let [source, target] = ["source", "target"].map(|it| Shape::read(arguments, it, n_vertices));
    let (k, pairs) = (arguments.number("k", 120), arguments.number("pairs", 200));
    let character = &source.character;
    let mut clock = Clock::new(source.mesh.n_vertices(), target.mesh.n_vertices());
    let operators = [&source, &target]
        .map(|it| cotangent_laplacian(&it.mesh, MassLumping::default()).expect("a clean mesh"));
    clock.lap("laplacian");
    let options = EigsOptions { k: pairs, ..EigsOptions::default() };
    let [m, n] = operators.map(|it| eigs(&it, &options).expect("eigenpairs").0);
    clock.lap("eigs");
    let (g, f) = (source.described(&m), target.described(&n));
    clock.lap("descriptors");
    let map = fit_functional_map((&m, &g), (&n, &f), &FitOptions::default()).expect("a map");
    clock.lap("fmap");
    let options = ZoomOutOptions {
        k,
        samples: arguments.number("samples", ZoomOutOptions::default().samples),
        final_rounds: arguments.number("final_rounds", ZoomOutOptions::default().final_rounds),
        ..ZoomOutOptions::default()
    };
    let places = (Some(source.mesh.vertices()), Some(target.mesh.vertices()));
    let map = refine((&m, places.0), (&n, places.1), &map, &options).expect("a map");
    clock.lap("zoomout");
    let rig = character.skeleton.as_ref().zip(source.weights.as_ref());
    let (skeleton, weights) = rig.expect("the source is rigged");
    let options = RegressorOptions::default();
    let (regressor, _) = exact_regressor(&source.mesh, skeleton, weights, &options)
        .expect("weights for every joint");
    let spectral = spectral_regressor(&regressor, &m, k).expect("enough eigenpairs");
    clock.lap("regressor");
    transfer_by_functions(&spectral, &map, &n, target.mesh.vertices()).expect("a skeleton");
    clock.lap("transfer");
    clock.finish();
    let mut clock = Clock::new(source.mesh.n_vertices(), target.mesh.n_vertices());
    point_map(&m, &n, &map);
    clock.lap("matches");
}

/// A mesh of the wanted size, with landmarks.
struct Shape {
    character: Character,
    mesh: TriMesh,
    weights: Option<SkinWeights>,
    landmarks: Vec<(String, u32)>,
}

impl Shape {
    fn read(arguments: &Arguments, name: &str, n_vertices: usize) -> Self {
        let file = arguments.text(name).expect("`source` and `target` are needed");
        let files = arguments.text("landmarks").expect("`landmarks` of source and target");
        let (of_source, of_target) = files.split_once(',').expect("two files of landmarks");
        let landmarks = if name == "source" { of_source } else { of_target };
        let path = Path::new(file);
        let bytes = std::fs::read(path).expect("a readable file");
        let extension = path.extension().expect("an extension").to_string_lossy();
        let character = read_character(&extension, &bytes, &|_| None, GltfOptions::default());
        let character = character.expect("a mesh");
        let landmarks = std::fs::read(landmarks).expect("a readable file of landmarks");
        let landmarks = read_landmarks(&landmarks, "json", &[]).expect("landmarks");
        let mut mesh = character.mesh.clone();
        let mut weights = character.weights.clone();
        let mut vertices = landmarks.vertices;
        let resample = |mesh: &TriMesh, vertices: &[u32]| {
            if n_vertices == 0 || mesh.n_vertices() == n_vertices {
                return None;
            }
            Some(if mesh.n_vertices() < n_vertices {
                subdivide(mesh, Scheme::Loop, 1).expect("a mesh")
            } else {
                let fixed = vertices.to_vec();
                decimate(mesh, &DecimateOptions { n_vertices, fixed, ..Default::default() })
                    .expect("a mesh")
            })
        };
        for _ in 0..5 {
            let Some(resampled) = resample(&mesh, &vertices) else { break };
            weights = weights.map(|it| resampled.weights(&it).expect("weights of the old mesh"));
            vertices = vertices
                .iter()
                .map(|&it| resampled.new_of_old[it as usize].expect("landmarks stay"))
                .collect();
            mesh = resampled.mesh;
        }
        let landmarks = landmarks.names.into_iter().zip(vertices).collect();
        Self { character, mesh, weights, landmarks }
    }

    fn described(&self, basis: &Basis) -> Descriptors {
        descriptors(basis, &self.landmarks, &DescriptorOptions::default()).expect("descriptors")
    }
}

/// CPU seconds between laps.
struct Clock {
    sizes: String,
    first: f64,
    last: f64,
}

impl Clock {
    fn new(n_source: usize, n_target: usize) -> Self {
        let now = cpu_secs();
        Self { sizes: format!("{n_source} {n_target}"), first: now, last: now }
    }

    fn lap(&mut self, step: &str) {
        let now = cpu_secs();
        println!("{} {step} {:.3}", self.sizes, now - self.last);
        self.last = now;
    }

    fn finish(self) {
        println!("{} all {:.3}", self.sizes, self.last - self.first);
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
}

/// CPU seconds of this process, all threads.
fn cpu_secs() -> f64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: the pointer is to a `timespec` that outlives the call.
    unsafe { libc::clock_gettime(libc::CLOCK_PROCESS_CPUTIME_ID, &mut time) };
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}
