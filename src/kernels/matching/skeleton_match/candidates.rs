//! What a node of the smaller skeleton may be matched with, given those before it.

use super::search::{Search, Side};

/// The most branches of the larger skeleton that one branch of the smaller one may take.
const MOST_BRANCHES: usize = 3;

/// Up to [`MOST_BRANCHES`] branches in a row, with the nodes between them.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Way {
    branches: [u32; MOST_BRANCHES],
    passed: [u32; MOST_BRANCHES],
    len: usize,
}

impl Way {
    pub fn branches(&self) -> &[u32] {
        &self.branches[..self.len]
    }

    pub fn passed(&self) -> &[u32] {
        &self.passed[..self.len.saturating_sub(1)]
    }

    fn then(mut self, from: u32, branch: u32) -> Self {
        if self.len > 0 {
            self.passed[self.len - 1] = from;
        }
        self.branches[self.len] = branch;
        self.len += 1;
        self
    }
}

/// A node of the larger skeleton that a node may be matched with.
#[derive(Debug, Clone)]
pub struct Candidate {
    pub image: u32,
    /// From the image of the node that the node hangs on.
    pub way: Way,
    /// Other pairs of branches: the nodes they start from, and the branches.
    pub closing: Vec<([u32; 2], [u32; 2])>,
    /// What the first rating changes by.
    pub cost: f64,
    /// The sizes of the branches that are matched, of both sides.
    pub taken: [f64; 2],
}

impl Candidate {
    fn start(image: u32) -> Self {
        Self { image, way: Way::default(), closing: vec![], cost: 0.0, taken: [0.0; 2] }
    }
}

impl Search<'_> {
    /// All candidates of a node, the cheapest first.
    pub fn candidates(&self, node: u32) -> Vec<Candidate> {
        if self.is_banned(node) {
            return Vec::new();
        }
        let mut res: Vec<Candidate> = match self.anchor(node) {
            None => self.unused().map(Candidate::start).collect(),
            Some((anchor, _)) if self.plan.to_parent[node as usize].len() > 1 => {
                let neighbors =
                    &self.large.collapsed.incident[self.image[anchor as usize] as usize];
                let free = neighbors.iter().map(|it| it.1).filter(|&it| !self.is_used[it as usize]);
                let mut free: Vec<u32> = free.collect();
                free.sort_unstable();
                free.dedup();
                free.into_iter()
                    .filter_map(|it| self.parallel_candidate(node, anchor, it))
                    .collect()
            }
            Some((anchor, own)) => self.reached(anchor, &own),
        };
        if !self.is_partial {
            let degree = self.small.collapsed.degree(node as usize);
            res.retain(|it| degree <= self.large.collapsed.degree(it.image as usize));
        }
        if !self.plan.back[node as usize].is_empty() {
            res.retain_mut(|it| self.close_cycles(node, it));
        }
        for it in &mut res {
            it.cost += self.valence_cost(node, it.image);
        }
        res.sort_by(|a, b| {
            let key = |it: &Candidate| it.cost + 1e-3 * self.distance(node, it.image);
            key(a).total_cmp(&key(b)).then(a.image.cmp(&b.image))
        });
        res
    }

    fn unused(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.is_used.len() as u32).filter(|&it| !self.is_used[it as usize])
    }

    /// Nodes that one way of unused branches leads to; past other nodes only in partial matches.
    fn reached(&self, anchor: u32, own: &[u32]) -> Vec<Candidate> {
        let own_size: f64 = own.iter().map(|&it| self.small.sizes[it as usize]).sum();
        let most = if self.is_partial { MOST_BRANCHES } else { 1 };
        let first = self.image[anchor as usize];
        let mut res: Vec<Candidate> = Vec::new();
        let mut stack = vec![(first, Way::default(), 0.0)];
        while let Some((at, way, size)) = stack.pop() {
            for &(branch, next) in &self.large.collapsed.incident[at as usize] {
                let is_passed = next == first || way.passed().contains(&next) || next == at;
                if self.is_branch_used[branch as usize] || self.is_used[next as usize] || is_passed
                {
                    continue;
                }
                let way = way.then(at, branch);
                let size = size + self.large.sizes[branch as usize];
                let cost = (own_size - size).abs() - own_size - size;
                let taken = [own_size, size];
                let found = Candidate { image: next, way, closing: vec![], cost, taken };
                match res.iter_mut().find(|it| it.image == next) {
                    Some(known) if known.cost <= found.cost => {}
                    Some(known) => *known = found,
                    None => res.push(found),
                }
                if way.branches().len() < most {
                    stack.push((next, way, size));
                }
            }
        }
        res
    }

    /// A node that hangs on its parent by several branches.
    fn parallel_candidate(&self, node: u32, anchor: u32, image: u32) -> Option<Candidate> {
        let mut candidate = Candidate::start(image);
        let own = self.plan.to_parent[node as usize].clone();
        let theirs = self.free_between(self.image[anchor as usize], image, &[]);
        let from = [anchor, self.image[anchor as usize]];
        add_pairs(self.small, self.large, &own, &theirs, from, &mut candidate).then_some(candidate)
    }

    /// Matches the branches that lead to other nodes before; false if there are too few.
    fn close_cycles(&self, node: u32, candidate: &mut Candidate) -> bool {
        let back = &self.plan.back[node as usize];
        let mut others: Vec<u32> = back.iter().map(|it| it.1).collect();
        others.sort_unstable();
        others.dedup();
        others.into_iter().all(|other| {
            let own: Vec<u32> = back.iter().filter(|it| it.1 == other).map(|it| it.0).collect();
            let image = if other == node { candidate.image } else { self.image[other as usize] };
            if image as usize >= self.is_used.len() {
                return false;
            }
            let taken: Vec<u32> = candidate.way.branches().to_vec();
            let theirs = self.free_between(image, candidate.image, &taken);
            add_pairs(self.small, self.large, &own, &theirs, [other, image], candidate)
        })
    }

    /// Unused branches between two nodes of the larger skeleton.
    fn free_between(&self, a: u32, b: u32, taken: &[u32]) -> Vec<u32> {
        let incident = self.large.collapsed.incident[a as usize].iter();
        let mut free: Vec<u32> = incident
            .filter(|it| it.1 == b && !self.is_branch_used[it.0 as usize] && !taken.contains(&it.0))
            .map(|it| it.0)
            .collect();
        free.sort_unstable();
        free.dedup();
        free
    }
}

