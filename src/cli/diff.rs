//! `sinew diff`: two runs side by side.

use std::{collections::BTreeMap, fmt::Write};

use serde_json::json;

use super::{Exit, Failure, LIBRARY, Ui, common::StoreArgs, runs, words::count};
use crate::{
    engine::{
        clock::show_secs,
        compare::{self, Comparison, Fared, OutputCompared},
        digest::Digest,
        record::{Line, Record},
        store::Store,
        why::name_some,
    },
    kernels::table::Table,
    report::table_diff::{self, ColumnDiff, Leftover, Pair, TableDiff},
};

/// Compare two runs: parameters, what ran, results, numbers of tables, time
///
/// Numbers are compared in every output that is a table. Rows are matched by their texts; a number
/// that is missing on one side is told and counted, never averaged.
#[derive(clap::Args)]
pub struct Args {
    /// The run before: `last`, `last~1`, or the beginning of its name
    #[arg(default_value = "last~1")]
    before: String,

    /// The run after
    #[arg(default_value = "last")]
    after: String,

    #[command(flatten)]
    store: StoreArgs,

    /// Writes Markdown
    #[arg(long)]
    md: bool,

    /// Rows of each column to show, those that changed most first
    #[arg(long, default_value_t = 5, value_name = "N")]
    rows: usize,

    /// Ends with exit code 5 if a number of a table changed by more than so many percent of what it
    /// was, or went missing; which way counts is said by `--worse`
    #[arg(long, value_name = "PERCENT")]
    fail_above: Option<f64>,

    /// Which way a number gets worse
    #[arg(long, value_name = "WAY", default_value = "either", requires = "fail_above")]
    worse: Worse,

    /// Only the columns of these names count for `--fail-above`
    #[arg(long, value_name = "NAME", requires = "fail_above")]
    column: Vec<String>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Worse {
    /// Errors, times: larger is worse
    Larger,
    /// Scores: smaller is worse
    Smaller,
    /// Any change is
    Either,
}

pub fn run(args: &Args, ui: &Ui) -> Result<Exit, Failure> {
    let before = runs::find(&args.store.cache, &args.before)?;
    let after = runs::find(&args.store.cache, &args.after)?;
    let store = args.store.open_read_only()?;
    let diff = Diff::new(before, after, &store);
    if ui.json {
        diff.print_json(ui);
    } else {
        ui.data(&diff.render(args));
    }
    let bad = args.fail_above.map(|limit| diff.beyond(limit, args.worse, &args.column));
    match bad.as_deref() {
        None | Some([]) => Ok(Exit::Success),
        Some(bad) => {
            let what = count(bad.len(), "number");
            let limit = args.fail_above.unwrap_or_default();
            ui.error(&format!("{what} beyond {limit} %: {}", name_some(bad)));
            Ok(Exit::Threshold)
        }
    }
}

struct Diff {
    before: Record,
    after: Record,
    comparison: Comparison,
    tables: Vec<ComparedTable>,
}

/// A table of one instance in both runs, or why it cannot be compared.
struct ComparedTable {
    name: String,
    diff: Result<TableDiff, String>,
}

impl Diff {
    fn new(before: Record, after: Record, store: &Store) -> Self {
        let comparison = compare::compare(&before, &after, store);
        let is_table = |it: &&OutputCompared| it.ty.as_deref() == Some("table");
        let tables = comparison.outputs.iter().filter(is_table).map(|it| compare_table(it, store));
        let tables = tables.collect();
        Self { before, after, comparison, tables }
    }

