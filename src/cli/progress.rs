//! What a run shows while it goes: lines for people on standard error.

use std::{
    collections::{BTreeMap, HashMap},
    io::Write,
    time::Duration,
};

use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressStyle};
use petgraph::graph::NodeIndex;

use super::{
    style,
    ui::Detail,
    words::{go_on, show_failure},
};
use crate::engine::{
    clock::{show_bytes, show_duration},
    events::{Event, ExportOutcome, Failure, Observer, Outcome},
    graph::Graph,
    settings::show_limit,
    why::{self, Places, Standing, Why},
};

/// Shows a run on a terminal or in a log.
pub struct Progress {
    detail: Detail,
    live: Option<Live>,
    /// Names are padded to this width.
    width: usize,
    places: Places,
    /// Why instances ran so far, by name: what comes later says what it comes from.
    whys: HashMap<String, Why>,
}

/// The moving part at the bottom of a terminal.
struct Live {
    bars: MultiProgress,
    total: ProgressBar,
    running: BTreeMap<NodeIndex, ProgressBar>,
}

impl Progress {
    /// `live`: bars that move, for a terminal.
    pub fn new(graph: &Graph, detail: Detail, live: bool) -> Self {
        let width = graph.instances.node_weights().map(|it| it.id().chars().count()).max();
        let live = (live && detail != Detail::Quiet).then(|| {
            let bars = MultiProgress::with_draw_target(ProgressDrawTarget::stderr_with_hz(10));
            let total = bars.add(ProgressBar::new(0));
            let template = "  {bar:24} {pos}/{len} nodes  {elapsed}  {msg}";
            total.set_style(ProgressStyle::with_template(template).expect("a valid template"));
            Live { bars, total, running: BTreeMap::new() }
        });
        Self {
            detail,
            live,
            width: width.unwrap_or(0).min(40),
            places: Places::default(),
            whys: HashMap::new(),
        }
    }

    /// Takes the moving part away.
    pub fn finish(&mut self) {
        if let Some(live) = self.live.take() {
            live.total.finish_and_clear();
            let _ = live.bars.clear();
        }
    }

    fn line(&self, word: &str, style: anstyle::Style, rest: &str) {
        let text = format!("{style}{word:>10}{style:#}  {rest}");
        // A terminal that has gone away does not stop the run.
        let write = || drop(writeln!(anstream::stderr(), "{text}"));
        match &self.live {
            Some(live) => live.bars.suspend(write),
            None => write(),
        }
    }

    fn finished(&mut self, graph: &Graph, index: NodeIndex, outcome: &Outcome) {
        if let Some(live) = &mut self.live
            && *outcome != Outcome::NotWanted
        {
            live.total.inc(1);
            if let Some(bar) = live.running.remove(&index) {
                bar.finish_and_clear();
            }
        }
        let id = graph.instances[index].id();
        let padded = format!("{id:width$}", width = self.width);
        let verbose = self.detail == Detail::Verbose;
        match outcome {
            Outcome::Ran { wall, reason, notes } if self.detail != Detail::Quiet => {
                let time = show_duration(*wall);
                let why = Why::of(graph, index, reason, &self.places);
                let look_up = |id: &str| self.whys.get(id).map(|it| Standing::Runs(it.clone()));
                let text = why::headline(&why, &look_up);
                self.line("ran", style::GOOD, &format!("{padded}  {time:>8}  {text}"));
                self.whys.insert(id.clone(), why);
                for note in notes {
                    self.line("note", style::NOTE, &format!("{id}: {note}"));
                }
            }
            Outcome::CutOff if self.detail != Detail::Quiet => {
                self.line("cut off", style::CACHED, &format!("{padded}  its inputs are as before"));
            }
            Outcome::Cached if verbose => self.line("cached", style::CACHED, &padded),
            Outcome::Shared if verbose => {
                self.line("shared", style::CACHED, &format!("{padded}  computed elsewhere"));
            }
            Outcome::Failed { failure, .. } => {
                let place = graph.show_place(&graph.instances[index].place);
                self.line("FAILED", style::BAD, &format!("{padded}  {}", show_failure(failure)));
                self.line("", style::NOTE, &format!("{:width$}  {place}", "", width = self.width));
            }
            Outcome::Skipped { because } if self.detail != Detail::Quiet => {
                let cause = graph.instances[*because].id();
                self.line("skipped", style::WARN, &format!("{padded}  needs {cause}"));
            }
            _ => {}
        }
    }

