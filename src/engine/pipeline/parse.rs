//! From text to the sections of a pipeline file. Nothing is looked up yet.

use std::{collections::HashSet, fmt::Display, ops::Range, sync::Arc};

use toml::de::DeTable;

use super::{
    diagnostic::{Diagnostic, Problems},
    nearest::{nearest, suggest},
    plain_toml,
    value::{self, Data, Entry, Key, Value},
};
use crate::engine::graph::{Place, Source};

/// The sections of one file, in the order of the file.
#[derive(Debug, Default)]
pub struct Document {
    pub title: Option<String>,
    pub cites: Vec<String>,
    pub inputs: Vec<InputPort>,
    pub params: Vec<Entry>,
    pub axes: Vec<AxisTable>,
    pub profiles: Vec<Profile>,
    pub nodes: Vec<NodeTable>,
    /// From paths (or names of ports, in an inner pipeline) to wires.
    pub outputs: Vec<Entry>,
}

/// An input of a pipeline that is used as a node.
#[derive(Debug)]
pub struct InputPort {
    pub name: Key,
    /// The name of its type.
    pub ty: Value,
}

/// Parameters under a name.
#[derive(Debug)]
pub struct Profile {
    pub name: Key,
    pub params: Vec<Entry>,
}

/// `[axes.NAME]`.
#[derive(Debug, Clone)]
pub struct AxisTable {
    pub name: Key,
    pub fields: Vec<Entry>,
}

/// `[nodes.NAME]`.
#[derive(Debug, Clone)]
pub struct NodeTable {
    pub name: Key,
    /// Broken if it is missing.
    pub kind: Value,
    /// Parameters and wires.
    pub fields: Vec<Entry>,
}

const SECTIONS: [&str; 7] =
    ["pipeline", "inputs", "params", "axes", "profiles", "nodes", "outputs"];

/// Reads a file's text. Every mistake is reported; what is left of the file is returned.
///
/// A file with mistakes of syntax gives `None`: what the parser makes of the rest is guesswork.
pub fn parse(source: usize, file: &Source, problems: &mut Problems) -> Option<Document> {
    let entries = match plain_toml::read(&file.text, source) {
        Some(entries) => entries,
        None => {
            let (table, errors) = DeTable::parse_recoverable(&file.text);
            if !errors.is_empty() {
                report_syntax(&errors, source, file, problems);
                return None;
            }
            value::entries(table.into_inner(), source, problems)
        }
    };
    let mut res = Document::default();
    for Entry { key, value } in entries {
        match &*key.name {
            "pipeline" => read_heading(value, &mut res, problems),
            "inputs" => res.inputs = read_inputs(value, problems),
            "params" => res.params = read_params(value, problems),
            "profiles" => res.profiles = read_profiles(value, problems),
            "nodes" => res.nodes = read_nodes(value, problems),
            "outputs" => res.outputs = table_entries(value, "`outputs`", problems),
            "axes" => res.axes = read_axes(value, problems),
            name => problems.push(
                Diagnostic::error(&key.place, format!("unknown section `{name}`"))
                    .hint(suggest(name, SECTIONS)),
            ),
        }
    }
    report_shared_names(&res, problems);
    if res.nodes.is_empty() && problems.is_empty() {
        let start = Place::new(source, 0..0);
        problems.push(
            Diagnostic::error(&start, "the pipeline has no nodes")
                .hint("a node is a table `[nodes.NAME]` with a `kind`".to_owned()),
        );
    }
    Some(res)
}

/// Reports mistakes of syntax. The parser goes on behind a mistake and tends to stumble over it
/// again, so one a line is told, none behind an array that is not closed, and of a table that is
/// given twice not its keys.
fn report_syntax(
    errors: &[toml::de::Error],
    source: usize,
    file: &Source,
    problems: &mut Problems,
) {
    let mut lines = HashSet::new();
    let mut in_double_table = false;
    for error in errors {
        let span = error.span().unwrap_or(0..0);
        let line = line_around(&file.text, span.start);
        let is_double = error.message() == DOUBLE_KEY;
        let is_table = line.trim_start().starts_with('[');
        let is_known = is_double && in_double_table && !is_table;
        in_double_table = is_double && (is_table || in_double_table);
        if !is_known && lines.insert(line.as_ptr()) {
            let (message, hint) = syntax_message(error.message(), &file.text, &span);
            let place = Place::new(source, span);
            problems.push(Diagnostic::error(&place, message).hint(hint));
        }
        if error.message().contains("array") {
            return;
        }
    }
}

