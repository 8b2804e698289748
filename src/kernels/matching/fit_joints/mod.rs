//! The joints of a figure from its surface in several poses.

mod carry_over;
mod choose;
mod figure;
mod parts;
mod recut;
mod samples;
mod search;
mod seeds;
mod solve;
mod split;
#[cfg(test)]
mod tests;

use nalgebra::Isometry3;

use self::carry_over::{grown, reordered, without};
use self::figure::Figure;
use self::parts::Parts;
use self::recut::recut;
use self::seeds::seeded;
use self::solve::{Point, State};
use super::find_joints::{Joint, JointOptions};
use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::rigs::skeleton::Skeleton;

/// How joints are fitted. Lengths are shares of the skeleton's greatest extent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FitOptions {
    /// About so many points of the surface at rest are looked at.
    pub n_samples: usize,
    /// Skin counts little within this distance along the curve from a joint, where it bends.
    pub ramp: f64,
    /// The surface of a pose is this near where a part lies on it.
    pub reach: f64,
    /// A joint turns by more than this in some pose, in degrees.
    pub min_angle: f64,
    /// Without a joint, more of the smaller part beside it would be off the surface than this share, in some
    /// pose.
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

impl Fit {
    /// The share of the surface that is off that of another pose, in the mean.
    fn lost(&self) -> f64 {
        let others = self.fits.len().saturating_sub(1).max(1);
        self.fits.iter().map(|it| 1.0 - it).sum::<f64>() / others as f64
    }
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
/// If much of the surface is off then, this begins again from joints all along the skeleton, and what brings
/// most of the surface to the other poses with the fewest joints is taken.
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
    let mut best: Option<(f64, Fit)> = None;
    for beginning in &BEGINNINGS {
        let joints = match beginning.spacing {
            Some(spacing) => seeded(skeleton, joints, spacing, figure.extent),
            None => joints.to_vec(),
        };
        if beginning.spacing.is_some() && joints.len() > MOST_SEEDS {
            continue;
        }
        let fit = fit_from(&figure, joints, beginning.finds_lost, options);
        let lost = fit.lost();
        let score = lost + PER_JOINT * fit.joints.len() as f64;
        if best.as_ref().is_none_or(|it| score < it.0) {
            best = Some((score, fit));
        }
        if lost <= ENOUGH {
            break;
        }
    }
    Ok(best.expect("there is a beginning").1)
}

/// How a fit begins.
struct Beginning {
    /// Besides the joints that are given, others so far apart along the curves, in extents. They follow small
    /// parts, of which those that move alike are united.
    spacing: Option<f64>,
    /// Whether parts that are off the surface of a pose are looked for all around their joints: where a curve
    /// was taken for another one, nothing else brings them back, but a limb fits in more than one way.
    finds_lost: bool,
}

/// They are tried in this order.
const BEGINNINGS: [Beginning; 4] = [
    Beginning { spacing: None, finds_lost: false },
    Beginning { spacing: Some(0.1), finds_lost: false },
    Beginning { spacing: Some(0.07), finds_lost: false },
    Beginning { spacing: None, finds_lost: true },
];

/// The equations of a pose have a row and a column for every part: more would take too much time and memory.
const MOST_SEEDS: usize = 150;

/// If so much of the surface is off in the mean pose, no other beginning is tried: skin around joints is
/// always.
const ENOUGH: f64 = 0.045;

/// A joint more has to bring so much of the surface to that of the mean pose.
const PER_JOINT: f64 = 0.0075;

/// Fits joints from where they are, drops and adds some.
fn fit_from(
    figure: &Figure,
    mut joints: Vec<Joint>,
    finds_lost: bool,
    options: &FitOptions,
) -> Fit {
    let fit = |joints: &[Joint], start: Start| figure.fit(joints, start, finds_lost, options);
    let (mut n_recuts, mut n_splits) = (0, 0);
    // Where joints are or were, which are not tried again.
    let mut taken: Vec<Vec3> = joints.iter().map(|it| it.position / figure.extent).collect();
    let mut current = fit(&joints, Start::Curves);
    loop {
        figure.describe(&mut joints, &current, options);
        if let Some(drop) = figure.weakest(&joints, &current, options) {
            joints.remove(drop.joint);
            current = fit(&joints, Start::Merged(without(&current, drop)));
            continue;
        }
        if n_recuts < options.n_recuts && !joints.is_empty() {
            n_recuts += 1;
            recut(&figure.skeleton, &mut joints, &current.state.joints);
            let moved = Parts::new(&figure.skeleton, &joints);
            let start = reordered(&current.parts, &moved, current.state);
            current = fit(&joints, Start::Recut(start));
            continue;
        }
        if n_splits == options.max_splits {
            break;
        }
        let Some((joint, gain)) = figure.split(&current, &taken, options) else { break };
        n_splits += 1;
        let place = joint.position / figure.extent;
        taken.push(place);
        let more = [&joints[..], &[joint]].concat();
        let parts = Parts::new(&figure.skeleton, &more);
        let start = grown(&current.parts, &parts, current.state.clone(), place);
        let tried = fit(&more, Start::Recut(start));
        let lost = |it: &Fitted| figure.lost(it, options);
        if lost(&tried) < lost(&current) - SPLIT_GAIN * gain {
            (joints, current) = (more, tried);
            // The new joint is only about where the part bends.
            n_recuts = n_recuts.saturating_sub(1);
        }
    }
    let Fitted { parts, state, mut fits, .. } = current;
    fits.insert(figure.rest, 1.0);
    let extent = figure.extent;
    for (joint, place) in joints.iter_mut().zip(&state.joints) {
        joint.position = place * extent;
    }
    Fit {
        joints,
        motions: figure.all_motions(&state, parts.n_parts()),
        sides: parts.sides,
        fits,
        rest: figure.rest,
    }
}

/// A joint that is added has to bring so much of what is lost to the surface.
const SPLIT_GAIN: f64 = 0.3;

/// A joint to be dropped, and the part whose motion both parts take.
#[derive(Debug, Clone, Copy)]
struct Drop {
    joint: usize,
    stays: usize,
}

/// What a fit begins with.
enum Start {
    Curves,
    /// Cuts are new, so that parts that were lost may be found.
    Recut(State),
    /// A joint is gone.
    Merged(State),
}

/// Parts between joints, moved onto the surfaces.
struct Fitted {
    parts: Parts,
    state: State,
    points: Vec<Point>,
    /// By pose, without that at rest.
    fits: Vec<f64>,
}
