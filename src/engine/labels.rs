//! What the items of axes are called.

use std::{
    collections::BTreeMap,
    sync::{Arc, LazyLock},
};

/// (axis, item) pairs, for people; empty for what has no axes.
pub type Labels = Arc<[(Arc<str>, Arc<str>)]>;

/// By labelled port: what the items are called that it gathers, in the order of its inputs.
pub type InputLabels = BTreeMap<&'static str, Vec<Labels>>;

/// The labels of what has no axes, which all share.
pub fn no_labels() -> Labels {
    static NONE: LazyLock<Labels> = LazyLock::new(|| Labels::from([]));
    Arc::clone(&NONE)
}
