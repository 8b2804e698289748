//! From the values of a file to the data that a kind's parameters are made of.

use std::fmt;

use serde_json::{Map, Value as Json};

use super::{
    diagnostic::{Diagnostic, Problems},
    nearest::{nearest, suggest},
    sources::Sources,
    value::{Data, Entry, Value},
};
use crate::engine::params::{Fields, Shape};

/// The name of a value within the parameters of a node. Written out only for a mistake.
#[derive(Clone, Copy)]
pub enum Name<'a> {
    Field(&'a str),
    Key(&'a Name<'a>, &'a str),
    Item(&'a Name<'a>, usize),
}

impl fmt::Display for Name<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Field(name) => f.write_str(name),
            Self::Key(table, name) => write!(f, "{table}.{name}"),
            Self::Item(list, index) => write!(f, "{list}[{index}]"),
        }
    }
}

/// Converts values of one node; every mistake is reported with the name of the field.
pub struct Converter<'a> {
    pub sources: &'a Sources,
    pub problems: &'a mut Problems,
}

impl Converter<'_> {
    /// The value as data; `None` if it is not what the field takes.
    pub fn convert(&mut self, name: Name<'_>, value: &Value, shape: &Shape) -> Option<Json> {
        match (shape, &value.data) {
            (_, Data::Broken) => None,
            (Shape::Text, Data::Text(text)) if !text.starts_with('@') => Some((**text).into()),
            (Shape::File, Data::Text(text)) if !text.starts_with('@') => {
                let path = self.sources.resolve(value.base, text);
                Some(path.to_string_lossy().into_owned().into())
            }
            (Shape::Program, Data::Text(text)) if !text.starts_with('@') => {
                let is_path = text.contains('/');
                let path = || self.sources.resolve(value.base, text).to_string_lossy().into_owned();
                Some(if is_path { path().into() } else { (**text).into() })
            }
            (Shape::Choice(names), Data::Text(text)) if !text.starts_with('@') => {
                self.choice(name, value, text, names)
            }
            (Shape::Bool, Data::Bool(it)) => Some((*it).into()),
            (Shape::Integer(range), Data::Integer(it)) if range.contains(*it as f64) => {
                Some((*it).into())
            }
            (Shape::Number(range), Data::Integer(it)) if range.contains(*it as f64) => {
                Some((*it as f64).into())
            }
            (Shape::Number(range), Data::Float(it)) if range.contains(*it) => Some((*it).into()),
            (Shape::List { item, min, max }, Data::List(items)) => {
                self.count(name, value, items.len(), *min, *max)?;
                self.list(name, items, std::iter::repeat(&**item))
            }
            (Shape::Tuple(shapes), Data::List(items)) => {
                self.count(name, value, items.len(), shapes.len(), shapes.len())?;
                self.list(name, items, shapes.iter())
            }
            (Shape::Table(fields), Data::Table(entries)) => {
                self.table(name, value, entries, fields)
            }
            (Shape::Map(item), Data::Table(entries)) => self.map(name, entries, item),
            (Shape::OneOf(shapes), _) => match pick(shapes, value) {
                Some(shape) => self.convert(name, value, shape),
                None => self.wrong_type(name, value, shape),
            },
            (Shape::Any, _) => self.anything(value),
            _ => self.wrong_type(name, value, shape),
        }
    }

    fn wrong_type(&mut self, name: Name<'_>, value: &Value, shape: &Shape) -> Option<Json> {
        let is_wire = value.as_text().is_some_and(|it| it.starts_with('@'));
        let message = if is_wire {
            format!("`{name}` is a parameter and takes no wire")
        } else {
            format!("`{name}` must be {}, but is {}", shape.describe(), value.describe())
        };
        self.report(value, message, None)
    }

    fn choice(
        &mut self,
        name: Name<'_>,
        value: &Value,
        text: &str,
        names: &[(String, String)],
    ) -> Option<Json> {
        if names.iter().any(|it| it.0 == text) {
            return Some(text.into());
        }
        let hint = suggest(text, names.iter().map(|it| it.0.as_str()));
        self.report(value, format!("`{name}` cannot be \"{text}\""), hint)
    }

    fn count(
        &mut self,
        name: Name<'_>,
        value: &Value,
        n: usize,
        min: usize,
        max: usize,
    ) -> Option<()> {
        if (min..=max).contains(&n) {
            return Some(());
        }
        let wanted = match (min, max) {
            _ if min == max => format!("exactly {min}"),
            (_, usize::MAX) => format!("at least {min}"),
            _ => format!("{min} to {max}"),
        };
        self.report(value, format!("`{name}` takes {wanted} values, but has {n}"), None)
    }

    fn list<'s>(
        &mut self,
        name: Name<'_>,
        items: &[Value],
        shapes: impl Iterator<Item = &'s Shape>,
    ) -> Option<Json> {
        let converted: Vec<Option<Json>> = items
            .iter()
            .zip(shapes)
            .enumerate()
            .map(|(index, (item, shape))| self.convert(Name::Item(&name, index), item, shape))
            .collect();
        converted.into_iter().collect::<Option<Vec<Json>>>().map(Json::Array)
    }

    fn map(&mut self, name: Name<'_>, entries: &[Entry], shape: &Shape) -> Option<Json> {
        let mut res = Some(Map::new());
        for Entry { key, value } in entries {
            let converted = self.convert(Name::Key(&name, &key.name), value, shape);
            insert(&mut res, &key.name, converted);
        }
        res.map(Json::Object)
    }

    fn table(
        &mut self,
        name: Name<'_>,
        value: &Value,
        entries: &[Entry],
        fields: &Fields,
    ) -> Option<Json> {
        let mut res = Some(Map::new());
        for Entry { key, value } in entries {
            let converted = match fields.get(&key.name) {
                Some(field) => self.convert(Name::Key(&name, &key.name), value, &field.shape),
                None if fields.open => self.anything(value),
                None => {
                    let hint = suggest(&key.name, fields.names());
                    let message = format!("`{name}` has no key `{}`", key.name);
                    self.problems.push(Diagnostic::error(&key.place, message).hint(hint));
                    None
                }
            };
            insert(&mut res, &key.name, converted);
        }
        for field in fields.list.iter().filter(|it| it.required) {
            let is_meant = |key: &str| match fields.get(key) {
                Some(found) => found.name == field.name,
                None => nearest(key, fields.names()) == Some(&field.name),
            };
            if !entries.iter().any(|it| is_meant(&it.key.name)) {
                let message = format!("`{name}` needs `{}`", field.name);
                res = self.report(value, message, Some(field.doc.clone()));
            }
        }
        res.map(Json::Object)
    }

    /// What no schema describes is left to the kind.
    fn anything(&mut self, value: &Value) -> Option<Json> {
        match &value.data {
            Data::Template(_) => unreachable!("items are filled in before values are converted"),
            Data::Broken => None,
            Data::Text(text) => Some((**text).into()),
            Data::Integer(it) => Some((*it).into()),
            Data::Float(it) => Some((*it).into()),
            Data::Bool(it) => Some((*it).into()),
            Data::List(items) => items.iter().map(|it| self.anything(it)).collect(),
            Data::Table(entries) => {
                let pairs = entries
                    .iter()
                    .map(|it| Some((it.key.name.to_string(), self.anything(&it.value)?)));
                pairs.collect::<Option<Map<_, _>>>().map(Json::Object)
            }
        }
    }

    fn report<T>(&mut self, value: &Value, message: String, hint: Option<String>) -> Option<T> {
        let place = value.origin.as_ref();
        self.problems.push(
            Diagnostic::error(&value.place, message)
                .hint(hint)
                .related(place, "the value is written here"),
        );
        None
    }
}

