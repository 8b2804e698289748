//! The last lines of a run: what came of it, what failed, and how to go on.

use std::{collections::BTreeMap, io::Write, path::Path};

use petgraph::graph::NodeIndex;

use super::{
    pipeline_args::PipelineArgs,
    style,
    words::{go_on, show_failure},
};
use crate::engine::{
    clock::show_duration,
    events::{Outcome, RunReport},
    graph::Graph,
};

/// More failures, or more nodes that one of them stops, are only counted.
const MAX_LISTED: usize = 10;

/// Tells how a run ended.
pub fn summarize(report: &RunReport, graph: &Graph, args: &PipelineArgs, run_id: &str) {
    finished(report, graph, run_id);
    let failed = failed_nodes(report);
    for &index in failed.iter().take(MAX_LISTED) {
        tell_failed(report, graph, index);
    }
    if failed.len() > MAX_LISTED {
        line(style::BAD, "failed", &format!("and {} more", failed.len() - MAX_LISTED));
    }
    for (cause, nodes) in skipped_nodes(report) {
        let cause = graph.instances[cause].id();
        line(style::WARN, "skipped", &format!("{}, for want of {cause}", names(graph, &nodes)));
    }
    if !failed.is_empty() {
        line(style::NOTE, "again", &again(graph, args, &failed));
    }
    if report.stopped && !report.succeeded() {
        let counts = report.counts();
        let n_done = counts.ran + counts.cached + counts.cut_off;
        let n_wanted = n_done + counts.failed + counts.skipped;
        line(style::WARN, "stopped", &go_on(n_done, n_wanted));
    }
}

fn line(style: anstyle::Style, word: &str, rest: &str) {
    // Nobody is left to read it if the terminal is gone.
    let _ = writeln!(anstream::stderr(), "{style}{word:>10}{style:#}  {rest}");
}

fn finished(report: &RunReport, graph: &Graph, run_id: &str) {
    let counts = report.counts();
    let time = show_duration(report.wall);
    let (head, text) = if report.succeeded() && counts.ran == 0 {
        let n = counts.cached + counts.cut_off;
        (style::GOOD, format!("{n} nodes up to date in {time}"))
    } else {
        let named = [
            (counts.ran, "ran"),
            (counts.cached, "cached"),
            (counts.cut_off, "cut off"),
            (counts.failed, "failed"),
            (counts.skipped - counts.not_reached, "skipped"),
            (counts.not_reached, "not reached"),
        ];
        let parts: Vec<String> =
            named.iter().filter(|it| it.0 > 0).map(|(n, what)| format!("{n} {what}")).collect();
        let head = if report.succeeded() { style::GOOD } else { style::BAD };
        (head, format!("{} of {} nodes in {time}", parts.join(", "), graph.instances.node_count()))
    };
    let note = style::NOTE;
    line(head, "Finished", &format!("{text}  {note}(run {run_id}){note:#}"));
}

fn failed_nodes(report: &RunReport) -> Vec<NodeIndex> {
    let outcomes = report.outcomes.iter().enumerate();
    let failed = outcomes.filter(|it| matches!(it.1, Outcome::Failed { .. }));
    failed.map(|it| NodeIndex::new(it.0)).collect()
}

/// What was skipped, by the failed node that is to blame.
fn skipped_nodes(report: &RunReport) -> BTreeMap<NodeIndex, Vec<NodeIndex>> {
    let mut res: BTreeMap<NodeIndex, Vec<NodeIndex>> = BTreeMap::new();
    for (index, outcome) in report.outcomes.iter().enumerate() {
        if let Outcome::Skipped { because } = outcome {
            res.entry(root_cause(report, *because)).or_default().push(NodeIndex::new(index));
        }
    }
    res
}

/// The failure at the beginning of a chain of skipped nodes.
fn root_cause(report: &RunReport, mut index: NodeIndex) -> NodeIndex {
    while let Outcome::Skipped { because } = report.outcomes[index.index()] {
        index = because;
    }
    index
}

fn tell_failed(report: &RunReport, graph: &Graph, index: NodeIndex) {
    let Outcome::Failed { failure, .. } = &report.outcomes[index.index()] else { return };
    let message = show_failure(failure);
    let first_line = message.lines().next().unwrap_or_default();
    line(style::BAD, "failed", &format!("{}  {first_line}", graph.instances[index].id()));
}

fn names(graph: &Graph, nodes: &[NodeIndex]) -> String {
    let shown = nodes.iter().take(MAX_LISTED).map(|&it| graph.instances[it].id());
    let shown: Vec<String> = shown.collect();
    match nodes.len().saturating_sub(MAX_LISTED) {
        0 => shown.join(", "),
        more => format!("{} and {more} more", shown.join(", ")),
    }
}

/// The command that runs what failed, and only that.
fn again(graph: &Graph, args: &PipelineArgs, failed: &[NodeIndex]) -> String {
    let mut words = vec!["sinew".to_owned(), "run".to_owned(), show_path(&args.file)];
    words.extend(args.settings.to_words());
    let ids = failed.iter().take(MAX_LISTED).map(|&it| graph.instances[it].id());
    words.extend(ids);
    words.iter().map(|it| quoted(it)).collect::<Vec<_>>().join(" ")
}

fn show_path(path: &Path) -> String {
    path.display().to_string()
}

/// A word as a shell reads it.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "_-./@,=:+%".contains(c);
    match !word.is_empty() && word.chars().all(is_plain) {
        true => word.to_owned(),
        false => format!("'{}'", word.replace('\'', "'\\''")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_survive_the_shell() {
        for (word, shown) in [
            ("score@wolf,40", "score@wolf,40"),
            ("name=my mesh", "'name=my mesh'"),
            ("it's", "'it'\\''s'"),
            ("", "''"),
        ] {
            assert_eq!(quoted(word), shown);
        }
    }
}
