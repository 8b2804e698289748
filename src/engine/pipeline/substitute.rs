//! `${name}`: alone it is the parameter itself, inside a longer text it is written out. `${axis}` and
//! `${axis.field}` stay as they are until an item is chosen ([`Data::Template`]).

use std::{collections::HashMap, sync::Arc};

use super::{
    diagnostic::{Diagnostic, Problems},
    nearest::suggest,
    value::{AxisField, AxisId, Data, Entry, Key, Piece, Value},
};

/// Parameters by name.
pub type Params = HashMap<Arc<str>, Value>;

/// What the texts of a file can name.
#[derive(Debug, Clone, Default)]
pub struct Names {
    pub params: Params,
    pub axes: HashMap<Arc<str>, AxisId>,
}

/// What `${}` stands for.
enum Meaning<'a> {
    Param(&'a Value),
    Axis(AxisField),
}

impl Names {
    fn find(&self, name: &str) -> Option<Meaning<'_>> {
        if let Some(param) = self.params.get(name) {
            return Some(Meaning::Param(param));
        }
        let (axis, field) = name.split_once('.').unwrap_or((name, ""));
        let &axis = self.axes.get(axis)?;
        Some(Meaning::Axis(AxisField { axis, written: name.into(), field: field.into() }))
    }
}

/// A text cut into its parts.
#[derive(Debug, PartialEq)]
enum Part<'a> {
    Plain(&'a str),
    Name(&'a str),
}

/// Replaces every `${name}` in a value. What names nothing becomes broken, with a diagnostic.
pub fn substitute(value: &Value, names: &Names, problems: &mut Problems) -> Value {
    let data = match &value.data {
        Data::Text(text) if text.contains("${") => {
            return substitute_text(text, value, names, problems);
        }
        Data::List(items) if items.iter().any(has_names) => {
            Data::List(items.iter().map(|it| substitute(it, names, problems)).collect())
        }
        Data::Table(entries) if entries.iter().any(|it| has_names(&it.value)) => {
            let entries = entries.iter().map(|Entry { key, value }| Entry {
                key: key.clone(),
                value: substitute(value, names, problems),
            });
            Data::Table(Arc::new(entries.collect()))
        }
        _ => return value.clone(),
    };
    Value { data, ..value.clone() }
}

/// Replaces every `${name}` in a key, such as the path of an output.
pub fn substitute_key(key: &Key, names: &Names, problems: &mut Problems) -> Value {
    let value = Value::new(Data::Text(Arc::clone(&key.name)), key.place.clone());
    substitute(&value, names, problems)
}

/// The parameters of a file after every `${}` among them has been replaced.
///
/// Values in `given` come from outside and are taken as they are.
pub fn resolve_params(declared: &[Entry], given: Names, problems: &mut Problems) -> Names {
    let declared: HashMap<&str, &Value> =
        declared.iter().map(|it| (&*it.key.name, &it.value)).collect();
    let mut resolver = Resolver { declared, resolved: given, open: Vec::new(), problems };
    let mut names: Vec<&str> = resolver.declared.keys().copied().collect();
    names.sort_by_key(|it| resolver.declared[it].place.start());
    for name in names {
        resolver.resolve(name);
    }
    resolver.resolved
}

struct Resolver<'a, 'p> {
    declared: HashMap<&'a str, &'a Value>,
    resolved: Names,
    /// The parameters whose resolution waits for the one at hand.
    open: Vec<&'a str>,
    problems: &'p mut Problems,
}

impl<'a> Resolver<'a, '_> {
    fn resolve(&mut self, name: &'a str) {
        if self.resolved.params.contains_key(name) {
            return;
        }
        let value = self.declared[name];
        if let Some(start) = self.open.iter().position(|&it| it == name) {
            self.report_cycle(start);
            self.resolved.params.insert(name.into(), value.broken());
            return;
        }
        self.open.push(name);
        for needed in names_in(value) {
            if let Some((&needed, _)) = self.declared.get_key_value(needed) {
                self.resolve(needed);
            }
        }
        self.open.pop();
        if !self.resolved.params.contains_key(name) {
            let value = substitute(value, &self.resolved, self.problems);
            self.resolved.params.insert(name.into(), value);
        }
    }

    fn report_cycle(&mut self, start: usize) {
        let cycle = &self.open[start..];
        let path: Vec<String> =
            cycle.iter().chain(cycle.first()).map(|it| format!("`{it}`")).collect();
        let message = format!("parameters refer to each other in a circle: {}", path.join(" → "));
        self.problems.push(Diagnostic::error(&self.declared[cycle[0]].place, message));
    }
}

