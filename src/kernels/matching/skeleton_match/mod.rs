//! Which nodes and branches of two skeletons belong together.

mod candidates;
mod collapse;
mod graph;
mod matched;
mod plan;
mod rating;
mod record;
mod search;
#[cfg(test)]
mod tests;
mod turns;

use nalgebra::UnitQuaternion;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use self::collapse::{Branch, Collapsed, collapse};
pub use self::graph::SkeletonGraph;
use self::matched::assemble;
pub use self::matched::{MatchedBranch, SkeletonMatch, SkeletonMatchError};
pub use self::rating::{Rating, SecondRating};
use self::rating::{best_turn, mean_distance, normalized_places, sizes};
use self::search::{Found, MatchedWay, Search, Side};
use self::turns::{Starts, turn_rating};
use crate::kernels::geometry::mesh::Vec3;

/// The most branch nodes and leaves of a skeleton that is matched.
const MOST_NODES: usize = 1000;

/// How skeletons are matched.
#[derive(Debug, Clone, PartialEq)]
pub struct MatchOptions {
    pub rating: Rating,
    /// What ranks matches whose first ratings are near the best.
    pub second_rating: SecondRating,
    /// What a branch more or less at a node costs in [`Rating::Lengths`].
    pub valence_weight: f64,
    /// Matches are kept whose first rating is above the best by this share of it…
    pub tolerance_share: f64,
    /// … or by so much; [`f64::INFINITY`] keeps all.
    pub tolerance: f64,
    /// Compare places after the best turn about this axis of length 1.
    pub turn_axis: Option<Vec3>,
    pub partial: Partial,
    /// The length of the ranked list.
    pub n_kept: usize,
    /// The search ends after so many matches…
    pub max_matches: usize,
    /// … or so many tried pairs of nodes.
    pub max_steps: usize,
}

/// When parts of the smaller skeleton may stay unmatched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Partial {
    /// Every branch node, leaf and branch of the smaller skeleton has its match.
    Never,
    /// Only if there is no match otherwise.
    #[default]
    Needed,
    /// Where that makes a better match.
    Always,
}

impl Default for MatchOptions {
    fn default() -> Self {
        Self {
            rating: Rating::default(),
            second_rating: SecondRating::default(),
            valence_weight: 0.1,
            tolerance_share: 0.1,
            tolerance: 0.02,
            turn_axis: None,
            partial: Partial::Needed,
            n_kept: 100,
            max_matches: 1_000_000,
            max_steps: 50_000,
        }
    }
}

/// The tolerance of the first rating that suits it.
pub fn default_tolerance(rating: Rating) -> f64 {
    match rating {
        Rating::Lengths => 0.02,
        Rating::NodeCounts => 2.0,
    }
}

/// The matches of two skeletons, the best first.
#[derive(Debug, Clone, PartialEq)]
pub struct Ranking {
    /// None if nothing fits.
    pub matches: Vec<SkeletonMatch>,
    /// How many were seen within the tolerance.
    pub n_found: usize,
    /// Whether all were seen that could be among the first; if not, the search ended early.
    pub is_complete: bool,
    /// Whether parts of the smaller skeleton were allowed to stay unmatched.
    pub is_partial: bool,
}

/// Why skeletons cannot be matched.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MatchError {
    #[error("the {whose} has no nodes")]
    NoNodes { whose: &'static str },
    #[error("the {whose} names node {node}, but it has {n_nodes} nodes")]
    OutOfRange { whose: &'static str, node: u32, n_nodes: usize },
    #[error(
        "the {whose} has {found} branch nodes and leaves, but at most {most} are matched: prune it \
         first"
    )]
    TooMany { whose: &'static str, found: usize, most: usize },
}

