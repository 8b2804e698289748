//! How nodes are run: again after a failure, in a process of their own, within limits, until somebody
//! asks to stop.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use crossbeam_channel::{Sender, unbounded};
use petgraph::graph::NodeIndex;
use proptest::prelude::*;
use sinew::engine::{
    digest::Digest,
    events::{Counts, Event, Failure, Observer, Outcome, RunReport, Silent},
    graph::Graph,
    pipeline::{self, Settings},
    record::{Line, Record, Recorder, RunStart},
    run::{self, RunOptions, WorkerProgram},
    store::{Access, Store},
    toy::TOY,
};

/// A temporary folder with a pipeline and a cache.
struct Bench {
    folder: PathBuf,
    _removed_at_end: Option<tempfile::TempDir>,
}

impl Bench {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        Self { folder: folder.path().to_owned(), _removed_at_end: Some(folder) }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    fn load(&self, text: &str) -> Graph {
        let file = self.path("pipeline.toml");
        fs::write(&file, text).unwrap();
        pipeline::load(&file, &TOY, &Settings::default())
            .unwrap_or_else(|e| panic!("{}", e.render(false)))
    }

    fn store(&self) -> Store {
        Store::open(&self.path("cache"), Access::ReadWrite).unwrap()
    }

    fn options(&self, threads: usize) -> RunOptions {
        RunOptions {
            threads,
            output_dir: self.path("out"),
            run_id: "test".to_owned(),
            worker: Some(WorkerProgram {
                path: env!("CARGO_BIN_EXE_sinew").into(),
                args: vec!["worker".to_owned(), "--toy".to_owned()],
            }),
            ..RunOptions::default()
        }
    }

    /// Runs a pipeline with two threads; the outcomes by node.
    fn run(&self, text: &str) -> BTreeMap<String, Outcome> {
        self.watch(text, &self.options(2), &mut Silent)
    }

    fn watch(
        &self,
        text: &str,
        options: &RunOptions,
        observer: &mut dyn Observer,
    ) -> BTreeMap<String, Outcome> {
        let graph = self.load(text);
        by_node(&graph, &run::run(&graph, &TOY, &self.store(), options, observer))
    }
}

fn by_node(graph: &Graph, report: &RunReport) -> BTreeMap<String, Outcome> {
    let ids = graph.instances.node_weights().map(|it| it.id());
    ids.zip(report.outcomes.iter().cloned()).collect()
}

/// The failure of a node.
#[track_caller]
fn failure<'a>(outcomes: &'a BTreeMap<String, Outcome>, node: &str) -> &'a Failure {
    match &outcomes[node] {
        Outcome::Failed { failure, .. } => failure,
        other => panic!("{node}: {other:?}"),
    }
}

fn has_run(outcomes: &BTreeMap<String, Outcome>, node: &str) -> bool {
    matches!(outcomes[node], Outcome::Ran { .. })
}

