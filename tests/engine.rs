//! The engine without geometry: pipelines of numbers, run in temporary folders.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::PathBuf,
    thread,
    time::Duration,
};

use petgraph::graph::NodeIndex;
use proptest::prelude::*;
use sinew::engine::{
    events::{Counts, Event, ExportOutcome, Failure, Observer, Outcome, RunReport, Silent},
    graph::Graph,
    pipeline::{self, Settings},
    plan::{self, PipelineMemory, Reason, Status},
    record::{Line, Record, Recorder, RunStart},
    run::{self, RunOptions},
    snapshot,
    store::{Access, Store, gc},
    toy::TOY,
};

/// A temporary folder with a pipeline, a cache, and what is written.
struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
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
            ..RunOptions::default()
        }
    }

    fn run(&self, text: &str) -> RunReport {
        let graph = self.load(text);
        run::run(&graph, &TOY, &self.store(), &self.options(2), &mut Silent)
    }

    /// Outcomes by node.
    fn outcomes(&self, text: &str) -> BTreeMap<String, Outcome> {
        let graph = self.load(text);
        let report = run::run(&graph, &TOY, &self.store(), &self.options(2), &mut Silent);
        let ids = graph.instances.node_weights().map(|it| it.id());
        ids.zip(report.outcomes).collect()
    }

    fn output(&self, name: &str) -> String {
        fs::read_to_string(self.path("out").join(name)).unwrap().trim().to_owned()
    }

    /// Removes every result from the store.
    fn lose_results(&self) {
        let options = gc::GcOptions { max_bytes: Some(0), ..gc::GcOptions::default() };
        gc::collect(&self.path("cache"), &options).unwrap();
    }
}

const CHAIN: &str = r#"
[nodes.one]
kind = "number"
value = 1

[nodes.ten]
kind = "scale"
number = "@one"
factor = 10.0

[nodes.parts]
kind = "divide"
number = "@ten"
by = 3

[nodes.sum]
kind = "add"
terms = ["@parts.quotient", "@parts.remainder", "@one"]

[outputs]
"sum.txt" = "@sum"
"#;

fn ran(n: usize) -> Counts {
    Counts { ran: n, ..Counts::default() }
}

#[test]
fn a_second_run_computes_nothing_and_writes_nothing() {
    let bench = Bench::new();
    let first = bench.run(CHAIN);
    assert_eq!((first.counts(), bench.output("sum.txt")), (ran(4), "5".to_owned()));
    let second = bench.run(CHAIN);
    assert_eq!(second.counts(), Counts { cached: 4, ..Counts::default() });
    assert_eq!(second.exports, [ExportOutcome::UpToDate]);
}

#[test]
fn a_file_that_was_touched_or_removed_is_written_again_without_computing() {
    let bench = Bench::new();
    bench.run(CHAIN);
    fs::write(bench.path("out/sum.txt"), "spoiled").unwrap();
    assert_eq!(bench.run(CHAIN).counts().ran, 0);
    assert_eq!(bench.output("sum.txt"), "5");
    fs::remove_file(bench.path("out/sum.txt")).unwrap();
    assert_eq!(bench.run(CHAIN).counts().ran, 0);
    assert_eq!(bench.output("sum.txt"), "5");
}

#[test]
fn a_change_runs_what_depends_on_it_and_says_why() {
    let bench = Bench::new();
    bench.run(CHAIN);
    let outcomes = bench.outcomes(&CHAIN.replace("by = 3", "by = 4"));
    assert_eq!(outcomes["one"], Outcome::Cached);
    assert_eq!(outcomes["ten"], Outcome::Cached);
    let why = |id: &str| match &outcomes[id] {
        Outcome::Ran { reason, .. } => reason.to_string(),
        other => panic!("{id}: {other:?}"),
    };
    assert_eq!(why("parts"), "`by`: 3 -> 4");
    assert!(why("sum").starts_with("input `terms` changed"), "{}", why("sum"));
}

