//! `sinew run`: brings a pipeline up to date.

use std::{
    io::Write,
    path::PathBuf,
    time::{Instant, SystemTime},
};

use crossbeam_channel::Receiver;

use super::{
    Exit, Failure, Ui,
    common::{self, StoreArgs},
    pipeline_args::PipelineArgs,
    progress::Progress,
    signals,
    summary::summarize,
};
use crate::engine::{
    clock,
    events::{Event, Observer, RunReport},
    graph::Graph,
    node::Surroundings,
    record::{self, Liner, RECORD_VERSION, Recorder, RunStart, SourceText},
    run::{self, RunOptions, WorkerProgram},
    settings::parse_size,
    store::{Access, Store},
};

/// Run a pipeline: compute what is missing or changed, write its outputs
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    pub pipeline: PipelineArgs,

    /// Nodes to bring up to date with all they need; all if none is named
    nodes: Vec<String>,

    #[command(flatten)]
    store: StoreArgs,

    /// Threads for all nodes together
    #[arg(short, long, value_name = "N", env = "SINEW_JOBS")]
    jobs: Option<usize>,

    /// Memory that results may take before they are dropped and read again, such as 8G
    #[arg(long, value_name = "SIZE", env = "SINEW_MEM", value_parser = parse_size)]
    mem: Option<u64>,

    /// Computes a node again although its result is stored
    #[arg(long, value_name = "NODE")]
    force: Vec<String>,

    /// Starts nothing more after the first failure
    #[arg(long)]
    fail_fast: bool,

    /// Reads the cache but writes nothing to it
    #[arg(long)]
    read_only_cache: bool,

    /// Uses no network
    #[arg(long, env = "SINEW_OFFLINE")]
    offline: bool,

    /// Folders where downloads are looked up first, by content
    #[arg(long, value_name = "DIR", env = "SINEW_MIRROR", value_delimiter = ':')]
    mirror: Vec<PathBuf>,

    /// The folder that the paths of `[outputs]` are relative to
    #[arg(long, value_name = "DIR", default_value = ".")]
    out: PathBuf,
}

pub fn run(args: &Args, ui: &Ui) -> Result<Exit, Failure> {
    // The process ends with the run: to take thousands of instances apart would only cost time.
    let graph = Box::leak(Box::new(args.pipeline.find_or_load(&args.store)?));
    run_graph(graph, args, &stop_requests()?, ui)
}

/// Ctrl-C as messages. To be asked for once.
pub fn stop_requests() -> Result<Receiver<()>, Failure> {
    signals::stop_requests()
        .map_err(|e| Failure::environment(format_args!("cannot listen for Ctrl-C: {e}")))
}

/// Runs a pipeline that has been read, until it is done or `stop` says so.
pub fn run_graph(
    graph: &Graph,
    args: &Args,
    stop: &Receiver<()>,
    ui: &Ui,
) -> Result<Exit, Failure> {
    let store =
        if args.read_only_cache { args.store.open_read_only()? } else { args.store.open()? };
    args.pipeline.keep(graph, &store);
    let options = RunOptions {
        threads: args.jobs.unwrap_or_else(available_threads).max(1),
        memory: args.mem.unwrap_or_else(default_memory),
        targets: common::select_all(graph, &args.nodes)?,
        forced: common::select_all(graph, &args.force)?.into_iter().collect(),
        fail_fast: args.fail_fast,
        surroundings: Surroundings {
            mirrors: args.mirror.clone(),
            offline: args.offline,
            isolated: false,
        },
        output_dir: args.out.clone(),
        run_id: record::new_run_id(store.dir()),
        worker: Some(this_program()),
        stop: stop.clone(),
    };
    let start = run_start(graph, &options);
    let mut watch = Watch::new(graph, &store, &start, ui);
    let report = run::run(graph, &crate::LIBRARY, &store, &options, &mut watch);
    watch.end(&report, graph, args, ui, &options.run_id);
    exit_code(&report, &store)
}

/// Everybody who watches a run from the command line.
struct Watch {
    progress: Progress,
    recorder: Option<Recorder>,
    json: Option<Liner>,
}

impl Watch {
    fn new(graph: &Graph, store: &Store, start: &RunStart, ui: &Ui) -> Self {
        let recorder =
            (store.access() == Access::ReadWrite).then(|| Recorder::start(store.dir(), start));
        let json = ui.json.then(|| {
            print_line(&record::Line::RunStart(start.clone()));
            Liner::new(Instant::now())
        });
        Self { progress: Progress::new(graph, ui.detail, ui.live), recorder, json }
    }

    fn end(mut self, report: &RunReport, graph: &Graph, args: &Args, ui: &Ui, run_id: &str) {
        self.progress.finish();
        if let Some(json) = &self.json {
            print_line(&json.done(report));
        }
        if let Some(recorder) = self.recorder {
            recorder.done(report);
        }
        if ui.detail != super::ui::Detail::Quiet {
            summarize(report, graph, &args.pipeline, run_id);
        }
    }
}

impl Observer for Watch {
    fn event(&mut self, graph: &Graph, event: &Event<'_>) {
        self.progress.event(graph, event);
        if let Some(recorder) = &mut self.recorder {
            recorder.event(graph, event);
        }
        if let Some(line) = self.json.as_ref().and_then(|it| it.line(graph, event)) {
            print_line(&line);
        }
    }
}

fn print_line(line: &record::Line) {
    let text = serde_json::to_string(line).expect("lines are plain data");
    // A reader that has gone away (`| head`) does not stop the run.
    let _ = writeln!(std::io::stdout(), "{text}");
}

/// This very program, also when its file has been replaced meanwhile.
pub fn this_program() -> WorkerProgram {
    WorkerProgram { path: "/proc/self/exe".into(), args: vec!["worker".to_owned()] }
}

fn exit_code(report: &RunReport, store: &Store) -> Result<Exit, Failure> {
    if let Some(error) = &report.store_error {
        return Err(Failure::environment(format_args!(
            "{error}\nwhat was stored in `{}` before is kept; run again to go on from there",
            store.dir().display()
        )));
    }
    Ok(match report {
        it if it.succeeded() => Exit::Success,
        it if it.stopped => Exit::Interrupted,
        it if it.panicked() => Exit::Bug,
        it if it.environment_failed() => Exit::Environment,
        _ => Exit::NodeFailed,
    })
}

fn run_start(graph: &Graph, options: &RunOptions) -> RunStart {
    let source = |it: &crate::engine::graph::Source| SourceText {
        path: it.path.clone(),
        text: it.text.to_string(),
    };
    RunStart {
        v: RECORD_VERSION,
        run: options.run_id.clone(),
        time: clock::iso_utc(SystemTime::now()),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        title: graph.title.clone(),
        args: std::env::args().collect(),
        folder: std::env::current_dir().unwrap_or_default(),
        host: std::fs::read_to_string("/etc/hostname").unwrap_or_default().trim().to_owned(),
        threads: options.threads,
        sources: graph.sources.iter().map(source).collect(),
    }
}

pub fn available_threads() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Half of the machine's memory.
pub fn default_memory() -> u64 {
    // SAFETY: plain system calls without memory.
    let (pages, size) =
        unsafe { (libc::sysconf(libc::_SC_PHYS_PAGES), libc::sysconf(libc::_SC_PAGESIZE)) };
    u64::try_from(pages).unwrap_or(1 << 20) * u64::try_from(size).unwrap_or(4096) / 2
}