fn substitute_text(text: &str, value: &Value, names: &Names, problems: &mut Problems) -> Value {
    let parts = match split(text) {
        Ok(parts) => parts,
        Err(message) => {
            problems.push(
                Diagnostic::error(&value.place, message)
                    .hint("`$${` stands for `${` itself".to_owned()),
            );
            return value.broken();
        }
    };
    if let [Part::Name(name)] = parts[..]
        && let Some(Meaning::Param(param)) = names.find(name)
    {
        return param.moved(&value.place);
    }
    let mut pieces = Pieces::default();
    let mut base = value.base;
    for (index, part) in parts.iter().enumerate() {
        match part {
            Part::Plain(plain) => pieces.push_text(plain),
            Part::Name(name) => match names.find(name) {
                None => return unknown(name, value, names, problems),
                Some(Meaning::Axis(field)) => pieces.push_field(field),
                Some(Meaning::Param(param)) => {
                    match (&param.data, param.written_out()) {
                        (Data::Template(inner), _) => pieces.extend(inner),
                        (_, Some(text)) => pieces.push_text(&text),
                        (_, None) => return not_text(name, param, value, problems),
                    }
                    // A relative path starts where its first part was written.
                    if index == 0 {
                        base = param.base;
                    }
                }
            },
        }
    }
    Value { data: pieces.finish(), place: value.place.clone(), origin: None, base }
}

/// A text under construction; neighbouring plain parts are joined.
#[derive(Default)]
struct Pieces {
    done: Vec<Piece>,
    text: String,
}

impl Pieces {
    fn push_text(&mut self, text: &str) {
        self.text.push_str(text);
    }

    fn push_field(&mut self, field: AxisField) {
        if !self.text.is_empty() {
            self.done.push(Piece::Text(std::mem::take(&mut self.text).into()));
        }
        self.done.push(Piece::Field(field));
    }

    fn extend(&mut self, pieces: &[Piece]) {
        for piece in pieces {
            match piece {
                Piece::Text(text) => self.push_text(text),
                Piece::Field(field) => self.push_field(field.clone()),
            }
        }
    }

    fn finish(mut self) -> Data {
        if self.done.is_empty() {
            return Data::Text(self.text.into());
        }
        if !self.text.is_empty() {
            self.done.push(Piece::Text(self.text.into()));
        }
        Data::Template(self.done.into())
    }
}

fn unknown(name: &str, value: &Value, names: &Names, problems: &mut Problems) -> Value {
    let mut known: Vec<&str> =
        names.params.keys().chain(names.axes.keys()).map(|it| &**it).collect();
    known.sort_unstable();
    let first = name.split('.').next().unwrap_or_default();
    let hint =
        suggest(first, known).unwrap_or_else(|| "parameters are declared in `[params]`".to_owned());
    problems.push(
        Diagnostic::error(&value.place, format!("there is no parameter `{name}`")).hint(hint),
    );
    value.broken()
}

fn not_text(name: &str, param: &Value, value: &Value, problems: &mut Problems) -> Value {
    if !param.is_broken() {
        let what = param.describe();
        let message = format!("`${{{name}}}` is {what} and cannot stand inside of a text");
        problems.push(
            Diagnostic::error(&value.place, message)
                .related(Some(&param.place), format!("`{name}` is written here")),
        );
    }
    value.broken()
}

/// Whether there is anything to replace in a value.
pub fn has_names(value: &Value) -> bool {
    match &value.data {
        Data::Text(text) => text.contains("${"),
        Data::List(items) => items.iter().any(has_names),
        Data::Table(entries) => entries.iter().any(|it| has_names(&it.value)),
        _ => false,
    }
}

fn names_in(value: &Value) -> Vec<&str> {
    match &value.data {
        Data::Text(text) => {
            let parts = split(text).unwrap_or_default().into_iter();
            let name = |it| if let Part::Name(name) = it { Some(name) } else { None };
            parts.filter_map(name).collect()
        }
        Data::List(items) => items.iter().flat_map(names_in).collect(),
        Data::Table(entries) => entries.iter().flat_map(|it| names_in(&it.value)).collect(),
        _ => Vec::new(),
    }
}

