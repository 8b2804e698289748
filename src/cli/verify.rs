//! `sinew verify`: are the stored results what they should be?

use std::path::PathBuf;

use anstream::println;
use petgraph::graph::NodeIndex;

use super::{
    Exit, Failure, LIBRARY, Ui,
    common::{self, StoreArgs},
    pipeline_args::PipelineArgs,
    run::{available_threads, default_memory},
    style,
    ui::Detail,
    words::count,
};
use crate::engine::{
    graph::Graph,
    node::Surroundings,
    plan,
    run::RunOptions,
    verify::{self, Verdict},
};

/// Check the stored results of a pipeline against their digests, or by computing them again
///
/// Ends with exit code 4 if a result is damaged or comes out differently, and with 1 if it cannot be
/// computed again. What is not stored is told, and is no mistake.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    pipeline: PipelineArgs,

    /// Nodes to verify with all they need; all if none is named
    nodes: Vec<String>,

    #[command(flatten)]
    store: StoreArgs,

    /// Computes results again from the stored inputs and compares the bytes; writes nothing
    #[arg(long)]
    rerun: bool,

    /// Computes only so many results again, chosen by `--seed`
    #[arg(long, value_name = "N", requires = "rerun")]
    sample: Option<usize>,

    /// Chooses another sample
    #[arg(long, value_name = "S", default_value_t = 0, requires = "rerun")]
    seed: u64,

    /// Threads for all nodes together
    #[arg(short, long, value_name = "N", env = "SINEW_JOBS")]
    jobs: Option<usize>,

    /// Uses no network
    #[arg(long, env = "SINEW_OFFLINE")]
    offline: bool,

    /// Folders where downloads are looked up first, by content
    #[arg(long, value_name = "DIR", env = "SINEW_MIRROR", value_delimiter = ':')]
    mirror: Vec<PathBuf>,
}

pub fn run(args: &Args, ui: &Ui) -> Result<Exit, Failure> {
    let graph = args.pipeline.load()?;
    let targets = common::select_all(&graph, &args.nodes)?;
    let mut teller = Teller::new(&graph, ui);
    if args.rerun {
        let store = args.store.open_read_only()?;
        let options = options(args, targets);
        let choose = |graph: &Graph, from: Vec<NodeIndex>| match args.sample {
            Some(n) => verify::sample(graph, from, n, args.seed),
            None => from,
        };
        let tell = |graph: &Graph, index, verdict: &Verdict| teller.tell(graph, index, verdict);
        verify::rerun(graph, &LIBRARY, &store, &options, choose, tell);
    } else {
        // Open to be written, so that what is damaged is set aside and made again.
        let store = args.store.open()?;
        let memory = common::memory(&store, &graph);
        let plan = plan::plan(&graph, &targets, &std::collections::BTreeSet::new(), &memory);
        let tell = |index, verdict: &Verdict| teller.tell(&graph, index, verdict);
        verify::check_objects(&graph, &LIBRARY, &store, &plan, tell);
    }
    Ok(teller.end(args.rerun))
}

fn options(args: &Args, targets: Vec<NodeIndex>) -> RunOptions {
    RunOptions {
        threads: args.jobs.unwrap_or_else(available_threads).max(1),
        memory: default_memory(),
        targets,
        surroundings: Surroundings {
            mirrors: args.mirror.clone(),
            offline: args.offline,
            ..Surroundings::default()
        },
        run_id: "verify".to_owned(),
        worker: Some(super::run::this_program()),
        ..RunOptions::default()
    }
}

/// Tells verdicts as they come, and counts them.
struct Teller<'a> {
    ui: &'a Ui,
    width: usize,
    good: usize,
    bad: usize,
    failed: usize,
    absent: usize,
}

impl<'a> Teller<'a> {
    fn new(graph: &Graph, ui: &'a Ui) -> Self {
        let width = graph.instances.node_weights().map(|it| it.id().chars().count()).max();
        Self { ui, width: width.unwrap_or(0).min(40), good: 0, bad: 0, failed: 0, absent: 0 }
    }

    fn tell(&mut self, graph: &Graph, index: NodeIndex, verdict: &Verdict) {
        let (count, word, style, text) = match verdict {
            Verdict::Good => (&mut self.good, "good", style::GOOD, String::new()),
            Verdict::Absent(why) => (&mut self.absent, "absent", style::WARN, why.clone()),
            Verdict::Damaged { port } => {
                (&mut self.bad, "DAMAGED", style::BAD, format!("`{port}` is not what was stored"))
            }
            Verdict::Differs { port, how } => {
                (&mut self.bad, "DIFFERS", style::BAD, format!("`{port}`: {how}"))
            }
            Verdict::Failed(message) => (&mut self.failed, "FAILED", style::BAD, message.clone()),
        };
        *count += 1;
        let id = graph.instances[index].id();
        if self.ui.json {
            let line = serde_json::json!({
                "node": id, "verdict": word.to_lowercase(), "text": text,
            });
            println!("{line}");
        } else if *verdict != Verdict::Good || self.ui.detail == Detail::Verbose {
            let text = format!("{id:width$}  {text}", width = self.width);
            println!("{style}{word:>10}{style:#}  {}", text.trim_end());
        }
    }

    fn end(self, rerun: bool) -> Exit {
        let Self { good, bad, failed, absent, .. } = self;
        if !self.ui.json {
            let what = if rerun { "the same again" } else { "as stored" };
            let mut text = format!("{} {what}", count(good, "result"));
            let bad_word = if rerun { "differ" } else { "damaged" };
            for (n, word) in [(bad, bad_word), (failed, "failed"), (absent, "not stored")] {
                if n > 0 {
                    text += &format!(", {n} {word}");
                }
            }
            let style = if bad + failed == 0 { style::GOOD } else { style::BAD };
            println!("{style}{:>10}{style:#}  {text}", "Verified");
        }
        match (bad, failed) {
            (0, 0) => Exit::Success,
            (0, _) => Exit::NodeFailed,
            _ => Exit::Stale,
        }
    }
}
