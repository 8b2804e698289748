//! A surface laid onto another shape, from matches of their vertices.

mod embedding;
mod gap;
mod pulls;
mod system;
#[cfg(test)]
mod tests;
mod touch;

use super::functional_map::PointMap;
use crate::kernels::geometry::mesh::{MeshError, TriMesh, Vec3};
pub use gap::{Gap, gap};

use embedding::Embedding;
use pulls::{Samples, pulls_by_matches};
use system::System;
use touch::Touch;

/// Options of [`fit_surface`].
#[derive(Debug, Clone, PartialEq)]
pub struct FitSurfaceOptions {
    /// About how many nodes carry the surface.
    pub n_nodes: usize,
    /// How much neighbouring nodes keep to one motion in the last stage, against an equal share of the
    /// surface that is pulled to its place; the first stages are thirty times as stiff.
    pub stiffness: f64,
    /// Rounds of looking for places and moving there, in each of five stages.
    pub rounds: usize,
    /// Vertices of either shape that pull; 0 for all.
    pub samples: usize,
    /// How much a place holds a vertex along the surface, against across it.
    pub sliding: f64,
}

impl Default for FitSurfaceOptions {
    fn default() -> Self {
        Self { n_nodes: 400, stiffness: 0.027, rounds: 2, samples: 3000, sliding: 0.02 }
    }
}

/// Why a surface cannot be laid onto another shape.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FitSurfaceError {
    #[error("{n_matched} vertices are matched, but the source has {n_source}")]
    Matches { n_matched: usize, n_source: usize },
    #[error("the matches belong to a target of {n_matched} vertices, but this one has {n_target}")]
    Target { n_matched: usize, n_target: usize },
    #[error("the source has no area")]
    NoArea,
    #[error("all matched vertices lie in one place")]
    OnePlace,
    #[error("the places do not determine where the surface lies")]
    Undetermined,
    #[error(transparent)]
    Mesh(#[from] MeshError),
}

/// What a stage is like: its stiffness over that of the last one, and beyond how many spacings of nodes
/// places count little.
const STAGES: [(f64, f64); 4] = [(30.0, 3.0), (10.0, 2.0), (3.0, 4.0 / 3.0), (1.0, 1.0)];

/// Lays a surface onto another shape without tearing it, and returns where its vertices lie then.
///
/// The surface follows nodes spread over it, joined along it (Sumner et al. 2007). Neighbouring nodes keep
/// to one similarity, a rotation with a size: for places `y` and edges `ij` with weights `w_ij`,
///
/// `s sum_ij w_ij |y_j - y_i - c_i R_i (g_j - g_i)|^2` (Sorkine & Alexa 2007),
///
/// where `R_i` is the best rotation of a node's edges and `c_i` the best factor over a wider
/// neighbourhood, so that what is small and badly matched (hands) is not crushed.
///
/// In the first stage vertices go to their matches, which count less the farther off they are. In
/// the others every sample of the surface goes to the plane of the nearest target vertex of a like
/// normal, and every sample of the target draws the nearest vertex of the surface, so that the end of
/// a limb is reached; stiffness falls from stage to stage (Amberg et al. 2007).
/// Matches of single vertices may be wrong by far: it is their mean over a limb that counts.
///
/// The target may be a point cloud, or turned inside out: the surface tells the side of normals.
///
/// # Errors
/// See [`FitSurfaceError`].
pub fn fit_surface(
    source: &TriMesh,
    target: &TriMesh,
    matches: &PointMap,
    options: &FitSurfaceOptions,
) -> Result<Vec<Vec3>, FitSurfaceError> {
    check(source, target, matches)?;
    let embedding = Embedding::new(source, options.n_nodes).ok_or(FitSurfaceError::NoArea)?;
    let places = |it: &u32| target.vertices()[*it as usize];
    let matched: Vec<Vec3> = matches.target_of_source.iter().map(places).collect();
    if matched.iter().all(|it| *it == matched[0]) {
        return Err(FitSurfaceError::OnePlace);
    }
    let samples = Samples::of(source, options.samples, embedding.n_nodes());
    let mut system = System::new(&embedding);
    let mut nodes = embedding.means(&matched, &source.vertex_areas());
    let mut step = |nodes: &mut Vec<Vec3>, stiffness: f64, touch: Option<(&Touch, f64)>| {
        let frames = embedding.frames(nodes);
        let vertices = embedding.deformed(nodes, &frames);
        let pulls = match touch {
            None => pulls_by_matches(&samples, &vertices, &matched),
            Some((touch, reach)) => {
                let normals = source.with_vertices(vertices.clone())?.vertex_normals();
                touch.pulls(&samples, &vertices, &normals, reach, options.sliding)
            }
        };
        let stiffness = options.stiffness * stiffness;
        *nodes = system.solve(&embedding, nodes, &frames, &pulls, stiffness)?;
        Ok::<(), FitSurfaceError>(())
    };
    for _ in 0..options.rounds {
        step(&mut nodes, STAGES[0].0, None)?;
    }
    let laid = |nodes: &[Vec3]| embedding.deformed(nodes, &embedding.frames(nodes));
    let n_nodes = embedding.n_nodes();
    let mut touch =
        Touch::new(&source.with_vertices(laid(&nodes))?, target, options.samples, n_nodes);
    for (stage, (stiffness, reach)) in STAGES.into_iter().enumerate() {
        if stage > 0 {
            touch.turn_sides(&source.with_vertices(laid(&nodes))?);
        }
        for _ in 0..options.rounds {
            step(&mut nodes, stiffness, Some((&touch, reach)))?;
        }
    }
    Ok(laid(&nodes))
}

fn check(source: &TriMesh, target: &TriMesh, matches: &PointMap) -> Result<(), FitSurfaceError> {
    source.check_has_faces()?;
    let (n_matched, n_source) = (matches.target_of_source.len(), source.n_vertices());
    if n_matched != n_source {
        return Err(FitSurfaceError::Matches { n_matched, n_source });
    }
    let (n_matched, n_target) = (matches.n_target, target.n_vertices());
    if n_matched != n_target {
        return Err(FitSurfaceError::Target { n_matched, n_target });
    }
    Ok(())
}
