//! From a raw curve skeleton to one that joints can be chosen from.

use super::curve_skeleton::CurveSkeleton;
use super::local_separators::median_distance;
use super::skeleton_cleanup::{
    PruneOptions, collapse_cycles, connect_components, drop_small_components, free_junctions,
    merge_close_nodes, prune, pull_inside, strip_radii,
};
use super::skeleton_placement::{PlacementError, PlacementOptions, place};
use crate::kernels::geometry::mesh::{TriMesh, Vec3};

/// The steps, in the order in which they are taken.
#[derive(Debug, Clone, PartialEq)]
pub struct FinishOptions {
    pub collapse_cycles: bool,
    pub prune: PruneOptions,
    /// Components of fewer nodes are removed.
    pub min_nodes: usize,
    /// Nodes stay where they are without.
    pub placement: Option<PlacementOptions>,
    /// Move nodes that are outside of a closed mesh into it.
    pub pull_inside: bool,
    /// Join components to one.
    pub connect: bool,
    /// Joined nodes closer than this are united, in the unit of the mesh.
    pub merge_distance: f64,
    /// Give the vertices of junctions to the curves around them.
    pub free_junctions: bool,
}

impl Default for FinishOptions {
    fn default() -> Self {
        Self {
            collapse_cycles: true,
            prune: PruneOptions::default(),
            min_nodes: 0,
            placement: Some(PlacementOptions {
                lambda_s: 0.02,
                is_relative: true,
                ..Default::default()
            }),
            pull_inside: true,
            connect: false,
            merge_distance: 0.0,
            free_junctions: false,
        }
    }
}

/// Removes cycles and spurs, places nodes in the middle, and unites what is close (Transfer4D,
/// section 3.2). A shape that has no curve gets one node at the mean of its vertices.
///
/// # Errors
/// See [`PlacementError`]; `raw` must label the vertices of the mesh.
pub fn finish_skeleton(
    raw: &CurveSkeleton,
    mesh: &TriMesh,
    options: &FinishOptions,
) -> Result<CurveSkeleton, PlacementError> {
    if raw.n_nodes() == 0 {
        return Ok(single_node(mesh.vertices()));
    }
    let mut skeleton = match options.collapse_cycles {
        true => collapse_cycles(raw),
        false => raw.clone(),
    };
    skeleton = prune(&skeleton, &strip_radii(&skeleton, mesh), &options.prune);
    skeleton = drop_small_components(&skeleton, options.min_nodes);
    if let Some(placement) = &options.placement {
        skeleton = place(&skeleton, mesh.vertices(), &mesh.vertex_normals(), placement)?;
    }
    if options.pull_inside {
        skeleton = pull_inside(&skeleton, mesh);
    }
    if options.connect {
        skeleton = connect_components(&skeleton);
    }
    skeleton = merge_close_nodes(&skeleton, options.merge_distance);
    match options.free_junctions {
        true => Ok(free_junctions(&skeleton, mesh.vertices())),
        false => Ok(skeleton),
    }
}

/// One node for all.
fn single_node(vertices: &[Vec3]) -> CurveSkeleton {
    let mean = vertices.iter().sum::<Vec3>() / vertices.len() as f64;
    let radius = median_distance(vertices, &mean);
    CurveSkeleton::new(vec![mean], vec![radius], vec![], vec![0; vertices.len()])
        .expect("the mean of finite points is finite")
}
