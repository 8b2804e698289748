//! Laplacians of surfaces and clouds, their eigenfunctions, and what these describe.

pub mod basis;
pub mod cloud_laplacian;
pub mod descriptors;
pub mod edge_weights;
pub mod eigs;
pub mod function_space;
pub mod intrinsic;
pub mod laplacian;
pub mod operator;
pub mod tufted;
