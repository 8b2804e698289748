//! How well a surface was tracked.

use rayon::prelude::*;

use super::correspond::{Limits, Seen, source_to_target, visible};
use super::silhouette::overlaps;
use super::target::{Pixel, Target};
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::geometry::mesh_sequence::MeshSequence;
use crate::kernels::geometry::point_tree::PointTree;
use crate::kernels::geometry::triangle::closest_on_triangle;
use crate::kernels::sensors::depth::DepthVideo;

/// One frame's errors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameError {
    /// The mean distance of visible vertices along the normals of their nearest target points, in
    /// metres, of those nearer than 0.15 times half the box's diagonal; NaN if there are none.
    pub point_to_plane: f64,
    /// The mean squared difference of inverse depths (1/m^2), nothing counting as 0, over the pixels
    /// where either picture has a depth; NaN if there are none.
    pub inverse_depth: f64,
    /// Intersection over union of silhouettes without pinholes; NaN if both are empty.
    pub iou: f64,
    /// Distances to the true places of the vertices, in metres: mean and greatest; NaN without truth.
    pub mean: f64,
    pub max: f64,
}

/// Why there is no comparison.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ErrorError {
    #[error("the sequence has {sequence} frames, the {what} {other}")]
    Frames { sequence: usize, what: &'static str, other: usize },
    #[error("the {what} has no faces")]
    NoFaces { what: &'static str },
    #[error("frame {frame} is the source, but there are {n_frames} frames")]
    Source { frame: usize, n_frames: usize },
}

/// Compares a tracked surface with the video and, where it is known, with the truth.
///
/// A truth of as many vertices is compared vertex by vertex; to another one the tracked vertices are
/// tied where they are nearest to its surface in frame `source`.
///
/// # Errors
/// See [`ErrorError`].
pub fn registration_errors(
    tracked: &MeshSequence,
    video: &DepthVideo,
    truth: Option<&MeshSequence>,
    source: usize,
) -> Result<Vec<FrameError>, ErrorError> {
    let sequence = tracked.n_frames();
    let counts = [("video", Some(video.n_frames())), ("truth", truth.map(MeshSequence::n_frames))];
    for (what, other) in counts {
        if let Some(other) = other.filter(|it| *it != sequence) {
            return Err(ErrorError::Frames { sequence, what, other });
        }
    }
    if source >= sequence {
        return Err(ErrorError::Source { frame: source, n_frames: sequence });
    }
    if tracked.faces().is_empty() {
        return Err(ErrorError::NoFaces { what: "tracked sequence" });
    }
    let ties = truth.map(|it| tie(tracked, it, source)).transpose()?;
    let compare = |frame: usize| {
        let mut error = seen_errors(tracked, video, frame);
        if let (Some(truth), Some(ties)) = (truth, &ties) {
            (error.mean, error.max) = true_error(tracked.frame(frame), truth, frame, ties);
        }
        error
    };
    Ok((0..sequence).into_par_iter().map(compare).collect())
}

fn seen_errors(tracked: &MeshSequence, video: &DepthVideo, frame: usize) -> FrameError {
    let vertices = tracked.frame(frame);
    let target = Target::new(video, frame, 0.05, 0);
    let seen = Seen::new(&target, vertices, tracked.faces());
    let (low, high) = tracked.mesh(0).expect("a sequence has a frame").bounds();
    let scale = (high - low).norm() / 2.0;
    let limits = Limits { distance: 0.15 * scale, cosine: 0.0, occlusion: 0.02 * scale };
    let places: Vec<(u32, Vec3)> = (0_u32..).zip(vertices.iter().copied()).collect();
    let visible = visible(&target, &seen, &places, &limits);
    let pairs = source_to_target(&target, &seen, &visible, &limits);
    let off = |it: &super::correspond::Pair| {
        (it.point - vertices[it.sample as usize]).dot(&it.normal).abs()
    };
    let point_to_plane = pairs.iter().map(off).sum::<f64>() / pairs.len() as f64;
    let (mut squares, mut either) = (0.0, 0.0);
    for (pixel, own) in seen.buffer.depths.iter().enumerate() {
        let is_measured = target.pixels[pixel] != Pixel::Nothing;
        let inverse = |it: f64| if it > 0.0 { 1.0 / it } else { 0.0 };
        let other = inverse(target.points[pixel].z);
        squares += (inverse(f64::from(*own)) - other).powi(2);
        either += f64::from(u8::from(*own > 0.0 || is_measured));
    }
    let (inverse_depth, (iou, _)) = (squares / either, overlaps(&target, &seen));
    FrameError { point_to_plane, inverse_depth, iou, mean: f64::NAN, max: f64::NAN }
}

/// Where on the true surface a vertex is: three vertices and their shares.
type Tie = ([u32; 3], [f64; 3]);

/// Faces around a vertex that are looked at.
const N_CANDIDATES: usize = 48;

fn tie(
    tracked: &MeshSequence,
    truth: &MeshSequence,
    source: usize,
) -> Result<Vec<Tie>, ErrorError> {
    let n_vertices = tracked.n_vertices();
    if truth.n_vertices() == n_vertices {
        return Ok((0..n_vertices as u32).map(|it| ([it; 3], [1.0, 0.0, 0.0])).collect());
    }
    if truth.faces().is_empty() {
        return Err(ErrorError::NoFaces { what: "truth" });
    }
    let places = truth.frame(source);
    let corners = |face: &[u32; 3]| face.map(|it| places[it as usize]);
    let centres: Vec<Vec3> =
        truth.faces().iter().map(|it| corners(it).iter().sum::<Vec3>() / 3.0).collect();
    let tree = PointTree::new(&centres);
    let tie_one = |point: &Vec3| {
        let mut found = Vec::new();
        tree.nearest(*point, N_CANDIDATES, &mut found);
        let on = found.iter().map(|it| {
            let face = &truth.faces()[it.1 as usize];
            let shares = closest_on_triangle(point, &corners(face));
            let tie = (*face, shares);
            ((place(places, &tie) - point).norm_squared(), tie)
        });
        on.min_by(|a, b| a.0.total_cmp(&b.0)).expect("there are faces").1
    };
    Ok(tracked.frame(source).par_iter().map(tie_one).collect())
}

fn place(vertices: &[Vec3], (face, shares): &Tie) -> Vec3 {
    (0..3).map(|it| vertices[face[it] as usize] * shares[it]).sum()
}

fn true_error(vertices: &[Vec3], truth: &MeshSequence, frame: usize, ties: &[Tie]) -> (f64, f64) {
    let distances = vertices
        .iter()
        .zip(ties)
        .map(|(vertex, tie)| (place(truth.frame(frame), tie) - vertex).norm());
    let (sum, max) =
        distances.fold((0.0, 0.0), |(sum, max): (f64, f64), it| (sum + it, max.max(it)));
    (sum / vertices.len() as f64, max)
}
