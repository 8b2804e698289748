//! Values of a pipeline file that remember where they are written.

use std::sync::Arc;

use toml::{
    Spanned,
    de::{DeTable, DeValue},
};

use super::diagnostic::{Diagnostic, Problems};
use crate::engine::graph::Place;

/// A value and its place. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Value {
    pub data: Data,
    /// Where it is used: for a substituted value, where the `${}` stands.
    pub place: Place,
    /// Where it comes from, if a `${}` was replaced by it.
    pub origin: Option<Place>,
    /// The source in whose folder a relative path starts.
    pub base: usize,
}

#[derive(Debug, Clone)]
pub enum Data {
    Text(Arc<str>),
    Integer(i64),
    Float(f64),
    Bool(bool),
    List(Arc<[Value]>),
    Table(Arc<[Entry]>),
    /// Its mistake has been reported; nothing more is to be said of it.
    Broken,
}

/// A key and its value, in the order of the file.
#[derive(Debug, Clone)]
pub struct Entry {
    pub key: Key,
    pub value: Value,
}

/// A name and its place.
#[derive(Debug, Clone)]
pub struct Key {
    pub name: Arc<str>,
    pub place: Place,
}

impl Value {
    pub fn new(data: Data, place: Place) -> Self {
        let base = place.source;
        Self { data, place, origin: None, base }
    }

    pub fn as_text(&self) -> Option<&str> {
        match &self.data {
            Data::Text(text) => Some(text),
            _ => None,
        }
    }

    pub fn is_broken(&self) -> bool {
        matches!(self.data, Data::Broken)
    }

    /// The same place with nothing in it.
    pub fn broken(&self) -> Self {
        Self { data: Data::Broken, ..self.clone() }
    }

    /// What it is, for a message: `the text "abc"`.
    pub fn describe(&self) -> String {
        match &self.data {
            Data::Text(text) if text.chars().count() <= 40 => format!("the text \"{text}\""),
            Data::Text(_) => "a text".to_owned(),
            Data::Integer(value) => value.to_string(),
            Data::Float(value) => format!("{value:?}"),
            Data::Bool(value) => value.to_string(),
            Data::List(items) if items.len() == 1 => "a list of 1 value".to_owned(),
            Data::List(items) => format!("a list of {} values", items.len()),
            Data::Table(_) => "a table".to_owned(),
            Data::Broken => "broken".to_owned(),
        }
    }
}

/// The entries of a parsed table in the order of the file. Reports numbers that no parameter takes.
pub fn entries(table: DeTable<'_>, source: usize, problems: &mut Problems) -> Vec<Entry> {
    let mut res: Vec<Entry> = table
        .into_iter()
        .map(|(key, value)| Entry {
            key: Key {
                place: Place { source, span: key.span() },
                name: key.into_inner().as_ref().into(),
            },
            value: read(value, source, problems),
        })
        .collect();
    res.sort_by_key(|it| it.key.place.span.start);
    res
}

/// One parsed value. Reports numbers that no parameter takes.
pub fn read(value: Spanned<DeValue<'_>>, source: usize, problems: &mut Problems) -> Value {
    let place = Place { source, span: value.span() };
    let data = match value.into_inner() {
        DeValue::String(text) => Ok(Data::Text(text.as_ref().into())),
        DeValue::Integer(digits) => i64::from_str_radix(digits.as_str(), digits.radix())
            .map(Data::Integer)
            .map_err(|_| format!("`{digits}` does not fit into 64 bits")),
        DeValue::Float(digits) => match digits.as_str().parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(Data::Float(number)),
            _ => Err(format!("`{digits}` is not a finite number")),
        },
        DeValue::Boolean(value) => Ok(Data::Bool(value)),
        DeValue::Datetime(_) => Err("a date is not a value of a pipeline".to_owned()),
        DeValue::Array(items) => {
            Ok(Data::List(items.into_iter().map(|it| read(it, source, problems)).collect()))
        }
        DeValue::Table(table) => Ok(Data::Table(entries(table, source, problems).into())),
    };
    let data = data.unwrap_or_else(|message| {
        problems.push(Diagnostic::error(&place, message));
        Data::Broken
    });
    Value::new(data, place)
}
