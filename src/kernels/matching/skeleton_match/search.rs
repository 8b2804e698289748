//! Backtracking with bounds.

use super::MatchOptions;
use super::candidates::{Candidate, Way};
use super::collapse::Collapsed;
use super::plan::{Plan, plan};
use super::rating::{Rating, SecondRating, least_distance};
use super::turns::Starts;
use crate::kernels::geometry::mesh::Vec3;

/// The image of a node that has none.
pub const NOTHING: u32 = u32::MAX;

/// Ratings closer than this are the same.
const SAME: f64 = 1e-9;

/// A collapsed skeleton with what ratings need of it.
pub struct Side<'a> {
    pub collapsed: &'a Collapsed,
    /// What each branch counts in the first rating.
    pub sizes: Vec<f64>,
    /// Normalized places of its nodes.
    pub places: &'a [Vec3],
    pub starts: Starts,
}

/// A way to put the smaller skeleton into the larger one.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// For every node of the smaller skeleton one of the larger, or [`NOTHING`].
    pub image: Vec<u32>,
    /// Branches that belong together, each side from the image of the same node; more than one where nodes
    /// are passed by.
    pub ways: Vec<MatchedWay>,
    pub first_rating: f64,
    pub second_rating: f64,
}

/// Branches of both sides from a matched node to a matched node.
#[derive(Debug, Clone, PartialEq)]
pub struct MatchedWay {
    pub from: [u32; 2],
    pub branches: [Vec<u32>; 2],
}

/// What is decided about a node of the smaller skeleton.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Decision {
    Open,
    Mapped,
    Skipped,
    /// Only this child is matched, as if it hung on the parent.
    PassedBy(u32),
}

/// What a branch of the search has come to.
#[derive(Debug, Clone, Copy)]
pub(super) struct State {
    index: usize,
    /// The first rating if nothing more is matched.
    pub cost: f64,
    /// The sizes of branches that are not decided yet, of both sides.
    open: [f64; 2],
    /// The sum of distances of matched places.
    distance: f64,
}

pub(super) struct Search<'a> {
    pub small: &'a Side<'a>,
    pub large: &'a Side<'a>,
    pub options: &'a MatchOptions,
    pub plan: Plan,
    pub is_partial: bool,
    /// Nodes that other searches begin with.
    banned: Vec<u32>,
    /// Small x large distances of places, or bounds of them.
    distances: Vec<f64>,
    pub decisions: Vec<Decision>,
    pub image: Vec<u32>,
    pub ways: Vec<Way>,
    /// Pairs of branches that close cycles, with the nodes they start from.
    pub closing: Vec<([u32; 2], [u32; 2])>,
    pub is_used: Vec<bool>,
    pub is_branch_used: Vec<bool>,
    n_steps: usize,
    pub(super) goal: Goal,
}

/// What is looked for.
pub(super) enum Goal {
    Least { least: f64 },
    All { bound: f64, best: Vec<Found>, n_found: usize },
}

impl<'a> Search<'a> {
    /// Prepares a search that begins with `starts[index]`; nodes of earlier searches stay unmatched.
    pub fn new(
        [small, large]: [&'a Side<'a>; 2],
        options: &'a MatchOptions,
        starts: &[Option<u32>],
        index: usize,
        is_partial: bool,
    ) -> Self {
        let (n_small, n_large) = (small.collapsed.nodes.len(), large.collapsed.nodes.len());
        let axis = options.turn_axis.as_ref();
        let row = |a: &'a Vec3| large.places.iter().map(move |b| least_distance(a, b, axis));
        Self {
            small,
            large,
            options,
            plan: plan(small.collapsed, starts[index]),
            is_partial,
            banned: starts[..index].iter().flatten().copied().collect(),
            distances: small.places.iter().flat_map(row).collect(),
            decisions: vec![Decision::Open; n_small],
            image: vec![NOTHING; n_small],
            ways: vec![Way::default(); n_small],
            closing: Vec::new(),
            is_used: vec![false; n_large],
            is_branch_used: vec![false; large.collapsed.branches.len()],
            n_steps: 0,
            goal: Goal::Least { least: f64::INFINITY },
        }
    }

    /// Lowers the best first rating if there is a better match. Returns whether all were looked at.
    pub fn find_least(&mut self, least: &mut f64) -> bool {
        self.goal = Goal::Least { least: *least };
        let is_complete = self.start();
        if let Goal::Least { least: found } = self.goal {
            *least = found;
        }
        is_complete
    }

    /// Adds the best matches up to a first rating, sorted. Returns whether all were looked at that could
    /// be among them.
    pub fn collect(&mut self, bound: f64, best: &mut Vec<Found>, n_found: &mut usize) -> bool {
        self.goal = Goal::All { bound, best: std::mem::take(best), n_found: *n_found };
        let is_complete = self.start();
        if let Goal::All { best: list, n_found: count, .. } = &mut self.goal {
            *best = std::mem::take(list);
            *n_found = *count;
        }
        is_complete
    }

    fn start(&mut self) -> bool {
        self.n_steps = 0;
        let open = [self.small, self.large].map(|it| it.sizes.iter().sum::<f64>());
        self.descend(State { index: 0, cost: open[0] + open[1], open, distance: 0.0 })
    }

