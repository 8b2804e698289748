//! The values of one instance: templates with their items put in.

use std::sync::Arc;

use super::{Axis, AxisId};
use crate::engine::pipeline::value::{AxisField, Data, Entry, Piece, Value};

/// One item of each of some axes: (axis, position), ascending by axis.
pub type Point = [(AxisId, usize)];

/// The value at a point. Every field that it names has been checked to exist.
pub fn fill(value: &Value, axes: &[Axis], point: &Point) -> Value {
    match &value.data {
        Data::Template(pieces) => fill_template(value, pieces, axes, point),
        Data::List(items) if !value.is_constant() => {
            let items = items.iter().map(|it| fill(it, axes, point)).collect();
            Value { data: Data::List(items), ..value.clone() }
        }
        Data::Table(entries) if !value.is_constant() => {
            let entries = entries.iter().map(|Entry { key, value }| Entry {
                key: key.clone(),
                value: fill(value, axes, point),
            });
            Value { data: Data::Table(Arc::new(entries.collect())), ..value.clone() }
        }
        _ => value.clone(),
    }
}

fn fill_template(value: &Value, pieces: &[Piece], axes: &[Axis], point: &Point) -> Value {
    if let [Piece::Field(field)] = pieces {
        return chosen(field, axes, point).moved(&value.place);
    }
    let mut text = String::new();
    let (mut base, mut origin) = (value.base, value.origin.clone());
    for (index, piece) in pieces.iter().enumerate() {
        match piece {
            Piece::Text(plain) => text.push_str(plain),
            Piece::Field(field) => {
                let chosen = chosen(field, axes, point);
                text.push_str(&chosen.written_out().unwrap_or_default());
                // A relative path starts where its first part was written.
                if index == 0 {
                    base = chosen.base;
                }
                origin = origin.or_else(|| Some(chosen.place.clone()));
            }
        }
    }
    Value { data: Data::Text(text.into()), place: value.place.clone(), origin, base }
}

fn chosen<'a>(field: &AxisField, axes: &'a [Axis], point: &Point) -> &'a Value {
    let axis = &axes[field.axis.0];
    let at = point.iter().find(|it| it.0 == field.axis).expect("a point has all axes of its node");
    let index = axis.field(&field.field).expect("fields are checked before they are filled in");
    &axis.items[at.1].values[index]
}
