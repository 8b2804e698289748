//! `sinew explain`: what one result is made from, and why it would (not) be computed again.

use std::collections::BTreeSet;

use anstream::println;
use indexmap::IndexMap;
use petgraph::graph::NodeIndex;
use serde_json::Value as Json;

use super::{
    Exit, Failure, Ui,
    common::{self, StoreArgs},
    pipeline_args::PipelineArgs,
    runs, style, told,
};
use crate::engine::{
    digest::Digest,
    key::Key,
    plan::{self, Memory, Reason, Status},
    why::{self, PlanCauses, Step, Tense},
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

    /// Tells what happened to it in a run instead: `last`, `last~1`, or the beginning of a name
    #[arg(long, value_name = "RUN")]
    run: Option<String>,
}

pub fn run(args: &Args, ui: &Ui) -> Result<Exit, Failure> {
    if let Some(run) = &args.run {
        let record = runs::find(&args.store.cache, run)?;
        return told::tell(&record, &args.node, &args.store, ui);
    }
    // The process ends with this: to take thousands of instances apart would only cost time.
    let graph = &*Box::leak(Box::new(args.pipeline.find_or_load(&args.store)?));
    let store = args.store.open_read_only()?;
    let index = common::find(graph, &args.node)?;
    let memory = common::memory(&store, graph);
    let plan = plan::plan(graph, &[index], &BTreeSet::new(), &memory);
    let key = plan.keys[index.index()].as_deref();
    let causes = PlanCauses::new(graph, &plan, &memory);
    if ui.json {
        print_json(index, &causes, key);
        return Ok(Exit::Success);
    }
    print_status(index, &causes);
    if let Some(key) = key {
        print_key(key);
    }
    let last = memory.last_key(&graph.instances[index].id());
    if let Some((digest, entry)) = last.and_then(|it| Some((it, store.entry(&it)?))) {
        println!();
        println!("{:>10}  {}", "last", digest.short());
        told::print_entry(&entry, &store);
    }
    Ok(Exit::Success)
}

fn print_status(index: NodeIndex, causes: &PlanCauses<'_>) {
    let PlanCauses { graph, plan, .. } = causes;
    let instance = &graph.instances[index];
    let id = instance.id();
    let (head, good, warn) = (style::HEAD, style::GOOD, style::WARN);
    let spec = &instance.kind.spec;
    println!(
        "{head}{id}{head:#}  {} (version {}), {}",
        spec.kind,
        spec.version,
        causes.places.show(graph, &instance.place)
    );
    match &plan.statuses[index.index()] {
        Status::Cached { key } => {
            println!("{:>10}  its result is stored under {}", "cached", key.short())
        }
        Status::Run { reason: reason @ Reason::Changed(_), .. } => {
            println!("{good}{:>10}{good:#}  its key is another one than last time", "would run");
            let why = causes.why(index, reason);
            told::print_steps(&why::chain(&why, Tense::Would, &|it| causes.standing(it)), 0);
        }
        Status::Run { reason, .. } => println!("{good}{:>10}{good:#}  {reason}", "would run"),
        Status::Follows { .. } => {
            println!(
                "{warn}{:>10}{warn:#}  if these give what they gave before, this will not run:",
                "follows"
            );
            print_roots(index, causes);
        }
        Status::Blocked(error) => println!("{:>10}  {}", "blocked", error.message(graph)),
        Status::NotWanted => {}
    }
}

/// The instances that run for certain before one that follows; those with one reason together.
fn print_roots(index: NodeIndex, causes: &PlanCauses<'_>) {
    let mut groups: IndexMap<String, (Vec<String>, Vec<Step>)> = IndexMap::new();
    for root in why::roots(causes.graph, index, causes.plan) {
        let Status::Run { reason, .. } = &causes.plan.statuses[root.index()] else { continue };
        let why = causes.why(root, reason);
        let headline = why::headline(&why, &|it| causes.standing(it));
        let group = groups.entry(headline).or_insert_with(|| {
            (Vec::new(), why::chain(&why, Tense::Would, &|it| causes.standing(it)))
        });
        group.0.push(causes.graph.instances[root].id());
    }
    for (ids, steps) in groups.values() {
        let name = why::name_some(ids);
        told::print_steps(&[Step { depth: 0, text: format!("{name} would run:") }], 0);
        told::print_steps(steps, 1);
    }
}

fn print_key(text: &str) {
    println!("{:>10}  {}", "key", Digest::of(text.as_bytes()).short());
    let key = Key::read(text).expect("keys are read as they are written");
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

fn print_json(index: NodeIndex, causes: &PlanCauses<'_>, key: Option<&str>) {
    let key: Option<Json> = key.and_then(|it| serde_json::from_str(it).ok());
    let PlanCauses { graph, plan, .. } = causes;
    let id = |it: &NodeIndex| graph.instances[*it].id();
    let (status, text, why) = match &plan.statuses[index.index()] {
        Status::Cached { .. } => ("cached", None, None),
        Status::Run { reason, .. } => {
            ("run", Some(reason.to_string()), Some(causes.why(index, reason)))
        }
        Status::Follows { after } => ("follows", Some(id(after)), None),
        Status::Blocked(error) => ("blocked", Some(error.message(graph)), None),
        Status::NotWanted => ("not_wanted", None, None),
    };
    let chain = why.as_ref().map(|it| why::chain(it, Tense::Would, &|id| causes.standing(id)));
    let chain: Vec<String> = chain.into_iter().flatten().map(|it| it.text).collect();
    let roots: Vec<String> = match plan.statuses[index.index()] {
        Status::Follows { .. } => why::roots(graph, index, plan).iter().map(id).collect(),
        _ => Vec::new(),
    };
    let line = serde_json::json!({
        "node": id(&index), "status": status, "text": text, "why": why, "chain": chain,
        "after": roots, "key": key,
    });
    println!("{line}");
}
