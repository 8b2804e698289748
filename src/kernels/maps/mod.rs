//! Maps between shapes: landmarks, functional maps, matches of points.

pub mod chirality;
pub mod correspondences;
pub mod farm_map;
pub mod fit_surface;
pub mod fmap;
pub mod functional_map;
pub mod icp_refine;
pub mod landmark_error;
pub mod landmark_files;
pub mod landmarks_auto;
pub mod map_quality;
pub mod nearest;
pub mod point_map;
pub mod rig_landmarks;
pub mod zoomout;
