//! What happened to one instance in a run, told from the run's record.

use std::time::Duration;

use anstream::println;

use super::{Exit, Failure, Ui, common::StoreArgs, style};
use crate::engine::{
    clock::{iso_utc, show_bytes, show_secs},
    pipeline::suggest,
    record::{Line, NodeDone, NodeStart, Record},
    store::{Entry, Store},
    why::{self, Standing, Step, Tense},
};

/// Tells what happened to an instance in a run, and why.
pub fn tell(record: &Record, id: &str, store: &StoreArgs, ui: &Ui) -> Result<Exit, Failure> {
    let node = record.node(id);
    let start = record.lines.iter().rev().find_map(|it| match it {
        Line::NodeStart(start) if start.node == id => Some(start),
        _ => None,
    });
    if node.is_none() && start.is_none() {
        return Err(unknown(record, id));
    }
    if ui.json {
        let done = node.map(|it| Line::NodeDone(it.clone()));
        for line in start.map(|it| Line::NodeStart(it.clone())).iter().chain(&done) {
            println!("{}", serde_json::to_string(line).expect("lines are plain data"));
        }
        return Ok(Exit::Success);
    }
    let head = style::HEAD;
    println!("{head}{id}{head:#}  in run {}, {}", record.start.run, record.start.time);
    if let Some(start) = start {
        tell_start(record, start);
    }
    match node {
        Some(node) => tell_end(node),
        None => println!("{:>10}  the run's record ends before this did", "no end"),
    }
    tell_waits(record, id);
    let store = store.open_read_only()?;
    if let Some(key) = node.and_then(|it| it.key) {
        println!("{:>10}  {}", "key", key.short());
        match store.entry(&key) {
            Some(entry) => print_entry(&entry, &store),
            None => println!("{:>12}nothing is stored under it (any more)", ""),
        }
    }
    Ok(Exit::Success)
}

fn unknown(record: &Record, id: &str) -> Failure {
    let hint = suggest(id, record.nodes().map(|it| it.node.as_str()));
    let hint = hint.map(|it| format!("\nhint: {it}")).unwrap_or_default();
    Failure::usage(format_args!("run `{}` tells nothing of `{id}`{hint}", record.start.run))
}

/// Why it ran, with the whole chain of causes.
fn tell_start(record: &Record, start: &NodeStart) {
    let good = style::GOOD;
    let threads = match start.threads {
        1 => "1 thread".to_owned(),
        n => format!("{n} threads"),
    };
    let at = show_secs(start.t);
    println!("{good}{:>10}{good:#}  {at} after the start, on {threads}, because:", "started");
    match &start.why {
        Some(why) => print_steps(&why::chain(why, Tense::Did, &standings(record)), 0),
        // An old record.
        None => println!("{:>12}{}", "", start.reason),
    }
}

/// How the instances of a run stand, by their names.
pub fn standings(record: &Record) -> impl Fn(&str) -> Option<Standing> {
    let whys = record.whys();
    move |id| whys.get(id).map(|it| Standing::Runs((*it).clone()))
}

fn tell_end(node: &NodeDone) {
    let (style, text) = match node.status.as_str() {
        "ran" => (style::GOOD, String::new()),
        "cached" => (style::CACHED, "its result was stored; nothing before it ran".to_owned()),
        "cut_off" => (style::CACHED, "what ran before it gave what it gave before".to_owned()),
        "shared" => (style::CACHED, "another node or process computed the same key".to_owned()),
        "failed" => (style::BAD, node.message.clone().unwrap_or_default()),
        "skipped" => {
            let cause = node.message.as_deref().unwrap_or_default();
            (style::WARN, format!("it needs `{cause}`, which failed or was skipped"))
        }
        "not_reached" => (style::WARN, "the run was stopped before its turn".to_owned()),
        _ => (style::WARN, node.message.clone().unwrap_or_default()),
    };
    let wall = node.wall_s.map(|it| format!("after {}  ", show_secs(it)));
    let word = node.status.replace('_', " ");
    println!("{style}{word:>10}{style:#}  {}{text}", wall.unwrap_or_default());
    for note in &node.notes {
        println!("{:>10}  {note}", "note");
    }
}

fn tell_waits(record: &Record, id: &str) {
    let waits = record.lines.iter().filter(|it| match it {
        Line::NodeWaiting { node, .. } => node == id,
        _ => false,
    });
    if waits.count() > 0 {
        println!("{:>10}  for another process that computed the same key", "waited");
    }
}

/// Causes below each other, each consequence above what it comes from.
pub fn print_steps(steps: &[Step], depth: usize) {
    for step in steps {
        println!("{:indent$}{}", "", step.text, indent = 12 + 2 * (depth + step.depth));
    }
}

/// What is stored under a key.
pub fn print_entry(entry: &Entry, store: &Store) {
    let made = std::time::UNIX_EPOCH + Duration::from_secs(entry.made);
    let took = show_secs(entry.wall_secs);
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
