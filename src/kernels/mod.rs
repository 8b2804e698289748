//! Plain geometry: usable without the engine, imports nothing else of ours.
//!
//! A kernel is a function (or a solver struct where repeated solves pay) with its options in a struct
//! and its errors in an enum that carries the facts. Kernels keep no global state. Those that use
//! several threads use the rayon pool they are called in, and cut their sums into chunks whose size
//! does not depend on the number of threads: same input, same bytes.

pub mod basis;
pub mod canvas;
pub mod cholesky;
pub mod clean;
pub mod clip;
pub mod cloud_laplacian;
pub mod corner_table;
pub mod decimate;
pub mod depth;
pub mod descriptors;
pub mod edge_weights;
pub mod eigs;
pub mod exact_regressor;
pub mod figure;
pub mod files;
pub mod fill;
pub mod fit_clip;
pub mod fmap;
pub mod functional_map;
pub mod image;
pub mod intrinsic;
pub mod io;
pub mod isosurface;
pub mod joint_error;
pub mod landmark_files;
pub mod landmarks;
pub mod laplacian;
pub mod limit_influences;
pub mod make_body;
pub mod mesh;
pub mod mesh_sequence;
pub mod nearest;
pub mod normalize;
pub mod operator;
pub mod point_tree;
pub mod random;
pub mod registration;
pub mod regressor;
pub mod remesh;
pub mod resampled;
pub mod rig_landmarks;
pub mod sample_points;
pub mod shapes;
pub mod skeleton;
pub mod skeleton_transfer;
pub mod skinning;
pub mod snapshot;
pub mod sparse;
pub mod star;
pub mod subdivide;
pub mod synthesize;
pub mod table;
pub mod tall;
pub mod text;
pub mod topology;
pub mod transfer_weights;
pub mod tufted;
pub mod weights;
pub mod zoomout;

#[cfg(test)]
mod test_shapes;
