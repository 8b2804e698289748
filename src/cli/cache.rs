//! `sinew cache`: what is stored, what can go, what is damaged.

use std::{collections::BTreeSet, path::Path};

use anstream::println;
use clap::Subcommand;

use super::{Exit, Failure, LIBRARY, Ui, common::StoreArgs, style};
use crate::engine::{
    clock::{show_bytes, show_secs},
    digest::Digest,
    record::NodeDone,
    settings::parse_size,
    store::{
        gc::{self, GcError, GcOptions, GcReport},
        pins,
    },
};

/// Look at the cache and keep house in it
#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    command: CacheCommand,

    #[command(flatten)]
    store: StoreArgs,
}

#[derive(Subcommand)]
enum CacheCommand {
    /// Sum up what is stored, by kind of node
    Stat,
    /// Remove results that nothing asks for; what stays is named by the options
    Gc {
        /// Keeps what the last N runs used
        #[arg(long, value_name = "N")]
        keep_runs: Option<usize>,
        /// Keeps what was used within so many days
        #[arg(long, value_name = "DAYS")]
        max_age: Option<f64>,
        /// Removes what was not used for longest until the rest is not larger, such as 10G
        #[arg(long, value_name = "SIZE", value_parser = parse_size)]
        max_size: Option<u64>,
        /// Tells what would be removed, and removes nothing
        #[arg(long)]
        dry_run: bool,
    },
    /// Keep the results of a run, whatever else `gc` and `rm` are told
    Pin {
        /// A run: the beginning of its name, or `latest`
        #[arg(default_value = "latest")]
        run: String,
        /// Nodes of the run whose results are kept; all if none is named
        nodes: Vec<String>,
    },
    /// Take the pin of a run back
    Unpin {
        /// The run, as `pins` lists it
        run: String,
    },
    /// List the pinned runs
    Pins,
    /// Read everything and compare it with its digests
    Verify,
    /// Remove the results of kinds of nodes, or of keys by the beginning of their digests
    Rm {
        /// Kinds, or beginnings of keys
        #[arg(required_unless_present = "all")]
        what: Vec<String>,
        /// Removes everything
        #[arg(long, conflicts_with = "what")]
        all: bool,
        /// Tells what would be removed, and removes nothing
        #[arg(long)]
        dry_run: bool,
    },
}

pub fn run(args: &Args, ui: &Ui) -> Result<Exit, Failure> {
    let dir = args.store.existing()?;
    match &args.command {
        CacheCommand::Stat => stat(args, ui),
        CacheCommand::Gc { keep_runs, max_age, max_size, dry_run } => {
            if keep_runs.is_none() && max_age.is_none() && max_size.is_none() {
                return Err(Failure::usage(
                    "say what stays: `--keep-runs N`, `--max-age DAYS` or `--max-size SIZE`",
                ));
            }
            let options = GcOptions {
                keep_runs: *keep_runs,
                max_age_secs: max_age.map(|it| (it * 86_400.0) as u64),
                max_bytes: *max_size,
                dry_run: *dry_run,
                ..GcOptions::default()
            };
            collect(args, &options, ui)
        }
        CacheCommand::Rm { what, all, dry_run } => {
            let (kinds, keys) = what.iter().cloned().partition(|it| LIBRARY.kind(it).is_some());
            let options =
                GcOptions { kinds, keys, all: *all, dry_run: *dry_run, ..GcOptions::default() };
            if let Some(key) = options.keys.iter().find(|it| !is_key(it)) {
                return Err(Failure::usage(format_args!("`{key}` is neither a kind nor a key")));
            }
            collect(args, &options, ui)
        }
        CacheCommand::Pin { run, nodes } => pin(dir, run, nodes, ui),
        CacheCommand::Unpin { run } => {
            let pins = pins::all(dir).map_err(|it| super::common::cache_stop(&it))?;
            if !pins.contains_key(run) {
                return Err(Failure::usage(format_args!("no run `{run}` is pinned")));
            }
            pins::remove(dir, run).map_err(|it| super::common::cache_stop(&it))?;
            ui.message(&format!("`{run}` is no longer pinned"));
            Ok(Exit::Success)
        }
        CacheCommand::Pins => {
            for (run, keys) in pins::all(dir).map_err(|it| super::common::cache_stop(&it))? {
                println!("{run}  {} results", keys.len());
            }
            Ok(Exit::Success)
        }
        CacheCommand::Verify => {
            let report = gc::verify(dir, &LIBRARY).map_err(stop)?;
            for damaged in &report.damaged {
                println!("{:>10}  {damaged}", "damaged");
            }
            let (entries, objects) = (report.entries, report.objects);
            let n_damaged = report.damaged.len();
            println!("{entries} entries and {objects} artifacts, {n_damaged} damaged");
            Ok(if n_damaged == 0 { Exit::Success } else { Exit::Stale })
        }
    }
}

