//! `sinew explain`: what one result is made from, and why it would (not) be computed again.

use std::{collections::BTreeSet, time::Duration};

use anstream::println;
use petgraph::graph::NodeIndex;

use super::{
    Exit, Failure, Ui,
    common::{self, StoreArgs},
    pipeline_args::PipelineArgs,
    style,
};
use crate::engine::{
    clock::{iso_utc, show_bytes, show_duration},
    graph::Graph,
    key::{Difference, Key},
    plan::{self, Memory, Plan, Reason, Status},
    store::{Entry, Store},
};

/// Tell what a node's result is made from, and why it would run or not
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    pipeline: PipelineArgs,

    /// The node
    node: String,

    #[command(flatten)]
    store: StoreArgs,
}

pub fn run(args: &Args, ui: &Ui) -> Result<Exit, Failure> {
    let graph = args.pipeline.load()?;
    let store = args.store.open_read_only()?;
    let index = common::find(&graph, &args.node)?;
    let memory = common::memory(&store, &graph);
    let plan = plan::plan(&graph, &[index], &BTreeSet::new(), &memory);
    let key = plan.keys[index.index()].as_ref();
    if ui.json {
        print_json(&graph, index, &plan, key);
        return Ok(Exit::Success);
    }
    print_status(&graph, index, &plan);
    if let Some(key) = key {
        print_key(key);
    }
    let last = memory.last_key(&graph.instances[index].id());
    if let Some((digest, entry)) = last.and_then(|it| Some((it, store.entry(&it)?))) {
        println!();
        println!("{:>10}  {}", "last", digest.short());
        print_entry(&entry, &store);
    }
    Ok(Exit::Success)
}

fn print_status(graph: &Graph, index: NodeIndex, plan: &Plan) {
    let instance = &graph.instances[index];
    let id = instance.id();
    let (head, good) = (style::HEAD, style::GOOD);
    let spec = &instance.kind.spec;
    println!(
        "{head}{id}{head:#}  {} (version {}), {}",
        spec.kind,
        spec.version,
        graph.show_place(&instance.place)
    );
    match &plan.statuses[index.index()] {
        Status::Cached { key } => {
            println!("{:>10}  its result is stored under {}", "cached", key.short())
        }
        Status::Run { reason: Reason::Changed(differences), .. } => {
            println!("{good}{:>10}{good:#}  its key is another one than last time", "would run");
            print_causes(graph, index, plan, differences);
        }
        Status::Run { reason, .. } => println!("{good}{:>10}{good:#}  {reason}", "would run"),
        Status::Follows { after } => {
            let after = graph.instances[*after].id();
            println!(
                "{:>10}  `{after}` would run first; if that gives what it gave before, this will not",
                "follows"
            );
        }
        Status::Blocked(error) => println!("{:>10}  {}", "blocked", error.message(graph)),
        Status::NotWanted => {}
    }
}

/// Where each changed thing is written, or which node made it.
fn print_causes(graph: &Graph, index: NodeIndex, plan: &Plan, differences: &[Difference]) {
    let instance = &graph.instances[index];
    for difference in differences {
        let field = difference.what.split_once('.').map_or(difference.what.as_str(), |it| it.1);
        let place = instance.field_places.get(field).map(|it| graph.show_place(it));
        let place = place.unwrap_or_else(|| graph.show_place(&instance.place));
        println!("{:>12}{difference}  {place}", "");
        for from in instance.inputs.get(field).into_iter().flatten() {
            let producer = graph.instances[from.instance].id();
            if let Status::Run { reason, .. } = &plan.statuses[from.instance.index()] {
                println!("{:>14}from `{producer}`, which would run: {reason}", "");
            }
        }
    }
}

fn print_key(key: &Key) {
    println!("{:>10}  {}", "key", crate::engine::digest::Digest::of(key.text().as_bytes()).short());
    println!("{:>12}numerics  {}", "", key.numerics);
    for (name, value) in key.params.as_object().into_iter().flatten() {
        println!("{:>12}{name} = {value}", "");
    }
    for (name, digest) in &key.files {
        println!("{:>12}file `{name}`  {}", "", digest.short());
    }
    for (name, fact) in &key.facts {
        println!("{:>12}fact `{name}`  {fact}", "");
    }
    for (port, digests) in &key.inputs {
        let list: Vec<String> = digests
            .iter()
            .map(|it| it.as_ref().map_or("none".to_owned(), |it| it.short()))
            .collect();
        println!("{:>12}input `{port}`  {}", "", list.join(" "));
    }
}

fn print_entry(entry: &Entry, store: &Store) {
    let made = std::time::UNIX_EPOCH + Duration::from_secs(entry.made);
    let took = show_duration(Duration::from_secs_f64(entry.wall_secs));
    println!("{:>12}made by run {} at {}, took {took}", "", entry.run, iso_utc(made));
    for output in &entry.outputs {
        let gone = if store.has_object(&output.digest) { "" } else { "  (no longer stored)" };
        let (size, digest) = (show_bytes(output.bytes), output.digest.short());
        println!("{:>12}{}: {}  {size}  {digest}{gone}", "", output.port, output.ty);
    }
    for (port, why) in &entry.absent {
        println!("{:>12}{port}: none, {why}", "");
    }
    for note in &entry.notes {
        println!("{:>12}note: {note}", "");
    }
}

fn print_json(graph: &Graph, index: NodeIndex, plan: &Plan, key: Option<&Key>) {
    let (status, why) = match &plan.statuses[index.index()] {
        Status::Cached { .. } => ("cached", None),
        Status::Run { reason, .. } => ("run", Some(reason.to_string())),
        Status::Follows { after } => ("follows", Some(graph.instances[*after].id())),
        Status::Blocked(error) => ("blocked", Some(error.message(graph))),
        Status::NotWanted => ("not_wanted", None),
    };
    let node = graph.instances[index].id();
    println!("{}", serde_json::json!({ "node": node, "status": status, "why": why, "key": key }));
}
