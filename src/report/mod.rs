//! What people look at: made from graphs and run records alone.

pub mod graph;
pub mod table_diff;
