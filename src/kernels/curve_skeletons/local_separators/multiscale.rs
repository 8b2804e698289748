//! Separators from coarse to fine.

use rayon::prelude::*;

use super::graph::SpatialGraph;
use super::layers::layers;
use super::pack::pack;
use super::scratch::{Mark, Scratch, ScratchPool};
use super::search::{SearchOptions, search};
use super::shrink::{Separator, shrink};
use crate::kernels::geometry::mesh::Vec3;

/// A separator grows from at most so many points (Bærentzen et al. 2023, section 4).
const MAX_SIZE: usize = 64;
/// From so many where a set became too large in the coarser layer already: that one covered more. What
/// it missed is so narrow that the coarser layer had no points for it, and closes early in this one.
const MAX_SIZE_AGAIN: usize = 24;

/// Finds disjoint separators of a graph from coarse to fine (Bærentzen et al. 2023): every layer adds
/// small ones to those that come from the coarser layer, and packs them by the capacity of its points.
///
/// Wide parts are separated where few points stand for many; growing stops early everywhere.
pub fn multiscale(graph: SpatialGraph, options: &SearchOptions) -> Vec<Separator> {
    let mut layers = layers(graph);
    let mut chosen: Vec<Separator> = vec![];
    let mut is_too_large = vec![];
    while let Some(layer) = layers.pop() {
        let mut touched = vec![0; layer.graph.n_points()];
        chosen.iter().flat_map(|it| &it.points).for_each(|&it| touched[it as usize] += 1);
        let max_size = |seed: u32| match is_too_large.get(seed as usize) {
            Some(true) => MAX_SIZE_AGAIN,
            _ => MAX_SIZE,
        };
        let found = search(&layer.graph, touched, &max_size, options);
        chosen.extend(found.separators);
        chosen = pack(chosen, &layer.capacities);
        if let Some(finer) = layers.last() {
            chosen = project(&finer.graph, &layer.coarse_of_fine, chosen);
            is_too_large =
                layer.coarse_of_fine.iter().map(|&it| found.is_too_large[it as usize]).collect();
        }
    }
    chosen
}

/// Separators of the finer layer where those of the coarser one are; some are lost.
fn project(
    graph: &SpatialGraph,
    coarse_of_fine: &[u32],
    separators: Vec<Separator>,
) -> Vec<Separator> {
    let fine_of_coarse = children(coarse_of_fine);
    let scratches = ScratchPool::new(graph.n_points());
    let projected: Vec<Option<Separator>> = separators
        .into_par_iter()
        .map(|separator| {
            let points = separator.points.iter().flat_map(|&it| &fine_of_coarse[it as usize]);
            let points = points.copied().collect();
            scratches.with(|scratch| settle(graph, points, scratch))
        })
        .collect();
    projected.into_iter().flatten().collect()
}

fn children(coarse_of_fine: &[u32]) -> Vec<Vec<u32>> {
    let n_coarse = coarse_of_fine.iter().max().map_or(0, |&it| it as usize + 1);
    let mut children = vec![vec![]; n_coarse];
    for (fine, &coarse) in coarse_of_fine.iter().enumerate() {
        children[coarse as usize].push(fine as u32);
    }
    children
}

/// Thickens a set by a ring on every side, where that keeps the sides apart, and shrinks it: it may be
/// in a better place one ring aside.
fn settle(graph: &SpatialGraph, mut inside: Vec<u32>, scratch: &mut Scratch) -> Option<Separator> {
    if let [end] = inside[..]
        && graph.neighbors(end).len() < 2
    {
        return None;
    }
    let (mut front, n_sides) = surround(graph, &inside, scratch);
    if n_sides < 2 {
        return None;
    }
    for side in 0..n_sides as u32 {
        let n_before = inside.len();
        inside.extend(front.iter().filter(|&&it| scratch.mark(it) == Mark::Side(side)));
        let (wider, n_wider) = surround(graph, &inside, scratch);
        if n_wider == n_sides {
            front = wider;
        } else {
            inside.truncate(n_before);
            front = surround(graph, &inside, scratch).0;
        }
    }
    let center = bounding_sphere_center(graph, &inside);
    shrink(graph, &inside, center, scratch)
}

/// Marks a set and the sides next to it; returns what is next to it, and the number of sides.
fn surround(graph: &SpatialGraph, inside: &[u32], scratch: &mut Scratch) -> (Vec<u32>, usize) {
    scratch.forget();
    inside.iter().for_each(|&it| scratch.put_inside(it));
    let mut front = vec![];
    for &next in inside.iter().flat_map(|&it| graph.neighbors(it)) {
        if scratch.mark(next) == Mark::Unseen {
            scratch.put_side(next, 0);
            front.push(next);
        }
    }
    let n_sides = scratch.label_sides(graph, &front).len();
    (front, n_sides)
}

/// The center of a sphere around points that is little larger than the smallest (Ritter 1990).
fn bounding_sphere_center(graph: &SpatialGraph, points: &[u32]) -> Vec3 {
    let farthest = |from: Vec3| {
        let distances = points.iter().map(|&it| (graph.position(it) - from).norm_squared());
        let far =
            distances.enumerate().fold((0, -1.0), |far, it| if it.1 > far.1 { it } else { far });
        graph.position(points[far.0])
    };
    let one = farthest(graph.position(points[0]));
    let other = farthest(one);
    let mut center = (one + other) * 0.5;
    let mut radius = (one - other).norm() * 0.5;
    for &point in points {
        let offset = graph.position(point) - center;
        let distance = offset.norm();
        if distance > radius {
            radius = 0.5 * (radius + distance);
            center += offset * (1.0 - radius / distance);
        }
    }
    center
}