/// Takes events down as short lines: `start a`, `retry a 1/2: not this time`, `end a`, `say a …`.
#[derive(Default)]
struct Diary {
    lines: Vec<String>,
    outputs: BTreeMap<(String, &'static str), Digest>,
    /// Asks to stop when one of these lines has been written.
    stop_at: Vec<(String, Sender<()>)>,
}

impl Observer for Diary {
    fn event(&mut self, graph: &Graph, event: &Event<'_>) {
        let id = |it: NodeIndex| graph.instances[it].id();
        let line = match event {
            Event::Started { instance, .. } => format!("start {}", id(*instance)),
            Event::Progress { instance, text, .. } => format!("say {} {text}", id(*instance)),
            Event::Retrying { instance, retry, retries, failure, .. } => {
                format!("retry {} {retry}/{retries}: {}", id(*instance), failure.message())
            }
            Event::Stopping { now, n_running, n_done, n_wanted } => {
                format!("stop {now} {n_running} {n_done}/{n_wanted}")
            }
            Event::Finished { instance, outputs, .. } => {
                for (port, info) in outputs.iter().flat_map(|it| it.artifacts.iter()) {
                    self.outputs.insert((id(*instance), port), info.digest);
                }
                format!("end {}", id(*instance))
            }
            _ => return,
        };
        for (_, stop) in self.stop_at.iter().filter(|it| it.0 == line) {
            stop.send(()).unwrap();
        }
        self.lines.push(line);
    }
}

impl Diary {
    #[track_caller]
    fn position(&self, line: &str) -> usize {
        let found = self.lines.iter().position(|it| it == line);
        found.unwrap_or_else(|| panic!("no `{line}` in {:#?}", self.lines))
    }
}

/// A node that misbehaves; `keys` are more lines of its table.
fn misbehaving(name: &str, how: &str, keys: &str) -> String {
    format!("[nodes.{name}]\nkind = \"misbehave\"\nhow = \"{how}\"\n{keys}\n\n")
}

// ---- retries ---------------------------------------------------------------------------------

#[test]
fn a_node_that_fails_is_tried_again_and_the_record_tells_it() {
    let bench = Bench::new();
    let counter = bench.path("counter");
    let keys = format!("counter = {counter:?}\ntimes = 2\nretries = 3\nbackoff = 0.001");
    let text =
        misbehaving("bad", "fail", &keys) + "[nodes.after]\nkind = \"add\"\nterms = \"@bad\"\n\n";
    let start: RunStart = serde_json::from_value(serde_json::json!({
        "v": 1, "run": "20260101-000000-abcd", "time": "", "version": "", "title": null,
        "args": [], "folder": "", "host": "", "threads": 2, "sources": [],
    }))
    .unwrap();
    let mut recorder = Recorder::start(bench.store().dir(), &start);
    let graph = bench.load(&text);
    let report = run::run(&graph, &TOY, &bench.store(), &bench.options(2), &mut recorder);
    recorder.done(&report);
    assert!(report.succeeded() && report.counts().ran == 2, "{:?}", report.outcomes);
    let record = Record::read(&bench.path("cache/runs/20260101-000000-abcd.jsonl")).unwrap();
    let retries = record.lines.iter().filter_map(|it| match it {
        Line::NodeRetry { node, retry, retries, wait_s, message, .. } => {
            Some((node.as_str(), *retry, *retries, *wait_s, message.as_str()))
        }
        _ => None,
    });
    let expected = [("bad", 1, 3, 0.001, "not this time"), ("bad", 2, 3, 0.002, "not this time")];
    assert_eq!(retries.collect::<Vec<_>>(), expected);
    assert_eq!(fs::read(counter).unwrap().len(), 3);
}

#[test]
fn every_kind_of_failure_is_a_try_and_the_last_one_is_told() {
    let bench = Bench::new();
    for (how, keys, message) in [
        ("fail", "", "not this time"),
        ("blame", "", "the machine does not want to"),
        ("panic", "", "not this time (src/engine/toy.rs:"),
        ("exit", "isolate = true", "the worker ended with exit code 7"),
        ("hang", "timeout = 0.05", "took longer than its time limit of 0.05 s"),
    ] {
        let keys = format!("{keys}\nretries = 2\nbackoff = 0.001");
        let mut diary = Diary::default();
        let text =
            misbehaving("bad", how, &keys) + "[nodes.after]\nkind = \"add\"\nterms = \"@bad\"\n\n";
        let outcomes = bench.watch(&text, &bench.options(2), &mut diary);
        let failure = failure(&outcomes, "bad").message();
        assert!(failure.starts_with(message), "{how}: {failure}");
        assert!(failure.ends_with(" (the last of 3 tries)"), "{how}: {failure}");
        assert!(matches!(outcomes["after"], Outcome::Skipped { .. }), "{how}");
        let retries = diary.lines.iter().filter(|it| it.starts_with("retry bad")).count();
        assert_eq!(retries, 2, "{how}: {:#?}", diary.lines);
    }
}

#[test]
fn the_wait_before_a_retry_takes_no_thread() {
    let bench = Bench::new();
    let text = misbehaving("bad", "fail", "retries = 1\nbackoff = 0.2")
        + "[nodes.a]\nkind = \"sleep\"\nduration_ms = 1\n\n\
           [nodes.b]\nkind = \"sleep\"\nduration_ms = 1\nafter = \"@a\"\n\n";
    let mut diary = Diary::default();
    bench.watch(&text, &bench.options(1), &mut diary);
    let second_try = diary.lines.iter().rposition(|it| it == "start bad").unwrap();
    assert!(diary.position("retry bad 1/1: not this time") < second_try);
    assert!(diary.position("end b") < second_try, "{:#?}", diary.lines);
}

#[test]
fn a_waiting_retry_does_not_outlive_a_failure_that_ends_the_run() {
    let bench = Bench::new();
    let text = misbehaving("patient", "fail", "retries = 1\nbackoff = 1000")
        + "[nodes.last]\nkind = \"sleep\"\nduration_ms = 100\n\n\
           [nodes.bad]\nkind = \"fail\"\nafter = \"@last\"\n\n";
    let options = RunOptions { fail_fast: true, ..bench.options(2) };
    let outcomes = bench.watch(&text, &options, &mut Silent);
    assert_eq!(failure(&outcomes, "patient").message(), "not this time");
    assert_eq!(failure(&outcomes, "bad").message(), "this node always fails");
}

// ---- processes of their own ------------------------------------------------------------------

/// Every way in which something enters or leaves a node: a file with another beside it, large and
/// small artifacts, lists, several and optional outputs, parameters that are hard to write down.
const EVERYTHING: &str = r#"
[nodes.text]
kind = "text_file"
path = "long.txt"

[nodes.length]
kind = "count"
text = "@text"

[nodes.third]
kind = "scale"
number = "@length"
factor = 0.30000000000000004

[nodes.parts]
kind = "divide"
number = "@third"
by = 7

[nodes.nothing]
kind = "optional"

[nodes.something]
kind = "optional"
value = 5

[nodes.sum]
kind = "add"
terms = ["@parts.quotient", "@parts.remainder", "@length", "@something"]
weights = [1, -2, 3, 4]

[nodes.last]
kind = "sleep"
after = "@nothing"
value = 3
"#;

#[test]
fn a_process_of_its_own_gives_the_same_bytes() {
    let isolated = EVERYTHING.replace("\n\n[", "\nisolate = true\n\n[") + "isolate = true\n";
    assert_eq!(isolated.matches("isolate").count(), EVERYTHING.matches("kind").count());
    let mut outputs = Vec::new();
    for text in [EVERYTHING, &isolated] {
        for memory in [1 << 30, 1] {
            let bench = Bench::new();
            let long = "long ".repeat(20_000) + "\ninclude other.txt\n";
            fs::write(bench.path("long.txt"), long).unwrap();
            fs::write(bench.path("other.txt"), "other").unwrap();
            let mut diary = Diary::default();
            let options = RunOptions { memory, ..bench.options(2) };
            let outcomes = bench.watch(text, &options, &mut diary);
            assert!(outcomes.keys().all(|it| has_run(&outcomes, it)), "{outcomes:#?}");
            // What one leaves in the store, the other finds there.
            let other = bench.run(if text == EVERYTHING { &isolated } else { EVERYTHING });
            assert!(other.values().all(|it| *it == Outcome::Cached), "{other:#?}");
            // Inputs come from the store.
            let graph = bench.load(text);
            for node in ["length", "sum"] {
                let forced = BTreeSet::from([graph.select(node)[0]]);
                let options = RunOptions { forced, ..bench.options(2) };
                let again = bench.watch(text, &options, &mut diary);
                assert!(has_run(&again, node) && again["last"] == Outcome::Cached, "{again:#?}");
            }
            outputs.push(diary.outputs);
        }
    }
    assert!(outputs.iter().all(|it| *it == outputs[0]), "{outputs:#?}");
    assert_eq!(outputs[0].len(), 8);
}

#[test]
fn a_crash_fails_one_node_and_says_how() {
    let bench = Bench::new();
    let mut text = "[nodes.good]\nkind = \"sleep\"\nduration_ms = 100\n\n".to_owned();
    for how in ["crash", "recurse", "exit", "panic", "fail", "blame"] {
        text += &misbehaving(how, how, "isolate = true");
    }
    text += &misbehaving("allocate", "allocate", "isolate = { memory = \"600 MB\" }");
    text += "[nodes.after]\nkind = \"add\"\nterms = [\"@crash\", \"@good\"]\n\n";
    let outcomes = bench.run(&text);
    assert!(has_run(&outcomes, "good"));
    assert!(matches!(outcomes["after"], Outcome::Skipped { .. }));
    let said = |node: &str| match failure(&outcomes, node) {
        Failure::Node(message) => format!("node: {message}"),
        Failure::Environment(message) => format!("environment: {message}"),
        Failure::Panic(message) => format!("bug: {message}"),
    };
    assert_eq!(
        said("crash"),
        "bug: the worker was killed by signal 11 (segmentation fault)\n    about to crash"
    );
    let recursion = said("recurse");
    assert!(recursion.starts_with("bug: the worker was killed by signal 6 (abort)"), "{recursion}");
    assert!(recursion.contains("stack overflow"), "{recursion}");
    assert_eq!(said("exit"), "bug: the worker ended with exit code 7");
    assert!(said("panic").starts_with("bug: not this time (src/engine/toy.rs:"));
    assert_eq!(said("fail"), "node: not this time");
    assert_eq!(said("blame"), "environment: the machine does not want to");
    assert_eq!(
        said("allocate"),
        "node: needs more memory than its limit of 600 MB: memory allocation of 67108864 bytes failed"
    );
}

#[test]
fn memory_within_the_limit_is_given() {
    let bench = Bench::new();
    fs::write(bench.path("long.txt"), "x".repeat(10 << 20)).unwrap();
    let text = "[nodes.text]\nkind = \"text_file\"\npath = \"long.txt\"\n\
                isolate = { memory = \"100 MB\" }\n\n\
                [nodes.length]\nkind = \"count\"\ntext = \"@text\"\nisolate = { memory = \"50 MB\" }\n";
    let outcomes = bench.run(text);
    assert!(outcomes.keys().all(|it| has_run(&outcomes, it)), "{outcomes:?}");
    let text = text.replace("100 MB", "10 MB");
    fs::remove_dir_all(bench.path("cache")).unwrap();
    let message = failure(&bench.run(&text), "text").message().to_owned();
    assert!(message.starts_with("needs more memory than its limit of 10 MB: "), "{message}");
}

#[test]
fn a_run_without_a_worker_program_says_so() {
    let bench = Bench::new();
    let options = RunOptions { worker: None, ..bench.options(1) };
    let outcomes =
        bench.watch(&misbehaving("bad", "hang", "isolate = true"), &options, &mut Silent);
    let expected = Failure::Environment("this run has no program for worker processes".to_owned());
    assert_eq!(*failure(&outcomes, "bad"), expected);
}

// ---- time limits -----------------------------------------------------------------------------

#[test]
fn a_time_limit_ends_what_can_be_killed_and_what_listens() {
    let bench = Bench::new();
    let text = misbehaving("hang", "hang", "timeout = 0.1")
        + "[nodes.wait]\nkind = \"wait\"\nduration_ms = 3600000\ntimeout = \"100ms\"\n\n\
           [nodes.quick]\nkind = \"wait\"\nduration_ms = 1\ntimeout = 60\n\n\
           [nodes.isolated]\nkind = \"wait\"\nduration_ms = 3600000\ntimeout = 0.1\nisolate = true\n";
    let outcomes = bench.run(&text);
    for node in ["hang", "wait", "isolated"] {
        let message = "took longer than its time limit of 0.1 s".to_owned();
        assert_eq!(*failure(&outcomes, node), Failure::Node(message), "{node}");
    }
    assert!(has_run(&outcomes, "quick"));
}

#[test]
fn waiting_for_a_turn_does_not_count_against_the_time_limit() {
    let bench = Bench::new();
    let mut text = String::new();
    for node in 0..6 {
        text += &format!(
            "[nodes.n{node}]\nkind = \"sleep\"\nduration_ms = 200\nvalue = {node}\ntimeout = 1\n\n"
        );
    }
    let outcomes = bench.watch(&text, &bench.options(1), &mut Silent);
    assert!(outcomes.keys().all(|it| has_run(&outcomes, it)), "{outcomes:?}");
}

// ---- failures --------------------------------------------------------------------------------

/// A failure at the start, others that run meanwhile, and what waits for either.
const FAILURE: &str = "[nodes.running]\nkind = \"sleep\"\nduration_ms = 100\n\n\
    [nodes.bad]\nkind = \"fail\"\n\n\
    [nodes.needs_bad]\nkind = \"add\"\nterms = [\"@bad\", \"@running\"]\n\n\
    [nodes.needs_both]\nkind = \"add\"\nterms = [\"@needs_bad\", \"@good\"]\n\n\
    [nodes.good]\nkind = \"add\"\nterms = [\"@running\"]\n\n";

#[test]
fn without_fail_fast_all_that_can_be_done_is_done() {
    let bench = Bench::new();
    let graph = bench.load(FAILURE);
    let outcomes = bench.run(FAILURE);
    assert!(has_run(&outcomes, "running") && has_run(&outcomes, "good"));
    assert_eq!(failure(&outcomes, "bad").message(), "this node always fails");
    let bad = graph.select("bad")[0];
    for skipped in ["needs_bad", "needs_both"] {
        let Outcome::Skipped { because } = outcomes[skipped] else { panic!("{outcomes:?}") };
        assert!(because == bad || graph.instances[because].id() == "needs_bad", "{outcomes:?}");
    }
}

#[test]
fn with_fail_fast_nothing_starts_after_a_failure_and_what_runs_is_kept() {
    let bench = Bench::new();
    let mut diary = Diary::default();
    let options = RunOptions { fail_fast: true, ..bench.options(2) };
    let outcomes = bench.watch(FAILURE, &options, &mut diary);
    let after = &diary.lines[diary.position("end bad")..];
    assert!(!after.iter().any(|it| it.starts_with("start")), "{:#?}", diary.lines);
    assert!(has_run(&outcomes, "running"));
    assert_eq!(outcomes["good"], Outcome::NotReached);
    // Another run goes on from there.
    assert_eq!(bench.run(FAILURE)["running"], Outcome::Cached);
}

// ---- stopping --------------------------------------------------------------------------------

#[test]
fn a_stopped_run_finishes_what_runs_here_and_starts_nothing_more() {
    let bench = Bench::new();
    let (stop, asked) = unbounded();
    let text = "[nodes.first]\nkind = \"sleep\"\nduration_ms = 50\n\n\
                [nodes.second]\nkind = \"add\"\nterms = [\"@first\"]\n\n\
                [outputs]\n\"second.txt\" = \"@second\"\n";
    let mut diary = Diary { stop_at: vec![("start first".to_owned(), stop)], ..Diary::default() };
    let graph = bench.load(text);
    let options = RunOptions { stop: asked, ..bench.options(2) };
    let report = run::run(&graph, &TOY, &bench.store(), &options, &mut diary);
    assert!(report.stopped && !report.succeeded());
    let outcomes = by_node(&graph, &report);
    assert!(has_run(&outcomes, "first") && outcomes["second"] == Outcome::NotReached);
    diary.position("stop false 1 0/2");
    // It goes on where it stopped.
    let outcomes = bench.run(text);
    assert!(outcomes["first"] == Outcome::Cached && has_run(&outcomes, "second"));
}

#[test]
fn a_stopped_run_kills_what_can_be_killed_after_a_grace() {
    let bench = Bench::new();
    let (stop, asked) = unbounded();
    let text = misbehaving("hang", "hang", "isolate = true")
        + &misbehaving("patient", "fail", "retries = 1\nbackoff = 1000")
        + "[nodes.wait]\nkind = \"wait\"\nduration_ms = 3600000\n\n\
           [nodes.nearly_done]\nkind = \"wait\"\nduration_ms = 300\n";
    let stop_at = vec![("say hang misbehaves".to_owned(), stop)];
    let mut diary = Diary { stop_at, ..Diary::default() };
    let options = RunOptions { stop: asked, ..bench.options(4) };
    let outcomes = bench.watch(&text, &options, &mut diary);
    assert_eq!(outcomes["hang"], Outcome::NotReached);
    assert_eq!(outcomes["wait"], Outcome::NotReached);
    assert!(has_run(&outcomes, "nearly_done"));
    assert_eq!(failure(&outcomes, "patient").message(), "not this time");
}

#[test]
fn a_run_that_is_asked_twice_ends_at_once() {
    let bench = Bench::new();
    let (stop, asked) = unbounded();
    let text = misbehaving("hang", "hang", "isolate = true")
        + "[nodes.wait]\nkind = \"wait\"\nduration_ms = 3600000\n";
    let stop_at = vec![
        ("say hang misbehaves".to_owned(), stop.clone()),
        ("stop false 2 0/2".to_owned(), stop),
    ];
    let mut diary = Diary { stop_at, ..Diary::default() };
    let options = RunOptions { stop: asked, ..bench.options(2) };
    let start = Instant::now();
    let outcomes = bench.watch(&text, &options, &mut diary);
    diary.position("stop true 2 0/2");
    assert!(outcomes.values().all(|it| *it == Outcome::NotReached), "{outcomes:?}");
    // The grace was not waited for.
    assert!(start.elapsed() < Duration::from_secs(60));
}

// ---- several runs ----------------------------------------------------------------------------

fn sleepers(n: usize, duration_ms: u64) -> String {
    let node = |it| {
        format!("[nodes.n{it}]\nkind = \"sleep\"\nduration_ms = {duration_ms}\nvalue = {it}\n\n")
    };
    (0..n).map(node).collect()
}

#[test]
fn two_runs_that_share_an_open_store_compute_every_key_once() {
    let bench = Bench::new();
    let graph = bench.load(&sleepers(8, 30));
    let store = bench.store();
    let counts: Vec<Counts> = thread::scope(|scope| {
        let run = || run::run(&graph, &TOY, &store, &bench.options(2), &mut Silent).counts();
        let threads: Vec<_> = (0..3).map(|_| scope.spawn(run)).collect();
        threads.into_iter().map(|it| it.join().unwrap()).collect()
    });
    assert_eq!(counts.iter().map(|it| it.ran).sum::<usize>(), 8, "{counts:?}");
    assert!(counts.iter().all(|it| it.ran + it.cached == 8), "{counts:?}");
}

/// The part of this program that other processes play: runs the pipeline of the folder that `RUN_IN`
/// names, and says how many nodes it ran.
#[test]
fn another_process() {
    let Some(folder) = std::env::var_os("RUN_IN") else { return };
    let bench = Bench { folder: folder.into(), _removed_at_end: None };
    let file = bench.path("pipeline.toml");
    let graph = pipeline::load(&file, &TOY, &Settings::default()).unwrap();
    let report = run::run(&graph, &TOY, &bench.store(), &bench.options(2), &mut Tell);
    println!("ran {} of {}", report.counts().ran, report.outcomes.len());
}

/// Says what starts, for the process that waits for it.
struct Tell;

impl Observer for Tell {
    fn event(&mut self, graph: &Graph, event: &Event<'_>) {
        if let Event::Progress { instance, .. } | Event::Started { instance, .. } = event {
            println!("at {}", graph.instances[*instance].id());
        }
    }
}

fn spawn_another(bench: &Bench) -> Child {
    Command::new(std::env::current_exe().unwrap())
        .args(["another_process", "--exact", "--nocapture", "--test-threads=1"])
        .env("RUN_IN", &bench.folder)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap()
}

/// Waits until the other process says a line for the second time: at start and by its progress.
fn wait_for_line(child: &mut Child, wanted: &str, times: usize) {
    use std::io::{BufRead, BufReader};
    let lines = BufReader::new(child.stdout.as_mut().unwrap()).lines();
    let mut n = 0;
    for line in lines {
        n += usize::from(line.unwrap().ends_with(wanted));
        if n == times {
            return;
        }
    }
    panic!("the other process ended without `{wanted}`");
}

#[test]
fn several_processes_compute_every_key_once() {
    let bench = Bench::new();
    bench.load(&sleepers(12, 20));
    let others: Vec<Child> = (0..4).map(|_| spawn_another(&bench)).collect();
    let mut n_ran = 0;
    for other in others {
        let output = other.wait_with_output().unwrap();
        let text = String::from_utf8(output.stdout).unwrap();
        let (_, rest) = text.split_once("ran ").unwrap_or_else(|| panic!("{text}"));
        n_ran += rest.split(' ').next().unwrap().parse::<usize>().unwrap();
    }
    assert_eq!(n_ran, 12);
}

#[test]
fn the_keys_of_a_killed_process_are_taken_over() {
    let bench = Bench::new();
    let counter = bench.path("counter");
    // The first process hangs, the second does not.
    let keys = format!("counter = {counter:?}\ntimes = 1");
    let text = misbehaving("node", "hang", &keys);
    let graph = bench.load(&text);
    let mut other = spawn_another(&bench);
    wait_for_line(&mut other, "at node", 2);
    let killed = thread::spawn(move || {
        thread::sleep(Duration::from_millis(100));
        other.kill().unwrap();
        let killed = Instant::now();
        other.wait().unwrap();
        killed
    });
    let report = run::run(&graph, &TOY, &bench.store(), &bench.options(2), &mut Silent);
    let took = killed.join().unwrap().elapsed();
    assert_eq!(report.counts().ran, 1);
    println!("taken over {took:?} after the death of its holder");
}

/// All processes whose parent is this one, and theirs.
fn descendants(pid: u32) -> Vec<u32> {
    let mut res = Vec::new();
    for entry in fs::read_dir("/proc").unwrap().flatten() {
        let Ok(child) = entry.file_name().to_string_lossy().parse::<u32>() else { continue };
        let stat = fs::read_to_string(entry.path().join("stat")).unwrap_or_default();
        let parent = stat.rsplit(')').next().and_then(|it| it.split_whitespace().nth(1));
        if parent == Some(&pid.to_string()) {
            res.push(child);
            res.extend(descendants(child));
        }
    }
    res
}

fn is_alive(pid: u32) -> bool {
    let stat = fs::read_to_string(Path::new("/proc").join(pid.to_string()).join("stat"));
    stat.is_ok_and(|it| !it.contains(") Z "))
}

#[test]
fn a_worker_dies_with_its_parent() {
    let bench = Bench::new();
    bench.load(&misbehaving("node", "hang", "isolate = true"));
    let mut other = spawn_another(&bench);
    wait_for_line(&mut other, "at node", 2);
    let workers = descendants(other.id());
    assert_eq!(workers.len(), 1);
    other.kill().unwrap();
    other.wait().unwrap();
    let start = Instant::now();
    while is_alive(workers[0]) {
        assert!(start.elapsed() < Duration::from_secs(60), "the worker lives on");
        thread::sleep(Duration::from_millis(1));
    }
}

// ---- random graphs of nodes that misbehave -----------------------------------------------------

/// One node of a random pipeline.
#[derive(Debug, Clone)]
struct RandomNode {
    terms: Vec<prop::sample::Index>,
    /// What it does the first times that it runs, and how often it is tried again.
    how: &'static str,
    times: u64,
    retries: u64,
    is_isolated: bool,
}

fn random_nodes() -> impl Strategy<Value = Vec<RandomNode>> {
    let how = prop::sample::select(vec!["fail", "blame", "panic", "crash", "exit", "hang"]);
    let terms = prop::collection::vec(any::<prop::sample::Index>(), 0..3);
    let node = (terms, how, 0u64..3, 0u64..3, any::<bool>()).prop_map(
        |(terms, how, times, retries, is_isolated)| RandomNode {
            terms,
            how,
            times,
            retries,
            is_isolated: is_isolated || ["crash", "exit"].contains(&how),
        },
    );
    prop::collection::vec(node, 1..8)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, ..ProptestConfig::default() })]

    /// A node is done if it is tried more often than it misbehaves, and all before it are done.
    /// Further runs do what is left, and nothing else.
    #[test]
    fn whatever_misbehaves_all_that_can_be_done_is_done(
        nodes in random_nodes(),
        threads in 1usize..5,
    ) {
        let bench = Bench::new();
        let mut text = String::new();
        let mut left: Vec<u64> = nodes.iter().map(|it| it.times).collect();
        for (index, node) in nodes.iter().enumerate() {
            let wires: BTreeSet<usize> =
                node.terms.iter().filter(|_| index > 0).map(|it| it.index(index.max(1))).collect();
            let wires: Vec<String> = wires.iter().map(|it| format!("\"@n{it}\"")).collect();
            let counter = bench.path(&format!("counter{index}"));
            let keys = format!(
                "terms = [{}]\ncounter = {counter:?}\ntimes = {}\nretries = {}\nbackoff = 0.001\n\
                 isolate = {}\n{}",
                wires.join(", "), node.times, node.retries, node.is_isolated,
                if node.how == "hang" { "timeout = 0.1" } else { "" },
            );
            text += &misbehaving(&format!("n{index}"), node.how, &keys);
        }
        let graph = bench.load(&text);
        let mut was_done = vec![false; nodes.len()];
        for round in 0..3 {
            let report = run::run(&graph, &TOY, &bench.store(), &bench.options(threads), &mut Silent);
            let mut is_done = Vec::new();
            for (index, node) in nodes.iter().enumerate() {
                let outcome = &report.outcomes[index];
                let inputs = graph.instances[NodeIndex::new(index)].inputs.values().flatten();
                let can_run = inputs.clone().all(|it| is_done[it.instance.index()]);
                let n_tries = left[index].min(node.retries + 1);
                if was_done[index] {
                    prop_assert_eq!(outcome, &Outcome::Cached);
                } else if !can_run {
                    prop_assert!(matches!(outcome, Outcome::Skipped { .. }), "{:?}", outcome);
                } else if left[index] <= node.retries {
                    prop_assert!(matches!(outcome, Outcome::Ran { .. }), "{:?}", outcome);
                    was_done[index] = true;
                } else {
                    prop_assert!(matches!(outcome, Outcome::Failed { .. }), "{:?}", outcome);
                }
                if can_run && (!was_done[index] || left[index] <= node.retries) {
                    left[index] -= n_tries;
                }
                is_done.push(was_done[index]);
            }
            if round == 0 && nodes.iter().all(|it| it.times <= it.retries) {
                prop_assert!(report.succeeded());
            }
        }
    }
}