#[test]
fn a_node_that_gives_the_same_bytes_again_stops_the_wave() {
    let bench = Bench::new();
    bench.run(CHAIN);
    // 10.4 is rounded to 10.
    let outcomes = bench.outcomes(&CHAIN.replace("factor = 10.0", "factor = 10.4"));
    assert!(matches!(outcomes["ten"], Outcome::Ran { .. }));
    assert_eq!(outcomes["parts"], Outcome::CutOff);
    assert_eq!(outcomes["sum"], Outcome::CutOff);
}

#[test]
fn going_back_to_an_earlier_file_runs_nothing() {
    let bench = Bench::new();
    bench.run(CHAIN);
    bench.run(&CHAIN.replace("value = 1", "value = 2"));
    assert_eq!(bench.run(CHAIN).counts().cached, 4);
    assert_eq!(bench.output("sum.txt"), "5");
}

#[test]
fn renaming_reordering_and_written_defaults_run_nothing() {
    let bench = Bench::new();
    bench.run(CHAIN);
    let renamed = CHAIN.replace("nodes.ten", "nodes.dozen").replace("@ten", "@dozen");
    assert_eq!(bench.run(&renamed).counts().cached, 4);
    let loud = CHAIN.replace("factor = 10.0", "rounding = \"nearest\"\nfactor = 10");
    assert_eq!(bench.run(&loud).counts().cached, 4);
}

#[test]
fn two_nodes_of_one_key_are_computed_once() {
    let bench = Bench::new();
    let text = r#"
[nodes.a]
kind = "sleep"
duration_ms = 50
value = 7

[nodes.b]
kind = "sleep"
duration_ms = 50
value = 7

[nodes.sum]
kind = "add"
terms = ["@a", "@b"]

[outputs]
"sum.txt" = "@sum"
"#;
    let report = bench.run(text);
    assert_eq!((report.counts().ran, bench.output("sum.txt")), (2, "14".to_owned()));
}

#[test]
fn failures_stop_only_what_depends_on_them() {
    let bench = Bench::new();
    let text = format!(
        "{CHAIN}\"bad.txt\" = \"@after\"\n\n[nodes.bad]\nkind = \"fail\"\nmessage = \"no luck\"\n\n\
         [nodes.after]\nkind = \"add\"\nterms = [\"@bad\", \"@one\"]\n\n\
         [nodes.worse]\nkind = \"panic\"\n"
    );
    let graph = bench.load(&text);
    let report = run::run(&graph, &TOY, &bench.store(), &bench.options(2), &mut Silent);
    let counts = report.counts();
    assert_eq!((counts.ran, counts.failed, counts.skipped), (4, 2, 1));
    assert!(!report.succeeded() && report.panicked() && !report.environment_failed());
    assert_eq!(bench.output("sum.txt"), "5");
    assert_eq!(report.exports[1], ExportOutcome::Skipped);
    let outcome = |id: &str| &report.outcomes[graph.select(id)[0].index()];
    let Outcome::Failed { failure: Failure::Node(message), .. } = outcome("bad") else { panic!() };
    assert_eq!(message, "no luck");
    let Outcome::Failed { failure: Failure::Panic(message), .. } = outcome("worse") else {
        panic!()
    };
    assert!(message.starts_with("this node always panics (src/engine/toy.rs:"), "{message}");
    assert_eq!(*outcome("after"), Outcome::Skipped { because: graph.select("bad")[0] });
    // What is mended runs, what was done stays done.
    let mended = text.replace("kind = \"fail\"\nmessage = \"no luck\"", "kind = \"number\"");
    assert_eq!(bench.run(&mended).counts().ran, 2);
}

