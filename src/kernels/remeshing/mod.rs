//! Other meshes of the same shape: cleaned, filled, reduced, refined, sampled.

pub mod clean;
pub mod decimate;
pub mod fill;
pub mod normalize;
pub mod remesh;
pub mod remesh_surface;
pub mod resampled;
pub mod sample_points;
pub mod shuffle;
pub mod subdivide;