const DOUBLE_KEY: &str = "duplicate key";

/// What the parser says, in words that fit pipelines.
fn syntax_message(message: &str, text: &str, span: &Range<usize>) -> (String, Option<String>) {
    let rest = text[span.start..].lines().next().unwrap_or_default();
    let word: String = rest.chars().take_while(|it| !" ,]}#\"'".contains(*it)).collect();
    let line = line_around(text, span.start).trim_end();
    if message == DOUBLE_KEY {
        (format!("`{}` is given twice", &text[span.clone()]), None)
    } else if message.starts_with("missing comma between array") {
        (message.replace('\n', ", "), Some("or a `]` is missing further up".to_owned()))
    } else if line.ends_with('=') && rest.trim().is_empty() {
        ("the value is missing".to_owned(), None)
    } else if line.contains('=') && word.starts_with(char::is_alphabetic) {
        let hint = format!("write \"{word}\"");
        ("a text must stand in quotes".to_owned(), Some(hint))
    } else {
        (message.replace('\n', ", "), None)
    }
}

/// The whole line of a position.
fn line_around(text: &str, position: usize) -> &str {
    let start = text[..position].rfind('\n').map_or(0, |it| it + 1);
    text[start..].lines().next().unwrap_or_default()
}

fn read_heading(value: Value, to: &mut Document, problems: &mut Problems) {
    for Entry { key, value } in table_entries(value, "`pipeline`", problems) {
        match &*key.name {
            "title" => to.title = text(&value, "`title`", problems).map(str::to_owned),
            "description" => {
                text(&value, "`description`", problems);
            }
            "cite" => {
                let items = match &value.data {
                    Data::List(items) => items,
                    _ => std::slice::from_ref(&value),
                };
                let texts = items.iter().filter_map(|it| text(it, "`cite`", problems));
                to.cites = texts.map(str::to_owned).collect();
            }
            name => problems.push(
                Diagnostic::error(&key.place, format!("unknown key `{name}` in `[pipeline]`"))
                    .hint(suggest(name, ["title", "cite", "description"])),
            ),
        }
    }
}

/// `name = "mesh"` or `name = { type = "mesh", doc = "…" }`.
fn read_inputs(value: Value, problems: &mut Problems) -> Vec<InputPort> {
    let mut res = Vec::new();
    for Entry { key: name, value } in table_entries(value, "`inputs`", problems) {
        if !check_name(&name, problems) {
            continue;
        }
        let Data::Table(fields) = &value.data else {
            res.push(InputPort { name, ty: value });
            continue;
        };
        let mut ty = None;
        for Entry { key, value } in fields.iter() {
            match &*key.name {
                "type" => ty = Some(value.clone()),
                "doc" => {
                    text(value, "`doc`", problems);
                }
                other => problems.push(
                    Diagnostic::error(&key.place, format!("unknown key `{other}` of an input"))
                        .hint(suggest(other, ["type", "doc"])),
                ),
            }
        }
        let is_misspelt = fields.iter().any(|it| nearest(&it.key.name, ["type"]).is_some());
        let ty = ty.unwrap_or_else(|| {
            if is_misspelt {
                return value.broken();
            }
            let message = format!("input `{}` has no `type`", name.name);
            problems.push(Diagnostic::error(&name.place, message));
            value.broken()
        });
        res.push(InputPort { name, ty });
    }
    res
}

fn read_params(value: Value, problems: &mut Problems) -> Vec<Entry> {
    let params = table_entries(value, "`params`", problems);
    for Entry { key, value } in &params {
        check_name(key, problems);
        if value.as_text().is_some_and(|it| it.starts_with('@')) {
            let message = format!("parameter `{}` cannot be a wire", key.name);
            problems.push(
                Diagnostic::error(&value.place, message)
                    .hint("artifacts enter a pipeline through `[inputs]`".to_owned()),
            );
        }
    }
    params
}