#[test]
fn an_optional_output_that_is_left_out_fails_only_those_who_need_it() {
    let bench = Bench::new();
    let text = "[nodes.maybe]\nkind = \"optional\"\n\n\
                [nodes.needs]\nkind = \"scale\"\nnumber = \"@maybe\"\nfactor = 2\n\n\
                [nodes.waits]\nkind = \"sleep\"\nafter = \"@maybe\"\nvalue = 3\n";
    let outcomes = bench.outcomes(text);
    assert!(matches!(outcomes["waits"], Outcome::Ran { .. }));
    let Outcome::Failed { failure, .. } = &outcomes["needs"] else { panic!() };
    let expected = "`number` needs `number` of `maybe`, which has none: it has no value";
    assert_eq!(failure.message(), expected);
    // The same when it is known from the store.
    let outcomes = bench.outcomes(text);
    assert_eq!(outcomes["waits"], Outcome::Cached);
    assert!(matches!(outcomes["needs"], Outcome::Failed { .. }));
}

#[test]
fn files_count_by_content() {
    let bench = Bench::new();
    fs::write(bench.path("note.txt"), "seven c").unwrap();
    let text = "[nodes.note]\nkind = \"text_file\"\npath = \"note.txt\"\n\n\
                [nodes.length]\nkind = \"count\"\ntext = \"@note\"\n\n\
                [outputs]\n\"length.txt\" = \"@length\"\n";
    assert_eq!(bench.run(text).counts().ran, 2);
    fs::copy(bench.path("note.txt"), bench.path("copy.txt")).unwrap();
    let moved = text.replace("note.txt", "copy.txt");
    assert_eq!(bench.run(&moved).counts().ran, 0);
    fs::write(bench.path("note.txt"), "7 chars").unwrap();
    let outcomes = bench.outcomes(text);
    let Outcome::Ran { reason, .. } = &outcomes["note"] else { panic!() };
    assert!(reason.to_string().starts_with("file `path` changed"), "{reason}");
    assert!(matches!(outcomes["length"], Outcome::Ran { .. }));
    assert_eq!(bench.output("length.txt"), "7");
}

#[test]
fn forced_nodes_run_and_their_equal_results_cut_off_the_rest() {
    let bench = Bench::new();
    bench.run(CHAIN);
    let graph = bench.load(CHAIN);
    let mut options = bench.options(2);
    options.forced.insert(graph.select("one")[0]);
    let report = run::run(&graph, &TOY, &bench.store(), &options, &mut Silent);
    assert_eq!(report.counts(), Counts { ran: 1, cut_off: 3, ..Counts::default() });
}

#[test]
fn a_target_runs_only_what_it_needs() {
    let bench = Bench::new();
    let graph = bench.load(CHAIN);
    let mut options = bench.options(2);
    options.targets.push(graph.select("ten")[0]);
    let report = run::run(&graph, &TOY, &bench.store(), &options, &mut Silent);
    assert_eq!(report.counts(), ran(2));
    // The output of a node that nobody asked for is not missing.
    assert!(report.succeeded());
}

#[test]
fn a_damaged_log_record_is_computed_again() {
    let bench = Bench::new();
    bench.run(CHAIN);
    // Flip a bit in every place of the log in turn: whatever it hits, the result is right.
    let log = fs::read_dir(bench.path("cache/log")).unwrap().next().unwrap().unwrap().path();
    let whole = fs::read(&log).unwrap();
    for place in (0..whole.len()).step_by(37) {
        let mut damaged = whole.clone();
        damaged[place] ^= 0x10;
        fs::write(&log, &damaged).unwrap();
        let _ = fs::remove_file(bench.path("out/sum.txt"));
        let report = bench.run(CHAIN);
        assert!(report.succeeded(), "bit at {place}");
        assert_eq!(bench.output("sum.txt"), "5", "bit at {place}");
        fs::write(&log, &whole).unwrap();
    }
}

#[test]
fn a_torn_log_loses_only_its_tail() {
    let bench = Bench::new();
    bench.run(CHAIN);
    let log = fs::read_dir(bench.path("cache/log")).unwrap().next().unwrap().unwrap().path();
    let whole = fs::read(&log).unwrap();
    for length in (0..whole.len()).step_by(61) {
        fs::write(&log, &whole[..length]).unwrap();
        assert!(bench.run(CHAIN).succeeded(), "{length} bytes");
        let second = bench.run(CHAIN);
        assert_eq!(second.counts().cached, 4, "{length} bytes");
    }
}

