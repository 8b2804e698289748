//! `sinew plan`: what a run would do, and why.

use std::collections::BTreeSet;

use anstream::println;
use serde_json::json;

use super::{
    Exit, Failure, Ui,
    common::{self, StoreArgs},
    pipeline_args::PipelineArgs,
    style,
};
use crate::engine::{
    graph::Graph,
    plan::{self, Plan, Status},
};

/// Tell what a run would do, and why; computes nothing
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    pipeline: PipelineArgs,

    /// Nodes to bring up to date with all they need; all if none is named
    nodes: Vec<String>,

    #[command(flatten)]
    store: StoreArgs,

    /// Ends with exit code 1 if anything would run
    #[arg(long)]
    fail_if_stale: bool,
}

pub fn run(args: &Args, ui: &Ui) -> Result<Exit, Failure> {
    let graph = args.pipeline.load()?;
    let store = args.store.open_read_only()?;
    let targets = common::select_all(&graph, &args.nodes)?;
    let memory = common::memory(&store, &graph);
    let plan = plan::plan(&graph, &targets, &BTreeSet::new(), &memory);
    if ui.json {
        print_json(&graph, &plan)
    } else {
        print_text(&graph, &plan)
    }
    let stale =
        plan.statuses.iter().any(|it| !matches!(it, Status::Cached { .. } | Status::NotWanted));
    Ok(if args.fail_if_stale && stale { Exit::NodeFailed } else { Exit::Success })
}

fn print_text(graph: &Graph, plan: &Plan) {
    let width = graph.instances.node_weights().map(|it| it.id().chars().count()).max().unwrap_or(0);
    let (mut cached, mut run, mut follow, mut blocked) = (0, 0, 0, 0);
    for &index in &plan.order {
        let (word, style, text) = match &plan.statuses[index.index()] {
            Status::NotWanted => continue,
            Status::Cached { .. } => {
                cached += 1;
                ("cached", style::CACHED, String::new())
            }
            Status::Run { reason, .. } => {
                run += 1;
                ("run", style::GOOD, reason.to_string())
            }
            Status::Follows { after } => {
                follow += 1;
                let after = graph.instances[*after].id();
                (
                    "follows",
                    style::WARN,
                    format!("`{after}`, unless that gives what it gave before"),
                )
            }
            Status::Blocked(error) => {
                blocked += 1;
                ("blocked", style::BAD, error.message(graph))
            }
        };
        let id = graph.instances[index].id();
        println!("{style}{word:>10}{style:#}  {id:width$}  {text}");
    }
    let head = style::HEAD;
    let mut text = format!("{run} to run, {follow} that follow, {cached} cached");
    if blocked > 0 {
        text += &format!(", {blocked} blocked");
    }
    println!("{head}{:>10}{head:#}  {text}", "Plan");
}

fn print_json(graph: &Graph, plan: &Plan) {
    for &index in &plan.order {
        let instance = &graph.instances[index];
        let (status, key, why) = match &plan.statuses[index.index()] {
            Status::NotWanted => continue,
            Status::Cached { key } => ("cached", Some(key), None),
            Status::Run { key, reason } => ("run", Some(key), Some(reason.to_string())),
            Status::Follows { after } => ("follows", None, Some(graph.instances[*after].id())),
            Status::Blocked(error) => ("blocked", None, Some(error.message(graph))),
        };
        let line = json!({
            "node": instance.id(), "kind": instance.kind.spec.kind,
            "status": status, "key": key, "why": why,
        });
        println!("{line}");
    }
}
