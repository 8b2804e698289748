//! CPU time and memory of the Laplacian and its eigenpairs, by phase.
//!
//! `cargo bench --bench eigs -- [k=200] [threads=1] [runs=1] [frequencies=55,100] [meshes=DIR]`:
//! uneven closed surfaces of `10 f^2 + 2` vertices. With `meshes=DIR` the operators are written
//! there for `benches/peers/eigs.py`, which prints the same lines for scipy with CHOLMOD.

use sinew::kernels::geometry::mesh::TriMesh;
use sinew::kernels::geometry::shapes::bumpy_sphere;
use sinew::kernels::spectral::eigs::{EigsOptions, EigsStats, Observer, Phase, eigs_observed};
use sinew::kernels::spectral::laplacian::{MassLumping, cotangent_laplacian};
use sinew::kernels::spectral::operator::Operator;
use std::alloc::{GlobalAlloc, Layout, System};
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

fn main() {
    let arguments = Arguments::parse();
    let threads = arguments.number("threads", 1);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
    for frequency in arguments.frequencies() {
        let mesh = bumpy_sphere(frequency);
        for _ in 0..arguments.number("runs", 1) {
            pool.install(|| measure(&mesh, &arguments, threads));
        }
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

    /// 10 f^2 + 2 vertices each.
    fn frequencies(&self) -> Vec<usize> {
        let list = self.text("frequencies").unwrap_or("55,100");
        list.split(',').map(|it| it.parse().expect("a number")).collect()
    }
}

fn measure(mesh: &TriMesh, arguments: &Arguments, threads: usize) {
    let k = arguments.number("k", 200);
    let n_vertices = mesh.n_vertices();
    let start = cpu_secs();
    let operator = cotangent_laplacian(mesh, MassLumping::default()).expect("a good mesh");
    println!("laplacian n={n_vertices} cpu={:.4}s", cpu_secs() - start);
    if let Some(folder) = arguments.text("meshes") {
        let path = Path::new(folder).join(format!("{n_vertices}.operator"));
        std::fs::write(path, encode(&operator)).expect("a writable folder");
    }
    let watch = Watch::default();
    let start = cpu_secs();
    let clock = std::time::Instant::now();
    let options = EigsOptions { k, ..Default::default() };
    let (basis, stats) = eigs_observed(&operator, &options, &watch).expect("eigenpairs");
    let total = cpu_secs() - start;
    let wall = clock.elapsed().as_secs_f64();
    let EigsStats { n_solves, residual, orthogonality, .. } = stats;
    println!(
        "eigs n={n_vertices} k={k} threads={threads} cpu={total:.3}s wall={wall:.3}s \
         solves={n_solves} residual={residual:.1e} \
         orthogonality={orthogonality:.1e} lambda_k={:.10e} bytes={}",
        basis.eigenvalues[k - 1],
        blake3::hash(bytemuck::cast_slice(&columns(&basis.eigenvectors))).to_hex().split_at(16).0,
    );
    // Phases of several threads overlap: only on one thread do their times mean something.
    if threads == 1 {
        watch.report();
    }
}

fn columns(matrix: &faer::Mat<f64>) -> Vec<f64> {
    matrix.col_iter().flat_map(|column| column.iter().copied().collect::<Vec<_>>()).collect()
}

/// Little-endian: `n`, number of entries, offsets, columns (64 bits each), values, masses.
fn encode(operator: &Operator) -> Vec<u8> {
    let stiffness = &operator.stiffness;
    let whole = [operator.mass.len(), stiffness.n_stored()];
    let columns = stiffness.columns.iter().map(|&it| it as usize);
    let indices = whole.into_iter().chain(stiffness.offsets.iter().copied()).chain(columns);
    let mut res: Vec<u8> = indices.flat_map(|it| (it as u64).to_le_bytes()).collect();
    let values = stiffness.values.iter().chain(&operator.mass);
    res.extend(values.flat_map(|it| it.to_le_bytes()));
    res
}

/// Adds up CPU time and the peak of memory by phase.
#[derive(Default)]
struct Watch(Mutex<State>);

#[derive(Default)]
struct State {
    now: Option<(Phase, f64)>,
    /// Phase, CPU seconds, peak of allocated bytes.
    phases: Vec<(Phase, f64, usize)>,
}

impl Observer for Watch {
    fn enter(&self, phase: Phase) {
        let mut state = self.0.lock().expect("no panic before");
        state.finish();
        PEAK.store(ALLOCATED.load(Relaxed), Relaxed);
        state.now = Some((phase, cpu_secs()));
    }
}

impl State {
    fn finish(&mut self) {
        let Some((phase, since)) = self.now.take() else { return };
        let (secs, peak) = (cpu_secs() - since, PEAK.load(Relaxed));
        match self.phases.iter_mut().find(|it| it.0 == phase) {
            Some(it) => (it.1, it.2) = (it.1 + secs, it.2.max(peak)),
            None => self.phases.push((phase, secs, peak)),
        }
    }
}

impl Watch {
    fn report(&self) {
        let mut state = self.0.lock().expect("no panic before");
        state.finish();
        for (phase, secs, peak) in &state.phases {
            let name = format!("{phase:?}");
            println!("    {name:20} {secs:7.3} s  peak {:5.0} MiB", *peak as f64 / 1048576.0);
        }
    }
}

/// CPU seconds of this process, all threads.
fn cpu_secs() -> f64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: the pointer is to a `timespec` that outlives the call.
    unsafe { libc::clock_gettime(libc::CLOCK_PROCESS_CPUTIME_ID, &mut time) };
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

static ALLOCATED: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

/// Counts what is allocated.
struct Counting;

// SAFETY: every call goes on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let now = ALLOCATED.fetch_add(layout.size(), Relaxed) + layout.size();
        PEAK.fetch_max(now, Relaxed);
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        let now = ALLOCATED.fetch_add(layout.size(), Relaxed) + layout.size();
        PEAK.fetch_max(now, Relaxed);
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        ALLOCATED.fetch_sub(layout.size(), Relaxed);
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;
