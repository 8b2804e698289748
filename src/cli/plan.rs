//! `sinew plan`: what a run would do, and why.

use std::collections::{BTreeMap, BTreeSet};

use anstream::println;
use petgraph::graph::NodeIndex;
use serde_json::json;

use super::{
    Exit, Failure, Ui,
    common::{self, StoreArgs},
    pipeline_args::PipelineArgs,
    style,
    ui::Detail,
    words::count,
};
use crate::engine::{
    clock::show_secs,
    graph::Graph,
    plan::{self, Memory, Plan, Status},
    why::{self, PlanCauses},
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

    /// Lists every instance, as `--verbose` does, instead of summing up
    #[arg(long)]
    all: bool,

    /// Ends with exit code 4 if anything would run
    #[arg(long)]
    fail_if_stale: bool,
}

pub fn run(args: &Args, ui: &Ui) -> Result<Exit, Failure> {
    // The process ends with this: to take thousands of instances apart would only cost time.
    let graph = &*Box::leak(Box::new(args.pipeline.find_or_load(&args.store)?));
    let store = args.store.open_read_only()?;
    let targets = common::select_all(graph, &args.nodes)?;
    let memory = common::memory(&store, graph);
    let plan = plan::plan(graph, &targets, &BTreeSet::new(), &memory);
    let causes = PlanCauses::new(graph, &plan, &memory);
    let teller = Teller { graph, plan: &plan, memory: &memory, causes };
    if ui.json {
        teller.print_json();
    } else {
        teller.print(args.all || ui.detail == Detail::Verbose);
    }
    let stale =
        plan.statuses.iter().any(|it| !matches!(it, Status::Cached { .. } | Status::NotWanted));
    Ok(if args.fail_if_stale && stale { Exit::Stale } else { Exit::Success })
}

struct Teller<'a> {
    graph: &'a Graph,
    plan: &'a Plan,
    memory: &'a dyn Memory,
    causes: PlanCauses<'a>,
}

/// A line of the plan: a node, and those of its instances that fare alike.
struct Line {
    name: String,
    word: &'static str,
    style: anstyle::Style,
    text: String,
    instances: Vec<NodeIndex>,
}

