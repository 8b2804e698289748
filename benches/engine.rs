//! What the engine itself costs: 1,000 trivial nodes, 10 layers of 100, each reading 3 of the layer
//! before. `cargo bench --bench engine [-- N]`
//!
//! Every scenario is a process of its own (this program, started again), so that start-up counts;
//! what is printed is its processor time (user + system), the best and the median of the runs.
//!
//! - `cold`: an empty cache; every node runs
//! - `noop`: nothing changed; no node runs
//! - `change`: one root gives another number; what reads it runs
//! - `cutoff`: one root's parameter changes, its number does not; one node runs
//! - `revert`: the file of before; no node runs

use std::{
    fmt::Write,
    fs,
    path::{Path, PathBuf},
    process::Command,
    time::{Duration, Instant},
};

use sinew::engine::{
    pipeline::{self, Settings},
    record::{self, RECORD_VERSION, Recorder, RunStart},
    run::{self, RunOptions},
    store::{Access, Store},
    toy::TOY,
};

const LAYERS: usize = 10;
const OFFSETS: [usize; 3] = [0, 1, 7];

fn main() {
    let args: Vec<String> = std::env::args().skip(1).filter(|it| it != "--bench").collect();
    match args.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["child", folder] => child(Path::new(folder)),
        [] => bench(1000),
        [n, ..] => bench(n.parse().expect("the number of nodes")),
    }
}

/// One process of a scenario: loads and runs `pipeline.toml`, prints how many nodes ran.
fn child(folder: &Path) {
    let graph = pipeline::load(&folder.join("pipeline.toml"), &TOY, &Settings::default())
        .unwrap_or_else(|e| panic!("{}", e.render(false)));
    let store = Store::open(&folder.join("cache"), Access::ReadWrite).expect("a writable folder");
    let options = RunOptions {
        threads: 2,
        output_dir: folder.to_owned(),
        run_id: "bench".to_owned(),
        ..RunOptions::default()
    };
    let start = RunStart {
        v: RECORD_VERSION,
        run: record::new_run_id(store.dir()),
        time: String::new(),
        version: String::new(),
        title: None,
        args: Vec::new(),
        folder: folder.to_owned(),
        host: String::new(),
        threads: options.threads,
        sources: Vec::new(),
    };
    let mut recorder = Recorder::start(store.dir(), &start);
    let report = run::run(&graph, &TOY, &store, &options, &mut recorder);
    assert!(report.succeeded());
    print!("{}", report.counts().ran);
    recorder.done(&report);
}

fn bench(n: usize) {
    let width = n / LAYERS;
    let folder = tempfile::tempdir_in(std::env::var_os("BENCH_DIR").unwrap_or("target".into()))
        .expect("a writable folder");
    let file = folder.path().join("pipeline.toml");
    let write = |first: i64, duration_ms: u64| {
        fs::write(&file, pipeline(width, first, duration_ms)).expect("a writable folder");
    };
    println!("{n} nodes    ran   cpu best  median   wall median");
    let mut numbers: Vec<(&str, usize, Vec<Sample>)> = Vec::new();
    for round in 0..7 {
        let _ = fs::remove_dir_all(folder.path().join("cache"));
        write(1, 0);
        let mut scenario = |name: &'static str, at: usize| {
            let sample = start(folder.path());
            if round == 0 {
                numbers.push((name, sample.ran, Vec::new()));
            }
            assert_eq!(numbers[at].1, sample.ran, "{name} runs the same nodes every time");
            numbers[at].2.push(sample);
        };
        scenario("cold", 0);
        scenario("noop", 1);
        write(2, 0);
        scenario("change", 2);
        write(2, 1);
        scenario("cutoff", 3);
        write(1, 0);
        scenario("revert", 4);
    }
    for (name, ran, samples) in &mut numbers {
        samples.sort_by_key(|it| it.cpu);
        let (best, median) = (samples[0].cpu, samples[samples.len() / 2].cpu);
        samples.sort_by_key(|it| it.wall);
        let wall = samples[samples.len() / 2].wall;
        println!("{name:8} {ran:6} {best:>10.1?} {median:>10.1?} {wall:>10.1?}");
    }
}

struct Sample {
    ran: usize,
    cpu: Duration,
    wall: Duration,
}

fn start(folder: &Path) -> Sample {
    let program: PathBuf = std::env::current_exe().expect("this program");
    let (before, start) = (children_cpu(), Instant::now());
    let output = Command::new(program).arg("child").arg(folder).output().expect("this program");
    let (wall, after) = (start.elapsed(), children_cpu());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    Sample { ran: text.parse().expect("a number"), cpu: after - before, wall }
}

/// Processor time of all ended children.
fn children_cpu() -> Duration {
    // SAFETY: the struct is plain numbers, and the call fills it.
    let usage = unsafe {
        let mut usage: libc::rusage = std::mem::zeroed();
        libc::getrusage(libc::RUSAGE_CHILDREN, &raw mut usage);
        usage
    };
    let time = |it: libc::timeval| {
        Duration::from_secs(it.tv_sec as u64) + Duration::from_micros(it.tv_usec as u64)
    };
    time(usage.ru_utime) + time(usage.ru_stime)
}

/// Numbers, and above them sums of three each. The first number can be changed, and how long it
/// takes to make it, which leaves it as it was.
fn pipeline(width: usize, first: i64, duration_ms: u64) -> String {
    let mut text = String::new();
    for column in 0..width {
        let value = if column == 0 { first } else { 10_000 * (column as i64 + 1) };
        let duration_ms = if column == 0 { duration_ms } else { 0 };
        let _ = write!(
            text,
            "[nodes.n0_{column}]\nkind = \"sleep\"\nvalue = {value}\nduration_ms = {duration_ms}\n\n"
        );
    }
    for layer in 1..LAYERS {
        for column in 0..width {
            let terms: Vec<String> = OFFSETS
                .iter()
                .map(|it| format!("\"@n{}_{}\"", layer - 1, (column + it) % width))
                .collect();
            let _ = write!(
                text,
                "[nodes.n{layer}_{column}]\nkind = \"add\"\nterms = [{}]\n\n",
                terms.join(", ")
            );
        }
    }
    text
}
