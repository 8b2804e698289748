//! Contractions until a shape is as thin as curves.

use super::equations::Equations;
use super::rings::Rings;
use super::schedule::{BOX, RingSize, Schedule, cotangent_rows, ring_sizes};
use crate::kernels::geometry::mesh::Vec3;

/// One contraction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// The weight of the Laplacian.
    pub weight: f64,
    /// The mean ring size, in parts of the first.
    pub size_ratio: f64,
    /// The area of all triangles, in parts of the first.
    pub area_ratio: f64,
}

/// Why contractions ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stop {
    /// The area is as small as was asked.
    Thin,
    /// Rings hardly became smaller.
    Settled,
    /// The most contractions were made.
    Iterations,
    /// The system had no solution in floating-point numbers; the last step was not taken.
    Unsolvable,
    /// The shape or its rings grew; the last step was taken back.
    Unstable,
}

/// A contracted shape.
#[derive(Debug, Clone, PartialEq)]
pub struct Contraction {
    /// In the unit of the input.
    pub positions: Vec<Vec3>,
    pub steps: Vec<Step>,
    pub stop: Stop,
}

/// A shape whose box grows by more than this since the beginning is unstable (Cao et al. 2010)…
const MOST_BOX: f64 = 1.2;

/// …and one whose rings grow by more than this in one step.
const MOST_RINGS: f64 = 1.05;

/// Draws the points of a connected shape together, again and again, so that what is left has hardly
/// any area: least squares between a small Laplacian and staying in place, in which points of small
/// rings are held more strongly (Au et al. 2008; for clouds Cao et al. 2010).
///
/// Rings are those of the input throughout; their weights are computed anew every time. Of unstable
/// steps the last good state is returned.
pub fn contract(rings: &Rings, positions: &[Vec3], schedule: &Schedule) -> Contraction {
    let (middle, scale) = frame(positions);
    let mut state: Vec<Vec3> = positions.iter().map(|it| (it - middle) * scale).collect();
    let first_area = rings.area(&state);
    let first_sizes = ring_sizes(rings, &state, schedule.ring_size);
    let first_size = mean_size(&first_sizes, schedule.ring_size);
    let first_extent = extent(&state);
    let first_edge = rings.mean_edge(&state);
    let mut weight = schedule.first_weight / first_edge.max(f64::MIN_POSITIVE);
    let mut anchors = vec![1.0; state.len()];
    let mut equations = Equations::new(rings);
    let mut steps: Vec<Step> = Vec::new();
    let mut stop = Stop::Iterations;
    for _ in 0..schedule.max_iterations {
        let mut rows = cotangent_rows(rings, &state, first_edge);
        rows.iter_mut().for_each(|it| *it *= weight);
        let Some(displacements) = equations.solve(&rows, &anchors, &state) else {
            stop = Stop::Unsolvable;
            break;
        };
        let next: Vec<Vec3> = state.iter().zip(&displacements).map(|(p, d)| p + d).collect();
        let sizes = ring_sizes(rings, &next, schedule.ring_size);
        let step = Step {
            weight,
            size_ratio: mean_size(&sizes, schedule.ring_size) / first_size,
            area_ratio: rings.area(&next) / first_area,
        };
        let before = steps.last().map_or(1.0, |it| it.size_ratio);
        let has_grown = step.size_ratio > MOST_RINGS * before;
        if has_grown || extent(&next) > MOST_BOX * first_extent {
            stop = Stop::Unstable;
            break;
        }
        state = next;
        steps.push(step);
        if step.area_ratio < schedule.least_area {
            stop = Stop::Thin;
            break;
        }
        if before - step.size_ratio < schedule.least_gain {
            stop = Stop::Settled;
            break;
        }
        weight = (weight * schedule.growth).min(schedule.most_weight);
        for ((anchor, size), first) in anchors.iter_mut().zip(&sizes).zip(&first_sizes) {
            *anchor = (first / size).min(schedule.most_anchor);
        }
    }
    let positions = state.iter().map(|it| it / scale + middle).collect();
    Contraction { positions, steps, stop }
}

/// The middle of the box, and what makes its longest side the one that weights are made for.
fn frame(positions: &[Vec3]) -> (Vec3, f64) {
    let (low, high) = bounds(positions);
    let side = (high - low).max();
    ((low + high) * 0.5, if side > 0.0 { BOX / side } else { 1.0 })
}

fn extent(positions: &[Vec3]) -> f64 {
    let (low, high) = bounds(positions);
    (high - low).norm()
}

fn bounds(positions: &[Vec3]) -> (Vec3, Vec3) {
    let first = positions[0];
    positions.iter().fold((first, first), |(low, high), it| (low.inf(it), high.sup(it)))
}

fn mean_size(sizes: &[f64], kind: RingSize) -> f64 {
    let total: f64 = match kind {
        // Areas add up; the root of the mean is a length.
        RingSize::Area => {
            return (sizes.iter().map(|it| it * it).sum::<f64>() / sizes.len() as f64).sqrt();
        }
        RingSize::ShortestEdge => sizes.iter().sum(),
    };
    total / sizes.len() as f64
}
