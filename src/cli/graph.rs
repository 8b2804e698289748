//! `sinew graph`: what a pipeline looks like.

use super::{Exit, Failure, pipeline_args::PipelineArgs, ui::Ui};
use crate::report::graph;

/// Draw a pipeline: as text, or for other programs
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    pipeline: PipelineArgs,
    #[command(flatten)]
    format: Format,
}

#[derive(clap::Args)]
#[group(multiple = false)]
struct Format {
    /// For Graphviz
    #[arg(long)]
    dot: bool,
    /// For Markdown files
    #[arg(long)]
    mermaid: bool,
    /// A picture
    #[arg(long)]
    svg: bool,
}

pub fn run(args: &Args, ui: &Ui) -> Result<Exit, Failure> {
    let pipeline = args.pipeline.load()?;
    ui.data(&match args.format {
        Format { dot: true, .. } => graph::dot(&pipeline),
        Format { mermaid: true, .. } => graph::mermaid(&pipeline),
        Format { svg: true, .. } => graph::svg(&pipeline),
        _ => graph::text(&pipeline),
    });
    Ok(Exit::Success)
}
