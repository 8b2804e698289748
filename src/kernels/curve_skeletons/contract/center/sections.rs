//! The middle of a cloud, by its points in sections across a curve.

use nalgebra::Vector2;
use rayon::prelude::*;

use super::super::super::curve_skeleton::CurveSkeleton;
use super::circle_fit::fit_circle;
use super::{Look, Surroundings, View};
use crate::kernels::geometry::mesh::Vec3;

/// How far along the curve nodes are whose points a node may see, in radii of the shape around it.
const NEAR: f64 = 2.0;

/// The most points of a node that are looked at.
const MOST_POINTS: usize = 512;

/// Sections reach so far to both sides of a node, in radii; farther where they have few points.
const HALF_WIDTHS: [f64; 3] = [0.4, 0.6, 0.9];

/// Points that make a section.
const ENOUGH: usize = 32;

/// Points farther than so many radii from a node are of another limb.
const FARTHEST: f64 = 2.0;

/// Parts of a section, which count the same however many points they have: one side of a scan often
/// has more than the other.
const SECTORS: usize = 16;

/// Points in fewer sectors tell no circle.
const FEWEST_SECTORS: usize = 4;

/// The number of sectors that would hold a node in its place as strongly as it is held.
const HOLD: f64 = 0.5;

/// The part of the way to the middle that a step is…
const STEP: f64 = 0.7;

/// …and the most it is, in radii of the circle.
const LONGEST_STEP: f64 = 0.35;

/// The points around the nodes of a curve skeleton.
pub struct Sections {
    /// For every node the points of those that are near along the curve.
    around: Vec<Vec<Vec3>>,
}

impl Sections {
    /// Gathers points by the nodes that they belong to, so that a limb does not see the next one.
    pub fn new(skeleton: &CurveSkeleton, vertices: &[Vec3]) -> Self {
        let groups = skeleton.vertices_of_nodes();
        let neighbors = skeleton.neighbors();
        let points_of = |node: usize| {
            let stride = groups[node].len().div_ceil(MOST_POINTS).max(1);
            groups[node].iter().step_by(stride).map(|&it| vertices[it as usize])
        };
        let nodes = (0..skeleton.n_nodes()).into_par_iter();
        let near = nodes.map(|it| near_along(skeleton, &neighbors, it));
        let around = near.map(|it| it.into_iter().flat_map(points_of).collect()).collect();
        Self { around }
    }
}

/// The nodes that are near along the curves, through no other junction; the node itself first.
fn near_along(skeleton: &CurveSkeleton, neighbors: &[Vec<u32>], start: usize) -> Vec<usize> {
    let places = skeleton.positions();
    let mut found = vec![(start, 0.0)];
    let mut next = 0;
    while let Some(&(node, way)) = found.get(next) {
        next += 1;
        if node != start && neighbors[node].len() > 2 {
            continue;
        }
        for other in neighbors[node].iter().map(|it| *it as usize) {
            let way = way + (places[other] - places[node]).norm();
            let is_near = way <= NEAR * skeleton.radii()[start];
            if is_near && found.iter().all(|it| it.0 != other) {
                found.push((other, way));
            }
        }
    }
    found.into_iter().map(|it| it.0).collect()
}

impl Surroundings for Sections {
    /// The step leads to the middle of a circle through the means of sectors. An arc is enough: points
    /// of one side tell where the limb's axis is.
    fn look(&self, view: &View) -> Option<Look> {
        let [side, other] = view.across();
        let means = sector_means(&section(&self.around[view.node], view, [side, other]));
        if means.len() < FEWEST_SECTORS {
            return None;
        }
        let circle = fit_circle(&means, HOLD)?;
        let step = (circle.center * STEP).cap_magnitude(LONGEST_STEP * circle.radius);
        Some(Look { shift: side * step.x + other * step.y, reach: circle.radius })
    }

    fn is_crossed(&self, _: Vec3, _: Vec3) -> bool {
        false
    }

    fn is_outside(&self, _: Vec3) -> bool {
        false
    }
}

/// The points beside a node, in the plane across the curve.
fn section(points: &[Vec3], view: &View, [side, other]: [Vec3; 2]) -> Vec<Vector2<f64>> {
    let within = |half_width: f64| {
        let arms = points.iter().map(|it| it - view.place);
        let beside = arms.filter(|it| it.dot(&view.along).abs() <= half_width * view.radius);
        beside.map(|it| Vector2::new(it.dot(&side), it.dot(&other))).collect::<Vec<_>>()
    };
    let mut found = Vec::new();
    for half_width in HALF_WIDTHS {
        found = within(half_width);
        if found.len() >= ENOUGH {
            break;
        }
    }
    found.retain(|it| it.norm() < FARTHEST * view.radius);
    found
}

/// The means of the points in every sector that has some.
fn sector_means(points: &[Vector2<f64>]) -> Vec<Vector2<f64>> {
    let mut sums = [(Vector2::zeros(), 0.0); SECTORS];
    for point in points {
        let turns = point.y.atan2(point.x) / std::f64::consts::TAU + 1.0;
        let (sum, count) = &mut sums[(turns * SECTORS as f64) as usize % SECTORS];
        *sum += point;
        *count += 1.0;
    }
    sums.iter().filter(|it| it.1 > 0.0).map(|it| it.0 / it.1).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A flat limb along x, around a line beside its axis, and a thin one next to it.
    #[test]
    fn neither_a_denser_side_nor_the_next_limb_pulls() {
        let nodes = (0..5).map(|it| Vec3::x() * f64::from(it) * 0.5);
        let next = nodes.clone().map(|it| it + Vec3::y() * 1.6);
        let edges = (0..4).flat_map(|it| [[it, it + 1], [it + 5, it + 6]]).collect();
        let (mut points, mut labels) = (Vec::new(), Vec::new());
        for (node, place) in nodes.clone().enumerate() {
            // Twice as many points above as below.
            for degree in (0..180).step_by(10).chain((180..360).step_by(20)) {
                let (sin, cos) = f64::from(degree).to_radians().sin_cos();
                for (limb, [high, wide], off) in [(0, [0.7, 1.2], 0.3), (5, [0.2, 0.2], 1.6)] {
                    points.push(place + Vec3::new(0.0, off + high * sin, wide * cos));
                    labels.push(limb + node as u32);
                }
            }
        }
        let radii = [[1.0; 5], [0.2; 5]].concat();
        let curves = CurveSkeleton::new(nodes.chain(next).collect(), radii, edges, labels).unwrap();
        let view = View {
            node: 2,
            place: curves.positions()[2],
            along: Vec3::x(),
            radius: 1.0,
            last_reach: f64::INFINITY,
        };
        let look = Sections::new(&curves, &points).look(&view).unwrap();
        let expected = Vec3::y() * 0.3 * STEP;
        assert!((look.shift - expected).norm() < 0.03, "{}", look.shift);
        assert!((0.7..1.2).contains(&look.reach), "{}", look.reach);
    }
}