    fn retrying(&mut self, graph: &Graph, index: NodeIndex, what: &str, failure: &Failure) {
        if let Some(live) = &mut self.live
            && let Some(bar) = live.running.remove(&index)
        {
            bar.finish_and_clear();
        }
        if self.detail != Detail::Quiet {
            let id = graph.instances[index].id();
            let (width, message) = (self.width, show_failure(failure));
            self.line("retry", style::WARN, &format!("{id:width$}  {what}: {message}"));
        }
    }

    fn stopping(&self, n_running: usize) {
        let nodes = super::words::count(n_running, "running node");
        let text = match n_running {
            0 => "nothing is running".to_owned(),
            _ => format!("waits for {nodes}; Ctrl-C again ends at once"),
        };
        self.line("stopping", style::WARN, &text);
    }

    fn exported(&self, graph: &Graph, rule: usize, outcome: &ExportOutcome) {
        let path = graph.outputs[rule].path.display();
        match outcome {
            ExportOutcome::Written { bytes } if self.detail != Detail::Quiet => {
                self.line("wrote", style::GOOD, &format!("{path}  {}", show_bytes(*bytes)));
            }
            ExportOutcome::UpToDate if self.detail == Detail::Verbose => {
                self.line("kept", style::CACHED, &format!("{path}  up to date"));
            }
            ExportOutcome::Failed { failure } => {
                self.line("FAILED", style::BAD, &format!("{path}  {}", show_failure(failure)));
            }
            _ => {}
        }
    }
}

impl Observer for Progress {
    fn event(&mut self, graph: &Graph, event: &Event<'_>) {
        match *event {
            Event::Planned { n_wanted, n_cached } => {
                if let Some(live) = &self.live {
                    live.total.set_length(n_wanted as u64);
                }
                if self.detail != Detail::Quiet && n_cached < n_wanted {
                    let to_run = n_wanted - n_cached;
                    let text = format!("{n_wanted} nodes: {n_cached} cached, {to_run} to do");
                    self.line("Planned", style::HEAD, &text);
                }
            }
            Event::Started { instance, threads, .. } => {
                let id = graph.instances[instance].id();
                if let Some(live) = &mut self.live {
                    let bar = live.bars.add(ProgressBar::new_spinner());
                    let template = "  {spinner} {prefix}  {elapsed}  {msg}";
                    bar.set_style(
                        ProgressStyle::with_template(template).expect("a valid template"),
                    );
                    bar.set_prefix(id);
                    bar.enable_steady_tick(Duration::from_millis(100));
                    live.running.insert(instance, bar);
                } else if self.detail == Detail::Verbose {
                    self.line("start", style::NOTE, &format!("{id}  {threads} threads"));
                }
            }
            Event::Progress { instance, fraction, text } => {
                if let Some(bar) = self.live.as_ref().and_then(|it| it.running.get(&instance)) {
                    let percent = fraction.map(|it| format!("{:.0} %  ", it * 100.0));
                    bar.set_message(format!("{}{text}", percent.unwrap_or_default()));
                }
            }
            Event::Waiting { instance } => {
                if self.detail == Detail::Verbose {
                    let id = graph.instances[instance].id();
                    self.line("waiting", style::NOTE, &format!("{id}  another run computes it"));
                }
            }
            Event::Retrying { instance, retry, retries, wait, failure } => {
                let what = format!("{retry}/{retries} in {}", show_limit(wait));
                self.retrying(graph, instance, &what, failure);
            }
            Event::Stopping { .. } if self.detail == Detail::Quiet => {}
            Event::Stopping { now: false, n_running, .. } => self.stopping(n_running),
            Event::Stopping { now: true, n_done, n_wanted, .. } => {
                self.line("stopped", style::WARN, &go_on(n_done, n_wanted));
            }
            Event::Finished { instance, outcome, .. } => self.finished(graph, instance, outcome),
            Event::Exported { rule, outcome } => self.exported(graph, rule, outcome),
            Event::Warning { text } => self.line("warning", style::WARN, text),
        }
    }
}