    /// Decides about the next node in all ways. Returns false if the search has to end.
    fn descend(&mut self, state: State) -> bool {
        let Some(&node) = self.plan.order.get(state.index) else { return self.record(&state) };
        let next = State { index: state.index + 1, ..state };
        let parent = self.plan.parent[node as usize].map(|it| it.0);
        let is_lost = match parent.map(|it| self.decisions[it as usize]) {
            Some(Decision::Skipped) => true,
            Some(Decision::PassedBy(child)) => child != node,
            _ => false,
        };
        if is_lost {
            return self.skip(node, next);
        }
        for candidate in self.candidates(node) {
            self.n_steps += 1;
            if self.n_steps > self.options.max_steps {
                return false;
            }
            let after = self.after(node, &candidate, next);
            if self.is_hopeless(&after) {
                continue;
            }
            self.apply(node, &candidate);
            let goes_on = self.descend(after);
            self.revert(node, &candidate);
            if !goes_on {
                return false;
            }
        }
        !self.is_partial || self.leave_out(node, next)
    }

    /// The ways not to match a node.
    fn leave_out(&mut self, node: u32, next: State) -> bool {
        let own = node as usize;
        let parent = self.plan.parent[own].map(|it| it.0);
        let is_start = next.index == 1;
        let can_pass = parent.is_some()
            && self.plan.back[own].is_empty()
            && self.plan.to_parent[own].len() == 1
            && self.plan.children[own].iter().all(|&it| self.plan.is_pendant[it as usize]);
        if can_pass {
            for child in self.plan.children[own].clone() {
                self.decisions[own] = Decision::PassedBy(child);
                let goes_on = self.descend(next);
                self.decisions[own] = Decision::Open;
                if !goes_on {
                    return false;
                }
            }
        }
        let hangs_on_passed =
            parent.is_some_and(|it| matches!(self.decisions[it as usize], Decision::PassedBy(_)));
        let can_skip = self.plan.is_pendant[own] && !is_start && !hangs_on_passed;
        !can_skip || self.skip(node, next)
    }

    fn skip(&mut self, node: u32, mut next: State) -> bool {
        self.n_steps += 1;
        let lost = self.plan.to_parent[node as usize]
            .iter()
            .chain(self.plan.back[node as usize].iter().map(|it| &it.0));
        next.open[0] -= lost.map(|&it| self.small.sizes[it as usize]).sum::<f64>();
        if self.n_steps > self.options.max_steps {
            return false;
        }
        if self.is_hopeless(&next) {
            return true;
        }
        self.decisions[node as usize] = Decision::Skipped;
        let goes_on = self.descend(next);
        self.decisions[node as usize] = Decision::Open;
        goes_on
    }

    fn after(&self, node: u32, candidate: &Candidate, next: State) -> State {
        let distance = self.distance(node, candidate.image);
        State {
            cost: next.cost + candidate.cost,
            open: [next.open[0] - candidate.taken[0], next.open[1] - candidate.taken[1]],
            distance: next.distance + distance,
            ..next
        }
    }

    /// Whether nothing that is looked for can come of a state.
    fn is_hopeless(&self, state: &State) -> bool {
        // No pair of branches lowers the rating by more than twice the smaller one.
        let least_cost = state.cost - 2.0 * state.open[0].min(state.open[1]);
        match &self.goal {
            Goal::Least { least } => least_cost > least - SAME,
            Goal::All { bound, best, .. } => {
                let mean = state.distance / self.image.len() as f64;
                // Distances say nothing of directions.
                let is_by_place = self.options.second_rating == SecondRating::Places;
                least_cost > bound + SAME
                    || (is_by_place
                        && best.len() >= self.options.n_kept
                        && best.last().is_some_and(|it| mean > it.second_rating + SAME))
            }
        }
    }

    fn apply(&mut self, node: u32, candidate: &Candidate) {
        self.decisions[node as usize] = Decision::Mapped;
        self.image[node as usize] = candidate.image;
        self.ways[node as usize] = candidate.way;
        self.mark(candidate, true);
        self.closing.extend(&candidate.closing);
    }

    fn revert(&mut self, node: u32, candidate: &Candidate) {
        self.decisions[node as usize] = Decision::Open;
        self.image[node as usize] = NOTHING;
        self.mark(candidate, false);
        self.closing.truncate(self.closing.len() - candidate.closing.len());
    }

    fn mark(&mut self, candidate: &Candidate, is_used: bool) {
        self.is_used[candidate.image as usize] = is_used;
        for &node in candidate.way.passed() {
            self.is_used[node as usize] = is_used;
        }
        let closing = candidate.closing.iter().map(|it| &it.1[1]);
        for &branch in candidate.way.branches().iter().chain(closing) {
            self.is_branch_used[branch as usize] = is_used;
        }
    }

    /// The matched node that a node hangs on, and the branches from there; none for a start.
    pub fn anchor(&self, node: u32) -> Option<(u32, Vec<u32>)> {
        let (mut anchor, branch) = self.plan.parent[node as usize]?;
        let mut branches = vec![branch];
        while let Decision::PassedBy(_) = self.decisions[anchor as usize] {
            let (next, branch) = self.plan.parent[anchor as usize]?;
            branches.push(branch);
            anchor = next;
        }
        branches.reverse();
        Some((anchor, branches))
    }

    pub fn is_banned(&self, node: u32) -> bool {
        self.banned.contains(&node)
    }

    pub fn distance(&self, node: u32, image: u32) -> f64 {
        self.distances[node as usize * self.large.collapsed.nodes.len() + image as usize]
    }

    /// What another number of branches at a node costs.
    pub fn valence_cost(&self, node: u32, image: u32) -> f64 {
        if self.options.rating == Rating::NodeCounts {
            return 0.0;
        }
        let [own, theirs] = [
            self.small.collapsed.degree(node as usize),
            self.large.collapsed.degree(image as usize),
        ];
        self.options.valence_weight * own.abs_diff(theirs) as f64
    }
}
