//! Pipelines, keys, plan, store, schedule, execution, run records. Knows no geometry.

pub mod artifact;
pub mod digest;
pub mod graph;
pub mod library;
pub mod node;
pub mod tensors;
#[doc(hidden)]
pub mod toy;
