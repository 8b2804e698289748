//! `values = [10, 20]`, `values = [{ k = 10, n = 2 }, …]`, and `zip = { a = …, b = … }`.

use std::sync::Arc;

use super::{
    list::{List, Reading},
    read::read_source,
};
use crate::engine::pipeline::{
    diagnostic::Diagnostic,
    parse,
    value::{Data, Entry, Value},
};

/// A list of single values, or of tables with the same keys; a table of lists is zipped.
pub fn read(value: &Value, reading: &mut Reading<'_>) -> Option<List> {
    match &value.data {
        Data::List(items) if items.iter().all(|it| matches!(it.data, Data::Table(_))) => {
            read_tables(value, items, reading)
        }
        Data::List(items) => {
            if let Some(wrong) = items.iter().find(|it| it.written_out().is_none()) {
                if !wrong.is_broken() {
                    let what = wrong.describe();
                    let message = format!("an item must be a text or a number, but this is {what}");
                    reading.problems.push(Diagnostic::error(&wrong.place, message));
                }
                return None;
            }
            Some(List::of_values(items.to_vec()))
        }
        Data::Table(lists) => read_zip(value, lists, reading),
        Data::Broken => None,
        _ => {
            let message = format!("`values` must be a list, but is {}", value.describe());
            reading.problems.push(Diagnostic::error(&value.place, message));
            None
        }
    }
}

/// One item a table. All tables have the same keys.
fn read_tables(value: &Value, items: &[Value], reading: &mut Reading<'_>) -> Option<List> {
    let tables: Vec<&Arc<Vec<Entry>>> = items
        .iter()
        .filter_map(|it| if let Data::Table(entries) = &it.data { Some(entries) } else { None })
        .collect();
    let mut names: Vec<Arc<str>> = vec!["".into()];
    names.extend(tables.first().into_iter().flat_map(|it| it.iter()).map(|it| it.key.name.clone()));
    let mut res = List::with_fields(names.iter().map(|it| &**it));
    for (index, entries) in tables.into_iter().enumerate() {
        let mut values = vec![value.broken()];
        for name in &names[1..] {
            match entries.iter().find(|it| it.key.name == *name) {
                Some(entry) => values.push(entry.value.clone()),
                None => {
                    let message = format!("this item has no `{name}`, but the first has");
                    reading.problems.push(Diagnostic::error(&items[index].place, message));
                    return None;
                }
            }
        }
        if let Some(extra) = entries.iter().find(|it| !names.contains(&it.key.name)) {
            let message = format!("this item has `{}`, but the first has not", extra.key.name);
            reading.problems.push(Diagnostic::error(&extra.key.place, message));
            return None;
        }
        let label = row_label(&names[1..], &values[1..], index);
        values[0] = Value { data: Data::Text(label.as_str().into()), ..items[index].clone() };
        res.push(label, values);
    }
    Some(res)
}

/// The column `label` or `name`, or all that can be written out.
pub fn row_label(names: &[Arc<str>], values: &[Value], index: usize) -> String {
    let named = |wanted: &str| {
        let at = names.iter().position(|it| **it == *wanted)?;
        values[at].written_out()
    };
    named("label").or_else(|| named("name")).unwrap_or_else(|| {
        let parts: Vec<String> = values.iter().filter_map(Value::written_out).collect();
        if parts.is_empty() { index.to_string() } else { parts.join("-") }
    })
}

/// Lists of one length, item by item: `zip = { a = { files = "a/*.off" }, b = { values = [1, 2] } }`,
/// or lists of values alone.
pub fn read_zip(value: &Value, lists: &[Entry], reading: &mut Reading<'_>) -> Option<List> {
    let mut parts: Vec<(&Entry, List)> = Vec::new();
    for entry in lists {
        let part = match &entry.value.data {
            Data::List(_) => read(&entry.value, reading),
            _ => {
                let what = format!("`{}`", entry.key.name);
                let fields = parse::table_entries(entry.value.clone(), &what, reading.problems);
                read_source(&entry.key, &fields, reading)
            }
        };
        parts.push((entry, part?));
    }
    let Some((first, first_part)) = parts.first() else {
        let message = "lists that are zipped are named: `{ a = […], b = […] }`";
        reading.problems.push(Diagnostic::error(&value.place, message));
        return None;
    };
    let n_items = first_part.items.len();
    if let Some((other, part)) = parts.iter().find(|it| it.1.items.len() != n_items) {
        let message = format!(
            "`{}` has {} items, but `{}` has {n_items}",
            other.key.name,
            part.items.len(),
            first.key.name
        );
        let hint = "lists that are zipped have one length".to_owned();
        reading.problems.push(
            Diagnostic::error(&other.value.place, message)
                .related(Some(&first.value.place), "the first list")
                .hint(hint),
        );
        return None;
    }
    Some(zipped(value, &parts, n_items))
}

fn zipped(value: &Value, parts: &[(&Entry, List)], n_items: usize) -> List {
    let prefixed = parts.iter().flat_map(|(entry, part)| {
        part.fields.iter().map(|field| match &**field {
            "" => entry.key.name.to_string(),
            field => format!("{}.{field}", entry.key.name),
        })
    });
    let names: Vec<String> = std::iter::once(String::new()).chain(prefixed).collect();
    let mut res = List::with_fields(names.iter().map(String::as_str));
    for index in 0..n_items {
        let labels: Vec<&str> = parts.iter().map(|it| it.1.items[index].0.as_str()).collect();
        let label = labels.join("-");
        let mut values = vec![Value { data: Data::Text(label.as_str().into()), ..value.clone() }];
        values.extend(parts.iter().flat_map(|it| it.1.items[index].1.iter().cloned()));
        res.push(label, values);
    }
    res
}
