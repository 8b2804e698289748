//! What the engine itself costs: trivial nodes, 10 layers, each node reading 3 of the layer before.
//! `cargo bench --bench engine [-- N]`
//!
//! Every scenario is a process of its own (this program, started again), so that start-up counts;
//! what is printed is its processor time (user + system), the best and the median of the runs.
//!
//! - `cold`: an empty cache; every node runs
//! - `noop`: nothing changed; no node runs
//! - `change`: one root gives another number; what reads it runs
//! - `cutoff`: one root's parameter changes, its number does not; one node runs
//! - `revert`: the file of before; no node runs
//! - `explain`: what one node of the last layer is made from
//! - `edited`: why it would run, right after an edit of the file
//! - `plan`: ten times 10,000 instances along an axis, of which none is stored
//! - `1 thread`, `2 threads`: two independent chains of nodes that compute
//! - and an artifact of 48 MB: made and handed on, stored, mapped, decoded

use std::{
    collections::BTreeSet,
    fmt::Write as _,
    fs,
    io::{Read, Write as _},
    path::Path,
    process::{Command, Stdio},
    sync::atomic::{AtomicUsize, Ordering},
    time::{Duration, Instant},
};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sinew::engine::{
    artifact::{AnyArtifact, Artifact, ArtifactKind, ArtifactType, DecodeError, Decoder, Encoder},
    graph::Graph,
    library::Library,
    memory,
    node::{Input, Node, NodeError, NodeIo, NodeKind, OptionalInputs, Output, Spec},
    pipeline::Settings,
    plan::{self, PipelineMemory, Status},
    record::{self, RECORD_VERSION, Recorder, RunStart},
    run::{self, RunOptions},
    snapshot,
    store::{Access, Store},
    toy::Number,
    why::{self, PlanCauses, Tense},
};

const LAYERS: usize = 10;
const OFFSETS: [usize; 3] = [0, 1, 7];
const ROUNDS: usize = 7;
const BLOCK_LEN: usize = 6_000_000;

fn main() {
    memory::prefer_large_pages();
    let args: Vec<String> = std::env::args().skip(1).filter(|it| it != "--bench").collect();
    match args.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["run", folder, jobs] => run_child(Path::new(folder), jobs.parse().expect("a number")),
        ["plan", folder] => plan_child(Path::new(folder)),
        ["explain", folder, node] => explain_child(Path::new(folder), node),
        ["block", folder] => block_child(Path::new(folder)),
        [] => bench(1000),
        [n, ..] => bench(n.parse().expect("the number of nodes")),
    }
}

fn bench(n: usize) {
    let folder = tempfile::tempdir_in(std::env::var_os("BENCH_DIR").unwrap_or("target".into()))
        .expect("a writable folder");
    let folder = folder.path();
    println!("{n} nodes      result   cpu best     median  wall median       peak");
    bench_layers(folder, n / LAYERS);
    bench_plan(folder);
    bench_threads(folder);
    bench_block(folder);
}

fn bench_layers(folder: &Path, width: usize) {
    let last = format!("n{}_0", LAYERS - 1);
    let steps: [(&str, u64, &[&str]); 7] = [
        ("cold", 64, &["run", "2"]),
        ("noop", 64, &["run", "2"]),
        ("change", 128, &["run", "2"]),
        ("cutoff", 129, &["run", "2"]),
        ("revert", 64, &["run", "2"]),
        ("explain", 64, &["explain", &last]),
        ("edited", 192, &["explain", &last]),
    ];
    let mut samples: Vec<Vec<Sample>> = steps.iter().map(|_| Vec::new()).collect();
    for _ in 0..ROUNDS {
        reset(folder);
        for ((_, first, args), samples) in steps.iter().zip(&mut samples) {
            write_pipeline(folder, &layers(width, *first));
            samples.push(start(folder, args));
        }
    }
    for ((name, ..), samples) in steps.iter().zip(samples) {
        print_samples(name, samples);
    }
}

fn bench_plan(folder: &Path) {
    reset(folder);
    write_pipeline(folder, &axis(10_000));
    print_samples("plan", (0..ROUNDS).map(|_| start(folder, &["plan"])).collect());
}

fn bench_threads(folder: &Path) {
    write_pipeline(folder, &chains());
    let sample = |jobs: &str| {
        reset(folder);
        start(folder, &["run", jobs])
    };
    let (one, two): (Vec<_>, Vec<_>) = (0..ROUNDS).map(|_| (sample("1"), sample("2"))).unzip();
    print_samples("1 thread", one);
    print_samples("2 threads", two);
}

