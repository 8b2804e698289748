//! `table = "pairs.csv"`: one item a row.

use std::{path::Path, sync::Arc};

use toml::de::DeTable;

use super::{
    list::{List, Reading},
    values::row_label,
};
use crate::engine::{
    graph::Place,
    node::extension_of,
    pipeline::{
        diagnostic::Diagnostic,
        parse,
        value::{self, Data, Value},
    },
};

/// Rows of a `.csv` or `.tsv` file with a heading, or of the first array of tables of a `.toml` file.
/// Relative paths among them start in the folder of that file.
pub fn read(value: &Value, reading: &mut Reading<'_>) -> Option<List> {
    let text = parse::text(value, "`table`", reading.problems)?;
    let path = reading.sources.resolve(value.base, text);
    let fail = |place: &Place, message: String, reading: &mut Reading<'_>| {
        reading.problems.push(
            Diagnostic::error(place, message)
                .related(value.origin.as_ref(), "the path is written here"),
        );
    };
    let source = match reading.sources.read(&path) {
        Ok(source) => source,
        Err(message) => {
            fail(&value.place, message, reading);
            return None;
        }
    };
    match extension_of(&path).as_str() {
        "csv" => read_separated(source, b',', &path, value, reading),
        "tsv" => read_separated(source, b'\t', &path, value, reading),
        "toml" => read_toml(source, &path, value, reading),
        _ => {
            let message = format!("`{}` is not a .csv, .tsv or .toml file", path.display());
            fail(&value.place, message, reading);
            None
        }
    }
}

fn read_separated(
    source: usize,
    separator: u8,
    path: &Path,
    value: &Value,
    reading: &mut Reading<'_>,
) -> Option<List> {
    let text = Arc::clone(&reading.sources.list[source].text);
    let mut reader = csv::ReaderBuilder::new()
        .delimiter(separator)
        .trim(csv::Trim::All)
        .from_reader(text.trim_start_matches('\u{feff}').as_bytes());
    let offset = text.len() - text.trim_start_matches('\u{feff}').len();
    let place = |at: Option<&csv::Position>| {
        let rest = &text[at.map_or(0, |it| it.byte() as usize + offset).min(text.len())..];
        // The reader takes empty lines, and the `\n` of a `\r\n`, for the start of the next row.
        let start = text.len() - rest.trim_start_matches(['\r', '\n']).len();
        let end = text[start..].find(['\r', '\n']).map_or(text.len(), |it| start + it);
        Place::new(source, start..end)
    };
    let mut fail = |at: Option<&csv::Position>, message: String| {
        let problem = Diagnostic::error(&place(at), message);
        reading.problems.push(problem.related(Some(&value.place), "the table is used here"));
    };
    let names: Vec<Arc<str>> = match reader.headers() {
        Ok(names) => names.iter().map(Arc::from).collect(),
        Err(error) => {
            fail(None, format!("cannot read `{}`: {error}", path.display()));
            return None;
        }
    };
    if let Some(name) = names.iter().find(|it| it.is_empty()) {
        fail(None, format!("column {} has no name", names.iter().position(|it| it == name)? + 1));
        return None;
    }
    let fields: Vec<&str> = std::iter::once("").chain(names.iter().map(|it| &**it)).collect();
    let mut res = List::with_fields(fields);
    let mut row = csv::StringRecord::new();
    loop {
        match reader.read_record(&mut row) {
            Ok(true) => {}
            Ok(false) => return Some(res),
            Err(error) => {
                let message = match error.kind() {
                    csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
                        format!("this row has {len} cells, but the heading has {expected_len}")
                    }
                    _ => error.to_string(),
                };
                fail(error.position(), message);
                return None;
            }
        }
        let place = place(row.position());
        // The reader takes all that follows an open quote for one cell.
        let end = reader.position().byte() as usize + offset;
        if text[place.start()..end].matches('"').count() % 2 == 1 {
            fail(row.position(), "a quote is not closed in this row".to_owned());
            return None;
        }
        let mut values = vec![Value::new(Data::Broken, place.clone())];
        values.extend(row.iter().map(|it| Value::new(cell(it), place.clone())));
        let label = row_label(&names, &values[1..], res.items.len());
        values[0].data = Data::Text(label.as_str().into());
        res.push(label, values);
    }
}

/// A cell is a number or a truth value if it reads like one.
fn cell(text: &str) -> Data {
    if let Ok(it) = text.parse::<i64>() {
        return Data::Integer(it);
    }
    match (text, text.parse::<f64>()) {
        ("true", _) => Data::Bool(true),
        ("false", _) => Data::Bool(false),
        (_, Ok(it)) if it.is_finite() => Data::Float(it),
        _ => Data::Text(text.into()),
    }
}

fn read_toml(source: usize, path: &Path, value: &Value, reading: &mut Reading<'_>) -> Option<List> {
    let text = Arc::clone(&reading.sources.list[source].text);
    let table = match DeTable::parse(&text) {
        Ok(table) => table,
        Err(error) => {
            let place = Place::new(source, error.span().unwrap_or(0..0));
            reading.problems.push(Diagnostic::error(&place, error.message().to_owned()));
            return None;
        }
    };
    let entries = value::entries(table.into_inner(), source, reading.problems);
    let rows = entries.iter().find(|it| matches!(it.value.data, Data::List(_)));
    match rows {
        Some(rows) => super::values::read(&rows.value, reading),
        None => {
            let message = format!("`{}` has no array of tables", path.display());
            let hint = "a row is written as `[[rows]]`".to_owned();
            reading.problems.push(Diagnostic::error(&value.place, message).hint(hint));
            None
        }
    }
}
