//! Plain geometry: usable without the engine, imports nothing else of ours.
//!
//! A kernel is a function (or a solver struct where repeated solves pay) with its options in a struct
//! and its errors in an enum that carries the facts. Kernels keep no global state. Those that use
//! several threads use the rayon pool they are called in, and cut their sums into chunks whose size
//! does not depend on the number of threads: same input, same bytes.

pub mod basis;
pub mod clip;
pub mod eigs;
pub mod files;
pub mod functional_map;
pub mod image;
pub mod landmarks;
pub mod laplacian;
pub mod mesh;
pub mod operator;
pub mod random;
pub mod regressor;
pub mod shapes;
pub mod skeleton;
pub mod sparse;
pub mod table;
pub mod tall;
pub mod weights;