#[test]
fn collected_results_are_computed_again_when_they_are_needed() {
    let bench = Bench::new();
    bench.run(CHAIN);
    bench.lose_results();
    let report = bench.run(CHAIN);
    assert_eq!(report.counts(), ran(4));
    let options = gc::GcOptions { keep_runs: Some(0), ..gc::GcOptions::default() };
    let collected = gc::collect(&bench.path("cache"), &options).unwrap();
    assert_eq!((collected.kept_entries, collected.removed_entries), (0, 4));
    assert_eq!(bench.run(CHAIN).counts(), ran(4));
}

#[test]
fn a_large_artifact_that_is_gone_or_damaged_is_made_again_for_those_who_need_it() {
    let bench = Bench::new();
    fs::write(bench.path("long.txt"), "long ".repeat(20_000)).unwrap();
    let text = "[nodes.long]\nkind = \"text_file\"\npath = \"long.txt\"\n\n\
                [nodes.length]\nkind = \"count\"\ntext = \"@long\"\n\n\
                [outputs]\n\"copy.txt\" = \"@long\"\n\"length.txt\" = \"@length\"\n";
    bench.run(text);
    let folder = fs::read_dir(bench.path("cache/objects")).unwrap().next().unwrap().unwrap().path();
    let object = fs::read_dir(folder).unwrap().next().unwrap().unwrap().path();
    // Nobody needs its value: nothing happens.
    fs::remove_file(&object).unwrap();
    assert_eq!(bench.run(text).counts().cached, 2);
    // An output needs it.
    fs::remove_file(bench.path("out/copy.txt")).unwrap();
    let outcomes = bench.outcomes(text);
    let Outcome::Ran { reason, .. } = &outcomes["long"] else { panic!("{outcomes:?}") };
    assert_eq!(*reason, Reason::Evicted { port: "text" });
    assert_eq!(outcomes["length"], Outcome::Cached);
    assert_eq!(bench.output("copy.txt").len(), 100_000 - 1);
    // A flipped bit is found when it is read.
    let mut bytes = fs::read(&object).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&object, &bytes).unwrap();
    let report = gc::verify(&bench.path("cache"), &TOY).unwrap();
    assert_eq!(report.damaged.len(), 1);
    fs::write(&object, &bytes).unwrap();
    fs::remove_file(bench.path("out/copy.txt")).unwrap();
    assert!(matches!(bench.outcomes(text)["long"], Outcome::Ran { .. }));
    assert_eq!(bench.output("copy.txt").len(), 100_000 - 1);
}

#[test]
fn a_result_is_never_stored_under_a_key_that_names_other_inputs() {
    let bench = Bench::new();
    let text = "[nodes.drift]\nkind = \"drift\"\n\n\
                [nodes.length]\nkind = \"count\"\ntext = \"@drift\"\n\n\
                [outputs]\n\"length.txt\" = \"@length\"\n";
    bench.run(text);
    assert_eq!(bench.output("length.txt"), "100000");
    fs::remove_dir_all(bench.path("cache/objects")).unwrap();
    // The count runs again, so the lost text is made again, and is another one.
    let graph = bench.load(text);
    let mut options = bench.options(2);
    options.forced.insert(graph.select("length")[0]);
    let report = run::run(&graph, &TOY, &bench.store(), &options, &mut Silent);
    assert_eq!((report.counts(), bench.output("length.txt")), (ran(2), "100001".to_owned()));
    // Its result belongs to the new text: nothing is left to do.
    assert_eq!(bench.run(text).counts(), Counts { cached: 2, ..Counts::default() });
}

