//! From contracted curves to curves fit for joints.

use super::super::curve_skeleton::CurveSkeleton;
use super::super::skeleton_cleanup::{
    PruneOptions, bend_edges, collapse_short_cycles, connect_components, inside_of, prune,
    pull_inside, strip_radii,
};
use super::super::skeleton_placement::{PlacementError, PlacementOptions, place};
use super::center::{CenterOptions, center};
use super::{ContractionSkeleton, with_radii};
use crate::kernels::geometry::mesh::TriMesh;

/// The steps, in the order in which they are taken.
#[derive(Debug, Clone, PartialEq)]
pub struct FinishOptions {
    /// Cycles of at most so many nodes become one node (Cao et al. 2010).
    pub max_cycle_nodes: usize,
    pub prune: PruneOptions,
    /// Move nodes to where the normals of their vertices meet: for shapes of which one side was seen.
    /// On whole ones, whose rings tell the middle, nodes of wide parts would pass each other.
    pub placement: Option<PlacementOptions>,
    /// Move nodes to the middle of the shape across them, with new ones in long edges. Needs a closed
    /// mesh or a cloud; curves of open meshes stay.
    pub center: Option<CenterOptions>,
    /// Move nodes and edges that are outside of a closed mesh into it.
    pub pull_inside: bool,
    /// Join the skeletons of different parts.
    pub connect: bool,
}

impl Default for FinishOptions {
    fn default() -> Self {
        Self {
            max_cycle_nodes: 6,
            prune: PruneOptions { max_nodes: 0, max_radii: 1.2 },
            placement: None,
            center: Some(CenterOptions::default()),
            pull_inside: true,
            connect: false,
        }
    }
}

/// Removes false cycles and spurs, and brings what is outside of the shape back into it.
///
/// # Errors
/// See [`PlacementError`].
pub fn finish(
    found: &ContractionSkeleton,
    shape: &TriMesh,
    options: &FinishOptions,
) -> Result<CurveSkeleton, PlacementError> {
    let vertices = shape.vertices();
    let mut skeleton = collapse_short_cycles(&found.skeleton, options.max_cycle_nodes);
    skeleton = with_radii(&skeleton, vertices);
    skeleton = prune(&skeleton, &strip_radii(&skeleton, shape), &options.prune);
    if let Some(placement) = &options.placement {
        skeleton = place(&skeleton, vertices, &found.normals, placement)?;
    }
    skeleton = with_radii(&skeleton, vertices);
    let needs_field = options.pull_inside || options.center.is_some();
    let field = if needs_field { inside_of(shape) } else { None };
    if options.pull_inside {
        skeleton = pull_inside(&skeleton, shape);
    }
    let bent = |skeleton: CurveSkeleton| match &field {
        Some(field) if options.pull_inside => bend_edges(&skeleton, field),
        _ => skeleton,
    };
    skeleton = bent(skeleton);
    if let Some(center_options) = &options.center
        && (field.is_some() || shape.is_point_cloud())
    {
        skeleton = bent(center(&skeleton, vertices, field.as_ref(), center_options));
    }
    Ok(if options.connect { connect_components(&skeleton) } else { skeleton })
}
