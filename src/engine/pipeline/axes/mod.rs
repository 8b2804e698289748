//! Axes: lists of items along which nodes are repeated. Data sets, sweeps, seeds and pairs are all the
//! same to what comes after.
//!
//! [`read`] makes an [`Axis`] from a table `[axes.NAME]`; [`fill`] puts the chosen items into the
//! parameters of an instance.

mod choose;
mod condition;
mod files;
mod fill;
mod list;
mod pairs;
mod range;
mod read;
mod rows;
mod values;

use std::sync::Arc;

pub use self::{
    choose::{Choice, read_choices, report_unknown_axes},
    files::listing,
    fill::{Point, fill},
    list::Reading,
    pairs::Side,
    read::read,
};
use super::value::{AxisId, Value};
use crate::engine::graph::Place;

/// A named list of items.
#[derive(Debug)]
pub struct Axis {
    pub name: Arc<str>,
    pub place: Place,
    /// What `${axis.field}` can name, in the order of [`Item::values`]. The empty name is the item
    /// itself.
    pub fields: Vec<Arc<str>>,
    pub items: Vec<Item>,
    /// Whether items are single values, which `${axis}` gives; of others it gives the label.
    pub is_plain: bool,
    /// The axis whose items these are, once (`copy_of`) or two by two (`pairs`).
    pub base: Base,
}

/// Where the items of an axis come from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Base {
    Own,
    CopyOf(AxisId),
    PairsOf(AxisId),
}

/// One item of an axis.
#[derive(Debug, Clone)]
pub struct Item {
    /// Unique within its axis; what people see.
    pub label: Arc<str>,
    /// By field.
    pub values: Vec<Value>,
    /// Positions in the base axis: of itself, or of its two sides.
    pub base: [usize; 2],
}

impl Axis {
    /// The position of a field in [`Item::values`].
    pub fn field(&self, name: &str) -> Option<usize> {
        self.fields.iter().position(|it| **it == *name)
    }

    /// The position of the item with this label.
    pub fn item(&self, label: &str) -> Option<usize> {
        self.items.iter().position(|it| *it.label == *label)
    }

    /// The names of fields that a user can write.
    pub fn named_fields(&self) -> impl Iterator<Item = &str> {
        self.fields.iter().map(|it| &**it).filter(|it| !it.is_empty())
    }
}
