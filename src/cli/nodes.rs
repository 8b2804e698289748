//! `sinew nodes`: the reference of kinds.

use super::{Exit, Failure, ui::Ui};
use crate::{
    LIBRARY,
    engine::{pipeline::suggest, reference},
};

/// List the kinds of nodes, or show one
#[derive(clap::Args)]
pub struct Args {
    /// The kind; all in a list if it is left out
    kind: Option<String>,
    /// The whole reference in Markdown
    #[arg(long, conflicts_with = "kind")]
    md: bool,
}

pub fn run(args: &Args, ui: &Ui) -> Result<Exit, Failure> {
    let kinds = match &args.kind {
        None => LIBRARY.kinds,
        Some(name) => std::slice::from_ref(LIBRARY.kind(name).ok_or_else(|| unknown(name))?),
    };
    if ui.json {
        kinds.iter().for_each(|it| ui.json_line(&reference::kind_json(it)));
    } else if args.md {
        ui.data(&reference::markdown(&LIBRARY));
    } else if args.kind.is_some() {
        ui.data(&reference::kind_markdown(&kinds[0]));
    } else {
        let width = kinds.iter().map(|it| it.spec.kind.len()).max().unwrap_or(0);
        for kind in kinds {
            ui.data(&format!("{:width$}  {}\n", kind.spec.kind, reference::summary(kind)));
        }
    }
    Ok(Exit::Success)
}

fn unknown(name: &str) -> Failure {
    let names = LIBRARY.kinds.iter().map(|it| it.spec.kind);
    let hint = suggest(name, names).map_or(String::new(), |it| format!(": {it}"));
    Failure::Usage(format!("there is no kind of node `{name}`{hint}"))
}
