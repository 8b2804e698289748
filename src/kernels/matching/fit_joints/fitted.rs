//! Parts between given joints, moved onto the surfaces of all poses.

use super::FitOptions;
use super::blocks::Point;
use super::figure::Figure;
use super::parts::{Parts, curve_pairs, motions_of_curves};
use super::samples::{Sample, labels};
use super::skin::blend_skin;
use super::solve::{Pose, Problem, State, Weights, step};
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::matching::find_joints::Joint;

/// Parts between joints, moved onto the surfaces.
pub struct Fitted {
    pub parts: Parts,
    pub state: State,
    pub points: Vec<Point>,
    /// By pose, without that at rest.
    pub fits: Vec<f64>,
}

impl Fitted {
    /// The share of the surface that is off that of a pose, in the mean.
    pub fn lost(&self) -> f64 {
        let off: f64 = self.fits.iter().map(|it| 1.0 - it).sum();
        off / self.fits.len().max(1) as f64
    }

    /// How bad it is if each joint costs this much.
    pub fn score(&self, per_joint: f64) -> f64 {
        self.lost() + per_joint * self.parts.sides.len() as f64
    }
}

/// What stays the same in a fit.
pub struct Setting<'a> {
    pub figure: &'a Figure,
    pub parts: &'a Parts,
    /// On the curves.
    pub cuts: Vec<Vec3>,
    pub poses: Vec<Pose<'a>>,
    pub options: &'a FitOptions,
}

/// Joints and priors are weak while parts are stiff: what holds parts together by force also holds them off
/// their places, and a prior on the curve is felt where parts turn little.
const STIFF: Weights = Weights {
    slide: 0.05,
    curve: 1e-3,
    joint: 0.02,
    prior: 1e-4,
    free: 0.0,
    held: 1.0,
    reach: 0.0,
};

/// With skin, surfaces tell more than curves, and parts fit where they are joined. Joints are held to curves only
/// along axes that all turns share.
const SKIN: Weights = Weights { curve: 1e-4, joint: 0.1, prior: 2e-5, free: 1e-3, ..STIFF };

/// Moves stiff parts onto the surfaces, from where curves are or from a state that is near the end. Skin near
/// joints counts little.
pub fn fit(
    figure: &Figure,
    joints: &[Joint],
    start: Option<State>,
    options: &FitOptions,
) -> Fitted {
    let parts = Parts::new(&figure.skeleton, joints);
    let curves = curves(figure, &parts);
    let setting = Setting::new(figure, &parts, joints, &curves, options);
    let points = points(figure, &parts, &setting.cuts, options);
    let is_first = start.is_none();
    let mut state = start.unwrap_or_else(|| State {
        motions: curves.iter().map(|it| motions_of_curves(&parts, it)).collect(),
        joints: setting.cuts.clone(),
    });
    let mut is_held = vec![false; joints.len()];
    let mut fits = setting.descend(&mut state, &points, &is_held, is_first);
    if setting.hold_outer(&mut state, &mut is_held) {
        fits = setting.descend(&mut state, &points, &is_held, false);
    }
    Fitted { parts, state, points, fits }
}

/// The same from a state that is near the end, with skin that moves with both sides of its joint.
pub fn fit_with_skin(
    figure: &Figure,
    joints: &[Joint],
    mut state: State,
    n_rounds: usize,
    options: &FitOptions,
) -> Fitted {
    const N_STEPS: usize = 6;
    let parts = Parts::new(&figure.skeleton, joints);
    let curves = curves(figure, &parts);
    let setting = Setting::new(figure, &parts, joints, &curves, options);
    let mut points = points(figure, &parts, &setting.cuts, options);
    let mut is_held = vec![false; joints.len()];
    let mut fits = Vec::new();
    let weights = Weights { reach: options.reach, ..SKIN };
    for _ in 0..n_rounds {
        blend_skin(&mut points, &setting, &state);
        for _ in 0..N_STEPS {
            fits = setting.step(&mut state, &points, &is_held, &weights);
        }
        setting.hold_outer(&mut state, &mut is_held);
    }
    Fitted { parts, state, points, fits }
}

/// Pairs of places on the curves by pose and part.
fn curves(figure: &Figure, parts: &Parts) -> Vec<Vec<Vec<(Vec3, Vec3)>>> {
    const STEP: f64 = 0.01;
    figure.poses.iter().map(|it| curve_pairs(&figure.skeleton, parts, it, STEP)).collect()
}

fn points(figure: &Figure, parts: &Parts, cuts: &[Vec3], options: &FitOptions) -> Vec<Point> {
    let labels = labels(&figure.samples, &figure.skeleton, parts, cuts, options.ramp);
    let point = |(it, &(part, weight)): (&Sample, &(usize, f64))| Point {
        place: it.point,
        normal: it.normal,
        part,
        weight,
        skin: None,
    };
    figure.samples.iter().zip(&labels).map(point).collect()
}

impl<'a> Setting<'a> {
    fn new(
        figure: &'a Figure,
        parts: &'a Parts,
        joints: &[Joint],
        curves: &'a [Vec<Vec<(Vec3, Vec3)>>],
        options: &'a FitOptions,
    ) -> Self {
        let cuts = joints.iter().map(|it| it.on_curve(&figure.skeleton)).collect();
        Self { figure, parts, cuts, poses: figure.poses(curves), options }
    }

    fn step(
        &self,
        state: &mut State,
        points: &[Point],
        is_held: &[bool],
        weights: &Weights,
    ) -> Vec<f64> {
        let (poses, sides, cuts) = (&self.poses, &self.parts.sides, &self.cuts);
        step(state, &Problem { points, poses, sides, cuts, is_held }, weights)
    }

    /// Steps from a wide reach to that of a fit; fewer of them, from a narrower one, where much is known. Returns what
    /// `step` does.
    fn descend(
        &self,
        state: &mut State,
        points: &[Point],
        is_held: &[bool],
        is_first: bool,
    ) -> Vec<f64> {
        const DECAY: f64 = 0.9;
        let (wide, n_steps) = if is_first { (8.0, 40) } else { (2.0, 12) };
        let mut fits = Vec::new();
        for round in 0..n_steps {
            let reach = self.options.reach * f64::max(wide * DECAY.powi(round), 1.0);
            fits = self.step(state, points, is_held, &Weights { reach, ..STIFF });
        }
        fits
    }

    /// Brings joints that are outside of the body at rest back to where they began, to be held there: the parts
    /// beside them do not say where they meet. Returns whether there are any.
    fn hold_outer(&self, state: &mut State, is_held: &mut [bool]) -> bool {
        /// Joints may be outside by this share of the extent, which is that of thin limbs.
        const OUTSIDE: f64 = 0.005;
        let body = &self.figure.body;
        for ((place, cut), is_held) in state.joints.iter_mut().zip(&self.cuts).zip(&mut *is_held) {
            if body.distance(*place) > OUTSIDE {
                (*place, *is_held) = (*cut, true);
            }
        }
        is_held.contains(&true)
    }
}
