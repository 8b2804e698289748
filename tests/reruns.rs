//! What its users are told about reruns: before, after, beside each other, and again.

use std::{
    fs,
    io::{BufRead, BufReader},
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    sync::mpsc::{Receiver, channel},
    thread,
    time::Duration,
};

use serde_json::Value;
use sinew::{
    LIBRARY,
    engine::{
        artifact::AnyArtifact,
        digest::Digest,
        graph::Graph,
        pipeline::{self, Settings},
        plan::{self, PipelineMemory, Status},
        store::{Access, Entry, EntryOutput, NewEntry, Store},
    },
    kernels::table::{Column, Table},
};

/// A temporary folder with a mesh, a pipeline and a cache.
struct Folder(tempfile::TempDir);

const CUBE: &str = "OFF\n8 12 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 0 1\n1 0 1\n1 1 1\n0 1 1\n\
    3 0 2 1\n3 0 3 2\n3 4 5 6\n3 4 6 7\n3 0 1 5\n3 0 5 4\n3 1 2 6\n3 1 6 5\n3 2 3 7\n3 2 7 6\n\
    3 3 0 4\n3 3 4 7\n";

const PIPELINE: &str = r#"[params]
levels = 1
k = 5

[nodes.cube]
kind = "load"
path = "cube.off"

[nodes.fine]
kind = "subdivide"
mesh = "@cube.mesh"
levels = "${levels}"

[nodes.laplacian]
kind = "laplacian"
mesh = "@fine.mesh"

[nodes.basis]
kind = "eigs"
operator = "@laplacian"
k = "${k}"

[outputs]
"basis.npz" = "@basis"
"#;

impl Folder {
    fn new(text: &str) -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        folder.write("cube.off", CUBE);
        folder.write("p.toml", text);
        folder
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, text: &str) {
        // As editors do it: another file takes the name.
        let new = self.path("saved~");
        fs::write(&new, text).unwrap();
        fs::rename(new, self.path(name)).unwrap();
    }

    fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_sinew"));
        command.args(args).current_dir(self.0.path()).env("NO_COLOR", "1");
        for name in ["SINEW_CACHE", "SINEW_JOBS", "SINEW_PROFILE", "CLICOLOR_FORCE"] {
            command.env_remove(name);
        }
        command
    }

    /// Runs `sinew` here; the exit code, and all that it says.
    fn sinew(&self, args: &[&str]) -> (i32, String) {
        let output = self.command(args).output().unwrap();
        let text = String::from_utf8([output.stdout, output.stderr].concat()).unwrap();
        (output.status.code().unwrap(), text)
    }

    /// What `sinew` says when all goes well.
    fn says(&self, args: &[&str]) -> String {
        let (code, text) = self.sinew(args);
        assert_eq!(code, 0, "{args:?}\n{text}");
        text
    }

    fn json(&self, args: &[&str]) -> Vec<Value> {
        let output = self.command(args).arg("--json").output().unwrap();
        let text = String::from_utf8(output.stdout).unwrap();
        text.lines().map(|it| serde_json::from_str(it).unwrap()).collect()
    }

    fn edit(&self, from: &str, to: &str) {
        let text = fs::read_to_string(self.path("p.toml")).unwrap();
        assert!(text.contains(from), "{from}");
        self.write("p.toml", &text.replace(from, to));
    }
}

#[track_caller]
fn assert_has(text: &str, lines: &[&str]) {
    for line in lines {
        assert!(text.contains(line), "{line}\n--- is not in\n{text}");
    }
}

