//! Zhang and others' skeleton: clusters of points whose distances from each other do not change.

use faer::Mat;
use rayon::prelude::*;

use super::k_means::k_means;
use super::leading_vectors::leading_vectors;
use super::regions::regions;
use super::{BaselineError, Moving, MovingSkeleton, means, tree};
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::geometry::point_tree::PointTree;
use crate::kernels::geometry::spanning_tree::spanning_tree;
use crate::kernels::numerics::random::Random;
use crate::kernels::rigs::weights::SkinWeights;

/// How points are clustered.
#[derive(Debug, Clone, PartialEq)]
pub struct ZhangOptions {
    /// Clusters before they are split into connected regions.
    pub n_clusters: usize,
    /// Random vertices whose distances are compared.
    pub n_samples: usize,
    /// The deviation of a distance at which affinity has fallen to `1 / e`, for a surface whose box has
    /// a diagonal of 2.
    pub scale: f64,
    /// Regions with a smaller share of the vertices are merged.
    pub least_share: f64,
    pub seed: u64,
}

impl Default for ZhangOptions {
    fn default() -> Self {
        Self { n_clusters: 20, n_samples: 2000, scale: 0.05, least_share: 0.01, seed: 0 }
    }
}

/// How many samples vote on the label of a vertex.
const N_VOTERS: usize = 10;

/// Finds a skeleton by spectral clustering (Zhang, Song, Tan & Tong 2013, as Transfer4D compares with).
///
/// `W = exp(-s / scale)` for the deviation `s` over time of the distance of two samples; k-means on the
/// smallest eigenvectors of the normalised Laplacian (the leading ones of `D^-1/2 W D^-1/2`); labels by
/// a vote of the 10 nearest samples; regions by connectivity. Joints are the regions' centroids, joined
/// where regions stay near each other; the root is the one nearest to the surface's centroid. Weights
/// are 1 for the own region.
///
/// # Errors
/// See [`BaselineError`].
pub fn skeletonize_zhang(
    moving: &Moving<'_>,
    options: &ZhangOptions,
) -> Result<MovingSkeleton, BaselineError> {
    moving.check_clusters(options.n_clusters)?;
    if !(options.scale > 0.0 && options.scale.is_finite()) {
        let (name, value) = ("scale", options.scale);
        return Err(BaselineError::Option { name, value, wanted: "a positive number" });
    }
    let samples =
        drawn(moving.n_vertices(), options.n_samples.max(options.n_clusters), options.seed);
    let clusters = clusters(moving, &samples, options)?;
    let labels = voted(moving.rest, &samples, &clusters);
    let regions = regions(moving.rest, moving.faces, &labels, options.least_share);
    of_regions(moving, &regions)
}

/// Ascending random vertices, none twice.
fn drawn(n_vertices: usize, n_samples: usize, seed: u64) -> Vec<u32> {
    let mut all: Vec<u32> = (0..n_vertices as u32).collect();
    Random::stream(seed, "zhang").shuffle(&mut all);
    all.truncate(n_samples);
    all.sort_unstable();
    all
}

fn clusters(
    moving: &Moving<'_>,
    samples: &[u32],
    options: &ZhangOptions,
) -> Result<Vec<u32>, BaselineError> {
    let (n, k) = (samples.len(), options.n_clusters);
    let paths: Vec<Vec<Vec3>> = samples
        .iter()
        .map(|it| moving.frames.iter().map(|at| at[*it as usize]).collect())
        .collect();
    let scale = options.scale * moving.scale();
    let affinity = |i: usize, j: usize| (-deviation(&paths[i], &paths[j]) / scale).exp();
    let rows: Vec<Vec<f64>> =
        (0..n).into_par_iter().map(|i| (0..=i).map(|j| affinity(i, j)).collect()).collect();
    let at = |i: usize, j: usize| rows[i.max(j)][i.min(j)];
    let roots: Vec<f64> = (0..n).map(|i| (0..n).map(|j| at(i, j)).sum::<f64>().sqrt()).collect();
    let matrix = Mat::from_fn(n, n, |i, j| at(i, j) / (roots[i] * roots[j]));
    let vectors = leading_vectors(matrix.as_ref(), k)
        .ok_or(BaselineError::Eigenvectors { n_points: n, k })?;
    // Rows of one length, as Ng, Jordan & Weiss 2001 want them.
    let row = |i: usize| {
        let row: Vec<f64> = (0..k).map(|it| vectors[(i, it)]).collect();
        let norm = row.iter().map(|it| it * it).sum::<f64>().sqrt();
        row.into_iter().map(move |it| if norm > 0.0 { it / norm } else { 0.0 })
    };
    let points: Vec<f64> = (0..n).flat_map(row).collect();
    Ok(k_means(&points, k, k, options.seed))
}

/// The deviation over time of the distance of two moving points.
fn deviation(a: &[Vec3], b: &[Vec3]) -> f64 {
    let n = a.len() as f64;
    let distances = || a.iter().zip(b).map(|(a, b)| (a - b).norm());
    let mean = distances().sum::<f64>() / n;
    (distances().map(|it| (it - mean).powi(2)).sum::<f64>() / n).sqrt()
}

/// The label that most of the nearest samples have; ties go to the nearer ones.
fn voted(rest: &[Vec3], samples: &[u32], labels: &[u32]) -> Vec<u32> {
    let places: Vec<Vec3> = samples.iter().map(|it| rest[*it as usize]).collect();
    let tree = PointTree::new(&places);
    let vote = |place: &Vec3| {
        let mut found = Vec::new();
        tree.nearest(*place, N_VOTERS, &mut found);
        let voters: Vec<u32> = found.iter().map(|it| labels[it.1 as usize]).collect();
        let count = |label: u32| voters.iter().filter(|it| **it == label).count();
        // Of equal elements the last one is the largest, hence backwards.
        voters.iter().rev().copied().max_by_key(|it| count(*it)).expect("there are samples")
    };
    rest.par_iter().map(vote).collect()
}

fn of_regions(moving: &Moving<'_>, regions: &[u32]) -> Result<MovingSkeleton, BaselineError> {
    let n = regions.iter().max().map_or(0, |it| *it as usize + 1);
    let rest = means(moving.rest, regions, n);
    // The centroid and the mean displacement: the mean in every frame.
    let paths: Vec<Vec<Vec3>> = moving.frames.iter().map(|it| means(it, regions, n)).collect();
    let edges = spanning_tree(n, tree::largest_gaps(&moving.frames, regions, n));
    let centre = moving.rest.iter().sum::<Vec3>() / moving.rest.len() as f64;
    let off = |it: &usize| (rest[*it] - centre).norm();
    let root = (0..n).min_by(|a, b| off(a).total_cmp(&off(b))).expect("there are regions");
    let parents = tree::rooted(n, &edges, root);
    let (skeleton, clip, new_of_old) = moving.assembled(&rest, &paths, &parents)?;
    let rows: Vec<Vec<(u32, f64)>> =
        regions.iter().map(|it| vec![(new_of_old[*it as usize], 1.0)]).collect();
    let weights = SkinWeights::from_rows(n, &rows)?;
    let error = moving.rigid_motions(regions)?.rmse;
    Ok(MovingSkeleton { skeleton, clip, weights, error })
}