fn read_axes(value: Value, problems: &mut Problems) -> Vec<AxisTable> {
    let mut res = Vec::new();
    for Entry { key: name, value } in table_entries(value, "`axes`", problems) {
        if check_name(&name, problems) {
            let fields = table_entries(value, format_args!("axis `{}`", name.name), problems);
            res.push(AxisTable { name, fields });
        }
    }
    res
}

fn read_profiles(value: Value, problems: &mut Problems) -> Vec<Profile> {
    let mut res = Vec::new();
    for Entry { key: name, value } in table_entries(value, "`profiles`", problems) {
        let params = table_entries(value, format_args!("profile `{}`", name.name), problems);
        res.push(Profile { name, params });
    }
    res
}

fn read_nodes(value: Value, problems: &mut Problems) -> Vec<NodeTable> {
    let mut res = Vec::new();
    for Entry { key: name, value } in table_entries(value, "`nodes`", problems) {
        let named = check_name(&name, problems);
        let broken = value.broken();
        let is_table = matches!(value.data, Data::Table(_));
        let mut fields = table_entries(value, format_args!("node `{}`", name.name), problems);
        let kind = match fields.iter().position(|it| &*it.key.name == "kind") {
            Some(index) => read_kind(fields.remove(index).value, problems),
            None => {
                if named && is_table {
                    let message = format!("node `{}` has no `kind`", name.name);
                    problems.push(
                        Diagnostic::error(&name.place, message)
                            .hint("`sinew nodes` lists all kinds".to_owned()),
                    );
                }
                broken
            }
        };
        res.push(NodeTable { name, kind, fields });
    }
    res
}

fn read_kind(kind: Value, problems: &mut Problems) -> Value {
    if text(&kind, "`kind`", problems).is_some() { kind } else { kind.broken() }
}

/// Nodes and inputs are both named by `@`, parameters and axes by `${}`.
fn report_shared_names(document: &Document, problems: &mut Problems) {
    let params: HashSet<&Arc<str>> = document.params.iter().map(|it| &it.key.name).collect();
    for axis in document.axes.iter().filter(|it| params.contains(&it.name.name)) {
        let message = format!("`{}` is a parameter as well as an axis", axis.name.name);
        problems.push(Diagnostic::error(&axis.name.place, message));
    }
    let inputs: HashSet<&Arc<str>> = document.inputs.iter().map(|it| &it.name.name).collect();
    for node in document.nodes.iter().filter(|it| inputs.contains(&it.name.name)) {
        let message = format!("`{}` is an input as well as a node", node.name.name);
        problems.push(Diagnostic::error(&node.name.place, message));
    }
}

/// The entries of a table; reports that it is none.
pub fn table_entries(value: Value, what: impl Display, problems: &mut Problems) -> Vec<Entry> {
    match value.data {
        Data::Table(entries) => Arc::unwrap_or_clone(entries),
        Data::Broken => Vec::new(),
        ref data => {
            let message = format!("{what} must be a table, but is {}", data.describe());
            problems.push(Diagnostic::error(&value.place, message));
            Vec::new()
        }
    }
}

/// The text of a value; reports that it is none.
pub fn text<'a>(value: &'a Value, what: &str, problems: &mut Problems) -> Option<&'a str> {
    let res = value.as_text();
    if res.is_none() && !value.is_broken() {
        let message = format!("{what} must be a text, but is {}", value.describe());
        problems.push(Diagnostic::error(&value.place, message));
    }
    res
}

/// Names of nodes, parameters and ports: letters, digits, `_` and `-`.
pub fn check_name(key: &Key, problems: &mut Problems) -> bool {
    let allowed = |it: char| it.is_ascii_alphanumeric() || it == '_' || it == '-';
    let res = !key.name.is_empty() && key.name.chars().all(allowed);
    if !res {
        let message = format!("`{}` is not a name", key.name);
        problems.push(
            Diagnostic::error(&key.place, message)
                .hint("names are made of letters, digits, `_` and `-`".to_owned()),
        );
    }
    res
}