fn bench_block(folder: &Path) {
    write_pipeline(
        folder,
        "[nodes.block]\nkind = \"block\"\n\n[nodes.first]\nkind = \"first\"\nblock = \"@block\"\n",
    );
    for _ in 0..ROUNDS {
        reset(folder);
        println!("block      {}", start(folder, &["block"]).result);
    }
}

fn reset(folder: &Path) {
    let _ = fs::remove_dir_all(folder.join("cache"));
}

fn write_pipeline(folder: &Path, text: &str) {
    fs::write(folder.join("pipeline.toml"), text).expect("a writable folder");
}

/// Numbers, and above them digests of three each. What the first gives is its parameter / 64.
fn layers(width: usize, first: u64) -> String {
    let mut text = String::new();
    for column in 0..width {
        let param = if column == 0 { first } else { 64_000 * (column as u64 + 1) };
        let _ = write!(text, "[nodes.n0_{column}]\nkind = \"work\"\nparam = {param}\n\n");
    }
    for layer in 1..LAYERS {
        for column in 0..width {
            let parents = OFFSETS.map(|it| format!("@n{}_{}", layer - 1, (column + it) % width));
            let _ = write!(
                text,
                "[nodes.n{layer}_{column}]\nkind = \"work\"\nparam = {layer}\nparents = {parents:?}\n\n"
            );
        }
    }
    text
}

/// A chain of nodes at every item of an axis.
fn axis(n_items: usize) -> String {
    let mut text = format!("[axes.item]\nrange = {{ from = 1, to = {n_items} }}\n\n");
    text += "[nodes.n0]\nkind = \"work\"\nparam = \"${item}\"\n\n";
    for layer in 1..LAYERS {
        let parent = layer - 1;
        let _ = write!(
            text,
            "[nodes.n{layer}]\nkind = \"work\"\nparam = {layer}\nparents = [\"@n{parent}\"]\n\n"
        );
    }
    text
}

/// Two chains of nodes that have nothing to do with each other, about 20 ms a node.
fn chains() -> String {
    let mut text = String::new();
    for chain in ["a", "b"] {
        for step in 0..20 {
            let _ = write!(text, "[nodes.{chain}{step}]\nkind = \"work\"\nparam = {step}\n");
            let _ = writeln!(text, "rounds = 2_000_000");
            if step > 0 {
                let _ = writeln!(text, "parents = [\"@{chain}{}\"]", step - 1);
            }
            text.push('\n');
        }
    }
    // Unlike roots, so that the chains do not share results.
    text.replacen(
        "[nodes.b0]\nkind = \"work\"\nparam = 0",
        "[nodes.b0]\nkind = \"work\"\nparam = 640",
        1,
    )
}

/// One process: what it printed, and what it took.
struct Sample {
    result: String,
    cpu: Duration,
    wall: Duration,
    peak_kib: i64,
}

/// Runs this program again: `args` with the folder after the first.
fn start(folder: &Path, args: &[&str]) -> Sample {
    let start = Instant::now();
    #[expect(clippy::zombie_processes, reason = "`wait4` below waits, and tells what was used")]
    let mut child = Command::new(std::env::current_exe().expect("this program"))
        .arg(args[0])
        .arg(folder)
        .args(&args[1..])
        .stdout(Stdio::piped())
        .spawn()
        .expect("this program");
    let mut result = String::new();
    child.stdout.take().expect("a pipe").read_to_string(&mut result).expect("text");
    // SAFETY: the struct is plain numbers, the call fills it, and nobody else waits for the child.
    let (status, usage) = unsafe {
        let (mut status, mut usage): (i32, libc::rusage) = (0, std::mem::zeroed());
        libc::wait4(child.id() as i32, &raw mut status, 0, &raw mut usage);
        (status, usage)
    };
    assert_eq!(status, 0, "the child ended well");
    let time = |it: libc::timeval| {
        Duration::from_secs(it.tv_sec as u64) + Duration::from_micros(it.tv_usec as u64)
    };
    let cpu = time(usage.ru_utime) + time(usage.ru_stime);
    Sample { result, cpu, wall: start.elapsed(), peak_kib: usage.ru_maxrss }
}

