//! Skeletons that belong together: matches, unions, joints seen in several poses, textures.

pub mod find_joints;
pub mod fit_joints;
pub mod joint_detection;
pub mod map_segments;
pub mod moving_joints;
pub mod skeleton_match;
pub mod skeleton_texture;
pub mod union_skeleton;
