//! `sinew check`: everything short of running.

use std::path::PathBuf;

use super::{Exit, Failure, pipeline_args::SettingsArgs, ui::Ui, words::count};
use crate::{LIBRARY, engine::pipeline};

/// Check pipelines without running them
#[derive(clap::Args)]
pub struct Args {
    /// The pipelines
    #[arg(required = true)]
    files: Vec<PathBuf>,
    #[command(flatten)]
    settings: SettingsArgs,
}

pub fn run(args: &Args, ui: &Ui) -> Result<Exit, Failure> {
    let mut n_mistakes = 0;
    for file in &args.files {
        match pipeline::check(file, &LIBRARY, &args.settings.to_settings()) {
            Ok(n_nodes) => {
                ui.status("Checked", &format!("{}: {}", file.display(), count(n_nodes, "node")));
            }
            Err(diagnostics) => {
                ui.diagnostics(&diagnostics);
                n_mistakes += diagnostics.list.len();
            }
        }
    }
    if n_mistakes == 0 {
        return Ok(Exit::Success);
    }
    ui.error(&count(n_mistakes, "mistake"));
    Ok(Exit::Invalid)
}