fn print_samples(name: &str, mut samples: Vec<Sample>) {
    let result = samples[0].result.clone();
    assert!(samples.iter().all(|it| it.result == result), "`{name}` does the same every time");
    samples.sort_by_key(|it| it.wall);
    let wall = samples[samples.len() / 2].wall;
    samples.sort_by_key(|it| it.cpu);
    let (best, median) = (samples[0].cpu, samples[samples.len() / 2].cpu);
    let peak = samples.iter().map(|it| it.peak_kib).max().unwrap_or_default() / 1024;
    println!("{name:10} {result:>10} {best:>10.1?} {median:>10.1?} {wall:>12.1?} {peak:>6} MiB");
}

/// As the program does it: the graph lives as long as the process.
fn load(folder: &Path, store: &Store) -> &'static Graph {
    let path = folder.join("pipeline.toml");
    let graph = snapshot::load(&path, &BENCH, &Settings::default(), store);
    Box::leak(Box::new(graph.unwrap_or_else(|e| panic!("{}", e.render(false)))))
}

fn open(folder: &Path, access: Access) -> Store {
    Store::open(&folder.join("cache"), access).expect("a writable folder")
}

/// Prints how many nodes ran.
fn run_child(folder: &Path, threads: usize) {
    print!("{}", run_all(folder, threads));
}

fn run_all(folder: &Path, threads: usize) -> usize {
    let store = open(folder, Access::ReadWrite);
    let graph = load(folder, &store);
    let options = RunOptions {
        threads,
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
        threads,
        sources: Vec::new(),
    };
    let mut recorder = Recorder::start(store.dir(), &start);
    let report = run::run(graph, &BENCH, &store, &options, &mut recorder);
    assert!(report.succeeded());
    recorder.done(&report);
    report.counts().ran
}

/// Prints how many instances would run, or perhaps would.
fn plan_child(folder: &Path) {
    let store = open(folder, Access::ReadOnly);
    let graph = load(folder, &store);
    let memory = PipelineMemory::new(&store, graph);
    let plan = plan::plan(graph, &[], &BTreeSet::new(), &memory);
    let is_to_do = |it: &&Status| matches!(it, Status::Run { .. } | Status::Follows { .. });
    print!("{}", plan.statuses.iter().filter(is_to_do).count());
}

/// Prints how many steps explain why a node would run, if it would.
fn explain_child(folder: &Path, node: &str) {
    let store = open(folder, Access::ReadOnly);
    let graph = load(folder, &store);
    let index = graph.select(node)[0];
    let memory = PipelineMemory::new(&store, graph);
    let plan = plan::plan(graph, &[index], &BTreeSet::new(), &memory);
    let causes = PlanCauses::new(graph, &plan, &memory);
    let roots = why::roots(graph, index, &plan);
    let steps = roots.into_iter().filter_map(|root| match &plan.statuses[root.index()] {
        Status::Run { reason, .. } => {
            let why = causes.why(root, reason);
            Some(why::chain(&why, Tense::Would, &|it| causes.standing(it)).len())
        }
        _ => None,
    });
    print!("{}", steps.sum::<usize>());
}

/// Prints how long it took to make, hand on, and store a large artifact, and to have it back: a moment
/// later, when it is checked, and once more, when its file looks as it did then.
fn block_child(folder: &Path) {
    let start = Instant::now();
    let block = Block::new();
    let made = start.elapsed();
    let start = Instant::now();
    run_all(folder, 2);
    let ran = start.elapsed();
    let (artifact, _) = AnyArtifact::encode(block);
    let store = open(folder, Access::ReadWrite);
    let map = || {
        let start = Instant::now();
        let bytes = store.object(Block::TYPE, &artifact.digest()).expect("it is stored");
        (bytes, start.elapsed())
    };
    // A file that was written just now could change again without looking different.
    std::thread::sleep(Duration::from_secs(4));
    let (bytes, checked) = map();
    let (_again, mapped) = map();
    let store_size = bytes.len() / 1_000_000;
    let start = Instant::now();
    let again = BENCH.types[0].decode(&bytes, Some(artifact.digest()));
    let decoded = start.elapsed();
    assert_eq!(again.expect("a block").digest(), artifact.digest());
    print!(
        "{store_size} MB: made {made:.1?}, run that makes and stores it {ran:.1?}, \
         mapped and checked {checked:.1?}, mapped again {mapped:.1?}, decoded {decoded:.1?}"
    );
}

