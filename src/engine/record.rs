//! Run records: one file of JSON lines a run, from which it can be told again.
//!
//! The same lines are the machine-readable output of `sinew run --json`. Trouble with a record never
//! fails a run.

use std::{
    collections::BTreeMap,
    fs::{self, File},
    io::{self, BufRead, BufReader, BufWriter, Write},
    path::{Path, PathBuf},
    time::{Instant, SystemTime},
};

use petgraph::graph::NodeIndex;
use serde::{Deserialize, Serialize, Serializer};

use super::{
    clock,
    digest::Digest,
    events::{Event, ExportOutcome, Failure, Observer, Outcome, RunReport},
    graph::Graph,
    plan::Outputs,
    why::{Places, Why},
};

/// Raise it when a line changes its meaning. Fields are only added, so that old records stay
/// readable; what a reader does not know it passes over.
///
/// 2: `node_start` has `why`, the reason as data.
pub const RECORD_VERSION: u32 = 2;

/// One line of a record.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Line {
    RunStart(RunStart),
    Planned {
        t: f64,
        nodes: usize,
        cached: usize,
    },
    NodeStart(NodeStart),
    NodeProgress {
        t: f64,
        node: String,
        fraction: Option<f64>,
        text: String,
    },
    NodeWaiting {
        t: f64,
        node: String,
    },
    NodeRetry {
        t: f64,
        node: String,
        retry: u32,
        retries: u32,
        wait_s: f64,
        message: String,
    },
    Stopping {
        t: f64,
        now: bool,
    },
    NodeDone(NodeDone),
    Output {
        t: f64,
        path: PathBuf,
        status: String,
        bytes: Option<u64>,
        message: Option<String>,
    },
    Warning {
        t: f64,
        text: String,
    },
    RunDone {
        t: f64,
        ran: usize,
        cached: usize,
        cut_off: usize,
        failed: usize,
        skipped: usize,
        /// It was asked to stop.
        #[serde(default)]
        stopped: bool,
    },
}

/// What was run, by whom, with what.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunStart {
    pub v: u32,
    pub run: String,
    /// UTC.
    pub time: String,
    /// The program's version.
    pub version: String,
    pub title: Option<String>,
    /// The command line.
    pub args: Vec<String>,
    /// The folder in which it was given.
    pub folder: PathBuf,
    pub host: String,
    pub threads: usize,
    /// Every pipeline file that was read, as it was; the first is the one that was asked for.
    pub sources: Vec<SourceText>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SourceText {
    pub path: PathBuf,
    pub text: String,
}

/// An instance begins to run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NodeStart {
    /// Seconds since the start of the run.
    pub t: f64,
    pub node: String,
    pub threads: usize,
    pub reason: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub why: Option<Why>,
}

/// How it ended for one instance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NodeDone {
    /// Seconds since the start of the run.
    pub t: f64,
    pub node: String,
    pub kind: String,
    /// `ran`, `cached`, `cut_off`, `shared`, `failed`, `skipped`, `not_reached`.
    pub status: String,
    pub key: Option<Digest>,
    pub wall_s: Option<f64>,
    /// Why it ran, why it failed, or because of which node it was skipped.
    pub message: Option<String>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// Outputs by port.
    pub out: BTreeMap<String, Digest>,
}

/// Turns events into lines.
pub struct Liner {
    start: Instant,
    places: Places,
}

impl Liner {
    pub fn new(start: Instant) -> Self {
        Self { start, places: Places::default() }
    }

    /// Seconds since the start of the run, to microseconds.
    fn t(&self) -> f64 {
        (self.start.elapsed().as_secs_f64() * 1e6).round() / 1e6
    }