#[test]
fn verification_finds_nothing_in_a_sound_store() {
    let bench = Bench::new();
    bench.run(CHAIN);
    let report = gc::verify(&bench.path("cache"), &TOY).unwrap();
    assert_eq!((report.entries, report.damaged), (4, Vec::new()));
}

#[test]
fn a_read_only_store_is_not_touched() {
    let bench = Bench::new();
    bench.run(CHAIN);
    let changed = CHAIN.replace("value = 1", "value = 5");
    let graph = bench.load(&changed);
    let before = fs::read_dir(bench.path("cache/log")).unwrap().count();
    let store = Store::open(&bench.path("cache"), Access::ReadOnly).unwrap();
    let report = run::run(&graph, &TOY, &store, &bench.options(2), &mut Silent);
    assert_eq!(report.counts(), ran(4));
    assert_eq!(bench.output("sum.txt"), "23");
    assert_eq!(fs::read_dir(bench.path("cache/log")).unwrap().count(), before);
    assert_eq!(bench.run(&changed).counts(), ran(4));
}

#[test]
fn two_runs_at_once_compute_every_key_once() {
    let bench = Bench::new();
    let mut text = String::new();
    for node in 0..8 {
        text += &format!("[nodes.n{node}]\nkind = \"sleep\"\nduration_ms = 60\nvalue = {node}\n\n");
    }
    let graph = bench.load(&text);
    let counts: Vec<Counts> = thread::scope(|scope| {
        let run = || {
            let options = bench.options(2);
            run::run(&graph, &TOY, &bench.store(), &options, &mut Silent).counts()
        };
        let threads: Vec<_> = (0..3).map(|_| scope.spawn(run)).collect();
        threads.into_iter().map(|it| it.join().unwrap()).collect()
    });
    assert_eq!(counts.iter().map(|it| it.ran).sum::<usize>(), 8, "{counts:?}");
    assert!(counts.iter().all(|it| it.ran + it.cached == 8), "{counts:?}");
}

#[test]
fn fail_fast_starts_nothing_more() {
    let bench = Bench::new();
    let mut text = "[nodes.bad]\nkind = \"fail\"\n\n".to_owned();
    for node in 0..20 {
        text += &format!("[nodes.n{node}]\nkind = \"sleep\"\nduration_ms = 5\nvalue = {node}\n\n");
    }
    let graph = bench.load(&text);
    let mut options = bench.options(1);
    options.fail_fast = true;
    let report = run::run(&graph, &TOY, &bench.store(), &options, &mut Silent);
    assert!(report.counts().ran < 20 && report.outcomes.contains(&Outcome::NotReached));
}

#[test]
fn results_are_dropped_to_stay_in_the_memory_budget() {
    let bench = Bench::new();
    let graph = bench.load(CHAIN);
    let mut options = bench.options(2);
    options.memory = 1;
    let report = run::run(&graph, &TOY, &bench.store(), &options, &mut Silent);
    assert_eq!((report.counts(), bench.output("sum.txt")), (ran(4), "5".to_owned()));
}

#[test]
fn a_record_tells_the_run_again() {
    let bench = Bench::new();
    let graph = bench.load(CHAIN);
    let store = bench.store();
    let start = RunStart {
        v: 1,
        run: "20260101-000000-abcd".to_owned(),
        time: "2026-01-01T00:00:00Z".to_owned(),
        version: "0".to_owned(),
        title: None,
        args: vec!["sinew".to_owned()],
        folder: PathBuf::from("/"),
        host: "here".to_owned(),
        threads: 2,
        sources: Vec::new(),
    };
    let mut recorder = Recorder::start(store.dir(), &start);
    let report = run::run(&graph, &TOY, &store, &bench.options(2), &mut recorder);
    recorder.done(&report);
    let record = Record::read(&bench.path("cache/runs/20260101-000000-abcd.jsonl")).unwrap();
    assert_eq!(record.start, start);
    let nodes: BTreeMap<&str, &str> =
        record.nodes().map(|it| (it.node.as_str(), it.status.as_str())).collect();
    assert_eq!(
        nodes,
        BTreeMap::from([("one", "ran"), ("parts", "ran"), ("sum", "ran"), ("ten", "ran")])
    );
    let Some(Line::RunDone { ran: 4, failed: 0, .. }) = record.lines.last() else {
        panic!("{:?}", record.lines.last())
    };
}

