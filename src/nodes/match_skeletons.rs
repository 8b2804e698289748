//! Kind `match_skeletons`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::matching::skeleton_match::{
    MatchOptions, Partial, Ranking, Rating, SecondRating, SkeletonGraph, SkeletonMatch, collapse,
    default_tolerance, match_skeletons,
};
use crate::kernels::rigs::skeleton::Skeleton;
use crate::kernels::table::{Column, Table};

/// Finds which joints and branches of two skeletons belong together.
///
/// Only branch nodes, leaves and the branches between them are compared: the smaller skeleton is put into
/// the larger one so that neighbours stay neighbours, branches are alike long and, among the ways that
/// are about as good, nodes are in like places. Names do not matter. Both should stand alike; with `turn`
/// they may face anywhere.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MatchSkeletons {
    /// What the first rating compares.
    pub rating: Rating,
    /// What ranks matches whose first ratings are near the best.
    pub second_rating: SecondRating,
    /// Of `lengths`: what a branch more or less at a node costs; all lengths of a skeleton are 1 in sum.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub valence_weight: f64,
    /// The second rating decides among matches whose first one is above the best by this share of it…
    #[schemars(range(min = 0.0, max = 100.0))]
    pub tolerance_share: f64,
    /// … or by so much: 0.02 of the length or 2 nodes if it is left out.
    #[schemars(range(min = 0.0, max = 1e6))]
    pub tolerance: Option<f64>,
    /// How the skeletons may be turned before places are compared. They are never mirrored.
    pub turn: Turn,
    /// When parts of the smaller skeleton may stay unmatched.
    pub partial: Partial,
    /// How many matches the ranking lists.
    #[schemars(range(min = 1, max = 10_000))]
    pub list: usize,
    /// Which match of the ranking is taken, from 1.
    #[schemars(range(min = 1, max = 10_000))]
    pub rank: usize,
    /// The search ends after so many matches.
    #[schemars(range(min = 1, max = 1_000_000_000))]
    pub max_matches: usize,
    /// The search ends after so many tried pairs of nodes; a million takes about half a second.
    #[schemars(range(min = 100, max = 1_000_000_000))]
    pub max_steps: usize,
}

/// How a skeleton may be turned.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Turn {
    #[default]
    None,
    /// About the y axis, as fits best.
    Up,
}

impl Default for MatchSkeletons {
    fn default() -> Self {
        let it = MatchOptions::default();
        Self {
            rating: it.rating,
            second_rating: it.second_rating,
            valence_weight: it.valence_weight,
            tolerance_share: it.tolerance_share,
            tolerance: None,
            turn: Turn::default(),
            partial: it.partial,
            list: it.n_kept,
            rank: 1,
            max_matches: it.max_matches,
            max_steps: it.max_steps,
        }
    }
}

impl MatchSkeletons {
    const SOURCE: Input<Skeleton> = Input::new("source", "a skeleton");
    const TARGET: Input<Skeleton> = Input::new("target", "another skeleton");
    const MATCH: Output<SkeletonMatch> = Output::new("match", "which joints belong together");
    const RANKING: Output<Table> =
        Output::new("ranking", "one row a match, the best first: ratings and pairs of joints");

    fn options(&self) -> MatchOptions {
        MatchOptions {
            rating: self.rating,
            second_rating: self.second_rating,
            valence_weight: self.valence_weight,
            tolerance_share: self.tolerance_share,
            tolerance: self.tolerance.unwrap_or(default_tolerance(self.rating)),
            turn_axis: match self.turn {
                Turn::None => None,
                Turn::Up => Some(Vec3::y()),
            },
            partial: self.partial,
            n_kept: self.list.max(self.rank),
            max_matches: self.max_matches,
            max_steps: self.max_steps,
        }
    }
}

impl Node for MatchSkeletons {
    const SPEC: Spec = Spec {
        kind: "match_skeletons",
        version: 1,
        inputs: &[Self::SOURCE.port(), Self::TARGET.port()],
        outputs: &[Self::MATCH.port(), Self::RANKING.port().aside()],
        cites: &["madaras2014skeleton"],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.other]
kind = "synthesize"
n_vertices = 1000
seed = 1
pose = "walk"

[nodes.matched]
kind = "match_skeletons"
source = "@body.skeleton"
target = "@other.skeleton"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (source, target) = (io.get(Self::SOURCE), io.get(Self::TARGET));
        let graphs = [&*source, &*target].map(SkeletonGraph::from);
        let ranking = match_skeletons(&graphs[0], &graphs[1], &self.options())?;
        let n_matches = ranking.matches.len();
        let Some(chosen) = ranking.matches.get(self.rank - 1) else {
            return Err(NodeError::failed(match n_matches {
                0 => nothing_fits(&graphs, &ranking),
                _ => format!("`rank` is {}, but there are {n_matches} matches", self.rank),
            }));
        };
        for note in notes(&ranking, chosen) {
            io.note(note);
        }
        io.put(Self::RANKING, ranking_table(&ranking, &source, &target));
        io.put(Self::MATCH, chosen.clone());
        Ok(())
    }
}

fn nothing_fits(graphs: &[SkeletonGraph; 2], ranking: &Ranking) -> String {
    let [source, target] = graphs.each_ref().map(|it| {
        let collapsed = collapse(it);
        let n_leaves = (0..collapsed.nodes.len()).filter(|&it| collapsed.degree(it) <= 1).count();
        format!("{} branch nodes and {n_leaves} leaves", collapsed.nodes.len() - n_leaves)
    });
    let why = match ranking.is_complete {
        true => "do not fit: `partial` lets parts stay unmatched",
        false => "were not matched in `max_steps`",
    };
    format!("the source with {source} and the target with {target} {why}")
}

fn notes(ranking: &Ranking, chosen: &SkeletonMatch) -> Vec<String> {
    let mut notes = Vec::new();
    if ranking.is_partial {
        let (n_nodes, n_branches) = (chosen.nodes().len(), chosen.branches().len());
        notes.push(format!(
            "parts may be unmatched: {n_nodes} branch nodes and leaves and {n_branches} branches \
             belong together"
        ));
    }
    if !ranking.is_complete {
        let n_found = ranking.n_found;
        notes.push(format!(
            "the search ended after {n_found} matches: a better one may have been left out"
        ));
    }
    if let [first, second, ..] = &ranking.matches[..] {
        let [best, next] = [first, second].map(|it| it.ratings()[1]);
        if next - best <= 1e-6 * (1.0 + best) {
            notes.push("the best two matches are equally good: limbs may be swapped".to_owned());
        }
    }
    notes
}

fn ranking_table(ranking: &Ranking, source: &Skeleton, target: &Skeleton) -> Table {
    let matches = &ranking.matches;
    let number = |name: &str, of: &dyn Fn(&SkeletonMatch) -> f64| {
        Column::numbers(name, "", matches.iter().map(of).collect())
    };
    let pair = |it: &[u32; 2]| {
        let [a, b] = it.map(|it| it as usize);
        format!("{} = {}", source.names()[a], target.names()[b])
    };
    let pairs = |it: &SkeletonMatch| it.nodes().iter().map(pair).collect::<Vec<_>>().join(", ");
    let ranks = (1..=matches.len()).map(|it| it as f64).collect();
    Table::new(vec![
        Column::numbers("rank", "", ranks),
        number("branches rating", &|it| it.ratings()[0]),
        number("places rating", &|it| it.ratings()[1]),
        number("nodes", &|it| it.nodes().len() as f64),
        number("branches", &|it| it.branches().len() as f64),
        Column::texts("pairs", matches.iter().map(pairs).collect()),
    ])
}
