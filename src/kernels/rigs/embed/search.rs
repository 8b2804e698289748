//! The best matching of joints and balls.

mod beam;

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use super::penalties::{Matched, Problem, Terms};

/// How long to search.
#[derive(Debug, Clone, Copy)]
pub struct SearchOptions {
    /// When more matchings wait than this, the better half is kept.
    pub max_queue: usize,
    /// After so many partial matchings the search goes on with the best only.
    pub max_steps: usize,
}

/// What a search found.
#[derive(Debug, Clone, PartialEq)]
pub struct Matching {
    /// The balls of the first joints; all joints if the search succeeded.
    pub balls: Vec<usize>,
    pub penalty: f64,
    /// The joint that found no place.
    pub lost: Option<usize>,
}

/// Total penalties from here on are no match.
const LIMIT: f64 = 1.0;

/// What a joint that is given up counts when the least loss is looked for.
const LOSS: f64 = 0.5;

/// Matches joints in their order, best first (A*).
///
/// A partial matching waits with its penalty plus, for every open joint whose parent is matched, the
/// least that this joint and all below it can cost there. So the first complete matching that is taken
/// is the best.
/// If there is none within `max_steps`, and joints have places, a beam of the best goes on, so that no joint
/// is given up for want of time; without places, returns the one with the most joints among those that were
/// taken (Transfer4D).
pub fn search(
    problem: &Problem<'_>,
    candidates: &[Vec<usize>],
    options: &SearchOptions,
) -> Matching {
    Search {
        problem,
        candidates,
        options,
        queue: BinaryHeap::new(),
        taken: Vec::new(),
        costs: vec![None; problem.reduced.n() * problem.graph.n()],
        least: vec![f64::NAN; problem.reduced.n() * problem.graph.n()],
        open: vec![f64::NAN; problem.reduced.n() * problem.graph.n()],
        loss: f64::INFINITY,
        n_queued: 0,
    }
    .run()
}

