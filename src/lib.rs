//! Sinew runs geometry and animation research as declarative pipelines.
//!
//! The layers, from the bottom up, and what each may import are described in `src/README.md`;
//! `tests/tidy.rs` holds them.

pub mod artifacts;
pub mod engine;
pub mod kernels;
pub mod nodes;
