//! One file a kind of node.

use crate::engine::node::NodeKind;

/// Every kind. Keep sorted by name.
pub static ALL: &[NodeKind] = &[];
