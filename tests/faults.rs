//! A store on a disk that fails: whatever fails, at whichever operation, the run says so, nothing
//! that was finished is lost, and the next run gives what an undisturbed one gives.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
    sync::{
        Arc, Mutex,
        atomic::{AtomicUsize, Ordering},
    },
};

use sinew::engine::{
    events::{Event, ExportOutcome, Failure, Observer, Outcome, RunReport, Silent},
    graph::Graph,
    pipeline::{self, Settings},
    run::{self, RunOptions},
    store::{
        Access, Store, StoreError,
        disk::{Disk, Faults, Operation, Verdict},
        gc, pins,
    },
    toy::TOY,
};

/// Some small results, and one that has a file of its own.
const PIPELINE: &str = r#"
[nodes.one]
kind = "number"
value = 1

[nodes.ten]
kind = "scale"
number = "@one"
factor = 10.0

[nodes.long]
kind = "text_file"
path = "long.txt"

[nodes.length]
kind = "count"
text = "@long"

[nodes.sum]
kind = "add"
terms = ["@ten", "@length", "@one"]

[outputs]
"sum.txt" = "@sum"
"long.txt" = "@long"
"#;

const SUM: &str = "100011\n";

/// A temporary folder with a pipeline, a cache, and what is written.
struct Bench {
    folder: tempfile::TempDir,
    graph: Graph,
}

impl Bench {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("long.txt"), "long ".repeat(20_000)).unwrap();
        let file = folder.path().join("pipeline.toml");
        fs::write(&file, PIPELINE).unwrap();
        let graph = pipeline::load(&file, &TOY, &Settings::default())
            .unwrap_or_else(|e| panic!("{}", e.render(false)));
        Self { folder, graph }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn cache(&self) -> PathBuf {
        self.path("cache")
    }

    fn options(&self, targets: &[&str]) -> RunOptions {
        RunOptions {
            threads: 2,
            targets: targets.iter().map(|it| self.graph.select(it)[0]).collect(),
            output_dir: self.path("out"),
            run_id: "test".to_owned(),
            ..RunOptions::default()
        }
    }

    fn run_on(&self, disk: &Disk, targets: &[&str]) -> Result<RunReport, StoreError> {
        let store = Store::open_on(disk, &self.cache(), Access::ReadWrite)?;
        Ok(run::run(&self.graph, &TOY, &store, &self.options(targets), &mut Silent))
    }

    fn run(&self) -> RunReport {
        self.run_on(&Disk::default(), &[]).unwrap()
    }

    /// Runs, and returns what was warned of.
    fn warnings(&self) -> (RunReport, Vec<String>) {
        let mut warnings = Warnings::default();
        let store = Store::open(&self.cache(), Access::ReadWrite).unwrap();
        let report = run::run(&self.graph, &TOY, &store, &self.options(&[]), &mut warnings);
        (report, warnings.0)
    }

    fn outcome<'a>(&self, report: &'a RunReport, id: &str) -> &'a Outcome {
        &report.outcomes[self.graph.select(id)[0].index()]
    }

    #[track_caller]
    fn assert_outputs(&self, context: &str) {
        let read = |name: &str| fs::read_to_string(self.path("out").join(name));
        assert_eq!(read("sum.txt").unwrap(), SUM, "{context}");
        assert!(read("long.txt").unwrap() == "long ".repeat(20_000), "{context}");
    }
}

#[derive(Default)]
struct Warnings(Vec<String>);

impl Observer for Warnings {
    fn event(&mut self, _: &Graph, event: &Event<'_>) {
        if let Event::Warning { text } = event {
            self.0.push((*text).to_owned());
        }
    }
}

/// Fails at the operation with a number, and at all that follow if the disk has gone for good.
struct FailAt {
    at: usize,
    verdict: Verdict,
    for_good: bool,
    count: AtomicUsize,
    failed: Mutex<Option<(Operation, PathBuf)>>,
}