    /// The line of an event; none for instances that nobody wants.
    pub fn line(&self, graph: &Graph, event: &Event<'_>) -> Option<Line> {
        let t = self.t();
        let id = |instance: NodeIndex| graph.instances[instance].id();
        Some(match *event {
            Event::Planned { n_wanted, n_cached } => {
                Line::Planned { t, nodes: n_wanted, cached: n_cached }
            }
            Event::Started { instance, threads, reason } => Line::NodeStart(NodeStart {
                t,
                node: id(instance),
                threads,
                reason: reason.to_string(),
                why: Some(Why::of(graph, instance, reason, &self.places)),
            }),
            Event::Progress { instance, fraction, text } => {
                Line::NodeProgress { t, node: id(instance), fraction, text: text.to_owned() }
            }
            Event::Waiting { instance } => Line::NodeWaiting { t, node: id(instance) },
            Event::Warning { text } => Line::Warning { t, text: text.to_owned() },
            Event::Retrying { instance, retry, retries, wait, failure } => {
                let (wait_s, message) = (wait.as_secs_f64(), told(failure));
                Line::NodeRetry { t, node: id(instance), retry, retries, wait_s, message }
            }
            Event::Stopping { now, .. } => Line::Stopping { t, now },
            Event::Finished { outcome: Outcome::NotWanted, .. } => return None,
            Event::Finished { instance, outcome, key, outputs } => Line::NodeDone(self.node_done(
                graph,
                &id(instance),
                outcome,
                key,
                outputs,
                instance,
            )),
            Event::Exported { rule, outcome } => {
                let path = graph.outputs[rule].path.clone();
                let (status, bytes, message) = match outcome {
                    ExportOutcome::Written { bytes } => ("written", Some(*bytes), None),
                    ExportOutcome::UpToDate => ("up_to_date", None, None),
                    ExportOutcome::Failed { failure } => {
                        ("failed", None, Some(failure.message().to_owned()))
                    }
                    ExportOutcome::Skipped => ("skipped", None, None),
                };
                Line::Output { t, path, status: status.to_owned(), bytes, message }
            }
        })
    }

    fn node_done(
        &self,
        graph: &Graph,
        id: &str,
        outcome: &Outcome,
        key: Option<Digest>,
        outputs: Option<&Outputs>,
        instance: NodeIndex,
    ) -> NodeDone {
        let (status, wall, message, notes) = match outcome {
            Outcome::NotWanted => ("not_wanted", None, None, &[][..]),
            Outcome::Cached => ("cached", None, None, &[][..]),
            Outcome::CutOff => ("cut_off", None, None, &[][..]),
            Outcome::Shared => ("shared", None, None, &[][..]),
            Outcome::Ran { wall, reason, notes } => {
                ("ran", Some(*wall), Some(reason.to_string()), &notes[..])
            }
            Outcome::Failed { failure, wall } => {
                ("failed", Some(*wall), Some(told(failure)), &[][..])
            }
            Outcome::Skipped { because } => {
                ("skipped", None, Some(graph.instances[*because].id()), &[][..])
            }
            Outcome::NotReached => ("not_reached", None, None, &[][..]),
        };
        let artifacts = outputs.map(|it| &it.artifacts).into_iter().flatten();
        NodeDone {
            t: self.t(),
            node: id.to_owned(),
            kind: graph.instances[instance].kind.spec.kind.to_owned(),
            status: status.to_owned(),
            key,
            wall_s: wall.map(|it| it.as_secs_f64()),
            message,
            notes: notes.to_vec(),
            out: artifacts.map(|(port, info)| ((*port).to_owned(), info.digest)).collect(),
        }
    }

    /// The line of an instance that was stored, as [`Liner::line`] makes it, but written at once: a
    /// pipeline of ten thousand has ten thousand of them in every record.
    fn write_stored(
        &self,
        to: &mut Vec<u8>,
        graph: &Graph,
        instance: NodeIndex,
        status: &str,
        key: Option<Digest>,
        outputs: Option<&Outputs>,
    ) {
        let instance = &graph.instances[instance];
        let line = StoredLine {
            event: "node_done",
            t: self.t(),
            node: &instance.shown_id(),
            kind: instance.kind.spec.kind,
            status,
            key,
            wall_s: None,
            message: None,
            out: StoredOutputs(outputs),
        };
        serde_json::to_writer(&mut *to, &line).expect("lines are plain data");
        to.push(b'\n');
    }

