//! Curve skeletons of large meshes by way of smaller ones.

use super::curve_skeleton::{CurveSkeleton, CurveSkeletonError, NO_NODE};
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::geometry::point_tree::PointTree;
use crate::kernels::remeshing::decimate::{DecimateError, DecimateOptions, decimate};

/// Why there is no skeleton of the smaller mesh.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CoarseSkeletonError {
    #[error(transparent)]
    Decimate(#[from] DecimateError),
    #[error(transparent)]
    Skeleton(#[from] CurveSkeletonError),
}

/// Extracts the skeleton of a mesh that is decimated to at most `n_vertices`, and labels the vertices
/// of the full one: by the vertex that took their place, or the nearest one.
///
/// Vertices of no face belong to no node.
///
/// # Errors
/// See [`DecimateError`].
pub fn coarse_skeleton(
    mesh: &TriMesh,
    n_vertices: usize,
    extract: impl FnOnce(&TriMesh) -> CurveSkeleton,
) -> Result<CurveSkeleton, CoarseSkeletonError> {
    if mesh.n_vertices() <= n_vertices {
        return Ok(extract(mesh));
    }
    let coarse = decimate(mesh, &DecimateOptions { n_vertices, ..Default::default() })?;
    let skeleton = extract(&coarse.mesh);
    let tree = PointTree::new(coarse.mesh.vertices());
    let mut is_used = vec![false; mesh.n_vertices()];
    mesh.faces().iter().flatten().for_each(|&it| is_used[it as usize] = true);
    let mut found = vec![];
    let mut label = |vertex: usize| {
        let stand_in = coarse.new_of_old[vertex].or_else(|| {
            tree.nearest(mesh.vertices()[vertex], 1, &mut found);
            found.first().map(|it| it.1)
        });
        match stand_in {
            Some(new) if is_used[vertex] => skeleton.node_of_vertex()[new as usize],
            _ => NO_NODE,
        }
    };
    let labels = (0..mesh.n_vertices()).map(&mut label).collect();
    let (positions, radii) = (skeleton.positions().to_vec(), skeleton.radii().to_vec());
    Ok(CurveSkeleton::new(positions, radii, skeleton.edges().to_vec(), labels)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::curve_skeletons::local_separators::{
        LocalSeparatorsOptions, SpatialGraph, local_separators,
    };
    use crate::kernels::geometry::shapes::torus;

    #[test]
    fn labels_of_the_full_mesh_lie_around_their_nodes() {
        let mesh = torus(1.0, 0.3, 90, 40);
        let extract = |it: &TriMesh| {
            assert!(it.n_vertices() <= 1000);
            local_separators(&SpatialGraph::of_mesh(it), &LocalSeparatorsOptions::default())
        };
        let skeleton = coarse_skeleton(&mesh, 1000, extract).unwrap();
        assert_eq!((skeleton.n_cycles(), skeleton.node_of_vertex().len()), (1, 3600));
        for (vertex, &node) in mesh.vertices().iter().zip(skeleton.node_of_vertex()) {
            let distance = (vertex - skeleton.positions()[node as usize]).norm();
            // The tube's radius is 0.3, and nodes are up to 0.4 apart along it.
            assert!(distance < 0.55, "{distance}");
        }
    }
}
