//! `--only target=003,004` and `--limit target=5`: fewer items for one run.

use super::{Axis, condition::is_like, list::Reading};
use crate::engine::{
    graph::Place,
    pipeline::{
        diagnostic::{Diagnostic, Problems},
        nearest::suggest,
        sources::Sources,
    },
};

/// What the user narrows about one axis.
#[derive(Debug)]
pub struct Choice {
    axis: String,
    keep: Keep,
    place: Place,
    /// Whether there is such an axis.
    used: bool,
}

#[derive(Debug)]
enum Keep {
    /// Items with one of these labels, which may be patterns of `*` and `?`.
    Only(Vec<String>),
    First(usize),
}

/// Reads `axis=item,item` of every `--only` and `axis=n` of every `--limit`.
pub fn read_choices(
    only: &[String],
    limit: &[String],
    sources: &mut Sources,
    problems: &mut Problems,
) -> Vec<Choice> {
    let mut res = Vec::new();
    for (flag, texts) in [("--only", only), ("--limit", limit)] {
        for text in texts {
            let source = sources.add(flag.into(), text, std::path::PathBuf::new());
            let place = Place::new(source, 0..text.len());
            let read = text.split_once('=').map(|(axis, rest)| (axis.trim(), rest));
            let keep = read.and_then(|(_, rest)| match flag {
                "--only" => {
                    Some(Keep::Only(rest.split(',').map(|it| it.trim().to_owned()).collect()))
                }
                _ => rest.trim().parse().ok().filter(|&it| it > 0).map(Keep::First),
            });
            match (read, keep) {
                (Some((axis, _)), Some(keep)) if !axis.is_empty() => {
                    res.push(Choice { axis: axis.to_owned(), keep, place, used: false });
                }
                _ => {
                    let form = if flag == "--only" { "axis=item,item" } else { "axis=number" };
                    let message = format!("`{flag}` is written as `{form}`");
                    problems.push(Diagnostic::error(&place, message));
                }
            }
        }
    }
    res
}

/// Leaves out what the user did not choose.
pub fn choose(axis: &mut Axis, reading: &mut Reading<'_>) {
    for choice in reading.choices.iter_mut().filter(|it| *it.axis == *axis.name) {
        choice.used = true;
        match &choice.keep {
            Keep::First(n) => axis.items.truncate(*n),
            Keep::Only(wanted) => {
                let is_wanted = |label: &str| wanted.iter().any(|it| is_like(label, it));
                for missing in wanted {
                    if !axis.items.iter().any(|it| is_like(&it.label, missing)) {
                        let message = format!("axis `{}` has no item `{missing}`", axis.name);
                        let labels = axis.items.iter().map(|it| &*it.label);
                        let hint = suggest(missing, labels);
                        reading.problems.push(Diagnostic::error(&choice.place, message).hint(hint));
                    }
                }
                axis.items.retain(|it| is_wanted(&it.label));
            }
        }
    }
}

/// Reports what the user narrows although there is no such axis.
pub fn report_unknown_axes(choices: &[Choice], axes: &[Axis], problems: &mut Problems) {
    for choice in choices.iter().filter(|it| !it.used) {
        let message = format!("there is no axis `{}`", choice.axis);
        let hint = suggest(&choice.axis, axes.iter().map(|it| &*it.name))
            .unwrap_or_else(|| "the pipeline has no axes".to_owned());
        problems.push(Diagnostic::error(&choice.place, message).hint(hint));
    }
}