#[test]
fn reasons_lead_to_the_line_that_changed_before_and_after_the_fact() {
    let folder = Folder::new(PIPELINE);
    folder.says(&["run", "p.toml"]);
    folder.edit("levels = 1", "levels = 2");
    let plan = folder.says(&["plan", "p.toml"]);
    assert_has(
        &plan,
        &[
            "`levels`: 1 -> 2 (p.toml:2)",
            "follows  laplacian … 1 more node",
            "1 to run, 2 that follow, 1 cached; ",
            " of work, as it was last time",
        ],
    );
    let all = folder.says(&["plan", "p.toml", "--all"]);
    assert_has(&all, &["follows  basis", "follows  laplacian", "cached  cube"]);
    let explain = folder.says(&["explain", "p.toml", "basis"]);
    assert_has(&explain, &["`fine` would run:", "  `levels`: 1 -> 2 (p.toml:2)"]);
    let run = folder.says(&["run", "p.toml"]);
    let because = "input `operator` changed because of `fine`: `levels`: 1 -> 2 (p.toml:2)";
    assert_has(&run, &[because]);
    for told in [
        folder.says(&["explain", "p.toml", "basis", "--run", "last"]),
        folder.says(&["runs", "last", "basis"]),
    ] {
        assert_has(
            &told,
            &[
                "input `operator` changed (p.toml:20)\n",
                "`laplacian` ran:\n",
                "input `mesh` changed (p.toml:16)\n",
                "`fine` ran:\n",
                "`levels`: 1 -> 2 (p.toml:2)\n",
            ],
        );
    }
    assert_has(&folder.says(&["runs", "last"]), &[because]);
    // What the command line says is a place as well.
    let plan = folder.says(&["plan", "p.toml", "--set", "k=7", "--set", "basis.tolerance=1e-8"]);
    assert_has(&plan, &["`k`: 5 -> 7 (--set k=7), `tolerance`: 1e-9 -> 1e-8 (--set basis."]);
    // Going back: what comes before is stored, and still is the cause.
    folder.says(&["cache", "rm", "eigs"]);
    folder.edit("levels = 2", "levels = 1");
    folder.says(&["run", "p.toml", "laplacian"]);
    folder.edit("k = 5", "k = 6");
    let explain = folder.says(&["explain", "p.toml", "basis"]);
    assert_has(&explain, &["its key is another one than last time; what that was made from is no"]);
}

#[test]
fn what_was_removed_or_damaged_is_called_so() {
    let folder = Folder::new(&PIPELINE.replace("levels = 1", "levels = 4"));
    folder.says(&["run", "p.toml"]);
    folder.says(&["cache", "rm", "eigs"]);
    let explain = folder.says(&["explain", "p.toml", "basis"]);
    assert_has(&explain, &["would run  its result is no longer in the store"]);
    folder.says(&["run", "p.toml"]);
    // The basis is too large for the log; an output needs it.
    let large: Vec<PathBuf> = fs::read_dir(folder.path("cache/objects"))
        .unwrap()
        .flat_map(|it| fs::read_dir(it.unwrap().path()).unwrap())
        .map(|it| it.unwrap().path())
        .collect();
    assert!(!large.is_empty());
    for path in &large {
        let mut bytes = fs::read(path).unwrap();
        let last = bytes.len() - 1;
        bytes[last] ^= 1;
        fs::write(path, bytes).unwrap();
    }
    let (code, text) = folder.sinew(&["verify", "p.toml"]);
    assert_eq!(code, 4, "{text}");
    assert_has(&text, &["DAMAGED  basis", "`basis` is not what was stored"]);
    fs::remove_file(folder.path("basis.npz")).unwrap();
    let plan = folder.says(&["plan", "p.toml"]);
    assert_has(&plan, &["`basis` was damaged in the store"]);
    let run = folder.says(&["run", "p.toml"]);
    assert_has(&run, &["`basis` was damaged in the store"]);
    assert_eq!(folder.sinew(&["plan", "p.toml", "--fail-if-stale"]).0, 0);
}

#[test]
fn a_stale_pipeline_ends_with_4_if_that_is_asked_for() {
    let folder = Folder::new(PIPELINE);
    let (code, text) = folder.sinew(&["plan", "p.toml", "--fail-if-stale"]);
    assert_eq!(code, 4, "{text}");
    assert_has(&text, &["run  cube", "  new\n", "follows  fine … 2 more nodes"]);
    let lines = folder.json(&["plan", "p.toml"]);
    assert_eq!(
        (lines[0]["node"].as_str(), lines[0]["why"]["reason"].as_str()),
        (Some("cube"), Some("new"))
    );
    folder.says(&["run", "p.toml"]);
    folder.says(&["plan", "p.toml", "--fail-if-stale"]);
}

