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
    /// What is not shared any more can be taken apart without a copy.
    Table(Arc<Vec<Entry>>),
    /// It depends on the item of an axis, and is filled in for every instance.
    Template(Arc<[Piece]>),
    /// Its mistake has been reported; nothing more is to be said of it.
    Broken,
}

/// A part of a text that depends on an axis. A template of one field is the field's value itself.
#[derive(Debug, Clone, PartialEq)]
pub enum Piece {
    Text(Arc<str>),
    Field(AxisField),
}

/// `${axis}` or `${axis.field}`.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisField {
    pub axis: AxisId,
    /// As it is written, for messages.
    pub written: Arc<str>,
    /// Empty for the item itself.
    pub field: Arc<str>,
}

/// Which of the axes of an expansion; they are numbered in the order of their declaration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct AxisId(pub usize);

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
        let base = place.source();
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

    /// Calls `see` with every axis field that the value names.
    pub fn axis_fields<'a>(&'a self, see: &mut dyn FnMut(&'a AxisField)) {
        match &self.data {
            Data::Template(pieces) => {
                for piece in pieces.iter() {
                    if let Piece::Field(field) = piece {
                        see(field);
                    }
                }
            }
            Data::List(items) => items.iter().for_each(|it| it.axis_fields(see)),
            Data::Table(entries) => entries.iter().for_each(|it| it.value.axis_fields(see)),
            _ => {}
        }
    }

    /// Whether it is the same for all items of all axes.
    pub fn is_constant(&self) -> bool {
        let mut res = true;
        self.axis_fields(&mut |_| res = false);
        res
    }

    /// A single value as text; `None` for lists, tables and what is not known yet.
    pub fn written_out(&self) -> Option<String> {
        match &self.data {
            Data::Text(text) => Some(text.to_string()),
            Data::Integer(value) => Some(value.to_string()),
            Data::Float(value) => Some(format!("{value:?}")),
            Data::Bool(value) => Some(value.to_string()),
            Data::List(_) | Data::Table(_) | Data::Template(_) | Data::Broken => None,
        }
    }

    /// The same value at the place where it is used.
    pub fn moved(&self, place: &Place) -> Self {
        let origin = self.origin.clone().unwrap_or_else(|| self.place.clone());
        Self {
            data: self.data.clone(),
            place: place.clone(),
            origin: Some(origin),
            base: self.base,
        }
    }

    /// What it is, for a message: `the text "abc"`.
    pub fn describe(&self) -> String {
        self.data.describe()
    }
}

impl Data {
    pub fn describe(&self) -> String {
        match self {
            Self::Text(text) if text.chars().count() <= 40 => format!("the text \"{text}\""),
            Self::Text(_) => "a text".to_owned(),
            Self::Integer(value) => value.to_string(),
            Self::Float(value) => format!("{value:?}"),
            Self::Bool(value) => value.to_string(),
            Self::List(items) if items.len() == 1 => "a list of 1 value".to_owned(),
            Self::List(items) => format!("a list of {} values", items.len()),
            Self::Table(_) => "a table".to_owned(),
            Self::Template(_) => "a value that depends on an axis".to_owned(),
            Self::Broken => "broken".to_owned(),
        }
    }
}

/// The entries of a parsed table in the order of the file. Reports numbers that no parameter takes.
pub fn entries(table: DeTable<'_>, source: usize, problems: &mut Problems) -> Vec<Entry> {
    let mut res: Vec<Entry> = table
        .into_iter()
        .map(|(key, value)| Entry {
            key: Key {
                place: Place::new(source, key.span()),
                name: key.into_inner().as_ref().into(),
            },
            value: read(value, source, problems),
        })
        .collect();
    res.sort_by_key(|it| it.key.place.start());
    res
}

/// One parsed value. Reports numbers that no parameter takes.
pub fn read(value: Spanned<DeValue<'_>>, source: usize, problems: &mut Problems) -> Value {
    let place = Place::new(source, value.span());
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