/// Gives each of some branches one of others, so that sizes differ least in sum; false if there are
/// too few of the others.
fn add_pairs(
    small: &Side<'_>,
    large: &Side<'_>,
    own: &[u32],
    theirs: &[u32],
    from: [u32; 2],
    to: &mut Candidate,
) -> bool {
    if own.len() > theirs.len() {
        return false;
    }
    let by_size = |branches: &[u32], sizes: &[f64]| {
        let mut sorted = branches.to_vec();
        sorted.sort_by(|&a, &b| sizes[a as usize].total_cmp(&sizes[b as usize]).then(a.cmp(&b)));
        sorted
    };
    let (own, theirs) = (by_size(own, &small.sizes), by_size(theirs, &large.sizes));
    let gain = |a: u32, b: u32| {
        let [a, b] = [small.sizes[a as usize], large.sizes[b as usize]];
        (a - b).abs() - a - b
    };
    // In order of size, no two pairs cross in the best choice: row by row the best of the first ones.
    let width = theirs.len() + 1;
    let mut costs = vec![0.0; width];
    let mut takes = vec![false; own.len() * width];
    for (row, &a) in own.iter().enumerate() {
        let mut next = vec![f64::INFINITY; width];
        for (column, &b) in theirs.iter().enumerate() {
            let taken = costs[column] + gain(a, b);
            let is_taken = taken <= next[column];
            next[column + 1] = if is_taken { taken } else { next[column] };
            takes[row * width + column + 1] = is_taken;
        }
        costs = next;
    }
    let mut column = theirs.len();
    for row in (0..own.len()).rev() {
        while !takes[row * width + column] {
            column -= 1;
        }
        column -= 1;
        let pair = [own[row], theirs[column]];
        to.cost += gain(pair[0], pair[1]);
        to.taken[0] += small.sizes[pair[0] as usize];
        to.taken[1] += large.sizes[pair[1] as usize];
        to.closing.push((from, pair));
    }
    true
}
