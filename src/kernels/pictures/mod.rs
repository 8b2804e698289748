//! Pictures of meshes, skeletons, matrices and tables, drawn in software.

pub mod canvas;
pub mod figure;
pub mod matrix_image;
pub mod snapshot;
