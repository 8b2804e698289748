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
    /// Plain for connected parts of up to 2000 points, multiscale for larger ones.
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
    let parts = graph.parts();
    if parts.len() == 1 {
        return assemble::assemble(graph, &separators(graph, options));
    }
    // Parts by themselves: the coarser graphs of one do not depend on how large others are.
    let found = parts.iter().flat_map(|part| {
        let own = separators(&graph.part(part), options);
        own.into_iter().map(|it| Separator {
            points: it.points.iter().map(|&point| part[point as usize]).collect(),
            quality: it.quality,
        })
    });
    assemble::assemble(graph, &found.collect::<Vec<_>>())
}

fn separators(graph: &SpatialGraph, options: &LocalSeparatorsOptions) -> Vec<Separator> {
    let is_plain = match options.variant {
        Variant::Auto => graph.n_points() <= MOST_PLAIN,
        Variant::Plain => true,
        Variant::Multiscale => false,
    };
    if is_plain { plain(graph, options) } else { multiscale(graph, options) }
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