/// Counts what was started.
#[derive(Default)]
struct Started(Vec<String>);

impl Observer for Started {
    fn event(&mut self, graph: &Graph, event: &Event<'_>) {
        if let Event::Started { instance, .. } = event {
            self.0.push(graph.instances[*instance].id());
        }
    }
}

#[test]
fn the_longest_path_starts_first() {
    let bench = Bench::new();
    let text = "[nodes.alone]\nkind = \"number\"\n\n\
                [nodes.first]\nkind = \"number\"\nvalue = 1\n\n\
                [nodes.second]\nkind = \"add\"\nterms = [\"@first\"]\n";
    let graph = bench.load(text);
    let mut started = Started::default();
    run::run(&graph, &TOY, &bench.store(), &bench.options(1), &mut started);
    assert_eq!(started.0[0], "first");
}

// ---- random graphs, random edits -------------------------------------------------------------

/// One node of a random pipeline: its number, and the nodes before it that it adds up.
#[derive(Debug, Clone)]
struct RandomNode {
    value: i64,
    terms: Vec<prop::sample::Index>,
}

/// What happens before a run: one node gets another value and perhaps other wires.
#[derive(Debug, Clone)]
struct Edit {
    which: prop::sample::Index,
    value: i64,
    terms: Option<Vec<prop::sample::Index>>,
    threads: usize,
    /// At 0, all results are lost.
    mishap: u8,
    /// Only this node is asked for.
    target: Option<prop::sample::Index>,
}

fn random_edit() -> impl Strategy<Value = Edit> {
    let index = any::<prop::sample::Index>;
    let terms = prop::option::of(prop::collection::vec(index(), 0..3));
    (index(), 0i64..4, terms, 1usize..9, 0u8..4, prop::option::of(index())).prop_map(
        |(which, value, terms, threads, mishap, target)| Edit {
            which,
            value,
            terms,
            threads,
            mishap,
            target,
        },
    )
}

fn random_nodes() -> impl Strategy<Value = Vec<RandomNode>> {
    let node = (0i64..4, prop::collection::vec(any::<prop::sample::Index>(), 0..3))
        .prop_map(|(value, terms)| RandomNode { value, terms });
    prop::collection::vec(node, 1..14)
}

