//! A match of two skeletons.

use super::graph::SkeletonGraph;
use super::search::{Found, MatchedWay, NOTHING, Side};

/// Branches of two skeletons that belong together: their nodes, both ends with them, from ends that belong
/// together on. They lead away from the source's root.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MatchedBranch {
    pub source: Vec<u32>,
    pub target: Vec<u32>,
}

/// Which nodes and branches of two skeletons belong together.
#[derive(Debug, Clone, PartialEq)]
pub struct SkeletonMatch {
    n_source: usize,
    n_target: usize,
    nodes: Vec<[u32; 2]>,
    branches: Vec<MatchedBranch>,
    ratings: [f64; 2],
}

/// Why something is no match.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SkeletonMatchError {
    #[error("node {node} of the {whose} is matched, but it has {n_nodes} nodes")]
    OutOfRange { whose: &'static str, node: u32, n_nodes: usize },
    #[error("node {node} of the {whose} is matched twice")]
    Twice { whose: &'static str, node: u32 },
    #[error("branch {branch} has {n_source} nodes in the source and {n_target} in the target")]
    Short { branch: usize, n_source: usize, n_target: usize },
    #[error("a rating is {value}")]
    Rating { value: f64 },
}

impl SkeletonMatch {
    /// Checks and wraps pairs of (source, target) nodes and pairs of branches of at least two nodes.
    ///
    /// # Errors
    /// See [`SkeletonMatchError`]; the first offending node or branch is named.
    pub fn new(
        [n_source, n_target]: [usize; 2],
        nodes: Vec<[u32; 2]>,
        branches: Vec<MatchedBranch>,
        ratings: [f64; 2],
    ) -> Result<Self, SkeletonMatchError> {
        for (side, whose, n_nodes) in [(0, "source", n_source), (1, "target", n_target)] {
            let along =
                branches.iter().flat_map(|it| if side == 0 { &it.source } else { &it.target });
            let mut ends: Vec<u32> = nodes.iter().map(|it| it[side]).collect();
            let is_beyond = |it: &u32| *it as usize >= n_nodes;
            if let Some(node) = ends.iter().chain(along).copied().find(is_beyond) {
                return Err(SkeletonMatchError::OutOfRange { whose, node, n_nodes });
            }
            // Sorted, since a count that was read from a file may be too large for a list of flags.
            ends.sort_unstable();
            if let Some(pair) = ends.windows(2).find(|it| it[0] == it[1]) {
                return Err(SkeletonMatchError::Twice { whose, node: pair[0] });
            }
        }
        let is_short = |it: &MatchedBranch| it.source.len() < 2 || it.target.len() < 2;
        if let Some(branch) = branches.iter().position(is_short) {
            let (n_source, n_target) =
                (branches[branch].source.len(), branches[branch].target.len());
            return Err(SkeletonMatchError::Short { branch, n_source, n_target });
        }
        if let Some(&value) = ratings.iter().find(|it| !(**it >= 0.0 && it.is_finite())) {
            return Err(SkeletonMatchError::Rating { value });
        }
        Ok(Self { n_source, n_target, nodes, branches, ratings })
    }

    pub fn n_source(&self) -> usize {
        self.n_source
    }

    pub fn n_target(&self) -> usize {
        self.n_target
    }

    /// Pairs of source and target nodes, sorted by the source.
    pub fn nodes(&self) -> &[[u32; 2]] {
        &self.nodes
    }

    pub fn branches(&self) -> &[MatchedBranch] {
        &self.branches
    }

    /// How branches differ, and how places of nodes differ.
    pub fn ratings(&self) -> [f64; 2] {
        self.ratings
    }

    /// The target's node of a source's node.
    pub fn target_of(&self, source: u32) -> Option<u32> {
        let index = self.nodes.binary_search_by_key(&source, |it| it[0]).ok()?;
        Some(self.nodes[index][1])
    }
}

/// Writes a match in terms of the skeletons' nodes.
///
/// Branches that hold a root of each skeleton between their ends are parted there: roots of two edges
/// belong together.
pub(super) fn assemble(
    graphs: [&SkeletonGraph; 2],
    [small, large]: [&Side<'_>; 2],
    is_swapped: bool,
    found: &Found,
) -> SkeletonMatch {
    let in_order = |own: u32, theirs: u32| if is_swapped { [theirs, own] } else { [own, theirs] };
    let pair = |(own, &theirs): (usize, &u32)| {
        let theirs = large.collapsed.nodes.get(theirs as usize).filter(|_| theirs != NOTHING)?;
        Some(in_order(small.collapsed.nodes[own], *theirs))
    };
    let mut nodes: Vec<[u32; 2]> = found.image.iter().enumerate().filter_map(pair).collect();
    let depths = graphs[0].depths();
    let mut branches = Vec::new();
    for way in &found.ways {
        let [own, theirs] = nodes_of_way([small, large], way);
        let [source, target] = if is_swapped { [theirs, own] } else { [own, theirs] };
        let mut branch = MatchedBranch { source, target };
        let end = |it: Option<&u32>| it.map(|&it| (depths[it as usize], it));
        if end(branch.source.first()) > end(branch.source.last()) {
            branch.source.reverse();
            branch.target.reverse();
        }
        match part_at_roots(graphs, &branch) {
            Some((roots, parts)) => {
                nodes.push(roots);
                branches.extend(parts);
            }
            None => branches.push(branch),
        }
    }
    nodes.sort_unstable();
    branches.sort_by(|a, b| (&a.source, &a.target).cmp(&(&b.source, &b.target)));
    let counts = graphs.map(|it| it.positions.len());
    SkeletonMatch::new(counts, nodes, branches, [found.first_rating, found.second_rating])
        .expect("a search matches no node twice")
}

fn nodes_of_way(sides: [&Side<'_>; 2], way: &MatchedWay) -> [Vec<u32>; 2] {
    [0, 1].map(|side| {
        let collapsed = sides[side].collapsed;
        let mut at = way.from[side];
        let mut nodes = vec![collapsed.nodes[at as usize]];
        for &branch in &way.branches[side] {
            nodes.extend(&collapsed.nodes_along(branch, at)[1..]);
            let ends = collapsed.branches[branch as usize].ends;
            at = if ends[0] == at { ends[1] } else { ends[0] };
        }
        nodes
    })
}

/// The two parts of a branch with roots on both sides, each leading away from them.
fn part_at_roots(
    graphs: [&SkeletonGraph; 2],
    branch: &MatchedBranch,
) -> Option<([u32; 2], [MatchedBranch; 2])> {
    let place = |graph: &SkeletonGraph, nodes: &[u32]| {
        (1..nodes.len() - 1).find(|&it| graph.roots.contains(&nodes[it]))
    };
    let (a, b) = (place(graphs[0], &branch.source)?, place(graphs[1], &branch.target)?);
    let reversed = |nodes: &[u32]| nodes.iter().rev().copied().collect();
    let before = MatchedBranch {
        source: reversed(&branch.source[..=a]),
        target: reversed(&branch.target[..=b]),
    };
    let after =
        MatchedBranch { source: branch.source[a..].to_vec(), target: branch.target[b..].to_vec() };
    Some(([branch.source[a], branch.target[b]], [before, after]))
}