/// The weighted penalties of every joint of a matching.
pub fn terms_of_matching(problem: &Problem<'_>, balls: &[usize]) -> Vec<Terms> {
    let sum = |a: Terms, b: Terms| std::array::from_fn(|it| a[it] + b[it]);
    (0..balls.len())
        .map(|joint| {
            let Some(parent) = problem.reduced.parents[joint] else {
                return problem.root_terms(balls[0]).unwrap_or_default();
            };
            let state = State::of(problem, balls[..joint].to_vec());
            let pair = problem.pair_terms(joint, balls[parent], balls[joint]);
            let context = problem.context_terms(&state.matched(), joint, balls[joint]);
            sum(pair.unwrap_or_default(), context.unwrap_or_default())
        })
        .collect()
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Waiting {
    /// The least that a complete matching from here on costs.
    bound: f64,
    penalty: f64,
    /// The taken matching that this one extends.
    taken: u32,
    ball: u32,
    n_joints: u32,
    serial: u64,
}

impl Eq for Waiting {}

impl Ord for Waiting {
    /// The greatest has the least bound; of equal ones that with more joints, then the earlier one.
    fn cmp(&self, other: &Self) -> Ordering {
        other
            .bound
            .total_cmp(&self.bound)
            .then(self.n_joints.cmp(&other.n_joints))
            .then(other.serial.cmp(&self.serial))
    }
}

impl PartialOrd for Waiting {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// The balls that a joint may be matched to if its parent is matched to a certain one, with the
/// penalties of these pairs, least first.
type Costs = std::rc::Rc<[(f64, u32)]>;

struct Search<'a> {
    problem: &'a Problem<'a>,
    candidates: &'a [Vec<usize>],
    options: &'a SearchOptions,
    queue: BinaryHeap<Waiting>,
    /// For every taken matching: the one it extends, and the ball of its last joint.
    taken: Vec<(u32, u32)>,
    /// By joint and the ball of its parent.
    costs: Vec<Option<Costs>>,
    /// By joint and the ball of its parent: what it and all below it cost at least; NaN if unknown yet.
    least: Vec<f64>,
    /// By joint and its ball: what all below it costs at least.
    open: Vec<f64>,
    /// What every joint counts if it and all below it are given up.
    loss: f64,
    n_queued: u64,
}

impl Search<'_> {
    fn run(mut self) -> Matching {
        let n_joints = self.problem.reduced.n();
        for &ball in &self.candidates[0] {
            if let Some(terms) = self.problem.root_terms(ball) {
                let penalty = terms.iter().sum::<f64>();
                let open = self.open_children(0, ball);
                self.push(penalty, penalty + open, u32::MAX, ball, 1);
            }
        }
        if self.queue.is_empty() {
            let lost = self.least_loss();
            return Matching { balls: vec![], penalty: 0.0, lost };
        }
        let mut deepest = Matching { balls: vec![], penalty: 0.0, lost: None };
        while let Some(best) = self.queue.pop() {
            let balls = self.balls(&best);
            if balls.len() > deepest.balls.len() {
                let lost = Some(balls.len()).filter(|it| *it < n_joints);
                deepest = Matching { balls: balls.clone(), penalty: best.penalty, lost };
            }
            if balls.len() == n_joints {
                return deepest;
            }
            if self.taken.len() == self.options.max_steps {
                break;
            }
            self.taken.push((best.taken, best.ball));
            self.extend(&best, balls);
        }
        match self.problem.places {
            Some(_) => self.beam(),
            None => deepest,
        }
    }

    /// What the open joints beside the next one cost at least.
    fn others(&mut self, joint: usize, balls: &[usize]) -> f64 {
        let reduced = self.problem.reduced;
        let mut sum = 0.0;
        for other in joint + 1..reduced.n() {
            let parent = reduced.parents[other].expect("only the first joint is a root");
            if parent < joint {
                sum += self.least_cost(other, balls[parent]);
            }
        }
        sum
    }

    fn balls(&self, waiting: &Waiting) -> Vec<usize> {
        let mut balls = vec![waiting.ball as usize];
        let mut at = waiting.taken;
        while at != u32::MAX {
            let (before, ball) = self.taken[at as usize];
            balls.push(ball as usize);
            at = before;
        }
        balls.reverse();
        balls
    }

    /// Matches the next joint in all ways that stay below the limit.
    fn extend(&mut self, from: &Waiting, balls: Vec<usize>) {
        let joint = balls.len();
        let reduced = self.problem.reduced;
        let state = State::of(self.problem, balls);
        let others = self.others(joint, &state.balls);
        let parent = reduced.parents[joint].expect("only the first joint is a root");
        let last = self.taken.len() as u32 - 1;
        for &(cost, ball) in self.costs(joint, state.balls[parent]).iter() {
            if from.penalty + cost + others >= LIMIT {
                break;
            }
            let ball = ball as usize;
            let Some(context) = self.problem.context_terms(&state.matched(), joint, ball) else {
                continue;
            };
            let penalty = from.penalty + cost + context.iter().sum::<f64>();
            if penalty + others >= LIMIT {
                continue;
            }
            let bound = penalty + others + self.open_children(joint, ball);
            self.push(penalty, bound, last, ball, joint as u32 + 1);
        }
    }

    fn push(&mut self, penalty: f64, bound: f64, taken: u32, ball: usize, n_joints: u32) {
        if bound >= LIMIT {
            return;
        }
        let (ball, serial) = (ball as u32, self.n_queued);
        self.n_queued += 1;
        self.queue.push(Waiting { bound, penalty, taken, ball, n_joints, serial });
        if self.queue.len() > self.options.max_queue {
            let mut all = std::mem::take(&mut self.queue).into_vec();
            all.sort_unstable_by(|a, b| b.cmp(a));
            all.truncate(self.options.max_queue / 2);
            self.queue = all.into();
        }
    }

    /// What everything below a joint costs at least if the joint is matched to a ball, but for what
    /// depends on other branches.
    fn open_children(&mut self, joint: usize, ball: usize) -> f64 {
        let at = joint * self.problem.graph.n() + ball;
        if self.open[at].is_nan() {
            let reduced = self.problem.reduced;
            let children = reduced.children[joint].iter();
            self.open[at] = children.map(|&child| self.least_cost(child, ball)).sum();
        }
        self.open[at]
    }

    fn least_cost(&mut self, joint: usize, parent_ball: usize) -> f64 {
        let at = joint * self.problem.graph.n() + parent_ball;
        if self.least[at].is_nan() {
            let mut least = self.loss * self.n_below(joint) as f64;
            if self.problem.places.is_none() {
                // With all balls to choose from, whole trees take longer than the search they save.
                let first = self.costs(joint, parent_ball).first().map(|it| it.0);
                least = least.min(first.unwrap_or(f64::INFINITY));
                self.least[at] = least;
                return least;
            }
            for &(cost, ball) in self.costs(joint, parent_ball).iter() {
                if cost >= least {
                    break;
                }
                least = least.min(cost + self.open_children(joint, ball as usize));
            }
            self.least[at] = least;
        }
        self.least[at]
    }

    /// How many joints a branch has.
    fn n_below(&self, joint: usize) -> usize {
        let children = self.problem.reduced.children[joint].iter();
        1 + children.map(|&it| self.n_below(it)).sum::<usize>()
    }

    /// The first joint that is given up if as little as possible is, where no tree of joints costs less
    /// than the limit.
    fn least_loss(&mut self) -> Option<usize> {
        self.loss = LOSS;
        self.least.fill(f64::NAN);
        self.open.fill(f64::NAN);
        let mut best = (f64::INFINITY, 0);
        for &ball in &self.candidates[0] {
            let Some(terms) = self.problem.root_terms(ball) else { continue };
            let cost = terms.iter().sum::<f64>() + self.open_children(0, ball);
            if cost < best.0 {
                best = (cost, ball);
            }
        }
        let reduced = self.problem.reduced;
        let mut balls = vec![best.1; reduced.n()];
        let mut dearest: Option<(f64, usize)> = None;
        for joint in 1..reduced.n() {
            let from = balls[reduced.parents[joint].expect("only the first joint is a root")];
            let mut found: Option<(f64, f64, usize)> = None;
            for &(cost, ball) in self.costs(joint, from).iter() {
                let all = cost + self.open_children(joint, ball as usize);
                if found.is_none_or(|it| all < it.0) {
                    found = Some((all, cost, ball as usize));
                }
            }
            let loss = LOSS * self.n_below(joint) as f64;
            let Some((_, cost, ball)) = found.filter(|it| it.0 < loss) else { return Some(joint) };
            balls[joint] = ball;
            if dearest.is_none_or(|it| cost > it.0) {
                dearest = Some((cost, joint));
            }
        }
        // All have a place, but together they cost too much.
        dearest.map(|it| it.1)
    }

    fn costs(&mut self, joint: usize, parent_ball: usize) -> Costs {
        let at = joint * self.problem.graph.n() + parent_ball;
        if let Some(costs) = &self.costs[at] {
            return costs.clone();
        }
        let mut costs: Vec<(f64, u32)> = self.candidates[joint]
            .iter()
            .filter_map(|&ball| {
                let terms = self.problem.pair_terms(joint, parent_ball, ball)?;
                let cost = terms.iter().sum::<f64>();
                (cost < LIMIT).then_some((cost, ball as u32))
            })
            .collect();
        costs.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let costs: Costs = costs.into();
        self.costs[at] = Some(costs.clone());
        costs
    }
}

/// A partial matching, prepared for the penalties of one more joint.
struct State {
    balls: Vec<usize>,
    is_used: Vec<bool>,
    depths: Vec<f64>,
}

impl State {
    fn of(problem: &Problem<'_>, balls: Vec<usize>) -> Self {
        let mut is_used = vec![false; problem.graph.n()];
        let mut depths: Vec<f64> = Vec::with_capacity(balls.len());
        for (joint, &ball) in balls.iter().enumerate() {
            let Some(parent) = problem.reduced.parents[joint] else {
                is_used[ball] = true;
                depths.push(0.0);
                continue;
            };
            let from = balls[parent];
            for it in problem.graph.path_back(from, ball) {
                is_used[it] = true;
            }
            depths.push(depths[parent] + problem.graph.distance(from, ball));
        }
        Self { balls, is_used, depths }
    }

    fn matched(&self) -> Matched<'_> {
        Matched { balls: &self.balls, is_used: &self.is_used, depths: &self.depths }
    }
}
