//! From a table `[axes.NAME]` to an axis.

use std::sync::Arc;

use super::{
    Axis, Base, Item,
    condition::Condition,
    files,
    list::{List, Reading},
    pairs::{self, Derived},
    range, rows, values,
};
use crate::engine::pipeline::{
    diagnostic::Diagnostic,
    nearest::{one_of, suggest},
    parse::{self, AxisTable},
    substitute,
    value::{Data, Entry, Key, Value},
};

/// The keys that say where items come from; an axis has one of them.
const SOURCES: [&str; 7] = ["values", "range", "files", "table", "zip", "pairs", "copy_of"];

/// All keys of an axis.
pub const KEYS: [&str; 10] =
    ["values", "range", "files", "table", "zip", "pairs", "copy_of", "which", "where", "label"];

/// Reads an axis. `known` are the axes before it. What is wrong is reported, and the axis has no items.
pub fn read(table: &AxisTable, known: &[Axis], reading: &mut Reading<'_>) -> Axis {
    let mut axis = Axis {
        name: Arc::clone(&table.name.name),
        place: table.name.place.clone(),
        fields: vec!["".into()],
        items: Vec::new(),
        is_plain: false,
        base: Base::Own,
    };
    let n_problems = reading.problems.len();
    if let Some(fields) = prepared(table, reading)
        && read_items(&mut axis, table, &fields, known, reading).is_some()
        && axis.items.is_empty()
        && reading.problems.len() == n_problems
    {
        let message = format!("axis `{}` has no items", axis.name);
        reading.problems.push(Diagnostic::error(&axis.place, message));
    }
    axis
}

/// The fields with parameters filled in; the label's are those of the items, and come later.
fn prepared(table: &AxisTable, reading: &mut Reading<'_>) -> Option<Vec<Entry>> {
    let mut res = Vec::new();
    let mut sound = true;
    for Entry { key, value } in &table.fields {
        if !KEYS.contains(&&*key.name) {
            let message = format!("an axis has no key `{}`", key.name);
            let hint = suggest(&key.name, KEYS);
            reading.problems.push(Diagnostic::error(&key.place, message).hint(hint));
            sound = false;
            continue;
        }
        let value = match &*key.name {
            "label" => value.clone(),
            _ => substitute::substitute(value, reading.names, reading.problems),
        };
        if !value.is_constant() {
            let message = "an axis cannot depend on the items of another one";
            let hint = "`pairs` and `copy_of` make an axis from another".to_owned();
            reading.problems.push(Diagnostic::error(&value.place, message).hint(hint));
            sound = false;
        }
        sound &= !value.is_broken();
        res.push(Entry { key: key.clone(), value });
    }
    sound.then_some(res)
}

fn read_items(
    axis: &mut Axis,
    table: &AxisTable,
    fields: &[Entry],
    known: &[Axis],
    reading: &mut Reading<'_>,
) -> Option<()> {
    let field = |name: &str| fields.iter().find(|it| *it.key.name == *name);
    let derived = match (field("pairs"), field("copy_of")) {
        (None, None) => {
            let list = read_source(&table.name, fields, reading)?;
            axis.is_plain = list.fields.len() == 1;
            axis.fields = list.fields;
            let items = list.items.into_iter();
            axis.items = items
                .map(|(label, values)| Item { label: label.into(), values, base: [0, 0] })
                .collect();
            None
        }
        _ => {
            one_source(&table.name, fields, reading)?;
            let which = field("which").map(|it| &it.value);
            Some(match (field("pairs"), field("copy_of")) {
                (Some(it), _) => {
                    let derived = pairs::pairs(&it.value, which, known, reading)?;
                    (Base::PairsOf(derived.base), derived)
                }
                (None, it) => {
                    let value = &it.expect("one of the two is there").value;
                    let derived = pairs::copies(value, known, reading)?;
                    (Base::CopyOf(derived.base), derived)
                }
            })
        }
    };
    if let Some((base, Derived { fields, items, .. })) = derived {
        (axis.base, axis.fields, axis.items) = (base, fields, items);
        axis.is_plain = matches!(base, Base::CopyOf(it) if known[it.0].is_plain);
    }
    if let Some(which) = field("which")
        && field("pairs").is_none()
    {
        let message = "`which` is for `pairs`";
        reading.problems.push(Diagnostic::error(&which.key.place, message));
    }
    number(axis);
    if let Some(condition) = field("where") {
        keep_where(axis, &condition.value, reading)?;
    }
    if let Some(label) = field("label") {
        relabel(axis, &label.value, reading)?;
    }
    store_labels(axis);
    report_equal_labels(axis, reading)?;
    super::choose::choose(axis, reading);
    Some(())
}