    pub fn done(&self, report: &RunReport) -> Line {
        let counts = report.counts();
        Line::RunDone {
            t: self.t(),
            ran: counts.ran,
            cached: counts.cached,
            cut_off: counts.cut_off,
            failed: counts.failed,
            skipped: counts.skipped,
            stopped: report.stopped,
        }
    }
}

/// A [`Line::NodeDone`] of what was stored, with borrowed parts.
#[derive(Serialize)]
struct StoredLine<'a> {
    event: &'static str,
    t: f64,
    node: &'a str,
    kind: &'static str,
    status: &'a str,
    key: Option<Digest>,
    wall_s: Option<f64>,
    message: Option<&'a str>,
    out: StoredOutputs<'a>,
}

/// The digests of outputs, by port.
struct StoredOutputs<'a>(Option<&'a Outputs>);

impl Serialize for StoredOutputs<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let artifacts = self.0.into_iter().flat_map(|it| &it.artifacts);
        serializer.collect_map(artifacts.map(|(port, info)| (port, info.digest)))
    }
}

fn told(failure: &Failure) -> String {
    let bug = if matches!(failure, Failure::Panic(_)) { "panic: " } else { "" };
    format!("{bug}{}", failure.message())
}

/// Writes the record of a run as it goes.
pub struct Recorder {
    liner: Liner,
    file: Option<BufWriter<File>>,
    /// The line that is being written.
    line: Vec<u8>,
}

impl Recorder {
    /// Starts a record `runs/<id>.jsonl` in a store's folder.
    pub fn start(store: &Path, start: &RunStart) -> Self {
        let path = store.join("runs").join(format!("{}.jsonl", start.run));
        let file = File::options().write(true).create_new(true).open(&path);
        if let Err(error) = &file {
            tracing::warn!(path = %path.display(), %error, "the run is not recorded");
        }
        // Tells readers that the run is going on; it dies with the process.
        let file = file.ok().inspect(|it| drop(it.try_lock()));
        let file = file.map(|it| BufWriter::with_capacity(1 << 16, it));
        let mut res = Self { liner: Liner::new(Instant::now()), file, line: Vec::new() };
        res.write(&Line::RunStart(start.clone()), true);
        res
    }

    /// Ends the record.
    pub fn done(mut self, report: &RunReport) {
        let line = self.liner.done(report);
        self.write(&line, true);
    }

    fn write(&mut self, line: &Line, flush: bool) {
        serde_json::to_writer(&mut self.line, line).expect("lines are plain data");
        self.line.push(b'\n');
        self.write_line(flush);
    }

    fn write_line(&mut self, flush: bool) {
        let Some(file) = &mut self.file else { return self.line.clear() };
        let written = file.write_all(&self.line);
        self.line.clear();
        let result = written.and_then(|()| if flush { file.flush() } else { Ok(()) });
        if let Err(error) = result {
            tracing::warn!(%error, "the rest of the run is not recorded");
            self.file = None;
        }
    }
}

impl Observer for Recorder {
    fn event(&mut self, graph: &Graph, event: &Event<'_>) {
        match *event {
            Event::Progress { .. } => return,
            Event::Finished { instance, outcome: Outcome::Cached, key, outputs } => {
                let line = &mut self.line;
                self.liner.write_stored(line, graph, instance, "cached", key, outputs);
                return self.write_line(false);
            }
            _ => {}
        }
        // What is cached would be cached again; what ran must not be lost with the process.
        let flush = matches!(
            event,
            Event::Finished { outcome: Outcome::Ran { .. } | Outcome::Failed { .. }, .. }
                | Event::Stopping { .. }
        );
        if let Some(line) = self.liner.line(graph, event) {
            self.write(&line, flush);
        }
    }
}

/// A record as it was read.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    pub start: RunStart,
    /// All further lines; a run that was killed has no `RunDone`.
    pub lines: Vec<Line>,
}

