//! `sinew check`: everything short of running.

use std::path::PathBuf;

use super::{
    Exit, Failure,
    pipeline_args::SettingsArgs,
    ui::{Ui, count},
};

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
        match args.settings.load(file) {
            Ok(graph) => {
                let n_nodes = count(graph.instances.node_count(), "node");
                ui.status("Checked", &format!("{}: {n_nodes}", file.display()));
            }
            Err(Failure::Pipeline(diagnostics)) => {
                ui.diagnostics(&diagnostics);
                n_mistakes += diagnostics.list.len();
            }
            Err(failure) => return Err(failure),
        }
    }
    if n_mistakes == 0 {
        return Ok(Exit::Success);
    }
    ui.error(&count(n_mistakes, "mistake"));
    Ok(Exit::Invalid)
}
