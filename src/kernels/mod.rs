//! Plain geometry: usable without the engine, imports nothing else of ours.
//!
//! A kernel is a function (or a solver struct where repeated solves pay) with its options in a struct
//! and its errors in an enum that carries the facts. Kernels keep no global state. Those that use
//! several threads use the rayon pool they are called in, and cut their sums into chunks whose size
//! does not depend on the number of threads: same input, same bytes.

pub mod adam;
pub mod adam_regressor;
pub mod animate;
pub mod avril_regressor;
pub mod basis;
pub mod canvas;
pub mod cholesky;
pub mod clean;
pub mod clip;
pub mod cloud_laplacian;
pub mod convex_regressor;
pub mod corner_table;
pub mod decimate;
pub mod deformation_error;
pub mod degrade;
pub mod descriptors;
pub mod distance_field;
pub mod dual_quaternion;
pub mod edge_weights;
pub mod eigs;
pub mod embed;
pub mod exact_regressor;
pub mod farm_map;
pub mod farthest_points;
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
pub mod kabsch;
pub mod landmark_error;
pub mod landmark_files;
pub mod landmarks;
pub mod landmarks_auto;
pub mod laplacian;
pub mod limit_influences;
pub mod make_body;
pub mod mesh;
pub mod mesh_sequence;
pub mod nearest;
pub mod normalize;
pub mod operator;
pub mod point_tree;
pub mod pose;
pub mod pose_regressor;
pub mod random;
pub mod regressor;
pub mod regressor_masks;
pub mod remesh;
pub mod remesh_surface;
pub mod resampled;
pub mod retarget;
pub mod retarget_bones;
pub mod rig_landmarks;
pub mod sample_points;
pub mod shapes;
pub mod shuffle;
pub mod simplify_skeleton;
pub mod skeleton;
pub mod skeleton_transfer;
pub mod skin_weights;
pub mod skinning;
pub mod snapshot;
pub mod sparse;
pub mod sparse_cholesky;
pub mod ssdr;
pub mod star;
pub mod subdivide;
pub mod synthesize;
pub mod table;
pub mod tall;
pub mod text;
pub mod topology;
pub mod transfer_weights;
pub mod triangle_tree;
pub mod tufted;
pub mod weights;
pub mod winding;
pub mod zoomout;

#[cfg(test)]
mod test_shapes;