impl FailAt {
    fn new(at: usize, verdict: Verdict, for_good: bool) -> Arc<Self> {
        let (count, failed) = (AtomicUsize::new(0), Mutex::new(None));
        Arc::new(Self { at, verdict, for_good, count, failed })
    }
}

impl Faults for FailAt {
    fn verdict(&self, operation: Operation, path: &Path) -> Verdict {
        let n = self.count.fetch_add(1, Ordering::Relaxed);
        if n == self.at {
            *self.failed.lock().unwrap() = Some((operation, path.to_owned()));
            return self.verdict;
        }
        if n > self.at && self.for_good { Verdict::Fail(libc::EIO) } else { Verdict::Go }
    }
}

/// Everything that a report blames.
fn complaints(report: &RunReport) -> Vec<String> {
    let mut res: Vec<String> = report.store_error.iter().map(ToString::to_string).collect();
    for outcome in &report.outcomes {
        if let Outcome::Failed { failure, .. } = outcome {
            res.push(failure.message().to_owned());
        }
    }
    for export in &report.exports {
        if let ExportOutcome::Failed { failure } = export {
            assert!(matches!(failure, Failure::Environment(_)), "{failure:?}");
            res.push(failure.message().to_owned());
        }
    }
    res
}

/// One fault at one operation of a run that continues an earlier one.
fn check_fault(at: usize, verdict: Verdict, for_good: bool) {
    let bench = Bench::new();
    assert_eq!(bench.run_on(&Disk::default(), &["ten"]).unwrap().counts().ran, 2);
    let faults = FailAt::new(at, verdict, for_good);
    let ended = bench.run_on(&Disk::with_faults(Arc::clone(&faults) as Arc<dyn Faults>), &[]);
    let failed = faults.failed.lock().unwrap().clone();
    let context = format!("{verdict:?} at operation {at}, {failed:?}, for good: {for_good}");
    let mut n_kept = None;
    match &ended {
        Err(error) => {
            let is_named = error.to_string().contains(&*bench.cache().to_string_lossy());
            assert!(is_named, "{context}: {error}");
        }
        Ok(report) => {
            assert!(!report.panicked(), "{context}");
            if report.succeeded() {
                if verdict != Verdict::Ignore {
                    bench.assert_outputs(&context);
                }
            } else {
                let complaints = complaints(report);
                let folder = bench.folder.path().to_string_lossy().into_owned();
                let is_named = complaints.iter().any(|it| it.contains(&folder));
                assert!(is_named, "{context}: {complaints:?}");
                assert!(report.environment_failed(), "{context}: {complaints:?}");
            }
            if report.store_error.is_none() && verdict != Verdict::Ignore {
                n_kept = Some(report.outcomes.iter().filter(|it| is_done(it)).count());
            }
        }
    }
    if verdict == Verdict::Ignore {
        // What a disk that lies has made of the outputs, nobody can know.
        let _ = fs::remove_dir_all(bench.path("out"));
    }
    let report = bench.run();
    assert!(report.succeeded(), "{context}: {:?}", complaints(&report));
    bench.assert_outputs(&context);
    // A read that gave too little looks like damage, and what is damaged is set aside.
    let was_set_aside =
        matches!((&verdict, &failed), (Verdict::Short(_), Some((Operation::Read, _))));
    for id in ["one", "ten"] {
        assert_eq!(*bench.outcome(&report, id), Outcome::Cached, "{context}: {id}");
    }
    if let Some(n_kept) = n_kept.filter(|_| !was_set_aside) {
        assert!(report.counts().ran <= 5 - n_kept, "{context}: {:?}", report.counts());
    }
    let verified = gc::verify(&bench.cache(), &TOY).unwrap();
    let is_honest = !matches!(verdict, Verdict::Ignore);
    assert!(!is_honest || verified.damaged.is_empty(), "{context}: {:?}", verified.damaged);
    let verified = gc::verify(&bench.cache(), &TOY).unwrap();
    assert!(verified.damaged.is_empty(), "{context}: {:?}", verified.damaged);
    assert_eq!(bench.run().counts().cached, 5, "{context}");
    let left: Vec<PathBuf> = files(&bench.path("out"));
    assert_eq!(left.len(), 2, "{context}: {left:?}");
}

