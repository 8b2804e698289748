//! Pipelines, keys, plan, store, schedule, execution, run records. Knows no geometry.

pub mod artifact;
pub mod cancel;
pub mod clock;
pub mod compare;
pub mod digest;
pub mod events;
pub mod facts;
pub mod file_digests;
pub mod graph;
pub mod key;
pub mod labels;
pub mod library;
pub mod memory;
pub mod node;
pub mod params;
pub mod pipeline;
pub mod plan;
pub mod port_map;
pub mod program;
pub mod record;
pub mod reference;
pub mod run;
pub mod schema;
pub mod settings;
pub mod shared_text;
pub mod snapshot;
pub mod store;
pub mod tensors;
#[doc(hidden)]
pub mod toy;
pub mod verify;
pub mod why;
