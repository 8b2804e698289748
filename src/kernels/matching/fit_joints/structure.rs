//! Which joints a figure has: what the surfaces can do without goes, and what they lack is added.

use super::carry_over::{grown, reordered, without};
use super::choose::Need;
use super::figure::Figure;
use super::fitted::{Fitted, fit, fit_with_skin};
use super::parts::Parts;
use super::recut::recut;
use super::{Fit, FitOptions};
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::matching::find_joints::Joint;

/// Joints and the fit of the parts between them.
pub struct Structure {
    joints: Vec<Joint>,
    pub fitted: Fitted,
}

/// A joint more has to bring so much of the surface to that of the mean pose, if skin counts little.
const PER_JOINT: f64 = 0.004;

/// The same with skin, of which more lies where it should.
const PER_JOINT_WITH_SKIN: f64 = 0.002;

/// With skin, joints that are needed more than this are not tried to be left out.
const MOST_NEED: f64 = 1.5;

/// A joint that is added has to bring so much of what is lost to the surface.
const SPLIT_GAIN: f64 = 0.3;

impl Structure {
    /// Fits stiff parts, from the joints that are given: drops some, cuts anew where joints were found, and adds
    /// others.
    pub fn stiff(figure: &Figure, joints: Vec<Joint>, options: &FitOptions) -> Self {
        let fit = |joints: &[Joint], start| fit(figure, joints, start, options);
        let (mut n_recuts, mut n_splits) = (0, 0);
        // Where joints are or were, which are not tried again.
        let mut taken: Vec<Vec3> = joints.iter().map(|it| it.position / figure.extent).collect();
        // Cuts that were tried to be left out.
        let mut needed: Vec<(usize, f64)> = Vec::new();
        let fitted = fit(&joints, None);
        let mut now = Self { joints, fitted };
        loop {
            figure.describe(&mut now.joints, &now.fitted, options);
            let needs = figure.needs(&now.joints, &now.fitted, options);
            let cut = |it: &Need| (now.joints[it.drop.joint].bone, now.joints[it.drop.joint].share);
            let is_tried = |it: &&Need| it.is_none || it.score < 1.0 && !needed.contains(&cut(it));
            if let Some(need) = needs.iter().find(is_tried) {
                let mut fewer = now.joints.clone();
                fewer.remove(need.drop.joint);
                let tried = fit(&fewer, Some(without(&now.fitted, need.drop)));
                if need.is_none || tried.score(PER_JOINT) <= now.fitted.score(PER_JOINT) {
                    now = Self { joints: fewer, fitted: tried };
                } else {
                    needed.push(cut(need));
                }
                continue;
            }
            if n_recuts < options.n_recuts && !now.joints.is_empty() {
                n_recuts += 1;
                recut(&figure.skeleton, &mut now.joints, &now.fitted.state.joints);
                let moved = Parts::new(&figure.skeleton, &now.joints);
                let start = reordered(&now.fitted.parts, &moved, now.fitted.state);
                now.fitted = fit(&now.joints, Some(start));
                continue;
            }
            if n_splits == options.max_splits {
                break;
            }
            let Some((joint, gain)) = figure.split(&now.fitted, &taken, options) else { break };
            n_splits += 1;
            let place = joint.position / figure.extent;
            taken.push(place);
            let more = [&now.joints[..], &[joint]].concat();
            let parts = Parts::new(&figure.skeleton, &more);
            let start = grown(&now.fitted.parts, &parts, now.fitted.state.clone(), place);
            let tried = fit(&more, Some(start));
            let lost = |it: &Fitted| figure.lost(it, options);
            if lost(&tried) < lost(&now.fitted) - SPLIT_GAIN * gain {
                now = Self { joints: more, fitted: tried };
                // The new joint is only about where the part bends.
                n_recuts = n_recuts.saturating_sub(1);
            }
        }
        now
    }

    /// Fits again with skin, cuts anew where joints are then, and drops those that it can do without.
    pub fn with_skin(self, figure: &Figure, options: &FitOptions) -> Self {
        /// Of one fit, and of one after which a joint is gone.
        const N_ROUNDS: [usize; 2] = [6, 3];
        let fit = |joints: &[Joint], state, n_rounds| {
            fit_with_skin(figure, joints, state, n_rounds, options)
        };
        let Self { mut joints, fitted } = self;
        let fitted = fit(&joints, fitted.state, N_ROUNDS[0]);
        recut(&figure.skeleton, &mut joints, &fitted.state.joints);
        let start = reordered(&fitted.parts, &Parts::new(&figure.skeleton, &joints), fitted.state);
        let fitted = fit(&joints, start, N_ROUNDS[0]);
        let mut now = Self { joints, fitted };
        'dropped: loop {
            figure.describe(&mut now.joints, &now.fitted, options);
            let needs = figure.needs(&now.joints, &now.fitted, options);
            for need in needs.iter().filter(|it| it.is_none || it.score < MOST_NEED) {
                let mut joints = now.joints.clone();
                joints.remove(need.drop.joint);
                let fitted = fit(&joints, without(&now.fitted, need.drop), N_ROUNDS[1]);
                let fewer = Self { joints, fitted };
                if need.is_none || fewer.score() < now.score() {
                    now = fewer;
                    continue 'dropped;
                }
            }
            return now;
        }
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