fn is_done(outcome: &Outcome) -> bool {
    matches!(outcome, Outcome::Ran { .. } | Outcome::Cached | Outcome::CutOff | Outcome::Shared)
}

/// Every file below a folder.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut res = Vec::new();
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() { res.extend(files(&path)) } else { res.push(path) }
    }
    res.sort();
    res
}

/// How many operations the disturbed run has.
fn n_operations() -> usize {
    let bench = Bench::new();
    bench.run_on(&Disk::default(), &["ten"]).unwrap();
    let faults = FailAt::new(usize::MAX, Verdict::Go, false);
    let disk = Disk::with_faults(Arc::clone(&faults) as Arc<dyn Faults>);
    assert!(bench.run_on(&disk, &[]).unwrap().succeeded());
    faults.count.load(Ordering::Relaxed)
}

#[test]
fn whatever_fails_at_whichever_operation_nothing_is_lost() {
    let n = n_operations();
    assert!(n > 40, "{n}");
    let verdicts = [libc::ENOSPC, libc::EIO, libc::EROFS, libc::ENOENT].map(Verdict::Fail);
    for at in 0..n + 4 {
        check_fault(at, verdicts[at % verdicts.len()], false);
        check_fault(at, Verdict::Short([0, 7, 100][at % 3]), false);
        check_fault(at, Verdict::Ignore, false);
    }
}

#[test]
fn when_the_disk_goes_for_good_what_was_finished_is_there() {
    for at in 0..n_operations() {
        check_fault(at, [Verdict::Fail(libc::ENOSPC), Verdict::Short(60)][at % 2], true);
    }
}

/// Refuses everything in the cache from the first write of results on.
struct FullCache;

impl Faults for FullCache {
    fn verdict(&self, operation: Operation, path: &Path) -> Verdict {
        let is_result = path.components().any(|it| it.as_os_str() == "objects");
        let is_cut = operation == Operation::Create && is_result;
        if is_cut { Verdict::Fail(libc::ENOSPC) } else { Verdict::Go }
    }
}

#[test]
fn with_a_full_cache_the_outputs_that_are_done_are_written() {
    let bench = Bench::new();
    let report = bench.run_on(&Disk::with_faults(Arc::new(FullCache)), &["long"]).unwrap();
    let error = report.store_error.as_ref().unwrap().to_string();
    assert!(error.starts_with("cannot write `") && error.contains("No space left"), "{error}");
    assert!(matches!(report.exports[1], ExportOutcome::Written { .. }), "{:?}", report.exports);
    assert_eq!(fs::read_to_string(bench.path("out/long.txt")).unwrap().len(), 100_000);
}

// ---- damage ------------------------------------------------------------------------------------

/// The only file in a folder of the cache.
fn only_file(folder: &Path) -> PathBuf {
    let found = files(folder);
    assert_eq!(found.len(), 1, "{found:?}");
    found[0].clone()
}