#[test]
fn instances_that_fare_alike_share_a_line() {
    let text = format!("{PIPELINE}\n[axes.cut]\nvalues = [3, 4, 5]\n")
        .replace("k = \"${k}\"", "k = \"${cut}\"");
    let text = text.replace("\"basis.npz\" = \"@basis\"", "\"basis-${cut}.npz\" = \"@basis\"");
    let folder = Folder::new(&text);
    folder.says(&["run", "p.toml"]);
    let plan = folder.says(&["plan", "p.toml", "--set", "basis.tolerance=1e-8"]);
    assert_has(
        &plan,
        &["     3       run  basis", "`tolerance`: 1e-9 -> 1e-8", "3 to run, 0 that follow"],
    );
    assert_eq!(plan.matches("1e-8 (").count(), 1, "{plan}");
    let all = folder.says(&["plan", "p.toml", "--all", "--set", "basis.tolerance=1e-8"]);
    assert_has(&all, &["run  basis@3", "run  basis@4", "run  basis@5"]);
    folder.says(&["run", "p.toml", "--set", "basis.tolerance=1e-8"]);
    let diff = folder.says(&["diff"]);
    assert_has(&diff, &["basis (3 instances)  tolerance  1e-9    1e-8"]);
    folder.edit("values = [3, 4, 5]", "values = [4, 5, 6]");
    folder.says(&["run", "p.toml", "--set", "basis.tolerance=1e-8"]);
    let diff = folder.says(&["diff"]);
    assert_has(&diff, &["removed  basis  3", "added    basis  6"]);
}

