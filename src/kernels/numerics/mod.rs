//! Numbers without geometry: matrices, solvers, random numbers.

pub mod adam;
pub mod block_pattern;
pub mod cholesky;
pub mod random;
pub mod sparse;
pub mod sparse_cholesky;
pub mod tall;