    /// The names of all numbers that got worse by more than a limit.
    fn beyond(&self, percent: f64, worse: Worse, columns: &[String]) -> Vec<String> {
        let is_beyond = |it: &Pair| {
            let change = 100.0 * it.relative();
            let gone = !it.before.is_nan() && it.after.is_nan();
            gone || match worse {
                Worse::Larger => change > percent,
                Worse::Smaller => change < -percent,
                Worse::Either => change.abs() > percent,
            }
        };
        let mut res = Vec::new();
        for ComparedTable { name, diff } in &self.tables {
            let diff = match diff {
                Ok(diff) => diff,
                Err(why) => {
                    res.push(format!("{name}: {why}"));
                    continue;
                }
            };
            res.extend(diff.only_before.rows.iter().map(|it| format!("{name}: {it}")));
            let counts = |it: &&ColumnDiff| columns.is_empty() || columns.contains(&it.name);
            for column in diff.columns.iter().filter(counts) {
                let bad = column.pairs.iter().filter(|it| is_beyond(it));
                res.extend(bad.map(|it| format!("{name}: {} of {}", column.name, it.row)));
            }
        }
        res
    }
}

fn compare_table(output: &OutputCompared, store: &Store) -> ComparedTable {
    let name = format!("{}.{}", output.instance, output.port);
    let read = |digest: &Digest, which: &str| {
        table(digest, store).map_err(|why| format!("the table of the run {which}: {why}"))
    };
    let both = read(&output.before, "before")
        .and_then(|before| Ok((before, read(&output.after, "after")?)));
    ComparedTable { name, diff: both.map(|(before, after)| table_diff::compare(&before, &after)) }
}

fn table(digest: &Digest, store: &Store) -> Result<std::sync::Arc<Table>, String> {
    let kind = LIBRARY.artifact_kind("table").expect("the library has tables");
    let bytes = store.object(kind.ty, digest).map_err(|e| e.to_string())?;
    let artifact = kind.decode(&bytes, Some(*digest)).map_err(|e| e.to_string())?;
    Ok(artifact.downcast().expect("a table was decoded"))
}

/// A part of what is written: a title, and rows of cells below heads.
struct Section {
    title: String,
    heads: Vec<&'static str>,
    rows: Vec<Vec<String>>,
}

impl Diff {
    fn render(&self, args: &Args) -> String {
        let mut res = String::new();
        let sections =
            [self.runs(), self.changes(), self.instances(), self.nodes(), self.outputs()];
        let tables = self.tables.iter().flat_map(|it| table_sections(it, args.rows));
        for section in sections.into_iter().chain(tables).filter(|it| !it.rows.is_empty()) {
            res += &if args.md { section.markdown() } else { section.text() };
            res.push('\n');
        }
        res
    }

    fn runs(&self) -> Section {
        let row = |which: &str, record: &Record| {
            let start = &record.start;
            let secs = match record.done() {
                Some(Line::RunDone { t, .. }) => show_secs(*t),
                _ => "did not end".to_owned(),
            };
            vec![which.to_owned(), start.run.clone(), secs, start.args.join(" ")]
        };
        Section {
            title: "Runs".to_owned(),
            heads: vec!["", "run", "time", "command"],
            rows: vec![row("before", &self.before), row("after", &self.after)],
        }
    }

    fn changes(&self) -> Section {
        let mut rows: Vec<Vec<String>> = Vec::new();
        for change in &self.comparison.changes {
            let what = &change.difference.what;
            let what = what.strip_prefix("params.").unwrap_or(what);
            let names = match change.instances.len() {
                1 => change.instances[0].clone(),
                n => format!("{} ({n} instances)", change.node),
            };
            let (old, new) = (change.difference.old.clone(), change.difference.new.clone());
            rows.push(vec![names, what.to_owned(), old, new]);
        }
        let unknown = &self.comparison.unknown;
        if !unknown.is_empty() {
            let why = "not known: what one of them was made from is not stored".to_owned();
            rows.push(vec![name_some(unknown), "?".to_owned(), why, String::new()]);
        }
        Section {
            title: "Changes".to_owned(),
            heads: vec!["node", "what", "before", "after"],
            rows,
        }
    }

    /// Nodes and items that came and went.
    fn instances(&self) -> Section {
        let mut rows = Vec::new();
        let sides =
            [("removed", &self.comparison.only_before), ("added", &self.comparison.only_after)];
        for (word, ids) in sides {
            let mut by_node: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
            for id in ids {
                by_node.entry(compare::node_of(id)).or_default().push(id);
            }
            for (node, ids) in by_node {
                let items: Vec<&str> =
                    ids.iter().filter_map(|it| Some(it.split_once('@')?.1)).collect();
                let shown = items[..items.len().min(6)].join("; ");
                let more = items.len().saturating_sub(6);
                let more = if more > 0 { format!(" and {more} more") } else { String::new() };
                rows.push(vec![word.to_owned(), node.to_owned(), format!("{shown}{more}")]);
            }
        }
        Section { title: "Nodes and items".to_owned(), heads: vec!["", "node", "items"], rows }
    }

    fn nodes(&self) -> Section {
        let time = |it: &Fared| {
            if it.wall_s > 0.0 { show_secs(it.wall_s) } else { String::new() }
        };
        let row = |it: &compare::NodeCompared| {
            vec![
                it.node.clone(),
                counts(&it.before),
                counts(&it.after),
                time(&it.before),
                time(&it.after),
            ]
        };
        Section {
            title: "What ran".to_owned(),
            heads: vec!["node", "before", "after", "time before", "time after"],
            rows: self.comparison.nodes.iter().map(row).collect(),
        }
    }

