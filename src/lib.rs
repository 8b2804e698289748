//! Sinew runs geometry and animation research as declarative pipelines.
//!
//! The layers, from the bottom up, and what each may import are described in `src/README.md`;
//! `tests/tidy.rs` holds them.

pub mod artifacts;
pub mod cli;
pub mod engine;
pub mod kernels;
pub mod nodes;
pub mod report;

/// Every kind and type that there is.
pub static LIBRARY: engine::library::Library = engine::library::Library {
    kinds: nodes::ALL,
    types: artifacts::ALL,
    common_formats: artifacts::COMMON_FORMATS,
};
