//! What commands write, and where.

use std::io::{IsTerminal, Write};

use anstream::ColorChoice;
use clap::ValueEnum;
use tracing_subscriber::{filter::Targets, layer::SubscriberExt, util::SubscriberInitExt};

use super::{Failure, GlobalArgs, words::count};
use crate::engine::pipeline::Diagnostics;

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ColorWhen {
    Auto,
    Always,
    Never,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ProgressStyle {
    /// Live on a terminal, plain elsewhere
    Auto,
    /// A line for each running node, rewritten in place
    Live,
    /// A line for each finished node
    Plain,
    /// Nothing but failures
    None,
}

/// How much is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Detail {
    /// Failures only.
    Quiet,
    /// What ran and what was written.
    Normal,
    /// What was cached as well, and every start.
    Verbose,
}

/// The global flags and the two streams.
pub struct Ui {
    pub quiet: bool,
    pub json: bool,
    /// How much a run tells.
    pub detail: Detail,
    /// Whether standard error can show bars that move.
    pub live: bool,
}

impl Ui {
    pub(super) fn new(args: &GlobalArgs) -> Self {
        match args.color {
            ColorWhen::Auto => ColorChoice::Auto,
            ColorWhen::Always => ColorChoice::Always,
            ColorWhen::Never => ColorChoice::Never,
        }
        .write_global();
        start_log(args.verbose);
        let detail = match args.verbose {
            _ if args.quiet || args.progress == ProgressStyle::None => Detail::Quiet,
            0 => Detail::Normal,
            _ => Detail::Verbose,
        };
        let dumb = std::env::var_os("TERM").is_some_and(|it| it == "dumb");
        let live = match args.progress {
            ProgressStyle::Live => true,
            ProgressStyle::Auto => std::io::stderr().is_terminal() && !dumb && args.verbose < 2,
            ProgressStyle::Plain | ProgressStyle::None => false,
        };
        Self { quiet: args.quiet, json: args.json, detail, live }
    }

    /// Writes data to standard output. A reader that has gone away is no mistake.
    pub fn data(&self, text: &str) {
        let _ = anstream::stdout().write_all(text.as_bytes());
    }

    /// One JSON object on a line of its own.
    pub fn json_line(&self, value: &serde_json::Value) {
        self.data(&format!("{value}\n"));
    }

    /// Writes a line for people, unless they want quiet. May hold colours.
    pub fn message(&self, text: &str) {
        if !self.quiet {
            anstream::eprintln!("{text}");
        }
    }

    /// A word of what was done and what it was done to: `   Checked file.toml`.
    pub fn status(&self, verb: &str, text: &str) {
        self.message(&format!("\x1b[1;32m{verb:>12}\x1b[0m {text}"));
    }

    /// Writes a line for people in any case.
    pub fn error(&self, text: &str) {
        anstream::eprintln!("\x1b[1;91merror\x1b[0m: {text}");
    }

    /// What is wrong with a pipeline.
    pub fn diagnostics(&self, diagnostics: &Diagnostics) {
        if self.json {
            diagnostics.to_json().iter().for_each(|it| self.json_line(it));
        } else {
            anstream::eprint!("{}", diagnostics.render(true));
        }
    }

    pub(super) fn failure(&self, failure: &Failure) {
        match failure {
            Failure::Usage(message) | Failure::Environment(message) => self.error(message),
            Failure::Pipeline(diagnostics) => {
                self.diagnostics(diagnostics);
                self.error(&count(diagnostics.list.len(), "mistake"));
            }
        }
    }
}

/// The developers' log on standard error: `-v`, `-vv` or `SINEW_LOG`, targets and levels in the form of
/// `RUST_LOG`.
fn start_log(verbose: u8) {
    let default = match verbose {
        0 => "",
        1 => "sinew=info",
        _ => "sinew=trace",
    };
    let wanted = std::env::var("SINEW_LOG").unwrap_or(default.to_owned());
    if wanted.is_empty() {
        return;
    }
    match wanted.parse::<Targets>() {
        Ok(targets) => {
            let log = tracing_subscriber::fmt::layer().with_writer(std::io::stderr);
            tracing_subscriber::registry().with(log).with(targets).init();
        }
        Err(error) => anstream::eprintln!("`SINEW_LOG` is `{wanted}`: {error}"),
    }
}
