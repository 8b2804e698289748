//! `sinew runs`: the runs that were, and one of them told again.

use std::{collections::BTreeMap, path::Path};

use anstream::println;

use super::{Exit, Failure, Ui, common::StoreArgs, style, told};
use crate::engine::{
    clock::{show_bytes, show_secs},
    record::{self, Line, NodeDone, Record},
    why,
};

/// List the runs that are on record, or tell one of them again
#[derive(clap::Args)]
pub struct Args {
    /// A run: `last`, `last~1` for the one before, or the beginning of its name
    run: Option<String>,

    /// Tells only what happened to this node, and why
    node: Option<String>,

    #[command(flatten)]
    store: StoreArgs,

    /// Runs to list
    #[arg(short, long, default_value_t = 20, value_name = "N")]
    number: usize,

    /// Prints the pipeline file of the run as it was
    #[arg(long, requires = "run", conflicts_with = "node")]
    pipeline: bool,

    /// Prints a table of the run's nodes with their kinds and times, for `table_file` or a spreadsheet
    #[arg(long, requires = "run", conflicts_with_all = ["node", "pipeline"])]
    csv: bool,
}

pub fn run(args: &Args, ui: &Ui) -> Result<Exit, Failure> {
    let dir = &args.store.cache;
    let Some(name) = &args.run else {
        for path in record::list(dir).iter().take(args.number) {
            list(path, ui);
        }
        return Ok(Exit::Success);
    };
    let record = find(dir, name)?;
    if let Some(node) = &args.node {
        return told::tell(&record, node, &args.store, ui);
    }
    if args.csv {
        print!("{}", csv(&record));
    } else if args.pipeline {
        let text = record.start.sources.first().map_or("", |it| it.text.as_str());
        print!("{text}");
    } else {
        tell(&record, ui);
    }
    Ok(Exit::Success)
}

/// The record of a run that the user names.
pub fn find(dir: &Path, name: &str) -> Result<Record, Failure> {
    let path = record::find(dir, name).map_err(|error| {
        Failure::usage(format_args!("{error}\nhint: `{}` is the cache", dir.display()))
    })?;
    Record::read(&path)
        .map_err(|e| Failure::environment(format_args!("cannot read `{}`: {e}", path.display())))
}

/// How a run stands, in one word.
fn status(path: &Path, record: &Record) -> &'static str {
    match record.done() {
        Some(Line::RunDone { failed: 0, skipped: 0, .. }) => "done",
        Some(_) => "failed",
        None if record::is_going_on(path) => "running",
        None => "broken off",
    }
}

fn list(path: &Path, ui: &Ui) {
    let record = match Record::read(path) {
        Ok(record) => record,
        Err(error) if ui.json => {
            let line = serde_json::json!({
                "run": record::name(path), "status": "unreadable", "error": error.to_string(),
            });
            return println!("{line}");
        }
        Err(error) => {
            let (name, bad) = (record::name(path), style::BAD);
            return println!("{name}  {bad}{:>10}{bad:#}  {error}", "unreadable");
        }
    };
    let status = status(path, &record);
    let counts = counts(&record);
    let secs = match record.done() {
        Some(Line::RunDone { t, .. }) => Some(*t),
        _ => None,
    };
    let start = &record.start;
    let file = start.sources.first().map(|it| it.path.display().to_string());
    if ui.json {
        let line = serde_json::json!({
            "run": start.run, "time": start.time, "file": file, "title": start.title,
            "status": status, "wall_s": secs, "counts": counts,
        });
        return println!("{line}");
    }
    let style = match status {
        "done" => style::GOOD,
        "running" => style::HEAD,
        _ => style::BAD,
    };
    let texts = counts.iter().map(|(what, n)| format!("{n} {}", what.replace('_', " ")));
    let text = texts.collect::<Vec<_>>().join(", ");
    let secs = secs.map(show_secs).unwrap_or_default();
    let file = file.unwrap_or_default();
    println!("{}  {style}{status:>10}{style:#}  {secs:>8}  {file}  {text}", start.run);
}

/// How many instances ended in each way, so far as the record goes.
pub fn counts(record: &Record) -> BTreeMap<&str, usize> {
    let mut last: BTreeMap<&str, &str> = BTreeMap::new();
    for node in record.nodes() {
        last.insert(&node.node, &node.status);
    }
    let mut counts = BTreeMap::new();
    for status in last.into_values() {
        *counts.entry(status).or_default() += 1;
    }
    counts
}

