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
use serde::{Deserialize, Serialize};

use super::{
    clock,
    digest::Digest,
    events::{Event, ExportOutcome, Failure, Observer, Outcome, RunReport},
    graph::Graph,
    plan::Outputs,
};

/// Raise it when a line changes its meaning.
pub const RECORD_VERSION: u32 = 1;

/// One line of a record.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Line {
    RunStart(RunStart),
    Planned { t: f64, nodes: usize, cached: usize },
    NodeStart { t: f64, node: String, threads: usize, reason: String },
    NodeProgress { t: f64, node: String, fraction: Option<f64>, text: String },
    NodeWaiting { t: f64, node: String },
    NodeDone(NodeDone),
    Output { t: f64, path: PathBuf, status: String, bytes: Option<u64>, message: Option<String> },
    Warning { t: f64, text: String },
    RunDone { t: f64, ran: usize, cached: usize, cut_off: usize, failed: usize, skipped: usize },
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
}

impl Liner {
    pub fn new(start: Instant) -> Self {
        Self { start }
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
            Event::Started { instance, threads, reason } => {
                Line::NodeStart { t, node: id(instance), threads, reason: reason.to_string() }
            }
            Event::Progress { instance, fraction, text } => {
                Line::NodeProgress { t, node: id(instance), fraction, text: text.to_owned() }
            }
            Event::Waiting { instance } => Line::NodeWaiting { t, node: id(instance) },
            Event::Warning { text } => Line::Warning { t, text: text.to_owned() },
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
                let bug = if matches!(failure, Failure::Panic(_)) { "panic: " } else { "" };
                ("failed", Some(*wall), Some(format!("{bug}{}", failure.message())), &[][..])
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

    pub fn done(&self, report: &RunReport) -> Line {
        let counts = report.counts();
        Line::RunDone {
            t: self.t(),
            ran: counts.ran,
            cached: counts.cached,
            cut_off: counts.cut_off,
            failed: counts.failed,
            skipped: counts.skipped,
        }
    }
}

/// Writes the record of a run as it goes.
pub struct Recorder {
    liner: Liner,
    file: Option<BufWriter<File>>,
}

impl Recorder {
    /// Starts a record `runs/<id>.jsonl` in a store's folder.
    pub fn start(store: &Path, start: &RunStart) -> Self {
        let path = store.join("runs").join(format!("{}.jsonl", start.run));
        let file = File::options().write(true).create_new(true).open(&path);
        if let Err(error) = &file {
            tracing::warn!(path = %path.display(), %error, "the run is not recorded");
        }
        let file = file.ok().map(|it| BufWriter::with_capacity(1 << 16, it));
        let mut res = Self { liner: Liner::new(Instant::now()), file };
        res.write(&Line::RunStart(start.clone()), true);
        res
    }

    /// Ends the record.
    pub fn done(mut self, report: &RunReport) {
        let line = self.liner.done(report);
        self.write(&line, true);
    }

    fn write(&mut self, line: &Line, flush: bool) {
        let Some(file) = &mut self.file else { return };
        let mut text = serde_json::to_vec(line).expect("lines are plain data");
        text.push(b'\n');
        let result = file.write_all(&text).and_then(|()| if flush { file.flush() } else { Ok(()) });
        if let Err(error) = result {
            tracing::warn!(%error, "the rest of the run is not recorded");
            self.file = None;
        }
    }
}

impl Observer for Recorder {
    fn event(&mut self, graph: &Graph, event: &Event<'_>) {
        if matches!(event, Event::Progress { .. }) {
            return;
        }
        // What is cached would be cached again; what ran must not be lost with the process.
        let flush = matches!(
            event,
            Event::Finished { outcome: Outcome::Ran { .. } | Outcome::Failed { .. }, .. }
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
    /// Reads a record. A torn last line is left out.
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
            match serde_json::from_str(&line?) {
                Ok(line) => res.lines.push(line),
                Err(_) => break,
            }
        }
        Ok(res)
    }

    /// The instances that ended, in this order.
    pub fn nodes(&self) -> impl Iterator<Item = &NodeDone> {
        self.lines.iter().filter_map(|it| match it {
            Line::NodeDone(node) => Some(node),
            _ => None,
        })
    }
}

/// The paths of all records in a store's folder, newest first.
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
pub fn new_run_id() -> String {
    let now = SystemTime::now();
    let salt = format!("{now:?} {}", std::process::id());
    format!("{}-{}", clock::compact_utc(now), &Digest::of(salt.as_bytes()).to_string()[..4])
}