impl Teller<'_> {
    fn print(&self, all: bool) {
        let lines = if all { self.instances() } else { self.nodes() };
        let width = lines.iter().map(|it| it.name.chars().count()).max().unwrap_or(0).min(48);
        for Line { name, word, style, text, instances } in &lines {
            let count = if instances.len() > 1 {
                format!("{:>6}", instances.len())
            } else if lines.iter().any(|it| it.instances.len() > 1) {
                " ".repeat(6)
            } else {
                String::new()
            };
            let text = format!("{name:width$}  {text}");
            println!("{count}{style}{word:>10}{style:#}  {}", text.trim_end());
        }
        self.print_sum();
    }

    /// One line an instance.
    fn instances(&self) -> Vec<Line> {
        let line = |&index: &NodeIndex| {
            let (word, style, text) = self.describe(index)?;
            let name = self.graph.instances[index].id();
            Some(Line { name, word, style, text, instances: vec![index] })
        };
        self.plan.order.iter().filter_map(line).collect()
    }

    /// One line for the instances of a node that fare alike, and one for all that follow.
    fn nodes(&self) -> Vec<Line> {
        let mut lines: Vec<Line> = Vec::new();
        let mut by_text: BTreeMap<(String, &str, String), usize> = BTreeMap::new();
        let mut following: Vec<NodeIndex> = Vec::new();
        for &index in &self.plan.order {
            if matches!(self.plan.statuses[index.index()], Status::Follows { .. }) {
                following.push(index);
                continue;
            }
            let Some((word, style, text)) = self.describe(index) else { continue };
            let name = self.graph.instances[index].name.to_string();
            let place = by_text.entry((name.clone(), word, text.clone())).or_insert(lines.len());
            match lines.get_mut(*place) {
                Some(line) => line.instances.push(index),
                None => lines.push(Line { name, word, style, text, instances: vec![index] }),
            }
        }
        // One instance goes by its full name.
        for line in lines.iter_mut().filter(|it| it.instances.len() == 1) {
            line.name = self.graph.instances[line.instances[0]].id();
        }
        lines.extend(self.following(following));
        lines
    }

    fn following(&self, instances: Vec<NodeIndex>) -> Option<Line> {
        let mut names: Vec<&str> = Vec::new();
        for &index in &instances {
            let name: &str = &self.graph.instances[index].name;
            if names.last() != Some(&name) && !names.contains(&name) {
                names.push(name);
            }
        }
        let name = match names[..] {
            [] => return None,
            [only] => only.to_owned(),
            [first, ref others @ ..] => format!("{first} … {}", count(others.len(), "more node")),
        };
        let text = "what stands above, unless that gives what it gave before".to_owned();
        Some(Line { name, word: "follows", style: style::WARN, text, instances })
    }

    /// The word for an instance, its colour, and why.
    fn describe(&self, index: NodeIndex) -> Option<(&'static str, anstyle::Style, String)> {
        Some(match &self.plan.statuses[index.index()] {
            Status::NotWanted => return None,
            Status::Cached { .. } => ("cached", style::CACHED, String::new()),
            Status::Run { reason, .. } => {
                let why = self.causes.why(index, reason);
                ("run", style::GOOD, why::headline(&why, &|id| self.causes.standing(id)))
            }
            Status::Follows { after } => {
                let after = self.graph.instances[*after].id();
                let text = format!("`{after}`, unless that gives what it gave before");
                ("follows", style::WARN, text)
            }
            Status::Blocked(error) => ("blocked", style::BAD, error.message(self.graph)),
        })
    }

    fn print_sum(&self) {
        let count =
            |what: fn(&Status) -> bool| self.plan.statuses.iter().filter(|it| what(it)).count();
        let run = count(|it| matches!(it, Status::Run { .. }));
        let follow = count(|it| matches!(it, Status::Follows { .. }));
        let cached = count(|it| matches!(it, Status::Cached { .. }));
        let blocked = count(|it| matches!(it, Status::Blocked(_)));
        let mut text = format!("{run} to run, {follow} that follow, {cached} cached");
        if blocked > 0 {
            text += &format!(", {blocked} blocked");
        }
        if run + follow > 0 {
            text += &self.estimate().to_string();
        }
        let head = style::HEAD;
        println!("{head}{:>10}{head:#}  {text}", "Plan");
    }

    /// How long what runs took when it ran last. An instance that never ran is taken to be like the
    /// others of its node.
    fn estimate(&self) -> Estimate {
        let mut res = Estimate::default();
        let mut of_node: BTreeMap<&str, (f64, usize, usize)> = BTreeMap::new();
        for (instance, status) in self.graph.instances.node_weights().zip(&self.plan.statuses) {
            if !matches!(status, Status::Run { .. } | Status::Follows { .. }) {
                continue;
            }
            let last = self.memory.last_key(&instance.id()).and_then(|it| self.memory.entry(&it));
            let node = of_node.entry(&instance.name).or_default();
            match last {
                Some(entry) => (node.0, node.1) = (node.0 + entry.wall_secs, node.1 + 1),
                None => node.2 += 1,
            }
        }
        for (secs, known, unknown) in of_node.into_values() {
            if known > 0 {
                res.secs += secs / known as f64 * (known + unknown) as f64;
                res.known += known + unknown;
            } else {
                res.unknown += unknown;
            }
        }
        res
    }

    fn print_json(&self) {
        for &index in &self.plan.order {
            let instance = &self.graph.instances[index];
            let (status, key, text) = match &self.plan.statuses[index.index()] {
                Status::NotWanted => continue,
                Status::Cached { key } => ("cached", Some(key), None),
                Status::Run { key, reason } => ("run", Some(key), Some(reason.to_string())),
                Status::Follows { after } => {
                    ("follows", None, Some(self.graph.instances[*after].id()))
                }
                Status::Blocked(error) => ("blocked", None, Some(error.message(self.graph))),
            };
            let why = match &self.plan.statuses[index.index()] {
                Status::Run { reason, .. } => Some(self.causes.why(index, reason)),
                _ => None,
            };
            let place = self.causes.places.show(self.graph, &instance.place);
            let line = json!({
                "node": instance.id(), "kind": instance.kind.spec.kind, "place": place,
                "status": status, "key": key, "text": text, "why": why,
            });
            println!("{line}");
        }
    }
}

/// What is known of how long a run will take.
#[derive(Debug, Default, PartialEq)]
struct Estimate {
    /// Of all instances that are known, one after the other.
    secs: f64,
    known: usize,
    unknown: usize,
}

impl std::fmt::Display for Estimate {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.known == 0 {
            return Ok(());
        }
        let time = show_secs(self.secs);
        write!(f, "; {time} of work, as it was last time")?;
        match self.unknown {
            0 => Ok(()),
            n => write!(f, " (and {n} that never ran)"),
        }
    }
}
