//! Curves in the middle of shapes: found, cleaned, placed, measured.

pub mod coarse_skeleton;
pub mod contract;
pub mod curve_skeleton;
pub mod finish_skeleton;
pub mod growing_skeleton;
pub mod local_separators;
pub mod medial_skeleton;
pub mod motion_skeleton;
pub mod rooted_skeleton;
pub mod skeleton_baselines;
pub mod skeleton_cleanup;
pub mod skeleton_error;
pub mod skeleton_placement;
