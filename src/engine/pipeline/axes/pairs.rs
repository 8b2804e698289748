//! `pairs = "shape"`: the items of another axis, two by two; `copy_of = "shape"`: once more.

use super::{Axis, AxisId, Item, list::Reading};
use crate::engine::pipeline::{
    diagnostic::Diagnostic,
    nearest::suggest,
    parse,
    value::{Data, Value},
};

/// One of the two items of a pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    Source,
    Target,
}

impl Side {
    pub const ALL: [Self; 2] = [Self::Source, Self::Target];

    pub fn name(self) -> &'static str {
        match self {
            Self::Source => "source",
            Self::Target => "target",
        }
    }
}

/// Which pairs there are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Which {
    /// All but those of an item with itself.
    Different,
    /// One of each two.
    Unordered,
    All,
}

const WHICH: [(&str, Which); 3] =
    [("different", Which::Different), ("unordered", Which::Unordered), ("all", Which::All)];

/// An axis that another one has been made from.
pub struct Derived {
    pub base: AxisId,
    pub fields: Vec<std::sync::Arc<str>>,
    pub items: Vec<Item>,
}

/// The axis that a value names.
pub fn base(value: &Value, axes: &[Axis], reading: &mut Reading<'_>) -> Option<AxisId> {
    let name = parse::text(value, "the name of an axis", reading.problems)?;
    let found = reading.axes.get(name).filter(|it| it.0 < axes.len());
    if found.is_none() {
        let message = format!("there is no axis `{name}` above this one");
        let names = reading.axes.iter().filter(|it| it.1.0 < axes.len()).map(|it| &**it.0);
        let mut names: Vec<&str> = names.collect();
        names.sort_unstable();
        let hint = suggest(name, names);
        reading.problems.push(Diagnostic::error(&value.place, message).hint(hint));
    }
    found.copied()
}

pub fn copies(value: &Value, axes: &[Axis], reading: &mut Reading<'_>) -> Option<Derived> {
    let base = base(value, axes, reading)?;
    let axis = &axes[base.0];
    let items = axis.items.iter().enumerate();
    let items = items.map(|(index, it)| Item { base: [index, index], ..it.clone() }).collect();
    Some(Derived { base, fields: axis.fields.clone(), items })
}

/// Fields: those of the two items, as `source.stem` and `target.stem`.
pub fn pairs(
    value: &Value,
    which: Option<&Value>,
    axes: &[Axis],
    reading: &mut Reading<'_>,
) -> Option<Derived> {
    let base = base(value, axes, reading)?;
    let which = match which {
        Some(value) => read_which(value, reading)?,
        None => Which::Different,
    };
    let axis = &axes[base.0];
    let mut fields = vec!["".into()];
    for side in Side::ALL {
        fields.extend(axis.fields.iter().map(|field| match &**field {
            "" => side.name().into(),
            field => format!("{}.{field}", side.name()).into(),
        }));
    }
    let mut items = Vec::new();
    for (i, source) in axis.items.iter().enumerate() {
        for (j, target) in axis.items.iter().enumerate() {
            let wanted = match which {
                Which::Different => i != j,
                Which::Unordered => i < j,
                Which::All => true,
            };
            if !wanted {
                continue;
            }
            let label: std::sync::Arc<str> = format!("{}-to-{}", source.label, target.label).into();
            let mut values =
                vec![Value { data: Data::Text(label.clone()), ..source.values[0].clone() }];
            values.extend(source.values.iter().chain(&target.values).cloned());
            items.push(Item { label, values, base: [i, j] });
        }
    }
    Some(Derived { base, fields, items })
}

fn read_which(value: &Value, reading: &mut Reading<'_>) -> Option<Which> {
    let text = parse::text(value, "`which`", reading.problems)?;
    let found = WHICH.iter().find(|it| it.0 == text);
    if found.is_none() {
        let message = format!("`which` cannot be \"{text}\"");
        let hint = suggest(text, WHICH.iter().map(|it| it.0));
        reading.problems.push(Diagnostic::error(&value.place, message).hint(hint));
    }
    Some(found?.1)
}