static BENCH: Library = Library {
    kinds: &[NodeKind::of::<BlockNode>(), NodeKind::of::<FirstNode>(), NodeKind::of::<WorkNode>()],
    types: &[ArtifactKind::of::<Block>(), ArtifactKind::of::<Number>()],
    common_formats: &[],
};

const NUMBER: Output<Number> = Output::new("number", "the result");
const FNV_PRIME: u64 = 0x0000_0100_0000_01b3;

/// Digests a parameter and what the nodes above gave; without any, it divides it by 64.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct WorkNode {
    /// The parameter.
    param: u64,
    /// How often it digests its result again, to take time.
    #[serde(default)]
    rounds: u64,
}

impl WorkNode {
    const PARENTS: OptionalInputs<Number> = OptionalInputs::new("parents", "the nodes above");
}

impl Node for WorkNode {
    const SPEC: Spec = Spec {
        kind: "work",
        version: 1,
        inputs: &[Self::PARENTS.port()],
        outputs: &[NUMBER.port()],
        cites: &[],
        example: "[nodes.root]\nkind = \"work\"\nparam = 64\n",
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let parents = io.get_all_optional(Self::PARENTS);
        let mut value = self.param / 64;
        if !parents.is_empty() {
            value = digest(0xcbf2_9ce4_8422_2325, &self.param.to_le_bytes());
            for parent in &parents {
                value = digest(value, &parent.0.to_le_bytes());
            }
        }
        for round in 0..self.rounds {
            value = digest(value, &round.to_le_bytes());
        }
        io.put(NUMBER, Number(value as i64));
        // The harness that compares engines counts what ran in this file.
        if let Some(log) = std::env::var_os("RUNS_LOG") {
            fs::File::options().create(true).append(true).open(log)?.write_all(b".")?;
        }
        Ok(())
    }
}

fn digest(seed: u64, bytes: &[u8]) -> u64 {
    bytes.iter().fold(seed, |value, &byte| (value ^ u64::from(byte)).wrapping_mul(FNV_PRIME))
}

/// 48 MB of numbers.
#[derive(Debug)]
struct Block(Vec<f64>);

impl Block {
    fn new() -> Self {
        Self((0..BLOCK_LEN).map(|it| (it as f64).sqrt()).collect())
    }
}

impl Artifact for Block {
    const TYPE: ArtifactType = ArtifactType { name: "block", version: 1, doc: "many numbers" };

    fn encode<'a>(&'a self, to: &mut Encoder<'a>) {
        to.array("values", &[self.0.len()], &self.0);
    }

    fn decode(from: &Decoder<'_>) -> Result<Self, DecodeError> {
        Ok(Self(from.vector::<f64>("values")?.into_owned()))
    }

    fn summary(&self) -> Vec<(String, String)> {
        vec![("numbers".to_owned(), self.0.len().to_string())]
    }
}

/// Where the block lies that was made last.
static BLOCK_ADDRESS: AtomicUsize = AtomicUsize::new(0);

/// Makes a block.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct BlockNode {}

impl BlockNode {
    const BLOCK: Output<Block> = Output::new("block", "square roots");
}

impl Node for BlockNode {
    const SPEC: Spec = Spec {
        kind: "block",
        version: 1,
        inputs: &[],
        outputs: &[Self::BLOCK.port()],
        cites: &[],
        example: "[nodes.block]\nkind = \"block\"\n",
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let block = Block::new();
        BLOCK_ADDRESS.store(block.0.as_ptr().addr(), Ordering::Relaxed);
        io.put(Self::BLOCK, block);
        Ok(())
    }
}

/// Reads the first number of a block, which must not have moved since it was made.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct FirstNode {}

impl FirstNode {
    const BLOCK: Input<Block> = Input::new("block", "what is read");
}

impl Node for FirstNode {
    const SPEC: Spec = Spec {
        kind: "first",
        version: 1,
        inputs: &[Self::BLOCK.port()],
        outputs: &[NUMBER.port()],
        cites: &[],
        example: "[nodes.block]\nkind = \"block\"\n\n\
                  [nodes.first]\nkind = \"first\"\nblock = \"@block\"\n",
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let block = io.get(Self::BLOCK);
        if block.0.as_ptr().addr() != BLOCK_ADDRESS.load(Ordering::Relaxed) {
            return Err(NodeError::failed("the block was copied on its way"));
        }
        io.put(NUMBER, Number(block.0[0] as i64));
        Ok(())
    }
}