/// One line a node: its name without items, its items, its kind, how it ended, and how long it took.
fn csv(record: &Record) -> String {
    let mut last: BTreeMap<&str, &NodeDone> = BTreeMap::new();
    for node in record.nodes() {
        last.insert(&node.node, node);
    }
    let mut writer = csv::Writer::from_writer(Vec::new());
    let mut put = |fields: [&str; 5]| writer.write_record(fields).expect("memory takes all");
    put(["node", "items", "kind", "status", "wall [s]"]);
    for (name, node) in last {
        let (base, items) = name.split_once('@').unwrap_or((name, ""));
        let wall = node.wall_s.map(|it| it.to_string()).unwrap_or_default();
        put([base, items, &node.kind, &node.status, &wall]);
    }
    let bytes = writer.into_inner().expect("memory takes all");
    String::from_utf8(bytes).expect("names are text")
}

/// Tells a run as it was told when it went.
fn tell(record: &Record, ui: &Ui) {
    if ui.json {
        let first = Line::RunStart(record.start.clone());
        for line in std::iter::once(&first).chain(&record.lines) {
            println!("{}", serde_json::to_string(line).expect("lines are plain data"));
        }
        return;
    }
    let start = &record.start;
    let head = style::HEAD;
    println!("{head}{:>10}{head:#}  {}  {}", "Run", start.run, start.time);
    println!("{:>10}  {}", "command", start.args.join(" "));
    println!("{:>10}  {}", "folder", start.folder.display());
    println!(
        "{:>10}  sinew {}, {} threads on {}",
        "with", start.version, start.threads, start.host
    );
    let width = record.nodes().map(|it| it.node.chars().count()).max().unwrap_or(0);
    let whys = record.whys();
    let standing = told::standings(record);
    for line in &record.lines {
        match line {
            Line::NodeDone(node) => {
                let why = whys.get(node.node.as_str()).filter(|_| node.status == "ran");
                tell_node(node, why.map(|it| why::headline(it, &standing)), width);
            }
            Line::Warning { text, .. } => {
                println!("{}{:>10}{:#}  {text}", style::WARN, "warning", style::WARN);
            }
            Line::Output { path, status, bytes, message, .. } => {
                let size = bytes.map(show_bytes).unwrap_or_default();
                let message = message.as_deref().unwrap_or_default();
                println!("{status:>10}  {}  {size}{message}", path.display());
            }
            Line::NodeRetry { node, retry, retries, wait_s, message, .. } => {
                let (word, warn, wait) = ("retry", style::WARN, show_secs(*wait_s));
                let what = format!("{retry}/{retries} after {wait}: {message}");
                println!("{warn}{word:>10}{warn:#}  {node:width$}  {what}");
            }
            Line::Stopping { t, now } => {
                let (word, warn) = ("stopping", style::WARN);
                let how = if *now { ", at once" } else { "" };
                println!("{warn}{word:>10}{warn:#}  asked to after {}{how}", show_secs(*t));
            }
            Line::RunDone { t, ran, cached, cut_off, failed, skipped, stopped } => println!(
                "{head}{:>10}{head:#}  {ran} ran, {cached} cached, {cut_off} cut off, {failed} \
                 failed, {skipped} skipped in {}",
                if *stopped { "Stopped" } else { "Finished" },
                show_secs(*t),
            ),
            _ => {}
        }
    }
    if record.done().is_none() {
        println!("{:>10}  the record ends here", "Broken off");
    }
}

fn tell_node(node: &NodeDone, headline: Option<String>, width: usize) {
    let style = match node.status.as_str() {
        "ran" => style::GOOD,
        "failed" => style::BAD,
        "skipped" | "not_reached" => style::WARN,
        _ => style::CACHED,
    };
    let time = node.wall_s.map(show_secs).unwrap_or_default();
    let message = headline.or_else(|| node.message.clone()).unwrap_or_default();
    let status = node.status.replace('_', " ");
    println!("{style}{status:>10}{style:#}  {:width$}  {time:>8}  {message}", node.node);
    for note in &node.notes {
        println!("{:>10}  {:width$}  {:>8}  note: {note}", "", "", "");
    }
}
