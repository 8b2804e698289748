//! From a pipeline file to a checked graph.
//!
//! Every step goes on after a mistake, and the next ones keep quiet about what is already known to
//! be broken, so that one reading tells every mistake once:
//!
//! 1. [`sources`] reads files, [`parse`] cuts them into sections ([`plain_toml`] does most
//!    of it), [`value`] keeps places;
//! 2. [`overrides`] applies a profile and `--set` to the file that was asked for;
//! 3. [`expand`] turns inner pipelines into nodes, fills in `${}` ([`substitute`]) and takes out how
//!    each node is run ([`settings`]); the ports that a node of an open kind declares become those of
//!    its kind ([`open_ports`]);
//! 4. [`wires`] finds the nodes that `@` names, through the ports of inner pipelines;
//! 5. [`check`] holds every node against its kind: parameters ([`convert`]), wires, files;
//! 6. [`outputs`] and [`cycles`] look at the whole.

mod axes;
mod check;
mod convert;
mod cycles;
pub mod diagnostic;
mod expand;
mod gather;
mod nearest;
mod open_ports;
mod outputs;
mod overrides;
mod parse;
mod plain_toml;
mod repeat;
mod settings;
mod sources;
mod substitute;
mod value;
mod wires;

use std::path::{Path, PathBuf};

pub use axes::listing;
pub use diagnostic::{Diagnostic, Diagnostics, Severity};
pub use nearest::suggest;
pub use open_ports::with_ports;

use self::{expand::Expansion, parse::Document, sources::Sources};
use super::{graph::Graph, library::Library};

/// What the user changes about a pipeline without touching its file.
#[derive(Debug, Clone, Default)]
pub struct Settings {
    /// The name of a `[profiles.NAME]` of the file.
    pub profile: Option<String>,
    /// `parameter=value` or `node.parameter=value`: values as in TOML, and what is none is a text.
    pub set: Vec<String>,
    /// `axis=item,item`: only these items; labels or patterns of `*` and `?`.
    pub only: Vec<String>,
    /// `axis=n`: only the first items.
    pub limit: Vec<String>,
}

/// Reads, expands and checks a pipeline file.
///
/// # Errors
/// With everything that is wrong.
pub fn load(path: &Path, library: &Library, settings: &Settings) -> Result<Graph, Diagnostics> {
    load_first(read(path)?, library, settings, true)
}

/// The same for a text that is no file; relative paths start in `folder`.
///
/// # Errors
/// With everything that is wrong.
pub fn load_text(
    text: &str,
    folder: PathBuf,
    library: &Library,
    settings: &Settings,
) -> Result<Graph, Diagnostics> {
    let mut sources = Sources::default();
    sources.add(folder.join("pipeline.toml"), text, folder);
    load_first(sources, library, settings, true)
}

/// Checks a pipeline file, which may be one that others use as a node. Returns the number of nodes.
///
/// # Errors
/// With everything that is wrong.
pub fn check(path: &Path, library: &Library, settings: &Settings) -> Result<usize, Diagnostics> {
    let graph = load_first(read(path)?, library, settings, false)?;
    Ok(graph.instances.node_count())
}

fn read(path: &Path) -> Result<Sources, Diagnostics> {
    let mut sources = Sources::default();
    match sources.read(path) {
        Ok(_) => Ok(sources),
        Err(message) => {
            let problem = Diagnostic::without_place(message);
            Err(Diagnostics::new(vec![problem], sources.list))
        }
    }
}

/// The graph of the first source. A `whole` pipeline has no inputs; the graph of another lacks what
/// they would be wired to.
fn load_first(
    mut sources: Sources,
    library: &Library,
    settings: &Settings,
    whole: bool,
) -> Result<Graph, Diagnostics> {
    let mut problems = Vec::new();
    let graph = parse::parse(0, &sources.list[0], &mut problems).and_then(|mut document| {
        if whole {
            report_inputs(&document, &mut problems);
        }
        overrides::apply(&mut document, settings, &mut sources, &mut problems);
        let Settings { only, limit, .. } = settings;
        let mut choices = axes::read_choices(only, limit, &mut sources, &mut problems);
        let expansion =
            Expansion::new(document, library, &mut sources, &mut choices, &mut problems);
        check::check(&expansion, library, &sources, &mut problems)
    });
    match graph {
        Some(graph) if problems.is_empty() => {
            Ok(Graph { sources: sources.list, looks: Some(sources.looks), ..graph })
        }
        _ => Err(Diagnostics::new(problems, sources.list)),
    }
}

fn report_inputs(document: &Document, problems: &mut Vec<Diagnostic>) {
    if let Some(input) = document.inputs.first() {
        let message = "a pipeline with inputs cannot run on its own";
        problems.push(
            Diagnostic::error(&input.name.place, message)
                .hint("use it as a node with `kind = \"pipeline\"`".to_owned()),
        );
    }
}
