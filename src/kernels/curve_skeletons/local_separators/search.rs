//! Separators from many seeds.

use rayon::prelude::*;

use super::graph::SpatialGraph;
use super::grow::{NoGrowth, grow};
use super::scratch::{Scratch, ScratchPool};
use super::shrink::{Separator, shrink};
use crate::kernels::numerics::random::Random;

/// How separators of one graph are looked for.
#[derive(Debug, Clone, PartialEq)]
pub struct SearchOptions {
    /// Skip seeds with a chance that grows with the number of separators through them.
    pub sampling: bool,
    /// Leave out separators of less quality.
    pub min_quality: f64,
    pub seed: u64,
}

/// What a search found.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    pub separators: Vec<Separator>,
    /// For every point whether a set that grew from there became too large.
    pub is_too_large: Vec<bool>,
}

/// So many seeds are tried at a time, on any number of threads: how often a point was touched is
/// counted in between.
const BATCH: usize = 64;

/// Looks for separators from all seeds in a random order; with `sampling`, a seed that `k` separators
/// go through is tried with the probability `2^-k` (Bærentzen & Rotenberg 2021, section 3.2).
///
/// `touched` tells for every point how many separators are known to go through it, `max_size` how many
/// points a set that grows from there may have.
pub fn search(
    graph: &SpatialGraph,
    mut touched: Vec<u32>,
    max_size: &(dyn Fn(u32) -> usize + Sync),
    options: &SearchOptions,
) -> Found {
    let n_points = graph.n_points();
    let scratches = ScratchPool::new(n_points);
    let mut random = Random::stream(options.seed, "local_separators");
    let mut order: Vec<u32> = (0..n_points as u32).collect();
    random.shuffle(&mut order);
    let mut seeds = order.into_iter();
    let mut res = Found { separators: vec![], is_too_large: vec![false; n_points] };
    loop {
        let is_tried = |seed: &u32| {
            let chance = 0.5_f64.powi(touched[*seed as usize].min(1000) as i32);
            !options.sampling || random.uniform() < chance
        };
        let batch: Vec<u32> = seeds.by_ref().filter(is_tried).take(BATCH).collect();
        if batch.is_empty() {
            return res;
        }
        let tried: Vec<Result<Option<Separator>, NoGrowth>> = batch
            .par_iter()
            .map(|&seed| scratches.with(|scratch| separator(graph, seed, max_size(seed), scratch)))
            .collect();
        for (seed, tried) in batch.into_iter().zip(tried) {
            match tried {
                Ok(Some(found)) if found.quality >= options.min_quality => {
                    found.points.iter().for_each(|&it| touched[it as usize] += 1);
                    res.separators.push(found);
                }
                Err(NoGrowth::TooLarge) => res.is_too_large[seed as usize] = true,
                _ => {}
            }
        }
    }
}

/// Grows and shrinks a separator from one seed. The end of a curve separates by itself.
fn separator(
    graph: &SpatialGraph,
    seed: u32,
    max_size: usize,
    scratch: &mut Scratch,
) -> Result<Option<Separator>, NoGrowth> {
    match graph.neighbors(seed).len() {
        0 => Ok(None),
        1 => Ok(Some(Separator { points: vec![seed], quality: 1.0 })),
        _ => {
            let growth = grow(graph, seed, max_size, scratch)?;
            Ok(shrink(graph, &growth.inside, growth.center, scratch))
        }
    }
}