#[test]
fn a_flipped_bit_anywhere_in_the_log_costs_one_record_and_is_reported() {
    let bench = Bench::new();
    bench.run();
    let log = only_file(&bench.path("cache/log"));
    let whole = fs::read(&log).unwrap();
    for place in (0..whole.len()).step_by(5) {
        let mut damaged = whole.clone();
        damaged[place] ^= 0x10;
        fs::write(&log, &damaged).unwrap();
        let _ = fs::remove_dir_all(bench.path("out"));
        let (report, warnings) = bench.warnings();
        let context = format!("bit at {place}: {:?}, {warnings:?}", report.counts());
        assert!(report.succeeded(), "{context}");
        bench.assert_outputs(&context);
        assert!(report.counts().ran <= 1, "{context}");
        let path = log.to_string_lossy().into_owned();
        assert!(
            report.counts().ran == 0 || warnings.iter().any(|it| it.contains(&path)),
            "{context}"
        );
        // What was made again stands before what is damaged.
        let (report, _) = bench.warnings();
        assert_eq!(report.counts().cached, 5, "bit at {place}");
        for other in files(&bench.path("cache/log")) {
            fs::remove_file(other).unwrap();
        }
        fs::write(&log, &whole).unwrap();
    }
}

#[test]
fn a_log_cut_anywhere_gives_back_all_before_the_cut() {
    let bench = Bench::new();
    bench.run();
    let log = only_file(&bench.path("cache/log"));
    let whole = fs::read(&log).unwrap();
    let mut most = 0;
    for length in (0..=whole.len()).step_by(3).chain([whole.len()]) {
        fs::write(&log, &whole[..length]).unwrap();
        let report = bench.run();
        assert!(report.succeeded(), "{length} bytes");
        let n_kept = report.counts().cached;
        assert!(n_kept >= most || report.counts().cut_off > 0, "{length} bytes: {n_kept}");
        most = most.max(n_kept);
        bench.assert_outputs(&format!("{length} bytes"));
        assert_eq!(bench.run().counts().cached, 5, "{length} bytes");
        for other in files(&bench.path("cache/log")) {
            fs::remove_file(other).unwrap();
        }
    }
    assert_eq!(most, 5);
}

#[test]
fn a_damaged_object_is_reported_with_its_path_and_made_again() {
    let bench = Bench::new();
    bench.run();
    let object = only_file(&bench.path("cache/objects"));
    let whole = fs::read(&object).unwrap();
    let flips = (0..whole.len()).step_by(9_973).map(|place| {
        let mut bytes = whole.clone();
        bytes[place] ^= 1;
        bytes
    });
    let cuts = (0..whole.len()).step_by(9_973).map(|length| whole[..length].to_vec());
    for damaged in flips.chain(cuts) {
        fs::write(&object, &damaged).unwrap();
        let _ = fs::remove_dir_all(bench.path("out"));
        let (report, warnings) = bench.warnings();
        bench.assert_outputs("a damaged object");
        assert_eq!(report.counts().ran, 1);
        let path = object.to_string_lossy();
        assert!(warnings.iter().any(|it| it.contains(&*path)), "{warnings:?}");
        assert!(fs::read(&object).unwrap() == whole);
    }
}

#[test]
fn a_damaged_tag_and_damaged_records_of_runs_disturb_nothing() {
    let bench = Bench::new();
    bench.run();
    fs::write(bench.path("cache/CACHEDIR.TAG"), "Sig").unwrap();
    fs::write(bench.path("cache/runs/20260101-000000-abcd.jsonl"), "{\"event\":").unwrap();
    fs::write(bench.path("cache/runs/20260101-000001-abcd.jsonl"), [0xff, 0xfe]).unwrap();
    assert_eq!(bench.run().counts().cached, 5);
    let verified = gc::verify(&bench.cache(), &TOY).unwrap();
    assert_eq!(verified.damaged.len(), 1, "{:?}", verified.damaged);
    assert!(gc::verify(&bench.cache(), &TOY).unwrap().damaged.is_empty());
    let options = gc::GcOptions { keep_runs: Some(1), ..gc::GcOptions::default() };
    gc::collect(&bench.cache(), &options).unwrap();
}

