//! Joints with the fit of the parts between them, and which of them a figure has with skin.

use super::carry_over::{reordered, without};
use super::figure::Figure;
use super::fitted::{Fitted, fit_with_skin};
use super::parts::Parts;
use super::recut::recut;
use super::solve::State;
use super::{Drop, Fit, FitOptions};
use crate::kernels::matching::find_joints::Joint;

/// Joints and the fit of the parts between them.
pub struct Structure {
    pub joints: Vec<Joint>,
    pub fitted: Fitted,
}

/// A joint more has to bring so much of the surface to that of the mean pose.
const PER_JOINT_WITH_SKIN: f64 = 0.002;

/// With skin, joints that are needed more than this are not tried to be left out.
const MOST_NEED: f64 = 1.5;

impl Structure {
    /// Fits again with skin, cuts anew where joints are then, and drops those that it can do without.
    pub fn with_skin(self, figure: &Figure, options: &FitOptions) -> Self {
        /// Of one fit, and of one after which a joint is gone.
        const N_ROUNDS: [usize; 2] = [6, 3];
        let fit = |joints: &[Joint], state, n_rounds| {
            fit_with_skin(figure, joints, state, n_rounds, options)
        };
        let Self { joints, fitted } = self;
        let fitted = fit(&joints, fitted.state, N_ROUNDS[0]);
        let mut now = Self { joints, fitted };
        let start = now.recut(figure);
        now.fitted = fit(&now.joints, start, N_ROUNDS[0]);
        'dropped: loop {
            figure.describe(&mut now.joints, &now.fitted, options);
            let needs = figure.needs(&now.joints, &now.fitted, options);
            for need in needs.iter().filter(|it| it.is_none || it.score < MOST_NEED) {
                let fewer = now.without(need.drop, |it, state| fit(it, state, N_ROUNDS[1]));
                if need.is_none || fewer.score() < now.score() {
                    now = fewer;
                    continue 'dropped;
                }
            }
            return now;
        }
    }

    /// What is left without a joint, fitted from where parts are.
    pub fn without(&self, drop: Drop, fit: impl Fn(&[Joint], State) -> Fitted) -> Self {
        let mut joints = self.joints.clone();
        joints.remove(drop.joint);
        let fitted = fit(&joints, without(&self.fitted, drop));
        Self { joints, fitted }
    }

    /// Moves cuts to where joints were found, and tells what a fit of the parts between them begins with.
    pub fn recut(&mut self, figure: &Figure) -> State {
        recut(&figure.skeleton, &mut self.joints, &self.fitted.state.joints);
        let moved = Parts::new(&figure.skeleton, &self.joints);
        reordered(&self.fitted.parts, &moved, self.fitted.state.clone())
    }

    /// How bad joints with skin are.
    pub fn score(&self) -> f64 {
        self.fitted.score(PER_JOINT_WITH_SKIN)
    }

    pub fn into_fit(self, figure: &Figure) -> Fit {
        let Self { mut joints, fitted: Fitted { parts, state, mut fits, .. } } = self;
        fits.insert(figure.rest, 1.0);
        for (joint, place) in joints.iter_mut().zip(&state.joints) {
            joint.position = place * figure.extent;
        }
        Fit {
            joints,
            motions: figure.all_motions(&state, parts.n_parts()),
            sides: parts.sides,
            fits,
            rest: figure.rest,
        }
    }
}
