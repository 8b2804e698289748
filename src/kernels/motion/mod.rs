//! Clips: played, fitted, carried to other bodies, kept from piercing them, measured.

pub mod animate;
pub mod clip_frames;
pub mod deformation_error;
pub mod direction_error;
pub mod fit_clip;
pub mod motion_error;
pub mod pose;
pub mod quaternion_spline;
pub mod resample_clip;
pub mod resolve_penetration;
pub mod retarget;
pub mod retarget_bones;
pub mod transfer_animation;