/// Cuts a text at its `${name}`; `$${` is a plain `${`.
fn split(text: &str) -> Result<Vec<Part<'_>>, String> {
    let mut res = Vec::new();
    let mut rest = text;
    while let Some(start) = rest.find("${") {
        let before = &rest[..start];
        if before.ends_with('$') {
            res.push(Part::Plain(before));
            res.push(Part::Plain("{"));
            rest = &rest[start + 2..];
            continue;
        }
        if !before.is_empty() {
            res.push(Part::Plain(before));
        }
        let inner = &rest[start + 2..];
        let end = inner.find('}').ok_or("`${` is not closed by `}`")?;
        match inner[..end].trim() {
            "" => return Err("`${}` names nothing".to_owned()),
            name => res.push(Part::Name(name)),
        }
        rest = &inner[end + 1..];
    }
    if !rest.is_empty() {
        res.push(Part::Plain(rest));
    }
    Ok(res)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::graph::Place;

    fn at(data: Data, source: usize) -> Value {
        Value::new(data, Place::new(source, 0..1))
    }

    fn text(text: &str) -> Value {
        at(Data::Text(text.into()), 0)
    }

    fn params() -> Names {
        let list = Data::List([at(Data::Integer(1), 0)].into());
        let params = [
            ("k", at(Data::Integer(60), 0)),
            ("x", at(Data::Float(1.0), 0)),
            ("dir", at(Data::Text("data".into()), 7)),
            ("list", at(list, 0)),
        ]
        .map(|(name, value)| (name.into(), value))
        .into();
        let axes = [("shape", AxisId(0)), ("n", AxisId(1))];
        Names { params, axes: axes.map(|(name, axis)| (name.into(), axis)).into() }
    }

    /// The result and the messages.
    fn check(template: &str, expected: &str) {
        let mut problems = Vec::new();
        let value = substitute(&text(template), &params(), &mut problems);
        let messages: Vec<String> = problems.into_iter().map(|it| it.message).collect();
        let found = if messages.is_empty() { value.describe() } else { messages.join("; ") };
        assert_eq!(found, expected, "{template}");
    }

    #[test]
    fn alone_it_keeps_its_type_and_inside_a_text_it_is_written_out() {
        check("${k}", "60");
        check("${x}", "1.0");
        check("${list}", "a list of 1 value");
        check("k=${k}", "the text \"k=60\"");
        check("${dir}/${k}.off", "the text \"data/60.off\"");
        check("${ k }", "60");
    }

    #[test]
    fn a_doubled_dollar_is_plain() {
        check("$${k}", "the text \"${k}\"");
        check("a$${k}b${k}", "the text \"a${k}b60\"");
        check("$5 {k}", "the text \"$5 {k}\"");
    }

    #[test]
    fn what_names_nothing_is_said_once() {
        check("${kk}", "there is no parameter `kk`");
        check("a${kk}${ll}", "there is no parameter `kk`");
        check("a${k", "`${` is not closed by `}`");
        check("a${}", "`${}` names nothing");
        check("a${list}", "`${list}` is a list of 1 value and cannot stand inside of a text");
    }

    #[test]
    fn a_path_starts_where_its_first_part_is_written() {
        let base = |template| substitute(&text(template), &params(), &mut Vec::new()).base;
        assert_eq!(base("${dir}"), 7);
        assert_eq!(base("${dir}/${k}.off"), 7);
        assert_eq!(base("shapes/${dir}.off"), 0);
    }

    /// The pieces of a template, fields in brackets.
    fn pieces(template: &str) -> String {
        let value = substitute(&text(template), &params(), &mut Vec::new());
        let Data::Template(pieces) = &value.data else { return value.describe() };
        let show = |it: &Piece| match it {
            Piece::Text(text) => text.to_string(),
            Piece::Field(it) => format!("[{}:{}]", it.axis.0, it.field),
        };
        pieces.iter().map(show).collect()
    }

    #[test]
    fn axes_stay_until_an_item_is_chosen() {
        assert_eq!(pieces("${n}"), "[1:]");
        assert_eq!(pieces("${dir}/${shape.stem}_${k}.off"), "data/[0:stem]_60.off");
        assert_eq!(pieces("${shape.a.b}"), "[0:a.b]");
        check("${shapes.stem}", "there is no parameter `shapes.stem`");
    }

    fn resolve(declared: &[(&str, &str)]) -> (Params, Vec<String>) {
        let entry = |(index, (name, value)): (usize, &(&str, &str))| Entry {
            key: Key { name: (*name).into(), place: Place::new(0, index..index + 1) },
            value: Value::new(Data::Text((*value).into()), Place::new(0, index..index + 1)),
        };
        let declared: Vec<Entry> = declared.iter().enumerate().map(entry).collect();
        let mut problems = Vec::new();
        let names = resolve_params(&declared, Names::default(), &mut problems);
        (names.params, problems.into_iter().map(|it| it.message).collect())
    }

    #[test]
    fn parameters_refer_to_later_ones() {
        let (params, problems) = resolve(&[("a", "${b}/x"), ("b", "${c}"), ("c", "y")]);
        assert_eq!(problems, [""; 0]);
        assert_eq!(params["a"].as_text(), Some("y/x"));
    }

    #[test]
    fn a_circle_of_parameters_is_shown_once() {
        let (_, problems) = resolve(&[("a", "${b}"), ("b", "${c}"), ("c", "${b}"), ("d", "${d}")]);
        assert_eq!(
            problems,
            [
                "parameters refer to each other in a circle: `b` → `c` → `b`",
                "parameters refer to each other in a circle: `d` → `d`"
            ]
        );
    }
}
