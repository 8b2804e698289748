//! Plain geometry: usable without the engine, imports nothing else of ours.
//!
//! A kernel is a function (or a solver struct where repeated solves pay) with its options in a struct
//! and its errors in an enum that carries the facts. Kernels keep no global state. Those that use
//! several threads use the rayon pool they are called in, and cut their sums into chunks whose size
//! does not depend on the number of threads: same input, same bytes.

pub mod curve_skeletons;
pub mod files;
pub mod geometry;
pub mod image;
pub mod io;
pub mod maps;
pub mod matching;
pub mod motion;
pub mod numerics;
pub mod pictures;
pub mod remeshing;
pub mod rigs;
pub mod sensors;
pub mod spectral;
pub mod synthetic;
pub mod table;
pub mod text;
pub mod transfer;

#[cfg(test)]
mod test_shapes;