    fn outputs(&self) -> Section {
        let mut by_port: BTreeMap<(&str, &str), Vec<&OutputCompared>> = BTreeMap::new();
        for output in &self.comparison.outputs {
            let node = compare::node_of(&output.instance);
            by_port.entry((node, &output.port)).or_default().push(output);
        }
        let row = |((node, port), outputs): ((&str, &str), Vec<&OutputCompared>)| {
            let ty = outputs.iter().find_map(|it| it.ty.clone());
            let which = match outputs[..] {
                [one] => one.instance.clone(),
                _ => count(outputs.len(), "instance"),
            };
            let ty = ty.unwrap_or_else(|| "no longer stored".to_owned());
            vec![format!("{node}.{port}"), ty, which]
        };
        Section {
            title: "Results that differ".to_owned(),
            heads: vec!["output", "type", "of"],
            rows: by_port.into_iter().map(row).collect(),
        }
    }

    fn print_json(&self, ui: &Ui) {
        let Comparison { changes, unknown, only_before, only_after, nodes, outputs } =
            &self.comparison;
        let run = |it: &Record| json!({ "run": it.start.run, "args": it.start.args });
        ui.json_line(&json!({
            "fact": "runs", "before": run(&self.before), "after": run(&self.after),
        }));
        for it in changes {
            ui.json_line(&json!({
                "fact": "change", "node": it.node, "what": it.difference.what,
                "before": it.difference.old, "after": it.difference.new, "instances": it.instances,
            }));
        }
        for (fact, ids) in [("unknown", unknown), ("removed", only_before), ("added", only_after)] {
            ids.iter().for_each(|it| ui.json_line(&json!({ "fact": fact, "node": it })));
        }
        for it in nodes {
            let fared = |it: &Fared| json!({ "counts": it.counts, "wall_s": it.wall_s });
            ui.json_line(&json!({
                "fact": "node", "node": it.node, "before": fared(&it.before),
                "after": fared(&it.after),
            }));
        }
        for it in outputs {
            ui.json_line(&json!({
                "fact": "output", "node": it.instance, "port": it.port, "type": it.ty,
                "before": it.before, "after": it.after,
            }));
        }
        for ComparedTable { name, diff } in &self.tables {
            let diff = match diff {
                Ok(diff) => diff,
                Err(why) => {
                    ui.json_line(&json!({ "fact": "lost_table", "table": name, "why": why }));
                    continue;
                }
            };
            for column in &diff.columns {
                for it in &column.pairs {
                    // What is no number is `null` in JSON.
                    ui.json_line(&json!({
                        "fact": "number", "table": name, "column": column.name,
                        "unit": column.unit, "row": it.row, "before": it.before, "after": it.after,
                        "difference": it.difference(), "relative": it.relative(),
                    }));
                }
            }
            for (fact, it) in [("removed", &diff.only_before), ("added", &diff.only_after)] {
                if *it != Leftover::default() {
                    ui.json_line(&json!({
                        "fact": format!("{fact}_in_table"), "table": name, "rows": it.rows,
                        "columns": it.columns,
                    }));
                }
            }
        }
    }
}

/// `2 ran, 1 cached`
fn counts(fared: &Fared) -> String {
    if fared.counts.is_empty() {
        return "–".to_owned();
    }
    let texts = fared.counts.iter().map(|(what, n)| format!("{n} {}", what.replace('_', " ")));
    texts.collect::<Vec<_>>().join(", ")
}

/// The columns of a table summed up, then the rows that changed most.
fn table_sections(table: &ComparedTable, n_rows: usize) -> Vec<Section> {
    let diff = match &table.diff {
        Ok(diff) => diff,
        Err(why) => {
            return vec![Section {
                title: format!("Table {}", table.name),
                heads: vec!["cannot be compared"],
                rows: vec![vec![why.clone()]],
            }];
        }
    };
    let mut rows: Vec<Vec<String>> = diff.columns.iter().map(summary_row).collect();
    for (word, it) in [("gone", &diff.only_before), ("new", &diff.only_after)] {
        for (what, names) in [("column", &it.columns), ("row", &it.rows)] {
            if !names.is_empty() {
                let n = count(names.len(), what);
                rows.push(vec![format!("{n} {word}: {}", name_some(names))]);
            }
        }
    }
    let by = match diff.matched_by[..] {
        [] => "rows by their numbers".to_owned(),
        ref names => format!("rows matched by `{}`", names.join("`, `")),
    };
    let summary = Section {
        title: format!("Table {} ({by})", table.name),
        heads: vec![
            "column",
            "mean before",
            "mean after",
            "difference",
            "change",
            "larger / smaller / equal",
        ],
        rows,
    };
    let changed = diff.columns.iter().flat_map(|it| changed_rows(it, n_rows)).collect();
    let most = Section {
        title: format!("Rows of {} that changed most", table.name),
        heads: vec!["column", "row", "before", "after", "difference", "change"],
        rows: changed,
    };
    vec![summary, most]
}

fn summary_row(column: &ColumnDiff) -> Vec<String> {
    let it = column.summary();
    let mut votes = format!("{} / {} / {}", it.larger, it.smaller, it.equal);
    for (n, word) in [(it.gone, "gone missing"), (it.come, "no longer missing")] {
        if n > 0 {
            votes += &format!(", {n} {word}");
        }
    }
    vec![
        titled(column),
        number(it.mean_before),
        number(it.mean_after),
        signed(it.mean_after - it.mean_before),
        percent(table_diff::relative(it.mean_before, it.mean_after)),
        votes,
    ]
}

fn changed_rows(column: &ColumnDiff, n_rows: usize) -> Vec<Vec<String>> {
    let mut changed: Vec<&Pair> = column
        .pairs
        .iter()
        .filter(|it| it.before != it.after && !(it.before.is_nan() && it.after.is_nan()))
        .collect();
    // What went missing stands first; the order of the table decides between equals.
    let size = |it: &Pair| {
        let relative = it.relative().abs();
        if relative.is_nan() { f64::INFINITY } else { relative }
    };
    changed.sort_by(|a, b| size(b).total_cmp(&size(a)));
    let row = |it: &&Pair| {
        vec![
            titled(column),
            it.row.clone(),
            number(it.before),
            number(it.after),
            signed(it.difference()),
            percent(it.relative()),
        ]
    };
    changed.iter().take(n_rows).map(row).collect()
}

fn titled(column: &ColumnDiff) -> String {
    let unit = &column.unit;
    if unit.is_empty() { column.name.clone() } else { format!("{} [{unit}]", column.name) }
}

/// Six significant digits; `missing` for what is no number.
fn number(value: f64) -> String {
    if value.is_nan() {
        return "missing".to_owned();
    }
    let magnitude = if value == 0.0 { 0.0 } else { value.abs().log10().floor() };
    if (-4.0..7.0).contains(&magnitude) {
        let digits = (5.0 - magnitude).max(0.0) as usize;
        let text = format!("{value:.digits$}");
        let text = if text.contains('.') { text.trim_end_matches('0') } else { &text };
        text.trim_end_matches('.').to_owned()
    } else {
        format!("{value:.5e}")
    }
}

fn signed(value: f64) -> String {
    if value.is_nan() {
        return String::new();
    }
    let text = number(value);
    if value > 0.0 { format!("+{text}") } else { text }
}

fn percent(fraction: f64) -> String {
    match 100.0 * fraction {
        it if it.is_nan() => String::new(),
        it if it.is_infinite() => "from zero".to_owned(),
        0.0 => "=".to_owned(),
        it => format!("{it:+.2} %"),
    }
}

impl Section {
    fn text(&self) -> String {
        let mut widths: Vec<usize> = self.heads.iter().map(|it| it.chars().count()).collect();
        // A lone cell is a sentence: it needs no column.
        for row in self.rows.iter().filter(|it| it.len() > 1) {
            for (width, cell) in widths.iter_mut().zip(row) {
                *width = (*width).max(cell.chars().count());
            }
        }
        let line = |cells: &[String]| {
            let padded = cells.iter().zip(&widths).map(|(cell, width)| format!("{cell:width$}"));
            format!("  {}\n", padded.collect::<Vec<_>>().join("  ").trim_end())
        };
        let heads: Vec<String> = self.heads.iter().map(|it| (*it).to_owned()).collect();
        let mut res = format!("{}\n", self.title);
        if self.heads.len() > 1 {
            res += &line(&heads);
        }
        for row in &self.rows {
            res += &if row.len() > 1 { line(row) } else { format!("  {}\n", row[0]) };
        }
        res
    }

    fn markdown(&self) -> String {
        let escape = |it: &str| it.replace('|', "\\|").replace('\n', " ");
        let mut res = format!("### {}\n\n", self.title);
        let _ = writeln!(res, "| {} |", self.heads.join(" | "));
        let _ = writeln!(res, "|{}", "---|".repeat(self.heads.len()));
        for row in &self.rows {
            let mut cells: Vec<String> = row.iter().map(|it| escape(it)).collect();
            cells.resize(self.heads.len(), String::new());
            let _ = writeln!(res, "| {} |", cells.join(" | "));
        }
        res
    }
}
