//! The search for joints of stiff parts: what the surfaces can do without goes, and what they lack is added.

use super::FitOptions;
use super::carry_over::grown;
use super::choose::Need;
use super::figure::Figure;
use super::fitted::{Fitted, fit};
use super::parts::Parts;
use super::solve::State;
use super::structure::Structure;
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::matching::find_joints::Joint;

/// A joint more has to bring so much of the surface to that of the mean pose. With skin, of which more lies where it
/// should, it is less.
const PER_JOINT: f64 = 0.004;

/// A joint that is added has to bring so much of what is lost to the surface.
const SPLIT_GAIN: f64 = 0.3;

/// Fits stiff parts, from the joints that are given: drops some, cuts anew where joints were found, and adds
/// others.
pub fn stiff(figure: &Figure, joints: Vec<Joint>, options: &FitOptions) -> Structure {
    let mut search = Search {
        figure,
        options,
        needed: Vec::new(),
        n_recuts: 0,
        taken: joints.iter().map(|it| it.position / figure.extent).collect(),
        n_splits: 0,
        now: Structure { fitted: fit(figure, &joints, None, options), joints },
    };
    while search.drops() || search.cuts_anew() || search.adds() {}
    search.now
}

/// Stiff parts, and what was tried with them.
struct Search<'a> {
    figure: &'a Figure,
    options: &'a FitOptions,
    now: Structure,
    /// Cuts that were tried to be left out.
    needed: Vec<(usize, f64)>,
    n_recuts: usize,
    /// Where joints are or were, which are not tried again.
    taken: Vec<Vec3>,
    n_splits: usize,
}

impl Search<'_> {
    fn fit(&self, joints: &[Joint], start: State) -> Fitted {
        fit(self.figure, joints, Some(start), self.options)
    }

    /// Tries to leave out a joint; returns whether there was one to be tried.
    fn drops(&mut self) -> bool {
        let Structure { joints, fitted } = &mut self.now;
        self.figure.describe(joints, fitted, self.options);
        let needs = self.figure.needs(joints, fitted, self.options);
        let cut = |it: &Need| (joints[it.drop.joint].bone, joints[it.drop.joint].share);
        let is_tried = |it: &&Need| it.is_none || it.score < 1.0 && !self.needed.contains(&cut(it));
        let Some(&need) = needs.iter().find(is_tried) else { return false };
        let cut = cut(&need);
        let fewer = self.now.without(need.drop, |joints, start| self.fit(joints, start));
        if need.is_none || fewer.fitted.score(PER_JOINT) <= self.now.fitted.score(PER_JOINT) {
            self.now = fewer;
        } else {
            self.needed.push(cut);
        }
        true
    }

    /// Moves cuts to where joints were found, some times; returns whether it did.
    fn cuts_anew(&mut self) -> bool {
        if self.n_recuts == self.options.n_recuts || self.now.joints.is_empty() {
            return false;
        }
        self.n_recuts += 1;
        let start = self.now.recut(self.figure);
        self.now.fitted = self.fit(&self.now.joints, start);
        true
    }

    /// Tries a joint where a part does not move as one; returns whether there was one to be tried.
    fn adds(&mut self) -> bool {
        if self.n_splits == self.options.max_splits {
            return false;
        }
        let (figure, options, now) = (self.figure, self.options, &self.now);
        let Some((joint, gain)) = figure.split(&now.fitted, &self.taken, options) else {
            return false;
        };
        let place = joint.position / figure.extent;
        let more = [&now.joints[..], &[joint]].concat();
        let parts = Parts::new(&figure.skeleton, &more);
        let start = grown(&now.fitted.parts, &parts, now.fitted.state.clone(), place);
        let tried = self.fit(&more, start);
        let lost = |it: &Fitted| figure.lost(it, options);
        if lost(&tried) < lost(&now.fitted) - SPLIT_GAIN * gain {
            self.now = Structure { joints: more, fitted: tried };
            // The new joint is only about where the part bends.
            self.n_recuts = self.n_recuts.saturating_sub(1);
        }
        self.n_splits += 1;
        self.taken.push(place);
        true
    }
}
