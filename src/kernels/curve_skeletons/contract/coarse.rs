//! Contraction of large shapes by way of smaller ones.

use super::super::curve_skeleton::{CurveSkeleton, NO_NODE};
use super::{ContractError, ContractOptions, ContractionSkeleton, contraction_skeleton};
use crate::kernels::geometry::farthest_points::farthest_points;
use crate::kernels::geometry::mesh::{MeshError, TriMesh, Vec3};
use crate::kernels::geometry::point_tree::PointTree;
use crate::kernels::remeshing::decimate::{DecimateError, DecimateOptions, decimate};

/// Why there is no skeleton of the smaller shape.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CoarseContractionError {
    #[error(transparent)]
    Contract(#[from] ContractError),
    #[error(transparent)]
    Decimate(#[from] DecimateError),
    #[error(transparent)]
    Mesh(#[from] MeshError),
}

/// Extracts the skeleton of a shape of at most `n_points` instead, and labels all its points: a mesh is
/// decimated; of a cloud, points are chosen that are far from each other, and moved to the mean of
/// those that are nearest to them, which also takes off noise.
///
/// # Errors
/// See [`ContractError`] and [`DecimateError`].
pub fn coarse_contraction(
    shape: &TriMesh,
    n_points: usize,
    options: &ContractOptions,
) -> Result<ContractionSkeleton, CoarseContractionError> {
    if shape.n_vertices() <= n_points {
        return Ok(contraction_skeleton(shape, options)?);
    }
    let (small, stand_ins) = match shape.is_point_cloud() {
        true => thinned(shape.vertices(), n_points)?,
        false => decimated(shape, n_points)?,
    };
    let found = contraction_skeleton(&small, options)?;
    Ok(for_all_points(found, &stand_ins))
}

/// A smaller cloud, and the point that stands for every old one.
fn thinned(points: &[Vec3], count: usize) -> Result<(TriMesh, Vec<Option<u32>>), MeshError> {
    let spread = farthest_points(points, count);
    let mut sums = vec![(Vec3::zeros(), 0.0); spread.chosen.len()];
    for (point, &cell) in points.iter().zip(&spread.cells) {
        sums[cell as usize].0 += point;
        sums[cell as usize].1 += 1.0;
    }
    let means = sums.into_iter().map(|(sum, count)| sum / count).collect();
    Ok((TriMesh::from_points(means)?, spread.cells.into_iter().map(Some).collect()))
}

fn decimated(
    mesh: &TriMesh,
    n_vertices: usize,
) -> Result<(TriMesh, Vec<Option<u32>>), DecimateError> {
    let small = decimate(mesh, &DecimateOptions { n_vertices, ..Default::default() })?;
    let tree = PointTree::new(small.mesh.vertices());
    let mut is_used = vec![false; mesh.n_vertices()];
    mesh.faces().iter().flatten().for_each(|&it| is_used[it as usize] = true);
    let mut found = Vec::new();
    let mut stand_in = |vertex: usize| {
        let near = || {
            tree.nearest(mesh.vertices()[vertex], 1, &mut found);
            found.first().map(|it| it.1)
        };
        if is_used[vertex] { small.new_of_old[vertex].or_else(near) } else { None }
    };
    let stand_ins = (0..mesh.n_vertices()).map(&mut stand_in).collect();
    Ok((small.mesh, stand_ins))
}

fn for_all_points(found: ContractionSkeleton, stand_ins: &[Option<u32>]) -> ContractionSkeleton {
    let old = &found.skeleton;
    let label = |it: &Option<u32>| it.map_or(NO_NODE, |it| old.node_of_vertex()[it as usize]);
    let labels: Vec<u32> = stand_ins.iter().map(label).collect();
    let spread = |of_small: &[Vec3]| -> Vec<Vec3> {
        stand_ins.iter().map(|it| it.map_or(Vec3::zeros(), |it| of_small[it as usize])).collect()
    };
    let (contracted, normals) = (spread(&found.contracted), spread(&found.normals));
    let n_lost = labels.iter().filter(|it| **it == NO_NODE).count();
    let (positions, radii) = (old.positions().to_vec(), old.radii().to_vec());
    let skeleton = CurveSkeleton::new(positions, radii, old.edges().to_vec(), labels)
        .expect("labels of nodes there are");
    ContractionSkeleton { skeleton, contracted, normals, n_lost, ..found }
}
