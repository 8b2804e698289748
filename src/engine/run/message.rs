//! What workers and the writer tell the coordinator.

use petgraph::graph::NodeIndex;

use super::worker::{JobResult, Loaded};
use crate::engine::store::StoreError;

/// One thing that happened on another thread.
pub enum Message {
    Progress { instance: NodeIndex, fraction: Option<f64>, text: String },
    Ran { instance: NodeIndex, loaded: Loaded, result: JobResult },
    Exported { rule: usize, loaded: Loaded, result: JobResult },
    Stored { instances: Vec<NodeIndex> },
    StoreFailed { error: StoreError },
}