/// Newer facts win in whichever segment they are, and whatever the clock says.
#[test]
fn what_is_written_later_wins_whatever_the_names_of_segments() {
    let bench = Bench::new();
    bench.run();
    let log = only_file(&bench.path("cache/log"));
    for name in ["0000000000-old.log", "9999999999-new.log"] {
        let renamed = bench.path("cache/log").join(name);
        fs::rename(files(&bench.path("cache/log"))[0].clone(), &renamed).unwrap();
        // A holder of that segment makes the next run begin another one.
        let held = fs::File::options().write(true).open(&renamed).unwrap();
        held.lock().unwrap();
        fs::write(bench.path("out/sum.txt"), "spoiled").unwrap();
        assert_eq!(bench.run().exports[0], ExportOutcome::Written { bytes: 7 });
        drop(held);
        // The receipt of the new file is found, not the one of the old file.
        assert_eq!(bench.run().exports[0], ExportOutcome::UpToDate, "{name}");
        for other in files(&bench.path("cache/log")).iter().filter(|it| **it != renamed) {
            fs::remove_file(other).unwrap();
        }
    }
    assert!(!log.exists());
}

#[test]
fn a_cache_that_vanishes_during_a_run_begins_again() {
    struct Vanish(PathBuf);
    impl Observer for Vanish {
        fn event(&mut self, graph: &Graph, event: &Event<'_>) {
            if let Event::Finished { instance, .. } = event
                && graph.instances[*instance].id() == "ten"
            {
                let _ = fs::remove_dir_all(&self.0);
            }
        }
    }
    let bench = Bench::new();
    bench.run_on(&Disk::default(), &["one"]).unwrap();
    let store = Store::open(&bench.cache(), Access::ReadWrite).unwrap();
    let mut vanish = Vanish(bench.cache());
    let mut options = bench.options(&[]);
    options.threads = 1;
    let report = run::run(&bench.graph, &TOY, &store, &options, &mut vanish);
    assert!(report.succeeded(), "{:?}", complaints(&report));
    bench.assert_outputs("vanished");
    drop(store);
    // What was finished after that is kept.
    let report = bench.run();
    let counts = report.counts();
    assert!(report.succeeded() && counts.cached + counts.cut_off > 0, "{counts:?}");
    assert_eq!(bench.run().counts().cached, 5);
}

/// Removes the cache just before files are made in it, some times.
struct VanishAtCreate {
    cache: PathBuf,
    times: AtomicUsize,
}

impl Faults for VanishAtCreate {
    fn verdict(&self, operation: Operation, path: &Path) -> Verdict {
        let is_result =
            path.parent().is_some_and(|it| it != self.cache && it.starts_with(&self.cache));
        let less = |it: usize| it.checked_sub(1);
        if operation == Operation::Create
            && is_result
            && self.times.fetch_update(Ordering::SeqCst, Ordering::SeqCst, less).is_ok()
        {
            fs::remove_dir_all(&self.cache).unwrap();
        }
        Verdict::Go
    }
}

#[test]
fn a_cache_that_vanishes_between_the_making_of_a_folder_and_of_a_file_is_made_again() {
    for times in 1..4 {
        let bench = Bench::new();
        let faults = VanishAtCreate { cache: bench.cache(), times: AtomicUsize::new(times) };
        let report = bench.run_on(&Disk::with_faults(Arc::new(faults)), &[]).unwrap();
        assert!(report.succeeded(), "{times}: {:?}", complaints(&report));
        bench.assert_outputs("vanished");
    }
}

// ---- housekeeping beside runs --------------------------------------------------------------------

/// Collects everything that may go, when an instance has started.
struct CollectAt {
    cache: PathBuf,
    collected: Vec<gc::GcReport>,
}

impl Observer for CollectAt {
    fn event(&mut self, _: &Graph, event: &Event<'_>) {
        if let Event::Started { .. } = event {
            let options = gc::GcOptions { max_bytes: Some(0), ..gc::GcOptions::default() };
            self.collected.push(gc::collect(&self.cache, &options).unwrap());
        }
    }
}