impl Record {
    /// Reads a record. Lines that are torn, or that a later version has added, are left out.
    ///
    /// # Errors
    /// If the file cannot be read or does not begin as a record.
    pub fn read(path: &Path) -> io::Result<Self> {
        let mut lines = BufReader::new(File::open(path)?).lines();
        let damaged =
            |e: serde_json::Error| io::Error::new(io::ErrorKind::InvalidData, e.to_string());
        let first = lines.next().transpose()?.unwrap_or_default();
        let Line::RunStart(start) = serde_json::from_str(&first).map_err(damaged)? else {
            return Err(io::Error::new(
                io::ErrorKind::InvalidData,
                "it starts with no `run_start`",
            ));
        };
        let mut res = Self { start, lines: Vec::new() };
        for line in lines {
            // What is no text any more is no line either: the rest of the record may be sound.
            let line = match line {
                Ok(line) => line,
                Err(error) if error.kind() == io::ErrorKind::InvalidData => continue,
                Err(error) => return Err(error),
            };
            res.lines.extend(serde_json::from_str::<Line>(&line));
        }
        Ok(res)
    }

    /// What happened to an instance; the last time counts if it ran twice.
    pub fn node(&self, id: &str) -> Option<&NodeDone> {
        self.lines.iter().rev().find_map(|it| match it {
            Line::NodeDone(node) if node.node == id => Some(node),
            _ => None,
        })
    }

    /// Why instances ran, by their names.
    pub fn whys(&self) -> BTreeMap<&str, &Why> {
        let starts = self.lines.iter().filter_map(|it| match it {
            Line::NodeStart(start) => Some((start.node.as_str(), start.why.as_ref()?)),
            _ => None,
        });
        starts.collect()
    }

    /// How the run ended; `None` if it did not.
    pub fn done(&self) -> Option<&Line> {
        self.lines.iter().rev().find(|it| matches!(it, Line::RunDone { .. }))
    }

    /// The instances that ended, in this order.
    pub fn nodes(&self) -> impl Iterator<Item = &NodeDone> {
        self.lines.iter().filter_map(|it| match it {
            Line::NodeDone(node) => Some(node),
            _ => None,
        })
    }
}

/// Whether the run of a record is going on: its process holds a lock on the file.
pub fn is_going_on(path: &Path) -> bool {
    let locked = |it: File| matches!(it.try_lock_shared(), Err(fs::TryLockError::WouldBlock));
    File::open(path).is_ok_and(locked)
}

/// The name of the run that a record tells of.
pub fn name(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// Why a name names no run.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum FindError {
    #[error("there is no run `{name}`{}", hint(.runs))]
    None { name: String, runs: Vec<String> },
    #[error("there are several runs `{name}…`: `{}`", .runs.join("`, `"))]
    Several { name: String, runs: Vec<String> },
}

fn hint(runs: &[String]) -> String {
    match runs {
        [] => ": there is none at all".to_owned(),
        runs => format!(": the last ones are `{}`", runs.join("`, `")),
    }
}

/// The record of a run: `last` (or `latest`), `last~2` for the second one before it, or the beginning
/// of a name that no other run shares.
///
/// # Errors
/// With the runs that could be meant.
pub fn find(store: &Path, name: &str) -> Result<PathBuf, FindError> {
    let paths = list(store);
    let (base, back) = name.split_once('~').unwrap_or((name, "0"));
    if let ("last" | "latest", Ok(back)) = (base, back.parse::<usize>()) {
        return paths.get(back).cloned().ok_or_else(|| none(name, &paths));
    }
    let mut found: Vec<&PathBuf> =
        paths.iter().filter(|it| self::name(it).starts_with(name)).collect();
    if let Some(exact) = found.iter().find(|it| self::name(it) == name) {
        return Ok((*exact).clone());
    }
    found.truncate(6);
    match found[..] {
        [] => Err(none(name, &paths)),
        [one] => Ok(one.clone()),
        _ => Err(FindError::Several {
            name: name.to_owned(),
            runs: found.iter().map(|it| self::name(it)).collect(),
        }),
    }
}

fn none(name: &str, paths: &[PathBuf]) -> FindError {
    let runs = paths.iter().take(4).map(|it| self::name(it)).collect();
    FindError::None { name: name.to_owned(), runs }
}

