//! Making a raw curve skeleton fit for joints: no false cycles, no spurs, no crowds of nodes.
//!
//! All steps keep the labels: a vertex follows its node into the one that takes its place.

mod bend_inside;
mod close_nodes;
mod connect;
mod cycles;
mod editor;
mod junctions;
mod merge_junctions;
mod prune;
mod pull_inside;
mod slight_leaves;
mod strip_radii;
#[cfg(test)]
mod tests;

pub use bend_inside::{bend_edges, inside_of, moved_inside};
pub use close_nodes::{merge_close_nodes, merge_crowded_nodes};
pub use connect::{connect_components, drop_small_components};
pub use cycles::{collapse_cycles, collapse_short_cycles};
pub use junctions::free_junctions;
pub use merge_junctions::merge_junctions;
pub use prune::{PruneOptions, prune};
pub use pull_inside::pull_inside;
pub use slight_leaves::drop_slight_leaves;
pub use strip_radii::strip_radii;
