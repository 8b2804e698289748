//! What all ways to make an axis share: what they are given, and the list that they give.

use std::{collections::HashMap, sync::Arc};

use super::{AxisId, Choice};
use crate::engine::pipeline::{
    diagnostic::Problems, sources::Sources, substitute::Names, value::Value,
};

/// What reading an axis needs of its file and of the run.
pub struct Reading<'a> {
    /// Parameters that its values can name.
    pub names: &'a Names,
    /// Axes of the same file that others can be made from.
    pub axes: &'a HashMap<Arc<str>, AxisId>,
    pub sources: &'a mut Sources,
    pub problems: &'a mut Problems,
    /// What the user narrows.
    pub choices: &'a mut [Choice],
}

/// Items before they are chosen from: fields, and for each item its label and values.
#[derive(Debug, Default)]
pub struct List {
    pub fields: Vec<Arc<str>>,
    pub items: Vec<(String, Vec<Value>)>,
}

impl List {
    pub fn with_fields<'a>(fields: impl IntoIterator<Item = &'a str>) -> Self {
        Self { fields: fields.into_iter().map(Arc::from).collect(), items: Vec::new() }
    }

    /// Items that are single values.
    pub fn of_values(values: Vec<Value>) -> Self {
        let items = values.into_iter();
        let items = items.map(|it| (it.written_out().unwrap_or_default(), vec![it])).collect();
        Self { fields: vec!["".into()], items }
    }

    pub fn push(&mut self, label: String, values: Vec<Value>) {
        debug_assert_eq!(values.len(), self.fields.len(), "a value for every field");
        self.items.push((label, values));
    }
}
