//! Joints in bodies, the weights by which they move skin, and clips that move joints.

pub mod clip;
pub mod dual_quaternion;
pub mod embed;
pub mod joint_error;
pub mod limit_influences;
pub mod segment_map;
pub mod segments_by_name;
pub mod simplify_skeleton;
pub mod skeleton;
pub mod skin_weights;
pub mod skinning;
pub mod ssdr;
pub mod weights;
pub mod weights_error;
