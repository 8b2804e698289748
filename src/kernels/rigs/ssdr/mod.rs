//! Smooth skinning decomposition with rigid bones: skin weights and bone motions of a moving mesh.
//!
//! Positions are kept as a `3T x V` matrix (a column a vertex), bone motions as a `3T x 4B` matrix (a
//! `3 x 4` block a frame and bone), so that what vertices and bones have in common are matrix products.

mod additions;
mod clusters;
mod descent;
mod motions;
mod moving;
mod sample;
mod search;
mod simplex;
mod smoothing;
mod weights;

use nalgebra::{Isometry3, Translation3, UnitQuaternion};

use super::weights::SkinWeights;
use crate::kernels::geometry::mesh::Vec3;

use descent::Descent;
use motions::Motions;
use moving::Moving;
use smoothing::{Smoothing, edges_of};
use weights::Row;

/// What is decomposed how.
#[derive(Debug, Clone, PartialEq)]
pub struct SsdrOptions {
    pub n_bones: usize,
    /// At most this many bones move a vertex.
    pub max_influences: usize,
    pub max_iterations: usize,
    /// Stop when the error falls by less than this share of itself…
    pub tolerance: f64,
    /// … so many times in a row.
    pub patience: usize,
    /// Rounds over all bones between two updates of weights.
    pub motion_sweeps: usize,
    /// Updates of weights between two updates of motions.
    pub weight_sweeps: usize,
    /// How strongly bones hold to the vertices that are mostly theirs.
    pub affinity: f64,
    /// How strongly weights are pulled towards those of neighbours that move alike.
    pub smoothness: f64,
}

impl Default for SsdrOptions {
    fn default() -> Self {
        Self {
            n_bones: 20,
            max_influences: 4,
            max_iterations: 100,
            tolerance: 1e-2,
            patience: 3,
            motion_sweeps: 5,
            weight_sweeps: 3,
            affinity: 0.0,
            smoothness: 1e-4,
        }
    }
}

/// Bones that move a mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Ssdr {
    /// `V x B`.
    pub weights: SkinWeights,
    /// `T * B` motions from the rest pose, frame by frame.
    pub motions: Vec<Isometry3<f64>>,
    /// The bones' centres in the rest pose: means of the vertices by weight.
    pub centers: Vec<Vec3>,
    /// The label (of those given, or the number of the bone found) that every bone began with, ascending: a
    /// bone that ends up moving nothing is not there.
    pub label_of_bone: Vec<u32>,
    /// The root of the mean squared distance over all frames and vertices, in mesh units.
    pub rmse: f64,
    /// This error after every iteration.
    pub history: Vec<f64>,
}

/// Why a motion cannot be decomposed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SsdrError {
    #[error("frame {frame} has {n_points} points, but the rest pose has {n_vertices}")]
    Count { frame: usize, n_points: usize, n_vertices: usize },
    #[error("there are {n_vertices} vertices and {n_frames} frames, but one of each is needed")]
    Nothing { n_vertices: usize, n_frames: usize },
    #[error("vertex {vertex} has the coordinate {value} in frame {frame}")]
    NotFinite { frame: usize, vertex: usize, value: f64 },
    #[error("the option `{name}` is {value}, but must be {wanted}")]
    Option { name: &'static str, value: f64, wanted: &'static str },
    #[error("the coordinates are too large or too small for double precision")]
    Range,
    #[error("{n_labels} labels were given for {n_vertices} vertices")]
    Labels { n_labels: usize, n_vertices: usize },
    #[error("face {face} refers to vertex {vertex}, but there are {n_vertices} vertices")]
    OutOfRange { face: usize, vertex: u32, n_vertices: usize },
}