/// Pins what a run used, or some of it.
fn pin(dir: &Path, run: &str, nodes: &[String], ui: &Ui) -> Result<Exit, Failure> {
    let record = super::runs::find(dir, run)?;
    let done: Vec<&NodeDone> = record.nodes().filter(|it| it.key.is_some()).collect();
    for name in nodes {
        if !done.iter().any(|it| it.node == *name) {
            let run = &record.start.run;
            return Err(Failure::usage(format_args!("the run `{run}` has no result of `{name}`")));
        }
    }
    let is_chosen = |it: &&&NodeDone| nodes.is_empty() || nodes.contains(&it.node);
    let keys: BTreeSet<Digest> = done.iter().filter(is_chosen).filter_map(|it| it.key).collect();
    pins::add(dir, &record.start.run, &keys).map_err(|it| super::common::cache_stop(&it))?;
    ui.message(&format!("pinned {} results of `{}`", keys.len(), record.start.run));
    Ok(Exit::Success)
}

/// At least four hexadecimal digits: fewer would remove by accident.
fn is_key(text: &str) -> bool {
    text.len() >= 4 && text.chars().all(|it| it.is_ascii_hexdigit())
}

fn stat(args: &Args, ui: &Ui) -> Result<Exit, Failure> {
    let stat = gc::stat(&args.store.cache).map_err(|it| super::common::cache_stop(&it))?;
    if ui.json {
        for (kind, it) in &stat.kinds {
            let line = serde_json::json!({
                "kind": kind, "entries": it.entries, "bytes": it.bytes, "wall_s": it.wall_secs,
            });
            println!("{line}");
        }
        return Ok(Exit::Success);
    }
    let head = style::HEAD;
    println!("{head}{:24} {:>8} {:>10} {:>12}{head:#}", "kind", "results", "size", "rebuild");
    for (kind, it) in &stat.kinds {
        let rebuild = show_secs(it.wall_secs);
        println!("{kind:24} {:>8} {:>10} {rebuild:>12}", it.entries, show_bytes(it.bytes));
    }
    let size = show_bytes(stat.object_bytes);
    println!(
        "{:24} {:>8} {size:>10}   {} artifacts, {} of log, {} runs",
        "total",
        stat.entries,
        stat.objects,
        show_bytes(stat.log_bytes),
        stat.runs
    );
    Ok(Exit::Success)
}

fn collect(args: &Args, options: &GcOptions, ui: &Ui) -> Result<Exit, Failure> {
    let report = gc::collect(&args.store.cache, options).map_err(stop)?;
    let GcReport { kept_entries, removed_entries, in_use, pinned, removed_objects, freed_bytes } =
        report;
    if ui.json {
        let line = serde_json::json!({
            "kept": kept_entries, "removed": removed_entries, "objects": removed_objects,
            "bytes": freed_bytes, "in_use": in_use, "pinned": pinned, "dry_run": options.dry_run,
        });
        println!("{line}");
    } else {
        let verb = if options.dry_run { "would remove" } else { "removed" };
        let size = show_bytes(freed_bytes);
        println!(
            "{verb} {removed_entries} results and {removed_objects} artifacts ({size}); \
             {kept_entries} results stay"
        );
        for (n, why) in [(in_use, "because a run uses them"), (pinned, "because they are pinned")] {
            if n > 0 {
                println!("{n} of them {why}");
            }
        }
    }
    Ok(Exit::Success)
}

fn stop(error: GcError) -> Failure {
    match error {
        GcError::InUse { .. } => Failure::environment(error),
        GcError::Store(error) => super::common::cache_stop(&error),
    }
}