/// The items of a source key that makes its own.
pub fn read_source(name: &Key, fields: &[Entry], reading: &mut Reading<'_>) -> Option<List> {
    let source = one_source(name, fields, reading)?;
    let value = &source.value;
    match &*source.key.name {
        "values" => values::read(value, reading),
        "range" => range::read(value, reading),
        "files" => files::read(value, reading),
        "table" => rows::read(value, reading),
        "zip" => match &value.data {
            Data::Table(lists) => values::read_zip(value, lists, reading),
            _ => {
                let message = format!("`zip` must be a table, but is {}", value.describe());
                reading.problems.push(Diagnostic::error(&value.place, message));
                None
            }
        },
        other => {
            let message = format!("`{other}` cannot be zipped");
            reading.problems.push(Diagnostic::error(&source.key.place, message));
            None
        }
    }
}

fn one_source<'a>(name: &Key, fields: &'a [Entry], reading: &mut Reading<'_>) -> Option<&'a Entry> {
    let mut sources = fields.iter().filter(|it| SOURCES.contains(&&*it.key.name));
    match (sources.next(), sources.next()) {
        (Some(source), None) => Some(source),
        (Some(first), Some(second)) => {
            let message = format!(
                "axis `{}` has `{}` and `{}`: its items come from one of them",
                name.name, first.key.name, second.key.name
            );
            reading.problems.push(Diagnostic::error(&second.key.place, message));
            None
        }
        (None, _) => {
            let message = format!("axis `{}` has no items", name.name);
            let hint = format!("it needs {}", one_of(SOURCES));
            reading.problems.push(Diagnostic::error(&name.place, message).hint(hint));
            None
        }
    }
}

/// Adds the field `index`, unless the items have one of their own: their positions before any is left
/// out.
fn number(axis: &mut Axis) {
    if axis.field("index").is_none() {
        axis.fields.push("index".into());
        for (index, item) in axis.items.iter_mut().enumerate() {
            let data = Data::Integer(index as i64);
            item.values.push(Value { data, ..item.values[0].clone() });
        }
    }
}

fn keep_where(axis: &mut Axis, value: &Value, reading: &mut Reading<'_>) -> Option<()> {
    let text = parse::text(value, "`where`", reading.problems)?;
    let field_of = |item: &'_ Item, name: &str| {
        let name = if name == &*axis.name { "" } else { name };
        axis.field(name).map(|it| item.values[it].clone())
    };
    let kept = Condition::parse(text).and_then(|condition| {
        let holds = |item| condition.holds(&|name| field_of(item, name));
        axis.items.iter().map(holds).collect::<Result<Vec<bool>, String>>()
    });
    match kept {
        Ok(kept) => {
            let mut kept = kept.into_iter();
            axis.items.retain(|_| kept.next().unwrap_or(true));
            Some(())
        }
        Err(message) => {
            let hint = format!("fields are {}", one_of(axis.named_fields()));
            reading.problems.push(Diagnostic::error(&value.place, message).hint(hint));
            None
        }
    }
}

/// Labels from a text in which `${field}` names fields of the item.
fn relabel(axis: &mut Axis, value: &Value, reading: &mut Reading<'_>) -> Option<()> {
    for item in &mut axis.items {
        let mut names = reading.names.clone();
        names.axes.clear();
        let fields = axis.fields.iter().zip(&item.values);
        names.params.extend(fields.map(|(name, value)| match &**name {
            "" => (Arc::clone(&axis.name), value.clone()),
            _ => (Arc::clone(name), value.clone()),
        }));
        let label = substitute::substitute(value, &names, reading.problems);
        if label.is_broken() {
            return None;
        }
        let Some(text) = label.written_out() else {
            let message = format!("`label` must be a text, but is {}", label.describe());
            reading.problems.push(Diagnostic::error(&value.place, message));
            return None;
        };
        item.label = text.into();
    }
    Some(())
}

/// Adds the field `label`, unless the items have one of their own; for items that are no single values
/// it is also what `${axis}` gives.
fn store_labels(axis: &mut Axis) {
    let own = axis.field("label");
    if own.is_none() {
        axis.fields.push("label".into());
    }
    for item in &mut axis.items {
        let label = Value { data: Data::Text(Arc::clone(&item.label)), ..item.values[0].clone() };
        if !axis.is_plain {
            item.values[0] = label.clone();
        }
        match own {
            None => item.values.push(label),
            // That of a copied axis is of before it was labelled anew.
            Some(at) if item.values[at].written_out().as_deref() != Some(&*item.label) => {
                item.values[at] = label;
            }
            Some(_) => {}
        }
    }
}

fn report_equal_labels(axis: &Axis, reading: &mut Reading<'_>) -> Option<()> {
    let mut labels: Vec<&str> = axis.items.iter().map(|it| &*it.label).collect();
    labels.sort_unstable();
    let Some(double) = labels.windows(2).find(|it| it[0] == it[1]) else { return Some(()) };
    let message = format!("axis `{}` has two items `{}`", axis.name, double[0]);
    let hint = "`label = \"${field}\"` makes other labels".to_owned();
    reading.problems.push(Diagnostic::error(&axis.place, message).hint(hint));
    None
}
