//! `sinew schema`: for editors.

use super::{Exit, Failure, ui::Ui};
use crate::{LIBRARY, engine::schema};

/// Write the JSON schema of pipeline files
///
/// With a first line `#:schema ./sinew.schema.json` an editor completes and checks pipelines.
#[derive(clap::Args)]
pub struct Args {}

pub fn run(_args: &Args, ui: &Ui) -> Result<Exit, Failure> {
    ui.data(&schema::schema_text(&LIBRARY));
    Ok(Exit::Success)
}
