//! The command line: one file a command.
//!
//! Data goes to standard output, everything meant for people to standard error.

mod cache;
mod check;
mod common;
mod completions;
mod diff;
mod explain;
mod graph;
mod new;
mod nodes;
mod pipeline_args;
mod plan;
mod progress;
mod run;
mod runs;
mod schema;
mod show;
mod signals;
mod style;
mod summary;
mod told;
mod ui;
mod verify;
mod watch;
mod words;
mod worker;

use std::{path::PathBuf, process::ExitCode};

use clap::{CommandFactory, Parser, Subcommand};

use crate::{LIBRARY, engine::pipeline::Diagnostics};
use ui::{ColorWhen, ProgressStyle, Ui};

/// Runs geometry and animation research as declarative pipelines, cached by content.
#[derive(Parser)]
#[command(name = "sinew", version, max_term_width = 96, propagate_version = true)]
struct Cli {
    #[command(flatten)]
    global: GlobalArgs,
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Args)]
#[command(next_help_heading = "Global options")]
struct GlobalArgs {
    /// Go to this folder first
    #[arg(short = 'C', value_name = "DIR", global = true)]
    folder: Option<PathBuf>,
    /// Only say what went wrong
    #[arg(short, long, global = true, conflicts_with = "verbose", env = "SINEW_QUIET")]
    quiet: bool,
    /// Say more; twice: everything
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    verbose: u8,
    /// Colours; without it as NO_COLOR, CLICOLOR_FORCE and the terminal say
    #[arg(long, value_name = "WHEN", global = true, default_value = "auto", env = "SINEW_COLOR")]
    color: ColorWhen,
    /// Write JSON, one object a line, to standard output
    #[arg(long, global = true)]
    json: bool,
    /// How a run shows what it does
    #[arg(
        long,
        value_name = "STYLE",
        global = true,
        default_value = "auto",
        env = "SINEW_PROGRESS"
    )]
    progress: ProgressStyle,
}

#[derive(Subcommand)]
enum Command {
    Run(run::Args),
    Plan(plan::Args),
    Watch(watch::Args),
    Explain(explain::Args),
    Show(show::Args),
    Runs(runs::Args),
    Diff(diff::Args),
    Verify(verify::Args),
    Cache(cache::Args),
    Check(check::Args),
    Graph(graph::Args),
    Nodes(nodes::Args),
    New(new::Args),
    Schema(schema::Args),
    Completions(completions::Args),
    #[command(hide = true)]
    Worker(worker::Args),
}

/// How a command ended, if it could do its work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Exit {
    Success = 0,
    NodeFailed = 1,
    /// Wrong usage or a wrong pipeline.
    Invalid = 2,
    /// Disk, network, permissions.
    Environment = 3,
    /// What is stored is not what it should be: out of date, damaged, or not made again alike.
    Stale = 4,
    /// A number is beyond the limit that was given.
    Threshold = 5,
    Bug = 101,
    /// Stopped by Ctrl-C or another signal.
    Interrupted = 130,
}

/// Why a command could not do its work.
#[derive(Debug)]
pub enum Failure {
    Usage(String),
    Pipeline(Diagnostics),
    Environment(String),
}

impl From<Diagnostics> for Failure {
    fn from(diagnostics: Diagnostics) -> Self {
        Self::Pipeline(diagnostics)
    }
}

impl Failure {
    fn usage(message: impl std::fmt::Display) -> Self {
        Self::Usage(message.to_string())
    }

    fn environment(message: impl std::fmt::Display) -> Self {
        Self::Environment(message.to_string())
    }

    fn exit(&self) -> Exit {
        match self {
            Self::Usage(_) | Self::Pipeline(_) => Exit::Invalid,
            Self::Environment(_) => Exit::Environment,
        }
    }
}

/// What `main` does.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    let ui = Ui::new(&cli.global);
    let res = enter_folder(cli.global.folder.as_deref()).and_then(|()| start(cli.command, &ui));
    let exit = res.unwrap_or_else(|failure| {
        ui.failure(&failure);
        failure.exit()
    });
    ExitCode::from(exit as u8)
}

fn start(command: Command, ui: &Ui) -> Result<Exit, Failure> {
    match command {
        Command::Run(args) => run::run(&args, ui),
        Command::Watch(args) => watch::run(&args, ui),
        Command::Verify(args) => verify::run(&args, ui),
        Command::Plan(args) => plan::run(&args, ui),
        Command::Explain(args) => explain::run(&args, ui),
        Command::Show(args) => show::run(&args, ui),
        Command::Runs(args) => runs::run(&args, ui),
        Command::Diff(args) => diff::run(&args, ui),
        Command::Cache(args) => cache::run(&args, ui),
        Command::Check(args) => check::run(&args, ui),
        Command::Graph(args) => graph::run(&args, ui),
        Command::Nodes(args) => nodes::run(&args, ui),
        Command::New(args) => new::run(&args, ui),
        Command::Schema(args) => schema::run(&args, ui),
        Command::Worker(args) => worker::run(&args),
        Command::Completions(args) => completions::run(&args, &mut Cli::command()),
    }
}

fn enter_folder(folder: Option<&std::path::Path>) -> Result<(), Failure> {
    let Some(folder) = folder else { return Ok(()) };
    std::env::set_current_dir(folder)
        .map_err(|e| Failure::Usage(format!("cannot go to the folder `{}`: {e}", folder.display())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_sound() {
        Cli::command().debug_assert();
    }
}
