//! `sinew runs`: the runs that were, and one of them told again.

use std::{path::Path, time::Duration};

use super::{Exit, Failure, Ui, common::StoreArgs, style};
use crate::engine::{
    clock::{show_bytes, show_duration},
    record::{self, Line, NodeDone, Record},
};
use anstream::println;

/// List the runs that are on record, or tell one of them again
#[derive(clap::Args)]
pub struct Args {
    /// A run: the beginning of its name, or `latest`
    run: Option<String>,

    #[command(flatten)]
    store: StoreArgs,

    /// Runs to list
    #[arg(short, long, default_value_t = 20, value_name = "N")]
    number: usize,

    /// Prints the pipeline file of the run as it was
    #[arg(long, requires = "run")]
    pipeline: bool,
}

pub fn run(args: &Args, ui: &Ui) -> Result<Exit, Failure> {
    let dir = &args.store.cache;
    match &args.run {
        Some(name) => {
            let record = find(dir, name)?;
            if args.pipeline {
                let text = record.start.sources.first().map_or("", |it| it.text.as_str());
                print!("{text}");
            } else {
                tell(&record, ui);
            }
        }
        None => {
            for path in record::list(dir).iter().take(args.number) {
                match Record::read(path) {
                    Ok(record) => list(&record, ui),
                    Err(error) => anstream::eprintln!("`{}`: {error}", path.display()),
                }
            }
        }
    }
    Ok(Exit::Success)
}

pub fn find(dir: &Path, name: &str) -> Result<Record, Failure> {
    let stem = |it: &Path| it.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let paths = record::list(dir);
    let path = match name {
        "latest" => paths.first(),
        _ => paths.iter().find(|it| stem(it).starts_with(name)),
    };
    let Some(path) = path else {
        return Err(Failure::usage(format_args!(
            "there is no run `{name}` in `{}`",
            dir.display()
        )));
    };
    Record::read(path)
        .map_err(|e| Failure::environment(format_args!("cannot read `{}`: {e}", path.display())))
}

fn list(record: &Record, ui: &Ui) {
    let done = record.lines.iter().find_map(|it| match it {
        Line::RunDone { t, ran, cached, cut_off, failed, .. } => {
            Some((*t, *ran, *cached + *cut_off, *failed))
        }
        _ => None,
    });
    let file = record.start.sources.first().map(|it| it.path.display().to_string());
    if ui.json {
        let start = &record.start;
        let done = done.map(|(t, ran, cached, failed)| {
            serde_json::json!({ "wall_s": t, "ran": ran, "cached": cached, "failed": failed })
        });
        let line = serde_json::json!({
            "run": start.run, "time": start.time, "file": file, "title": start.title, "done": done,
        });
        println!("{line}");
        return;
    }
    let text = match done {
        Some((t, ran, cached, failed)) => {
            let failed = if failed > 0 { format!(", {failed} failed") } else { String::new() };
            format!("{ran} ran, {cached} cached{failed} in {}", show_secs(t))
        }
        None => "did not end".to_owned(),
    };
    let head = style::HEAD;
    println!("{head}{}{head:#}  {}  {text}", record.start.run, file.unwrap_or_default());
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
    for line in &record.lines {
        match line {
            Line::NodeDone(node) => tell_node(node, width),
            Line::Warning { text, .. } => {
                println!("{}{:>10}{:#}  {text}", style::WARN, "warning", style::WARN);
            }
            Line::Output { path, status, bytes, message, .. } => {
                let size = bytes.map(show_bytes).unwrap_or_default();
                let message = message.as_deref().unwrap_or_default();
                println!("{status:>10}  {}  {size}{message}", path.display());
            }
            Line::RunDone { t, ran, cached, cut_off, failed, skipped } => println!(
                "{head}{:>10}{head:#}  {ran} ran, {cached} cached, {cut_off} cut off, {failed} \
                 failed, {skipped} skipped in {}",
                "Finished",
                show_secs(*t)
            ),
            _ => {}
        }
    }
}

fn tell_node(node: &NodeDone, width: usize) {
    let style = match node.status.as_str() {
        "ran" => style::GOOD,
        "failed" => style::BAD,
        "skipped" | "not_reached" => style::WARN,
        _ => style::CACHED,
    };
    let time = node.wall_s.map(show_secs).unwrap_or_default();
    let message = node.message.as_deref().unwrap_or_default();
    let status = node.status.replace('_', " ");
    println!("{style}{status:>10}{style:#}  {:width$}  {time:>8}  {message}", node.node);
    for note in &node.notes {
        println!("{:>10}  {:width$}  {:>8}  note: {note}", "", "", "");
    }
}

fn show_secs(secs: f64) -> String {
    show_duration(Duration::from_secs_f64(secs.max(0.0)))
}
