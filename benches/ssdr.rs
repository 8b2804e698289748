//! CPU time and error of smooth skinning decompositions.
//!
//! `cargo bench --bench ssdr -- file=A.glb [clip=NAME] [every=1] [threads=1] [bones=10,20,30]
//! [write=A.bin]`: the first clip of a rigged character, or the one whose name contains `clip`, is
//! played, and the moving mesh decomposed with the default options. CPU seconds of the process, one
//! run; the root mean squared distance as a share of the rest pose's diagonal. `write` leaves the
//! moving mesh for `benches/peers/ssdr.py`, which prints the same lines for Dem Bones.

use std::path::Path;
use std::time::Instant;

use sinew::kernels::geometry::mesh::{TriMesh, Vec3};
use sinew::kernels::io::gltf::GltfOptions;
use sinew::kernels::io::read::read_character;
use sinew::kernels::rigs::skinning::skin;
use sinew::kernels::rigs::ssdr::{SsdrOptions, ssdr};

fn main() {
    let arguments = Arguments(std::env::args().skip(1).filter(|it| it.contains('=')).collect());
    let Some(file) = arguments.text("file") else {
        println!("`file=A.glb` is needed: a rigged character with a clip");
        return;
    };
    let (mesh, frames) = played(file, &arguments);
    if let Some(path) = arguments.text("write") {
        std::fs::write(path, bytes(&mesh, &frames)).expect("a writable folder");
    }
    let threads = arguments.text("threads").map_or(1, |it| it.parse().expect("a number"));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
    for n_bones in arguments.text("bones").unwrap_or("10,20,30").split(',') {
        let n_bones = n_bones.parse().expect("a number of bones");
        pool.install(|| measure(&mesh, &frames, n_bones));
    }
}

fn measure(mesh: &TriMesh, frames: &[Vec<Vec3>], n_bones: usize) {
    let frames: Vec<&[Vec3]> = frames.iter().map(Vec::as_slice).collect();
    let options = SsdrOptions { n_bones, ..Default::default() };
    let (clock, start) = (Instant::now(), cpu_secs());
    let res = ssdr(mesh.vertices(), mesh.faces(), &frames, None, &options).expect("finite points");
    let (cpu, wall) = (cpu_secs() - start, clock.elapsed().as_secs_f64());
    let first = mesh.vertices()[0];
    let (low, high) =
        mesh.vertices().iter().fold((first, first), |(low, high), it| (low.inf(it), high.sup(it)));
    println!(
        "ssdr       n={} frames={} bones={}/{n_bones} cpu={cpu:.3}s wall={wall:.3}s rmse={:.4}%",
        mesh.n_vertices(),
        frames.len(),
        res.centers.len(),
        100.0 * res.rmse / (high - low).norm(),
    );
}

/// The mesh and where its vertices are in every frame.
fn played(file: &str, arguments: &Arguments) -> (TriMesh, Vec<Vec<Vec3>>) {
    let path = Path::new(file);
    let bytes = std::fs::read(path).expect("a readable file");
    let extension = path.extension().unwrap_or_default().to_string_lossy();
    let character = read_character(&extension, &bytes, &|_| None, GltfOptions::default());
    let character = character.expect("a character");
    let wanted = arguments.text("clip").unwrap_or("");
    let clip = character.clips.iter().find(|it| it.name.contains(wanted)).expect("such a clip");
    let (skeleton, weights) =
        character.skeleton.as_ref().zip(character.weights.as_ref()).expect("a rig");
    let every = arguments.text("every").map_or(1, |it| it.parse().expect("a number"));
    let frames = (0..clip.n_frames())
        .step_by(every)
        .map(|frame| skin(&character.mesh, skeleton, weights, clip, frame).expect("one rig"))
        .collect();
    (character.mesh, frames)
}

/// Counts of vertices, faces and frames (`u32`); the rest pose, the frames (`f64`); faces (`u32`).
fn bytes(mesh: &TriMesh, frames: &[Vec<Vec3>]) -> Vec<u8> {
    let counts = [mesh.n_vertices(), mesh.faces().len(), frames.len()];
    let mut bytes: Vec<u8> = counts.iter().flat_map(|it| (*it as u32).to_le_bytes()).collect();
    let points = mesh.vertices().iter().chain(frames.iter().flatten());
    bytes.extend(points.flat_map(|it| [it.x, it.y, it.z]).flat_map(f64::to_le_bytes));
    bytes.extend(mesh.faces().iter().flatten().flat_map(|it| it.to_le_bytes()));
    bytes
}

/// `name=value` words; `cargo bench` adds `--bench`, which is skipped.
struct Arguments(Vec<String>);

impl Arguments {
    fn text(&self, name: &str) -> Option<&str> {
        self.0.iter().find_map(|it| it.strip_prefix(name)?.strip_prefix('='))
    }
}

/// CPU seconds of this process, all threads.
fn cpu_secs() -> f64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: the pointer is to a `timespec` that outlives the call.
    unsafe { libc::clock_gettime(libc::CLOCK_PROCESS_CPUTIME_ID, &mut time) };
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}
