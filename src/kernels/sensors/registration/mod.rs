//! Non-rigid registration of a surface to the frames of a depth video.

mod chamfer;
mod correspond;
mod energy;
pub mod erode;
pub mod error;
mod fpfh;
pub mod graph;
mod normal_matrix;
mod paper;
mod relocalize;
mod silhouette;
mod solve;
mod source;
mod target;
pub mod track;
pub mod warp;

pub use paper::PaperOptions;
pub use source::{SourceError, SourceOptions, source_mesh};
pub use track::{FrameReport, NrrError, NrrOptions, Solver, Tracked, track};

#[cfg(test)]
mod tests;