/// Finds which nodes and branches of two skeletons belong together (Madaras et al. 2014, section 4).
///
/// Both are collapsed to branch nodes, leaves and branches. Backtracking lists the ways to put the
/// smaller one into the larger one so that neighbours stay neighbours; they are rated by the lengths of
/// branches (or their numbers of nodes), and those near the best by the distances of matched nodes after
/// position and size are taken away. Parts of the larger skeleton may stay unmatched, and as
/// `options.partial` says also pendant parts of the smaller one; then a branch may also lead past nodes
/// whose other branches are not matched.
///
/// Branch and bound keeps time and memory small even where symmetric limbs make very many matches; the
/// order of the result depends on the skeletons alone.
///
/// # Errors
/// See [`MatchError`]. Skeletons that do not fit are no error: the ranking is empty.
pub fn match_skeletons(
    source: &SkeletonGraph,
    target: &SkeletonGraph,
    options: &MatchOptions,
) -> Result<Ranking, MatchError> {
    let mut collapsed = Vec::with_capacity(2);
    for (graph, whose) in [(source, "source"), (target, "target")] {
        graph.check(whose)?;
        let it = collapse(graph);
        let (found, most) = (it.nodes.len(), MOST_NODES);
        if found > most {
            return Err(MatchError::TooMany { whose, found, most });
        }
        collapsed.push(it);
    }
    let count = |it: &Collapsed| (it.nodes.len(), it.branches.len());
    let is_swapped = count(&collapsed[1]) < count(&collapsed[0]);
    let places =
        [normalized_places(source, &collapsed[0]), normalized_places(target, &collapsed[1])];
    let graphs = [source, target];
    let side = |index: usize| Side {
        collapsed: &collapsed[index],
        sizes: sizes(&collapsed[index], options.rating),
        places: &places[index],
        starts: Starts::new(graphs[index], &collapsed[index]),
    };
    let (small, large) = (side(usize::from(is_swapped)), side(usize::from(!is_swapped)));
    let (found, is_partial) = search(&small, &large, options);
    let build = |it: &Found| assemble(graphs, [&small, &large], is_swapped, it);
    Ok(Ranking {
        matches: found.best.iter().map(build).collect(),
        n_found: found.n_found,
        is_complete: found.is_complete,
        is_partial,
    })
}

/// What one search found, ranked.
struct Ranked {
    best: Vec<Found>,
    n_found: usize,
    is_complete: bool,
}

/// Whole matches first; partial ones if they are wanted.
fn search(small: &Side<'_>, large: &Side<'_>, options: &MatchOptions) -> (Ranked, bool) {
    if options.partial != Partial::Always {
        let whole = ranked(small, large, options, &[None], false);
        if !whole.best.is_empty() || options.partial == Partial::Never {
            return (whole, false);
        }
    }
    (ranked(small, large, options, &starts(small.collapsed), true), true)
}

/// Where a partial match may begin: it must contain one of these.
fn starts(collapsed: &Collapsed) -> Vec<Option<u32>> {
    const MOST_STARTS: usize = 3;
    let mut nodes: Vec<u32> = (0..collapsed.nodes.len() as u32).collect();
    nodes.sort_by_key(|&it| std::cmp::Reverse(collapsed.degree(it as usize)));
    let n_junctions = nodes.iter().filter(|&&it| collapsed.degree(it as usize) > 2).count();
    nodes.truncate(n_junctions.clamp(1, MOST_STARTS));
    nodes.into_iter().map(Some).collect()
}

/// Finds the best first rating, then all matches near it, and ranks them by the second.
fn ranked(
    small: &Side<'_>,
    large: &Side<'_>,
    options: &MatchOptions,
    starts: &[Option<u32>],
    is_partial: bool,
) -> Ranked {
    let new = |it: usize| Search::new([small, large], options, starts, it, is_partial);
    let mut searches: Vec<Search<'_>> = (0..starts.len()).map(new).collect();
    let mut least = f64::INFINITY;
    let mut is_complete = true;
    if options.tolerance < f64::INFINITY {
        for search in &mut searches {
            is_complete &= search.find_least(&mut least);
        }
    }
    let bound = least + (options.tolerance_share * least).max(options.tolerance);
    let mut best: Vec<Found> = Vec::new();
    let mut n_found = 0;
    if options.tolerance < f64::INFINITY && least.is_infinite() {
        return Ranked { best, n_found, is_complete };
    }
    for search in &mut searches {
        is_complete &= search.collect(bound, &mut best, &mut n_found);
    }
    Ranked { best, n_found, is_complete }
}

/// The second rating of matched nodes and ways.
fn second_rating(
    [small, large]: [&Side<'_>; 2],
    image: &[u32],
    ways: &[MatchedWay],
    options: &MatchOptions,
) -> f64 {
    let pair = |(a, &b): (usize, &u32)| Some((small.places[a], *large.places.get(b as usize)?));
    let pairs: Vec<(Vec3, Vec3)> = image.iter().enumerate().filter_map(pair).collect();
    let axis = options.turn_axis.as_ref();
    match options.second_rating {
        SecondRating::Places => mean_distance(&pairs, axis),
        SecondRating::Directions => {
            let turn = axis.map_or_else(UnitQuaternion::identity, |axis| best_turn(&pairs, axis));
            let sides = [small, large].map(|it| (it.collapsed, &it.starts));
            turn_rating(sides, ways, &turn)
        }
    }
}
