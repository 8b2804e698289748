//! Vertices that move alike: where bones begin.

use super::motions::Motions;
use super::{Moving, weights::single_errors};

/// Rounds of fitting bones to their vertices and vertices to their bones after every split.
const ROUNDS: usize = 5;
/// A cluster is split if both parts can have so many vertices.
const LEAST: usize = 4;
/// Clusters whose vertices are off by this, in sizes of the mesh, move rigidly.
const RIGID: f64 = 1e-6;

/// Labels every vertex with one of at most `n_bones` clusters, none of them empty.
///
/// Starts with one cluster and splits those with the largest errors, up to all of them at a time
/// (Linde, Buzo & Gray 1980): the vertex with the largest product of error and distance from the middle
/// takes the vertices that are nearer to it than to the middle. Then every vertex goes to the bone
/// that moves it best.
pub fn clusters(moving: &Moving, n_bones: usize) -> Vec<u32> {
    let mut labels = vec![0u32; moving.n_vertices()];
    let mut n_clusters = 1;
    // Splits may fail, because what splits off moves like another bone.
    let mut n_failures = 0;
    while n_clusters < n_bones && n_failures < 3 {
        let mut motions = Motions::identity(moving, n_clusters);
        motions.fit_rigid(moving, &labels);
        let errors = own_errors(moving, &motions, &labels);
        let n_split = split(moving, &errors, &mut labels, n_clusters, n_bones);
        if n_split == 0 {
            break;
        }
        settle(moving, &mut labels, n_clusters + n_split);
        let before = n_clusters;
        n_clusters = without_small(moving, &mut labels, n_clusters + n_split);
        n_failures = if n_clusters > before { 0 } else { n_failures + 1 };
    }
    labels
}

fn own_errors(moving: &Moving, motions: &Motions, labels: &[u32]) -> Vec<f64> {
    let all = single_errors(moving, motions);
    all.iter().zip(labels).map(|(errors, &label)| errors[label as usize].max(0.0)).collect()
}

/// Splits the clusters with the largest errors; returns how many.
fn split(
    moving: &Moving,
    errors: &[f64],
    labels: &mut [u32],
    n_clusters: usize,
    n_bones: usize,
) -> usize {
    let mut members = vec![Vec::new(); n_clusters];
    for (vertex, &label) in labels.iter().enumerate() {
        members[label as usize].push(vertex);
    }
    let total = |cluster: usize| members[cluster].iter().map(|&it| errors[it]).sum::<f64>();
    let totals: Vec<f64> = (0..n_clusters).map(total).collect();
    let rigid = RIGID * RIGID * moving.n_frames() as f64;
    let mut order: Vec<usize> = (0..n_clusters)
        .filter(|&it| {
            members[it].len() >= 2 * LEAST && totals[it] > rigid * members[it].len() as f64
        })
        .collect();
    order.sort_by(|&a, &b| totals[b].total_cmp(&totals[a]).then(a.cmp(&b)));
    order.truncate(n_bones - n_clusters);
    for (index, &cluster) in order.iter().enumerate() {
        let place = |vertex: usize| nalgebra::Vector4::from(moving.rest[vertex]);
        let own = &members[cluster];
        let middle = own.iter().map(|&it| place(it)).sum::<nalgebra::Vector4<f64>>();
        let middle = middle / own.len() as f64;
        let pull = |it: usize| errors[it].sqrt() * (place(it) - middle).norm();
        let seed = own.iter().copied().max_by(|&a, &b| pull(a).total_cmp(&pull(b)).then(b.cmp(&a)));
        let seed = place(seed.expect("the cluster has vertices"));
        for &vertex in own {
            let at = place(vertex);
            if (at - seed).norm_squared() < (at - middle).norm_squared() {
                labels[vertex] = (n_clusters + index) as u32;
            }
        }
    }
    order.len()
}

/// Lets vertices go to the bones that move them best.
fn settle(moving: &Moving, labels: &mut [u32], n_clusters: usize) {
    let mut motions = Motions::identity(moving, n_clusters);
    for _ in 0..ROUNDS {
        motions.fit_rigid(moving, labels);
        let mut has_changed = false;
        for (vertex, errors) in single_errors(moving, &motions).iter().enumerate() {
            let own = labels[vertex] as usize;
            let best = (0..n_clusters).min_by(|&a, &b| errors[a].total_cmp(&errors[b]));
            let best = best.expect("there is a cluster");
            // A vertex at which bones agree stays.
            if errors[best] < errors[own] * (1.0 - 1e-9) - 1e-15 {
                labels[vertex] = best as u32;
                has_changed = true;
            }
        }
        if !has_changed {
            return;
        }
    }
}

/// Gives the vertices of clusters that are too small to the best others, and numbers the rest anew.
/// Returns how many there are.
fn without_small(moving: &Moving, labels: &mut [u32], n_clusters: usize) -> usize {
    let mut sizes = vec![0usize; n_clusters];
    for &label in labels.iter() {
        sizes[label as usize] += 1;
    }
    // At least the largest stays.
    let least = LEAST.min(sizes.iter().copied().max().unwrap_or(0));
    let kept: Vec<usize> = (0..n_clusters).filter(|&it| sizes[it] >= least).collect();
    let mut motions = Motions::identity(moving, n_clusters);
    motions.fit_rigid(moving, labels);
    let errors = single_errors(moving, &motions);
    for (vertex, label) in labels.iter_mut().enumerate() {
        let own = kept.binary_search(&(*label as usize)).ok();
        let best = || {
            let error = |it: usize| errors[vertex][kept[it]];
            (0..kept.len()).min_by(|&a, &b| error(a).total_cmp(&error(b)))
        };
        *label = own.or_else(best).expect("one cluster is large enough") as u32;
    }
    kept.len()
}
