//! `over` and `missing`: what a node that gathers says about its inputs.

use super::{
    diagnostic::{Diagnostic, Problems},
    nearest::suggest,
    parse,
    value::{Data, Entry, Key, Value},
};
use crate::engine::node::NodeKind;

/// How a node gathers the items of axes.
#[derive(Debug, Default)]
pub struct Gather {
    /// Names of the axes that are gathered, `*` for all that the inputs have.
    pub over: Vec<Key>,
    /// Whether items that failed are left out (and told) instead of failing this node as well.
    pub shows_missing: bool,
}

impl Gather {
    pub fn takes(&self, axis: &str) -> bool {
        self.over.iter().any(|it| *it.name == *axis || &*it.name == "*")
    }
}

/// Takes `over` and `missing` out of a node's fields.
pub fn take(fields: &mut Vec<Entry>, kind: &NodeKind, problems: &mut Problems) -> Gather {
    let mut res = Gather::default();
    if let Some(Entry { key, value }) = remove(fields, "over") {
        let takes_lists = kind.spec.inputs.iter().any(|it| it.arity.takes_list());
        if takes_lists {
            res.over = read_over(&value, problems);
        } else {
            let message = format!("kind `{}` has no list of inputs to gather into", kind.spec.kind);
            problems.push(Diagnostic::error(&key.place, message));
        }
    }
    if let Some(Entry { key, value }) = remove(fields, "missing") {
        res.shows_missing = read_missing(&value, problems).unwrap_or(false);
        if res.shows_missing && !kind.spec.inputs.iter().any(|it| it.labelled) {
            let message = format!("kind `{}` cannot show what is missing", kind.spec.kind);
            problems.push(Diagnostic::error(&key.place, message));
        }
    }
    res
}

fn remove(fields: &mut Vec<Entry>, name: &str) -> Option<Entry> {
    let index = fields.iter().position(|it| *it.key.name == *name)?;
    Some(fields.remove(index))
}

fn read_over(value: &Value, problems: &mut Problems) -> Vec<Key> {
    let items = match &value.data {
        Data::List(items) => &items[..],
        _ => std::slice::from_ref(value),
    };
    let mut res = Vec::new();
    for item in items {
        if let Some(name) = parse::text(item, "the name of an axis", problems) {
            res.push(Key { name: name.into(), place: item.place.clone() });
        }
    }
    res
}

fn read_missing(value: &Value, problems: &mut Problems) -> Option<bool> {
    match parse::text(value, "`missing`", problems)? {
        "show" => Some(true),
        "fail" => Some(false),
        other => {
            let message = format!("`missing` cannot be \"{other}\"");
            let hint = suggest(other, ["fail", "show"]);
            problems.push(Diagnostic::error(&value.place, message).hint(hint));
            None
        }
    }
}