/// Decomposes a moving mesh into rigid bones and sparse weights (Le & Deng 2012).
///
/// Minimizes `sum_t sum_i |v_i^t - sum_j w_ij (R_j^t u_i + T_j^t)|^2` over rotations, translations
/// and weights that are not negative and sum to one: bones are fitted one after the other, in closed
/// form, then the weights of every vertex. Without `labels` (a bone a vertex) it starts from bones that
/// were found on few of the vertices: clusters that move alike, of which those that do little are
/// moved to where the error is largest. `faces` only say which vertices are neighbours.
///
/// # Errors
/// See [`SsdrError`].
pub fn ssdr(
    rest: &[Vec3],
    faces: &[[u32; 3]],
    frames: &[&[Vec3]],
    labels: Option<&[u32]>,
    options: &SsdrOptions,
) -> Result<Ssdr, SsdrError> {
    check(rest, faces, frames, labels, options)?;
    let moving = Moving::new(rest, frames);
    if !(moving.scale > 0.0 && moving.squares.iter().all(|it| it.is_finite())) {
        return Err(SsdrError::Range);
    }
    let edges = edges_of(rest, faces);
    let (start, known) = match labels {
        Some(labels) => {
            let (labels, known) = compact(labels);
            (from_labels(&moving, &labels), known)
        }
        None => {
            let start = search::search(&moving, &edges, options);
            let known = (0..start.0.n_bones() as u32).collect();
            (start, known)
        }
    };
    let ((motions, rows), history) = match options.max_iterations {
        0 => (start, Vec::new()),
        _ => descended(&moving, &Smoothing::new(&moving, &edges), start, options),
    };
    Ok(finish(rest, frames, &moving, (rows, &motions, &known), history))
}

/// A bone for every label.
fn from_labels(moving: &Moving, labels: &[u32]) -> (Motions, Vec<Row>) {
    let n_bones = labels.iter().max().map_or(1, |it| *it as usize + 1);
    let mut motions = Motions::identity(moving, n_bones);
    motions.fit_rigid(moving, labels);
    (motions, labels.iter().map(|&it| vec![(it, 1.0)]).collect())
}

/// The best motions and weights of a descent, and the error after every step.
fn descended(
    moving: &Moving,
    smoothing: &Smoothing,
    (motions, rows): (Motions, Vec<Row>),
    options: &SsdrOptions,
) -> ((Motions, Vec<Row>), Vec<f64>) {
    let mut descent = Descent::new(moving, smoothing, options, motions, rows);
    let mut history: Vec<f64> = Vec::new();
    let mut best: Option<(f64, Motions, Vec<Row>)> = None;
    let mut n_idle = 0;
    for _ in 0..options.max_iterations {
        descent.step();
        let error = descent.rmse();
        history.push(error / moving.scale);
        let before = best.as_ref().map_or(f64::INFINITY, |it| it.0);
        if error < before {
            best = Some((error, descent.motions.clone(), descent.rows.clone()));
        }
        // Infinite before the first iteration: no gain is idle then.
        n_idle = if before - error < options.tolerance * before { n_idle + 1 } else { 0 };
        if n_idle >= options.patience || error == 0.0 {
            break;
        }
    }
    let best = best.map(|(_, motions, rows)| (motions, rows));
    (best.unwrap_or((descent.motions, descent.rows)), history)
}

fn check(
    rest: &[Vec3],
    faces: &[[u32; 3]],
    frames: &[&[Vec3]],
    labels: Option<&[u32]>,
    options: &SsdrOptions,
) -> Result<(), SsdrError> {
    let n_vertices = rest.len();
    if n_vertices == 0 || frames.is_empty() {
        return Err(SsdrError::Nothing { n_vertices, n_frames: frames.len() });
    }
    for (frame, points) in std::iter::once(&rest).chain(frames).enumerate() {
        // The rest pose comes first and is no frame.
        let frame = frame.saturating_sub(1);
        if points.len() != n_vertices {
            return Err(SsdrError::Count { frame, n_points: points.len(), n_vertices });
        }
        for (vertex, point) in points.iter().enumerate() {
            if let Some(&value) = point.iter().find(|it| !it.is_finite()) {
                return Err(SsdrError::NotFinite { frame, vertex, value });
            }
        }
    }
    for (face, corners) in faces.iter().enumerate() {
        if let Some(&vertex) = corners.iter().find(|&&it| it as usize >= n_vertices) {
            return Err(SsdrError::OutOfRange { face, vertex, n_vertices });
        }
    }
    if let Some(labels) = labels.filter(|it| it.len() != n_vertices) {
        return Err(SsdrError::Labels { n_labels: labels.len(), n_vertices });
    }
    let counts = [
        ("n_bones", options.n_bones),
        ("max_influences", options.max_influences),
        ("motion_sweeps", options.motion_sweeps),
        ("weight_sweeps", options.weight_sweeps),
    ];
    if let Some((name, _)) = counts.iter().find(|it| it.1 == 0) {
        return Err(SsdrError::Option { name, value: 0.0, wanted: "at least 1" });
    }
    for (name, value) in [
        ("affinity", options.affinity),
        ("smoothness", options.smoothness),
        ("tolerance", options.tolerance),
    ] {
        if !(value >= 0.0 && value.is_finite()) {
            return Err(SsdrError::Option { name, value, wanted: "a number from 0" });
        }
    }
    Ok(())
}

