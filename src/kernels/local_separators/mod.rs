//! Curve skeletons by local separators.

mod assemble;
mod graph;
mod grow;
mod layers;
mod multiscale;
mod pack;
mod scratch;
mod search;
mod shrink;
#[cfg(test)]
mod tests;

use super::curve_skeleton::CurveSkeleton;

pub use assemble::median_distance;
pub use graph::SpatialGraph;

use search::SearchOptions;
use shrink::Separator;

/// How separators are looked for.
#[derive(Debug, Clone, PartialEq)]
pub struct LocalSeparatorsOptions {
    pub variant: Variant,
    /// Skip seeds with a chance that grows with the number of separators through them.
    pub sampling: bool,
    /// Of the order of the seeds and of the chance.
    pub seed: u64,
}

impl Default for LocalSeparatorsOptions {
    fn default() -> Self {
        Self { variant: Variant::Auto, sampling: true, seed: 0 }
    }
}

/// On what separators are looked for.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Variant {
    /// On the graph up to 2000 points, on coarser ones from there.
    #[default]
    Auto,
    /// On the graph itself. Time grows with the square of its size.
    Plain,
    /// On coarser and coarser graphs, too.
    Multiscale,
}

/// Larger graphs are worth the coarser ones.
const MOST_PLAIN: usize = 2000;

/// Extracts the curve skeleton of a graph: usually the vertices and edges of a surface mesh, but any
/// points will do whose edges lead along the surface.
///
/// A local separator is a set of points whose removal cuts its surroundings into parts, such as a ring
/// around a limb. Many are grown from seeds, thinned, packed so that they do not overlap, and joined
/// where their surroundings touch (Bærentzen & Rotenberg, "Skeletonization via local separators",
/// 2021; with coarser graphs: Bærentzen, Christensen, Gæde & Rotenberg, "Multilevel skeletonization
/// using local separators", 2023).
///
/// Every connected part gets a curve of its own; parts without a narrow place, such as a ball, get none,
/// and their points no node. Curves may have cycles, those of the shape's handles and false ones where
/// four and more curves meet.
pub fn local_separators(graph: &SpatialGraph, options: &LocalSeparatorsOptions) -> CurveSkeleton {
    let is_plain = match options.variant {
        Variant::Auto => graph.n_points() <= MOST_PLAIN,
        Variant::Plain => true,
        Variant::Multiscale => false,
    };
    let separators = if is_plain { plain(graph, options) } else { multiscale(graph, options) };
    assemble::assemble(graph, &separators)
}

fn plain(graph: &SpatialGraph, options: &LocalSeparatorsOptions) -> Vec<Separator> {
    let options =
        SearchOptions { sampling: options.sampling, min_quality: 0.0, seed: options.seed };
    let n_points = graph.n_points();
    let found = search::search(graph, vec![0; n_points], &|_| usize::MAX, &options);
    pack::pack(found.separators, &vec![1; n_points])
}

fn multiscale(graph: &SpatialGraph, options: &LocalSeparatorsOptions) -> Vec<Separator> {
    let options =
        SearchOptions { sampling: options.sampling, min_quality: 0.1, seed: options.seed };
    multiscale::multiscale(graph.clone(), &options)
}