/// The paths of all records in a store's folder, newest first.
///
/// By name: names grow ([`new_run_id`]), while files may be copied, touched, or come from a machine
/// with another clock.
pub fn list(store: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(store.join("runs")).into_iter().flatten().flatten();
    let mut paths: Vec<PathBuf> = entries
        .map(|it| it.path())
        .filter(|it| it.extension().is_some_and(|e| e == "jsonl"))
        .collect();
    paths.sort();
    paths.reverse();
    paths
}

/// A name for a run that starts now: its time, and something that tells it from others.
///
/// The newest run always has the greatest name. If the clock was turned back, or two runs start in
/// one second, a number that is one greater than that of the newest run tells which came later.
pub fn new_run_id(store: &Path) -> String {
    let now = SystemTime::now();
    let salt = format!("{now:?} {}", std::process::id());
    let salt = &Digest::of(salt.as_bytes()).to_string()[..4];
    let newest = list(store).first().map(|it| name(it)).unwrap_or_default();
    next_name(&clock::compact_utc(now), salt, &newest)
}

/// The name for a time that sorts after the newest one.
fn next_name(time: &str, salt: &str, newest: &str) -> String {
    let is_time = |it: &&str| it.bytes().all(|it| it.is_ascii_digit() || it == b'-');
    let newest_time = newest.get(..time.len()).filter(is_time).filter(|it| *it >= time);
    let Some(newest_time) = newest_time else { return format!("{time}-{salt}") };
    // `x` sorts after the hexadecimal digits of a salt.
    let counted = newest[time.len()..].strip_prefix("-x").and_then(|it| it.split('-').next());
    let number = counted.and_then(|it| it.parse::<u32>().ok()).unwrap_or(0) + 1;
    format!("{newest_time}-x{number:04}-{salt}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::{
        pipeline::{self, Settings},
        plan::OutputInfo,
        toy::TOY,
    };

    #[test]
    fn what_was_stored_is_written_as_any_other_line() {
        let text = "[axes.n]\nvalues = [1, 2]\n[nodes.\"a\"]\nkind = \"number\"\nvalue = \"${n}\"\n\
                    [nodes.parts]\nkind = \"divide\"\nnumber = \"@a\"\nby = 2\n";
        let settings = Settings::default();
        let graph = pipeline::load_text(text, PathBuf::new(), &TOY, &settings).ok().unwrap();
        let liner = Liner::new(Instant::now());
        let without_time = |text: &[u8]| {
            let text = std::str::from_utf8(text).unwrap();
            let (start, rest) = text.split_once("\"t\":").unwrap();
            format!("{start}{}", rest.split_once(',').unwrap().1)
        };
        for instance in graph.instances.node_indices() {
            let ports = graph.instances[instance].kind.spec.outputs;
            let info = |it: &str| OutputInfo { digest: Digest::of(it.as_bytes()), bytes: 1 };
            let artifacts = ports.iter().map(|it| (it.name, info(it.name))).collect();
            let outputs = Outputs { artifacts, ..Outputs::default() };
            for outputs in [None, Some(&outputs)] {
                let key = outputs.map(|_| Digest::of(b"key"));
                let mut written = Vec::new();
                liner.write_stored(&mut written, &graph, instance, "cached", key, outputs);
                let event = Event::Finished { instance, outcome: &Outcome::Cached, key, outputs };
                let line = serde_json::to_vec(&liner.line(&graph, &event)).unwrap();
                assert_eq!(without_time(&written), without_time(&line) + "\n");
            }
        }
    }

    #[test]
    fn names_of_runs_grow_whatever_the_clock_does() {
        let times = [
            "20260101-000000",
            "20260101-000000",
            "20260101-000000",
            "20991231-235959",
            "20260101-000001",
            "20260101-000002",
        ];
        let mut names = vec![String::new()];
        for (index, time) in times.iter().enumerate() {
            // Salts that do not help: the later, the smaller.
            let salt = format!("{:04x}", 0xffff - index);
            names.push(next_name(time, &salt, names.last().unwrap()));
        }
        assert!(names.is_sorted_by(|a, b| a < b), "{names:?}");
        assert_eq!(names[1], "20260101-000000-ffff");
        assert_eq!(
            next_name("20260101-000000", "abcd", "zz-not-named-by-us"),
            "20260101-000000-abcd"
        );
    }
}