/// The pipeline, and the value of its last node.
fn random_pipeline(nodes: &[RandomNode]) -> (String, i64) {
    let mut text = String::new();
    let mut values: Vec<i64> = Vec::new();
    for (index, RandomNode { value, terms }) in nodes.iter().enumerate() {
        let terms: Vec<usize> =
            if index == 0 { Vec::new() } else { terms.iter().map(|it| it.index(index)).collect() };
        if terms.is_empty() {
            text += &format!("[nodes.n{index}]\nkind = \"number\"\nvalue = {value}\n\n");
            values.push(*value);
        } else {
            let wires: Vec<String> = terms.iter().map(|it| format!("\"@n{it}\"")).collect();
            let weights = vec![value.to_string(); terms.len()].join(", ");
            text += &format!(
                "[nodes.n{index}]\nkind = \"add\"\nterms = [{}]\nweights = [{weights}]\n\n",
                wires.join(", ")
            );
            values.push(terms.iter().map(|it| values[*it].wrapping_mul(*value)).sum());
        }
    }
    text += &format!("[outputs]\n\"last.txt\" = \"@n{}\"\n", nodes.len() - 1);
    (text, *values.last().unwrap())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1000, ..ProptestConfig::default() })]

    /// However a pipeline is edited, and whatever is lost in between, a run gives what a fresh
    /// evaluation gives, at any number of threads; and what the plan foresees is what happens.
    #[test]
    fn edits_always_give_the_values_of_a_fresh_evaluation(
        nodes in random_nodes(),
        edits in prop::collection::vec(random_edit(), 1..6),
    ) {
        let bench = Bench::new();
        let mut nodes = nodes;
        for Edit { which, value, terms, threads, mishap, target } in edits {
            let index = which.index(nodes.len());
            nodes[index].value = value;
            if let Some(terms) = terms {
                nodes[index].terms = terms;
            }
            if mishap == 0 && bench.path("cache/CACHEDIR.TAG").exists() {
                bench.lose_results();
            }
            let (text, expected) = random_pipeline(&nodes);
            let graph = bench.load(&text);
            let store = bench.store();
            let targets: Vec<NodeIndex> =
                target.iter().map(|it| NodeIndex::new(it.index(nodes.len()))).collect();
            let plan = |graph: &Graph| {
                let memory = PipelineMemory::new(&store, graph);
                plan::plan(graph, &targets, &BTreeSet::new(), &memory)
            };
            // What was kept of the file before this edit is not believed, and what is kept of this one
            // is as good as reading it.
            let (file, settings) = (bench.path("pipeline.toml"), Settings::default());
            let find = || snapshot::find(&file, &TOY, &settings, store.disk(), store.dir());
            if let Some(found) = find() {
                prop_assert_eq!(&*found.sources[0].text, &*text);
            }
            snapshot::write(&graph, &file, &TOY, &settings, &store).unwrap();
            let kept = find().expect("it was just written");
            let (read, plan) = (plan(&graph), plan(&kept));
            prop_assert_eq!(&read.statuses, &plan.statuses);
            prop_assert_eq!(&read.keys, &plan.keys);
            let graph = if value % 2 == 0 { kept } else { graph };
            let options = RunOptions { targets, ..bench.options(threads) };
            let report = run::run(&graph, &TOY, &store, &options, &mut Silent);
            prop_assert!(report.succeeded(), "{report:?}");
            if options.targets.is_empty() {
                prop_assert_eq!(bench.output("last.txt"), expected.to_string());
            }
            for (status, outcome) in plan.statuses.iter().zip(&report.outcomes) {
                if let (Status::Run { reason, .. }, Outcome::Ran { reason: given, .. }) =
                    (status, outcome)
                {
                    prop_assert_eq!(reason, given);
                }
                let (was_made, was_cut_off) = (
                    matches!(outcome, Outcome::Ran { .. } | Outcome::Shared),
                    *outcome == Outcome::CutOff,
                );
                let as_planned = match status {
                    Status::Cached { .. } => *outcome == Outcome::Cached,
                    Status::Run { .. } => was_made,
                    Status::Follows { .. } => was_made || was_cut_off,
                    Status::NotWanted => *outcome == Outcome::NotWanted,
                    Status::Blocked(_) => false,
                };
                prop_assert!(as_planned, "{:?} became {:?}", status, outcome);
            }
        }
    }
}

#[test]
fn nothing_waits_for_ever_when_a_claim_is_held_elsewhere() {
    let bench = Bench::new();
    let graph = bench.load(CHAIN);
    let store = bench.store();
    let other = bench.store();
    let key = {
        let memory = PipelineMemory::new(&store, &graph);
        let plan = plan::plan(&graph, &[], &BTreeSet::new(), &memory);
        match plan.statuses[graph.select("one")[0].index()] {
            Status::Run { key, .. } => key,
            ref other => panic!("{other:?}"),
        }
    };
    let claim = other.claim(&key).unwrap().expect("nobody else has it");
    assert!(store.claim(&key).unwrap().is_none());
    thread::scope(|scope| {
        scope.spawn(move || {
            thread::sleep(Duration::from_millis(100));
            // Its holder ends without a result: the waiting run takes over.
            drop(claim);
        });
        let report = run::run(&graph, &TOY, &store, &bench.options(2), &mut Silent);
        assert_eq!(report.counts(), ran(4));
    });
}
