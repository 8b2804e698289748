//! The joints of a figure from its surface in several poses.

mod blocks;
mod carry_over;
mod choose;
mod figure;
mod fitted;
mod misfit;
mod parts;
mod recut;
mod samples;
mod search;
mod seeds;
mod skin;
mod solve;
mod split;
mod structure;
#[cfg(test)]
mod tests;

use nalgebra::Isometry3;

use self::figure::Figure;
use self::search::stiff;
use self::seeds::seeded;
use self::structure::Structure;
use super::find_joints::{Joint, JointOptions};
use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::rigs::skeleton::Skeleton;

/// How joints are fitted. Lengths are shares of the skeleton's greatest extent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FitOptions {
    /// About so many points of the surface at rest are looked at.
    pub n_samples: usize,
    /// Skin counts little within this distance along the curve from a joint, while joints are looked for.
    pub ramp: f64,
    /// The surface of a pose is this near where a part lies on it.
    pub reach: f64,
    /// A joint turns by more than this in some pose, in degrees.
    pub min_angle: f64,
    /// Joints are tried to be left out if without them at most this share more of the smaller part beside them
    /// would be off the surface of every pose.
    pub min_gain: f64,
    /// How often joints are cut anew where they were found.
    pub n_recuts: usize,
    /// At most so many joints are added where a part does not move as one.
    pub max_splits: usize,
    /// A degree of freedom has a spread of more than this angle in degrees, and than this share of the
    /// first one's.
    pub freedoms: [f64; 2],
}

impl Default for FitOptions {
    fn default() -> Self {
        let joints = JointOptions::default();
        Self {
            n_samples: 3000,
            ramp: 0.04,
            reach: 0.01,
            min_angle: 20.0,
            min_gain: 0.25,
            n_recuts: 2,
            max_splits: 8,
            freedoms: [joints.min_spread, joints.spread_share],
        }
    }
}

/// Joints that agree with the surfaces, and how well the parts between them do.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// Those that remain, in their order.
    pub joints: Vec<Joint>,
    /// Poses x parts, in the skeleton's unit; the pose at rest is the identity.
    pub motions: Vec<Vec<Isometry3<f64>>>,
    /// For every joint the part before and the one behind it.
    pub sides: Vec<[usize; 2]>,
    /// The share of the surface at rest that lies on the surface of each pose; 1 in its own.
    pub fits: Vec<f64>,
    /// The pose at rest, in which the skeleton is.
    pub rest: usize,
}

/// Why joints cannot be fitted.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FitError {
    #[error("there are {n_surfaces} surfaces, but the skeleton is in {n_poses} poses")]
    Counts { n_surfaces: usize, n_poses: usize },
    #[error("surface {surface} has no faces")]
    NoFaces { surface: usize },
    #[error("pose {pose} has {found} joints, but the skeleton {n_joints}")]
    Joints { pose: usize, found: usize, n_joints: usize },
    #[error("the skeleton is in none of the poses: it is off by {off} in the nearest one, {pose}")]
    NoRest { pose: usize, off: f64 },
    #[error("a skeleton of the extent {extent} cannot be fitted")]
    Extent { extent: f64 },
}

/// Moves joints that were found on curves to where the surface turns about them, and drops those that it
/// does not turn about.
///
/// Joints cut the skeleton, and with it the surface at rest, into stiff parts. All parts are moved onto the
/// surfaces of all poses together with the joints, which are where both parts beside them take them to
/// the same place (articulated ICP: Pekelny & Gotsman 2008; centres of rotation: O'Brien et al. 2000):
/// Gauss-Newton steps of distances along the surface's normals, so that surfaces need no vertices in common.
///
/// Then joints go, one after the other, that the surfaces can do without, cuts move to where joints were
/// found, and a part that lies on a surface only up to a place on its curve is cut there.
///
/// Skin near joints moves with both parts. While joints are looked for, it counts little; in the end every
/// point of it gets the share of both motions with which it lies best on all surfaces (linear blend
/// skinning; Chang & Zwicker 2009), in turn with the motions and the joints, and joints that are not needed
/// then go, too.
///
/// If more than a little of the surface is off then, this begins again from joints all along the skeleton, and what
/// brings most of the surface to the other poses with the fewest joints is taken.
///
/// `surfaces` are one a pose; `skeleton` is in one of the `poses`.
///
/// # Errors
/// See [`FitError`].
pub fn fit_joints(
    skeleton: &Skeleton,
    poses: &[Vec<Vec3>],
    surfaces: &[&TriMesh],
    joints: &[Joint],
    options: &FitOptions,
) -> Result<Fit, FitError> {
    let figure = Figure::new(skeleton, poses, surfaces, options)?;
    let mut best: Option<Structure> = None;
    for spacing in BEGINNINGS {
        let joints = match spacing {
            Some(spacing) => seeded(skeleton, joints, spacing, figure.extent),
            None => joints.to_vec(),
        };
        if spacing.is_some() && joints.len() > MOST_SEEDS {
            continue;
        }
        let found = stiff(&figure, joints, options).with_skin(&figure, options);
        let lost = found.fitted.lost();
        if best.as_ref().is_none_or(|it| found.score() < it.score()) {
            best = Some(found);
        }
        if lost <= ENOUGH {
            break;
        }
    }
    Ok(best.expect("there is a beginning").into_fit(&figure))
}

/// What fits begin with: the joints that are given, or besides others so far apart along the curves, in extents.
/// Those follow small parts, of which the ones that move alike are united.
const BEGINNINGS: [Option<f64>; 4] = [None, Some(0.1), Some(0.07), Some(0.055)];

/// The equations of a pose have a row and a column for every part: more would take too much time and memory.
const MOST_SEEDS: usize = 150;

/// If so much of the surface is off in the mean pose, no other beginning is tried: some skin always is.
const ENOUGH: f64 = 0.0125;

/// A joint to be dropped, and the part whose motion both parts take.
#[derive(Debug, Clone, Copy)]
struct Drop {
    joint: usize,
    stays: usize,
}