#[test]
fn housekeeping_beside_a_run_removes_nothing_that_the_run_relies_on() {
    let bench = Bench::new();
    bench.run_on(&Disk::default(), &["long", "ten"]).unwrap();
    let store = Store::open(&bench.cache(), Access::ReadWrite).unwrap();
    let mut observer = CollectAt { cache: bench.cache(), collected: Vec::new() };
    let report = run::run(&bench.graph, &TOY, &store, &bench.options(&[]), &mut observer);
    assert_eq!((report.counts().cached, report.counts().ran), (3, 2));
    assert!(observer.collected.iter().all(|it| it.removed_entries == 0 && it.in_use >= 3));
    drop(store);
    assert_eq!(bench.run().counts().cached, 5, "what ran beside housekeeping is stored");
    // Nobody needs it any more.
    let options = gc::GcOptions { max_bytes: Some(0), ..gc::GcOptions::default() };
    let report = gc::collect(&bench.cache(), &options).unwrap();
    assert_eq!((report.removed_entries, report.in_use, report.kept_entries), (5, 0, 0));
    assert!(files(&bench.path("cache/objects")).is_empty());
}

#[test]
fn runs_and_housekeeping_in_loops_always_give_the_right_bytes() {
    let bench = Bench::new();
    bench.run();
    std::thread::scope(|scope| {
        let runs = scope.spawn(|| {
            for _ in 0..30 {
                let _ = fs::remove_dir_all(bench.path("out"));
                assert!(bench.run().succeeded());
                bench.assert_outputs("beside housekeeping");
            }
        });
        while !runs.is_finished() {
            let options = gc::GcOptions { max_bytes: Some(0), ..gc::GcOptions::default() };
            gc::collect(&bench.cache(), &options).unwrap();
            gc::verify(&bench.cache(), &TOY)
                .map(|it| assert!(it.damaged.is_empty(), "{:?}", it.damaged))
                .unwrap();
        }
    });
    bench.run();
    assert_eq!(bench.run().counts().cached, 5);
    assert_eq!(files(&bench.path("cache/uses")), Vec::<PathBuf>::new());
}

#[test]
fn pinned_results_stay() {
    let bench = Bench::new();
    bench.run();
    let store = Store::open(&bench.cache(), Access::ReadOnly).unwrap();
    let memory = sinew::engine::plan::PipelineMemory::new(&store, &bench.graph);
    let plan = sinew::engine::plan::plan(&bench.graph, &[], &BTreeSet::new(), &memory);
    let key = |id: &str| match plan.statuses[bench.graph.select(id)[0].index()] {
        sinew::engine::plan::Status::Cached { key } => key,
        ref other => panic!("{other:?}"),
    };
    let pinned = BTreeSet::from([key("long"), key("sum")]);
    pins::add(&bench.cache(), "20260101-000000-abcd", &pinned).unwrap();
    let expected = BTreeMap::from([("20260101-000000-abcd".to_owned(), pinned)]);
    assert_eq!(pins::all(&bench.cache()).unwrap(), expected);
    let all = gc::GcOptions { all: true, ..gc::GcOptions::default() };
    let report = gc::collect(&bench.cache(), &all).unwrap();
    assert_eq!((report.kept_entries, report.pinned, report.removed_entries), (2, 2, 3));
    assert_eq!(files(&bench.path("cache/objects")).len(), 1);
    // A pin that cannot be read must not let anything go.
    fs::write(bench.path("cache/pins/other"), "what?\n").unwrap();
    let error = gc::collect(&bench.cache(), &all).unwrap_err().to_string();
    assert!(error.contains("`what?` is no key"), "{error}");
    fs::remove_file(bench.path("cache/pins/other")).unwrap();
    pins::remove(&bench.cache(), "20260101-000000-abcd").unwrap();
    assert_eq!(gc::collect(&bench.cache(), &all).unwrap().kept_entries, 0);
}
