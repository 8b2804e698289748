//! Depth videos: reading, cutting out, meshing and simulating what a depth camera sees.
//!
//! Camera space throughout: metres, x to the right, y down, z forward. Pixel `(u, v)` has its centre
//! at the whole numbers; `u = fx x / z + cx`, `v = fy y / z + cy`. A depth of 0 is no measurement.

pub mod camera;
pub mod files;
pub mod film;
pub mod mesh;
pub mod names;
pub mod noise;
pub mod portrait;
pub mod raster;
pub mod read;
pub mod segment;
pub mod smooth;
pub mod steps;
pub mod video;

pub use video::{DepthError, DepthVideo, Intrinsics};
