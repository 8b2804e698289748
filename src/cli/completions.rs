//! `sinew completions`.

use std::io::Write;

use clap_complete::Shell;

use super::{Exit, Failure};

/// Write a completion script for a shell
#[derive(clap::Args)]
pub struct Args {
    shell: Shell,
}

pub fn run(args: &Args, command: &mut clap::Command) -> Result<Exit, Failure> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, command, "sinew", &mut script);
    std::io::stdout()
        .write_all(&script)
        .map_err(|e| Failure::Environment(format!("cannot write the script: {e}")))?;
    Ok(Exit::Success)
}