fn insert(to: &mut Option<Map<String, Json>>, name: &str, value: Option<Json>) {
    match (to.as_mut(), value) {
        (Some(map), Some(value)) => drop(map.insert(name.to_owned(), value)),
        _ => *to = None,
    }
}

/// The alternative that a value is meant to be: for a table the one whose tag it has.
fn pick<'a>(shapes: &'a [Shape], value: &Value) -> Option<&'a Shape> {
    shapes
        .iter()
        .find(|it| matches(it, value, true))
        .or_else(|| shapes.iter().find(|it| matches(it, value, false)))
}

fn matches(shape: &Shape, value: &Value, exactly: bool) -> bool {
    match (shape, &value.data) {
        (Shape::Any, _)
        | (Shape::Bool, Data::Bool(_))
        | (Shape::Integer(_) | Shape::Number(_), Data::Integer(_))
        | (Shape::Number(_), Data::Float(_))
        | (Shape::Text | Shape::File | Shape::Program, Data::Text(_))
        | (Shape::List { .. } | Shape::Tuple(_), Data::List(_))
        | (Shape::Map(_), Data::Table(_)) => true,
        (Shape::Choice(names), Data::Text(text)) => {
            !exactly || names.iter().any(|it| *it.0 == **text)
        }
        (Shape::Table(fields), Data::Table(entries)) => {
            !exactly
                || fields.list.iter().filter(|it| it.required).all(|field| {
                    let entry = entries.iter().find(|it| *it.key.name == *field.name);
                    entry.is_some_and(|it| match (&field.shape, &it.value.data) {
                        (Shape::Choice(names), Data::Text(tag)) => {
                            names.iter().any(|it| *it.0 == **tag)
                        }
                        _ => true,
                    })
                })
        }
        (Shape::OneOf(shapes), _) => shapes.iter().any(|it| matches(it, value, exactly)),
        _ => false,
    }
}
