//! From what happens in a run to the lines that tell it.

use std::time::Instant;

use petgraph::graph::NodeIndex;
use serde::{Serialize, Serializer};

use super::{Line, NodeDone, NodeStart};
use crate::engine::{
    digest::Digest,
    events::{Event, ExportOutcome, Failure, Outcome, RunReport},
    graph::Graph,
    plan::Outputs,
    why::{Places, Why},
};

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
    pub fn write_stored(
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

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

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
}
