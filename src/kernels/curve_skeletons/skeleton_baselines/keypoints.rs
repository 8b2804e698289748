//! A skeleton of keypoints: means of vertices that move alike.

use super::k_means::k_means;
use super::{BaselineError, Moving, MovingSkeleton, means, tree};
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::geometry::spanning_tree::spanning_tree;
use crate::kernels::rigs::ssdr::rmse;
use crate::kernels::rigs::weights::SkinWeights;

/// How keypoints are chosen.
#[derive(Debug, Clone, PartialEq)]
pub struct KeypointOptions {
    pub n_keypoints: usize,
    /// How fast weights fall with distance, for a surface whose box has a diagonal of 2.
    pub falloff: f64,
    pub seed: u64,
}

impl Default for KeypointOptions {
    fn default() -> Self {
        Self { n_keypoints: 24, falloff: 8.0, seed: 0 }
    }
}

/// Finds a skeleton of keypoints: k-means on the paths of all vertices, joined by a minimum spanning
/// tree.
///
/// Stands in for Neural Marionette (Bae et al. 2022), whose keypoints, tree and weights are learned and
/// cannot be had without its training: it has that method's 24 keypoints and two-joint weights
/// proportional to `exp(-8 d)`, and nothing else of it. A vertex follows the keypoint of its cluster and
/// the nearest of those joined to that one. Keypoints are joined that lie near each other whenever they
/// are farthest apart; the root is the one nearest to the surface's centroid.
///
/// # Errors
/// See [`BaselineError`].
pub fn skeletonize_kmeans(
    moving: &Moving<'_>,
    options: &KeypointOptions,
) -> Result<MovingSkeleton, BaselineError> {
    moving.check_clusters(options.n_keypoints)?;
    let (name, value) = ("falloff", options.falloff);
    if !(value >= 0.0 && value.is_finite()) {
        return Err(BaselineError::Option { name, value, wanted: "a number from 0" });
    }
    let coordinates = |vertex: usize| moving.frames.iter().flat_map(move |it| it[vertex].data.0[0]);
    let points: Vec<f64> = (0..moving.n_vertices()).flat_map(coordinates).collect();
    let labels = k_means(&points, 3 * moving.frames.len(), options.n_keypoints, options.seed);
    let n = labels.iter().max().map_or(0, |it| *it as usize + 1);
    let rest = means(moving.rest, &labels, n);
    let paths: Vec<Vec<Vec3>> = moving.frames.iter().map(|it| means(it, &labels, n)).collect();
    let farthest =
        |a: usize, b: usize| paths.iter().map(|it| (it[a] - it[b]).norm()).fold(0.0, f64::max);
    let pairs = (0..n).flat_map(|a| (a + 1..n).map(move |b| (a, b)));
    let edges = spanning_tree(n, pairs.map(|(a, b)| (farthest(a, b), a, b)).collect());
    let centre = moving.rest.iter().sum::<Vec3>() / moving.rest.len() as f64;
    let off = |it: &usize| (rest[*it] - centre).norm();
    let root = (0..n).min_by(|a, b| off(a).total_cmp(&off(b))).expect("there are keypoints");
    let parents = tree::rooted(n, &edges, root);
    let rows = rows(moving, &rest, &edges, &labels, options.falloff);
    let motions = moving.rigid_motions(&labels)?.motions;
    let error = rmse(moving.rest, &moving.frames, &SkinWeights::from_rows(n, &rows)?, &motions);
    let (skeleton, clip, new_of_old) = moving.assembled(&rest, &paths, &parents)?;
    let renumbered: Vec<Vec<(u32, f64)>> = (rows.iter())
        .map(|row| row.iter().map(|it| (new_of_old[it.0 as usize], it.1)).collect())
        .collect();
    let weights = SkinWeights::from_rows(n, &renumbered)?;
    Ok(MovingSkeleton { skeleton, clip, weights, error })
}

/// For every vertex its own keypoint and the nearest joined one, with weights `exp(-falloff d)`.
fn rows(
    moving: &Moving<'_>,
    keypoints: &[Vec3],
    edges: &[(usize, usize)],
    labels: &[u32],
    falloff: f64,
) -> Vec<Vec<(u32, f64)>> {
    let mut joined = vec![Vec::new(); keypoints.len()];
    for &(a, b) in edges {
        joined[a].push(b as u32);
        joined[b].push(a as u32);
    }
    let scale = moving.scale();
    let row = |(place, &own): (&Vec3, &u32)| {
        let distance = |it: u32| (keypoints[it as usize] - place).norm() / scale;
        let others = joined[own as usize].iter().copied();
        let other = others.min_by(|a, b| distance(*a).total_cmp(&distance(*b)));
        let nearest = other.map_or(f64::INFINITY, distance).min(distance(own));
        // From the nearer one on, so that far away not both weights vanish.
        let weight = |it: u32| (-falloff * (distance(it) - nearest)).exp();
        std::iter::once(own).chain(other).map(|it| (it, weight(it))).collect()
    };
    moving.rest.iter().zip(labels).map(row).collect()
}