#[test]
fn runs_are_found_by_age_and_by_name_and_survive_torn_records() {
    let folder = Folder::new(PIPELINE);
    folder.says(&["run", "p.toml"]);
    folder.says(&["run", "p.toml"]);
    let names: Vec<String> =
        folder.json(&["runs"]).iter().map(|it| it["run"].as_str().unwrap().to_owned()).collect();
    assert_eq!(names.len(), 2);
    assert!(names[0] > names[1]);
    assert_has(&folder.says(&["runs", "last~1"]), &[&names[1]]);
    assert_has(&folder.says(&["runs", &names[1]]), &[&names[1]]);
    let (code, text) = folder.sinew(&["runs", "last~2"]);
    assert_eq!(code, 2);
    assert_has(&text, &["there is no run `last~2`: the last ones are", &names[0]]);
    let (code, text) = folder.sinew(&["runs", "2"]);
    assert_eq!(code, 2);
    assert_has(&text, &["there are several runs `2…`", &names[0], &names[1]]);
    // A clock that was turned back: the later run still is the last one.
    fs::copy(
        folder.path(&format!("cache/runs/{}.jsonl", names[0])),
        folder.path("cache/runs/29990101-000000-abcd.jsonl"),
    )
    .unwrap();
    folder.says(&["run", "p.toml"]);
    let last = folder.json(&["runs"])[0]["run"].as_str().unwrap().to_owned();
    assert!(last.starts_with("29990101-000000-x0001-"), "{last}");
    // Torn anywhere, a record is told as far as it goes.
    let path = folder.path(&format!("cache/runs/{}.jsonl", names[1]));
    let whole = fs::read(&path).unwrap();
    for length in (0..whole.len()).step_by(whole.len() / 7).take(7) {
        fs::write(&path, &whole[..length]).unwrap();
        let list = folder.json(&["runs"]);
        let torn = list.last().unwrap();
        assert_eq!(torn["run"].as_str(), Some(names[1].as_str()));
        let status = torn["status"].as_str().unwrap();
        assert!(["broken off", "unreadable"].contains(&status), "{length}: {status}");
    }
    // Garbage in the middle costs only itself.
    let text = String::from_utf8(whole).unwrap();
    let mut lines: Vec<&[u8]> = text.lines().map(str::as_bytes).collect();
    lines.insert(1, b"\xff\xfe garbage");
    lines.insert(1, br#"{"event":"of a later version"}"#);
    fs::write(&path, lines.join(&b'\n')).unwrap();
    assert_eq!(folder.json(&["runs"]).last().unwrap()["status"], "done");
}

#[test]
fn records_of_the_first_version_are_told() {
    let folder = Folder::new(PIPELINE);
    fs::create_dir_all(folder.path("cache/runs")).unwrap();
    let key = "0".repeat(64);
    let record = format!(
        r#"{{"event":"run_start","v":1,"run":"20260101-000000-abcd","time":"2026-01-01T00:00:00Z","version":"0.1.0","title":null,"args":["sinew","run","p.toml"],"folder":"/","host":"h","threads":2,"sources":[]}}
{{"event":"planned","t":0.1,"nodes":1,"cached":0}}
{{"event":"node_start","t":0.2,"node":"basis","threads":2,"reason":"`k`: 5 -> 6"}}
{{"event":"node_done","t":0.5,"node":"basis","kind":"eigs","status":"ran","key":"{key}","wall_s":0.3,"message":"`k`: 5 -> 6","out":{{}}}}
{{"event":"run_done","t":0.6,"ran":1,"cached":0,"cut_off":0,"failed":0,"skipped":0}}
"#
    );
    fs::write(folder.path("cache/runs/20260101-000000-abcd.jsonl"), record).unwrap();
    let told = folder.says(&["runs", "last", "basis"]);
    assert_has(&told, &["on 2 threads, because:\n            `k`: 5 -> 6\n", "ran  after 0.30 s"]);
    let (code, text) = folder.sinew(&["runs", "last", "bassi"]);
    assert_eq!(code, 2);
    assert_has(&text, &["tells nothing of `bassi`", "did you mean `basis`?"]);
}

// ---- tables ------------------------------------------------------------------------------------

/// A pipeline with a table, and the same with other numbers put into the store in its place.
const TABLE: &str = r#"[nodes.score]
kind = "table_file"
path = "measured.csv"

[outputs]
"score.csv" = "@score"
"#;

fn load(folder: &Folder) -> Graph {
    pipeline::load(&folder.path("p.toml"), &LIBRARY, &Settings::default())
        .unwrap_or_else(|e| panic!("{}", e.render(false)))
}

/// Stores other artifacts for a node than it would make, as a machine that computes wrongly does.
fn forge(folder: &Folder, node: &str, port: &str, table: Table) {
    let graph = load(folder);
    let store = Store::open(&folder.path("cache"), Access::ReadWrite).unwrap();
    let memory = PipelineMemory::new(&store, &graph);
    let plan = plan::plan(&graph, &[], &Default::default(), &memory);
    let index = graph.select(node)[0];
    let Status::Cached { key } = plan.statuses[index.index()] else {
        panic!("{:?}", plan.statuses[index.index()])
    };
    let mut entry: Entry = (*store.entry(&key).unwrap()).clone();
    let (artifact, bytes) = AnyArtifact::encode(table);
    let digest: Digest = artifact.digest();
    let output: &mut EntryOutput = entry.outputs.iter_mut().find(|it| it.port == port).unwrap();
    (output.digest, output.bytes) = (digest, bytes.len() as u64);
    store.write(vec![NewEntry { key, entry, objects: vec![(digest, bytes)] }]).unwrap();
}

fn read_table(folder: &Folder) -> Vec<String> {
    let text = fs::read_to_string(folder.path("score.csv")).unwrap();
    text.lines().map(str::to_owned).collect()
}

#[test]
fn numbers_stand_side_by_side_and_a_worse_one_ends_with_5() {
    let folder = Folder::new(TABLE);
    folder.write("measured.csv", "joint,error [mm]\na,1\nb,2\n");
    folder.says(&["run", "p.toml"]);
    let before = read_table(&folder);
    let verified = folder.says(&["verify", "p.toml", "--rerun"]);
    assert_has(&verified, &["Verified  1 result the same again"]);
    let table = |errors: Vec<f64>| {
        let names = ["a", "b", "c"].map(str::to_owned).to_vec();
        Table::new(vec![Column::texts("joint", names), Column::numbers("error", "mm", errors)])
    };
    forge(&folder, "score", "table", table(vec![1.0, 2.0, 4.0]));
    folder.says(&["run", "p.toml"]);
    assert_ne!(read_table(&folder), before);
    forge(&folder, "score", "table", table(vec![1.0, 3.0, f64::NAN]));
    folder.says(&["run", "p.toml"]);
    let diff = folder.says(&["diff", "last~1", "last"]);
    assert_has(
        &diff,
        &[
            "Results that differ",
            "score.table  table  score",
            "Table score.table (rows matched by `joint`)",
            "error [mm]  1.5          2           +0.5        +33.33 %  1 / 0 / 1, 1 gone missing",
            "error [mm]  c    4       missing",
            "error [mm]  b    2       3        +1          +50.00 %",
        ],
    );
    let markdown = folder.says(&["diff", "--md"]);
    assert_has(
        &markdown,
        &[
            "### Table score.table (rows matched by `joint`)\n\n| column | mean before |",
            "|---|---|---|---|---|---|\n",
            "| error [mm] | b | 2 | 3 | +1 | +50.00 % |\n",
        ],
    );
    let numbers: Vec<Value> =
        folder.json(&["diff"]).into_iter().filter(|it| it["fact"] == "number").collect();
    assert_eq!(numbers.len(), 3);
    assert_eq!((&numbers[1]["row"], &numbers[1]["difference"]), (&"b".into(), &1.0.into()));
    let fails = |args: &[&str]| folder.sinew(&[&["diff"], args].concat()).0;
    assert_eq!(fails(&["--fail-above", "10"]), 5);
    // The number that went missing counts at any limit.
    assert_eq!(fails(&["--fail-above", "60"]), 5);
    assert_eq!(fails(&["--fail-above", "10", "--column", "other"]), 0);
    forge(&folder, "score", "table", table(vec![1.0, 2.0, 3.0]));
    folder.says(&["run", "p.toml"]);
    forge(&folder, "score", "table", table(vec![1.0, 2.5, 3.0]));
    folder.says(&["run", "p.toml"]);
    assert_eq!(fails(&["--fail-above", "25"]), 0);
    assert_eq!(fails(&["--fail-above", "24"]), 5);
    assert_eq!(fails(&["--fail-above", "24", "--worse", "smaller"]), 0);
    assert_eq!(fails(&["--fail-above", "24", "--worse", "larger"]), 5);
    // A forged result is found when it is made again, and nothing is written over it.
    let (code, text) = folder.sinew(&["verify", "p.toml", "--rerun", "-j", "2"]);
    assert_eq!(code, 4, "{text}");
    assert_has(&text, &["DIFFERS  score", "`table`: array `numbers` is F64", "1 differ"]);
    assert_has(&folder.says(&["plan", "p.toml", "--fail-if-stale"]), &["1 cached"]);
    // What is no longer stored cannot be compared, and is not guessed.
    folder.says(&["cache", "rm", "--all"]);
    let diff = folder.says(&["diff"]);
    assert_has(&diff, &["score.table  no longer stored  score"]);
}

// ---- watch -------------------------------------------------------------------------------------

/// A running `sinew watch` and what it says.
struct Watcher {
    child: Child,
    lines: Receiver<String>,
}

impl Watcher {
    fn start(folder: &Folder) -> Self {
        let mut command = folder.command(&["watch", "p.toml", "--poll", "20"]);
        // Who runs the tests may ignore the signal (`nohup`), and children inherit that.
        // SAFETY: `signal` may be called between fork and exec.
        unsafe {
            std::os::unix::process::CommandExt::pre_exec(&mut command, || {
                libc::signal(libc::SIGINT, libc::SIG_DFL);
                Ok(())
            });
        }
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let stderr = BufReader::new(child.stderr.take().unwrap());
        let (sender, lines) = channel();
        thread::spawn(move || {
            for line in stderr.lines().map_while(Result::ok) {
                let _ = sender.send(line);
            }
        });
        Self { child, lines }
    }

    /// All that is said until a line with this text comes.
    #[track_caller]
    fn wait_for(&self, text: &str) -> String {
        let mut said = String::new();
        loop {
            match self.lines.recv_timeout(Duration::from_secs(60)) {
                Ok(line) => {
                    said += &format!("{line}\n");
                    if line.contains(text) {
                        return said;
                    }
                }
                Err(_) => panic!("`{text}` does not come after\n{said}"),
            }
        }
    }
}

impl Drop for Watcher {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn watching_follows_every_save_and_outlives_mistakes() {
    let folder = Folder::new(PIPELINE);
    let mut watcher = Watcher::start(&folder);
    watcher.wait_for("2 files; Ctrl-C ends");
    let output = |folder: &Folder| fs::read(folder.path("basis.npz")).unwrap();
    let first = output(&folder);
    folder.edit("k = 5", "k = 6");
    let said = watcher.wait_for("Ctrl-C ends");
    assert_has(&said, &["`k`: 5 -> 6 (p.toml:3)", "1 ran, 3 cached"]);
    let second = output(&folder);
    assert_ne!(first, second);
    folder.edit("k = 6", "k = 6.5");
    let said = watcher.wait_for("until that is mended; Ctrl-C ends");
    assert_has(&said, &["`k` must be an integer", "p.toml:21"]);
    assert_eq!(output(&folder), second, "the last good output stays");
    folder.edit("k = 6.5", "k = 7");
    let said = watcher.wait_for("Ctrl-C ends");
    assert_has(&said, &["`k`: 6 -> 7 (p.toml:3)"]);
    let third = output(&folder);
    assert_ne!(third, second);
    // A file that the pipeline reads, gone for a while.
    fs::remove_file(folder.path("cube.off")).unwrap();
    watcher.wait_for("until that is mended");
    folder.write("cube.off", &CUBE.replace("1 1 1\n", "1 1 2\n"));
    let said = watcher.wait_for("Ctrl-C ends");
    assert_has(&said, &["file `path` changed", "4 ran"]);
    assert_ne!(output(&folder), third);
    interrupt(&mut watcher.child);
}

/// Sends SIGINT, as Ctrl-C does, and waits for the end.
fn interrupt(child: &mut Child) {
    let id = i32::try_from(child.id()).unwrap();
    // SAFETY: a system call without memory, on a child that has not been waited for.
    assert_eq!(unsafe { libc::kill(id, libc::SIGINT) }, 0);
    for _ in 0..1000 {
        if let Some(status) = child.try_wait().unwrap() {
            return assert_eq!(status.code(), Some(130));
        }
        thread::sleep(Duration::from_millis(10));
    }
    panic!("SIGINT did not end it");
}

// ---- computing again, without geometry -----------------------------------------------------------

mod toys {
    use std::collections::BTreeMap;

    use sinew::engine::{
        events::Silent,
        run::{self, RunOptions},
        toy::TOY,
        verify::{self, Verdict},
    };

    use super::*;

    const DRIFTING: &str = "[nodes.drift]\nkind = \"drift\"\n\n\
        [nodes.length]\nkind = \"count\"\ntext = \"@drift\"\n\n\
        [nodes.one]\nkind = \"number\"\nvalue = 1\n\n\
        [nodes.sum]\nkind = \"add\"\nterms = [\"@length\", \"@one\"]\n\n\
        [outputs]\n\"sum.txt\" = \"@sum\"\n";

    fn options(folder: &Path) -> RunOptions {
        RunOptions {
            threads: 2,
            output_dir: folder.to_owned(),
            run_id: "test".to_owned(),
            ..RunOptions::default()
        }
    }

    fn verdicts(file: &Path, store: &Store, n: usize, seed: u64) -> BTreeMap<String, Verdict> {
        let graph = pipeline::load(file, &TOY, &Settings::default()).map_err(|_| ()).unwrap();
        let options = options(file.parent().unwrap());
        let mut res = BTreeMap::new();
        let choose = |graph: &Graph, from| verify::sample(graph, from, n, seed);
        verify::rerun(graph, &TOY, store, &options, choose, |graph, index, verdict| {
            res.insert(graph.instances[index].id(), verdict.clone());
        });
        res
    }

    #[test]
    fn a_kind_that_drifts_is_found_and_what_stands_behind_it_is_judged_by_its_own_input() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("p.toml");
        fs::write(&file, DRIFTING).unwrap();
        let graph = pipeline::load(&file, &TOY, &Settings::default()).map_err(|_| ()).unwrap();
        let cache = folder.path().join("cache");
        {
            let store = Store::open(&cache, Access::ReadWrite).unwrap();
            run::run(&graph, &TOY, &store, &options(folder.path()), &mut Silent);
        }
        fs::remove_file(folder.path().join("sum.txt")).unwrap();
        let log = || {
            let path = fs::read_dir(cache.join("log")).unwrap().next().unwrap().unwrap().path();
            fs::read(path).unwrap()
        };
        let before = log();
        let store = Store::open(&cache, Access::ReadOnly).unwrap();
        let found = verdicts(&file, &store, usize::MAX, 0);
        for good in ["length", "one", "sum"] {
            assert_eq!(found[good], Verdict::Good, "{good}");
        }
        let Verdict::Differs { port, how } = &found["drift"] else { panic!("{found:?}") };
        assert_eq!((port.as_str(), how.as_str()), ("text", "its text `text` differs"));
        // Nothing was written: neither a result nor a file of the user.
        assert_eq!(log(), before);
        assert!(!folder.path().join("sum.txt").exists());
        // A sample has its size, and the same seed chooses the same.
        let sampled = verdicts(&file, &store, 2, 5);
        assert_eq!(sampled.len(), 2);
        let names = |it: &BTreeMap<String, Verdict>| it.keys().cloned().collect::<Vec<_>>();
        assert_eq!(names(&verdicts(&file, &store, 2, 5)), names(&sampled));
        let others =
            (0..20).any(|seed| names(&verdicts(&file, &store, 2, seed)) != names(&sampled));
        assert!(others, "another seed chooses others");
        // Without the text, its reader cannot be verified, and that is said.
        fs::remove_dir_all(cache.join("objects")).unwrap();
        let found = verdicts(&file, &store, usize::MAX, 0);
        assert_eq!(
            found["length"],
            Verdict::Absent("its input `text` is no longer stored".to_owned())
        );
        assert_eq!(found["sum"], Verdict::Good);
    }
}