/// Numbers labels from zero, without gaps, in their order; and which labels there are.
fn compact(labels: &[u32]) -> (Vec<u32>, Vec<u32>) {
    let mut known = labels.to_vec();
    known.sort_unstable();
    known.dedup();
    let number = |it: &u32| known.binary_search(it).expect("every label is known") as u32;
    (labels.iter().map(number).collect(), known)
}

/// Drops bones that move nothing, and goes back to the frame of the mesh.
fn finish(
    rest: &[Vec3],
    frames: &[&[Vec3]],
    moving: &Moving,
    (rows, motions, labels): (Vec<Row>, &Motions, &[u32]),
    history: Vec<f64>,
) -> Ssdr {
    let mut totals = vec![0.0; motions.n_bones()];
    let mut sums = vec![Vec3::zeros(); motions.n_bones()];
    for (row, place) in rows.iter().zip(rest) {
        for &(bone, weight) in row {
            totals[bone as usize] += weight;
            sums[bone as usize] += place * weight;
        }
    }
    let kept: Vec<usize> = (0..totals.len()).filter(|&it| totals[it] > 0.0).collect();
    let new_of_old = |bone: u32| kept.binary_search(&(bone as usize)).expect("it moves something");
    let rows: Vec<Vec<(u32, f64)>> = rows
        .iter()
        .map(|row| row.iter().map(|&(bone, weight)| (new_of_old(bone) as u32, weight)).collect())
        .collect();
    let weights =
        SkinWeights::from_rows(kept.len(), &rows).expect("weights of a vertex sum to one");
    let mut all = Vec::with_capacity(frames.len() * kept.len());
    for frame in 0..frames.len() {
        for &bone in &kept {
            let (rotation, offset) = motions.get(frame, bone);
            let rotation = UnitQuaternion::from_rotation_matrix(
                &nalgebra::Rotation3::from_matrix_unchecked(rotation),
            );
            let back = Translation3::from(moving.centers[frame] + offset / moving.scale);
            let there = Translation3::from(-moving.rest_center);
            all.push(back * rotation * there);
        }
    }
    let centers = kept.iter().map(|&it| sums[it] / totals[it]).collect();
    let rmse = rmse(rest, frames, &weights, &all);
    let label_of_bone = kept.iter().map(|&it| labels[it]).collect();
    Ssdr { weights, motions: all, centers, label_of_bone, rmse, history }
}

/// The root of the mean squared distance between skinned and given positions.
///
/// # Panics
/// If there are not as many motions as bones and frames want.
pub fn rmse(
    rest: &[Vec3],
    frames: &[&[Vec3]],
    weights: &SkinWeights,
    motions: &[Isometry3<f64>],
) -> f64 {
    let n_bones = weights.n_joints();
    assert_eq!(motions.len(), n_bones * frames.len(), "a motion for every bone and frame");
    let mut sum = 0.0;
    for (frame, points) in frames.iter().enumerate() {
        let motions = &motions[frame * n_bones..(frame + 1) * n_bones];
        for (vertex, point) in points.iter().enumerate() {
            let place = nalgebra::Point3::from(rest[vertex]);
            let moved =
                |(bone, weight): (u32, f64)| (motions[bone as usize] * place).coords * weight;
            let skinned: Vec3 = weights.row(vertex).map(moved).sum();
            sum += (skinned - point).norm_squared();
        }
    }
    (sum / (rest.len() * frames.len()) as f64).sqrt()
}

#[cfg(test)]
mod tests;
