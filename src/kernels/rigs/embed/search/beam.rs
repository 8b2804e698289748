//! What a search does that ran out of steps.

use super::{LIMIT, Matching, Search, State, terms_of_matching};

impl Search<'_> {
    /// Matches joint after joint in the best ways only, so that the end is reached in any case but that
    /// a joint has no place at all.
    ///
    /// If all have a place, but together they cost too much, the dearest joint is lost.
    pub(super) fn beam(&mut self) -> Matching {
        let n_joints = self.problem.reduced.n();
        let mut level: Vec<Partial> = vec![];
        for &ball in &self.candidates[0] {
            if let Some(terms) = self.problem.root_terms(ball) {
                let penalty = terms.iter().sum::<f64>();
                let bound = penalty + self.open_children(0, ball);
                level.push(Partial { bound, penalty, balls: vec![ball] });
            }
        }
        best_only(&mut level);
        for joint in 1..n_joints {
            let mut next = vec![];
            for from in &level {
                self.ways(from, &mut next);
            }
            best_only(&mut next);
            if next.is_empty() {
                let best = level.swap_remove(0);
                return Matching { balls: best.balls, penalty: best.penalty, lost: Some(joint) };
            }
            level = next;
        }
        let best = level.swap_remove(0);
        let lost = (best.penalty >= LIMIT).then(|| self.dearest(&best.balls));
        Matching { balls: best.balls, penalty: best.penalty, lost }
    }

    /// All ways to match the next joint, whatever they cost.
    fn ways(&mut self, from: &Partial, to: &mut Vec<Partial>) {
        let joint = from.balls.len();
        let reduced = self.problem.reduced;
        let state = State::of(self.problem, from.balls.clone());
        let parent = reduced.parents[joint].expect("only the first joint is a root");
        let others = self.others(joint, &state.balls);
        for &(cost, ball) in self.costs(joint, state.balls[parent]).iter() {
            let ball = ball as usize;
            let Some(context) = self.problem.context_terms(&state.matched(), joint, ball) else {
                continue;
            };
            let penalty = from.penalty + cost + context.iter().sum::<f64>();
            let bound = penalty + others + self.open_children(joint, ball);
            let mut balls = from.balls.clone();
            balls.push(ball);
            to.push(Partial { bound, penalty, balls });
        }
    }

    /// The joint of a matching that costs most; of equal ones the first. The root stays.
    fn dearest(&self, balls: &[usize]) -> usize {
        let costs: Vec<f64> = (terms_of_matching(self.problem, balls).iter())
            .map(|it| it.iter().sum::<f64>())
            .collect();
        let dearest = (1..balls.len()).min_by(|&a, &b| costs[b].total_cmp(&costs[a]));
        dearest.expect("a root alone never costs as much as the limit")
    }
}

/// So many of the best matchings are extended by every joint once the search gave up.
const BEAM: usize = 100;

/// A partial matching of the search that goes on when the first one gives up.
struct Partial {
    bound: f64,
    penalty: f64,
    balls: Vec<usize>,
}

/// Keeps the best, and sorts them; of equal ones those with smaller balls come first.
fn best_only(level: &mut Vec<Partial>) {
    level.sort_by(|a, b| a.bound.total_cmp(&b.bound).then_with(|| a.balls.cmp(&b.balls)));
    level.truncate(BEAM);
}
