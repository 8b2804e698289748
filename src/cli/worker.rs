//! `sinew worker`: the process of one node that runs apart. Started by `sinew run` only.

use super::{Exit, Failure};
use crate::engine::{run, toy::TOY};

/// Does one job that is described on standard input
#[derive(clap::Args)]
pub struct Args {
    /// Knows the kinds of the engine's tests instead of the real ones
    #[arg(long, hide = true)]
    toy: bool,
}

pub fn run(args: &Args) -> Result<Exit, Failure> {
    let library = if args.toy { &TOY } else { &crate::LIBRARY };
    run::serve_parent(library)
        .map_err(|e| Failure::environment(format_args!("cannot work for another process: {e}")))?;
    Ok(Exit::Success)
}
