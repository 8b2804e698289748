//! How curves pass through their nodes.

use rayon::prelude::*;

use super::super::super::curve_skeleton::CurveSkeleton;

/// How curves pass through a node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Passage {
    /// Not at all, or the node may not move.
    None,
    /// Between two neighbours.
    Between([usize; 2]),
    /// As `Between`, but so near to a junction that what is across is not the limb, but the trunk that
    /// it comes from.
    Root([usize; 2]),
    /// A trunk leads from this neighbour to a junction…
    TrunkEnd(usize),
    /// …or between these on through it.
    Trunk([usize; 2]),
}

/// Nodes of limbs nearer to a junction than so many of its radii are in the trunk.
const ROOT: f64 = 0.75;

/// A trunk goes on in the only curve whose direction has a cosine below this with its own.
const STRAIGHT: f64 = -0.5;

/// How curves pass through all nodes.
///
/// At a junction the widest curve is the trunk. It may go on in one other, as it does where arms leave
/// it, but not where it ends in two legs.
pub fn passages(curves: &CurveSkeleton, neighbors: &[Vec<u32>], is_free: &[bool]) -> Vec<Passage> {
    let own = |node: usize| match neighbors[node][..] {
        _ if !is_free[node] => Passage::None,
        [] | [_] => Passage::None,
        [from, to] => Passage::Between([from as usize, to as usize]),
        _ => trunk(curves, neighbors, node),
    };
    let mut found: Vec<Passage> = (0..curves.n_nodes()).into_par_iter().map(own).collect();
    for junction in curves.junctions() {
        mark_roots(&mut found, curves, neighbors, junction as usize);
    }
    found
}

fn mark_roots(
    found: &mut [Passage],
    curves: &CurveSkeleton,
    neighbors: &[Vec<u32>],
    junction: usize,
) {
    let of_trunk = match found[junction] {
        Passage::TrunkEnd(from) => [from; 2],
        Passage::Trunk(ends) => ends,
        _ => return,
    };
    let place = curves.positions()[junction];
    let is_in_trunk =
        |it: &usize| (curves.positions()[*it] - place).norm() <= ROOT * curves.radii()[junction];
    let limbs = neighbors[junction].iter().map(|it| *it as usize);
    for first in limbs.filter(|it| !of_trunk.contains(it)) {
        for node in Curve::new(neighbors, junction, first).take_while(is_in_trunk) {
            if let Passage::Between(ends) = found[node] {
                found[node] = Passage::Root(ends);
            }
        }
    }
}

fn trunk(curves: &CurveSkeleton, neighbors: &[Vec<u32>], junction: usize) -> Passage {
    let (place, radius) = (curves.positions()[junction], curves.radii()[junction]);
    let around: Vec<usize> = neighbors[junction].iter().map(|it| *it as usize).collect();
    let curve = |&first: &usize| Curve::new(neighbors, junction, first);
    // As seen from a radius away.
    let direction = |first: &usize| {
        let arms = || curve(first).map(|it| curves.positions()[it] - place);
        let arm = arms().find(|it| it.norm() >= radius).or(arms().last());
        arm.unwrap_or_default().try_normalize(0.0).unwrap_or_default()
    };
    let mean_radius = |first: &usize| {
        let count = curve(first).count() as f64;
        curve(first).map(|it| curves.radii()[it]).sum::<f64>() / count
    };
    let widest = around.iter().copied().max_by(|a, b| mean_radius(a).total_cmp(&mean_radius(b)));
    let Some(widest) = widest else { return Passage::None };
    let along = direction(&widest);
    let is_opposite = |it: &&usize| direction(it).dot(&along) < STRAIGHT;
    let opposite: Vec<&usize> = around.iter().filter(is_opposite).collect();
    match opposite[..] {
        [&other] => Passage::Trunk([widest, other]),
        _ => Passage::TrunkEnd(widest),
    }
}

/// The nodes of a curve from a junction on, without this, up to its end.
struct Curve<'a> {
    neighbors: &'a [Vec<u32>],
    start: usize,
    last: usize,
    next: Option<usize>,
}

impl<'a> Curve<'a> {
    fn new(neighbors: &'a [Vec<u32>], start: usize, first: usize) -> Self {
        Self { neighbors, start, last: start, next: Some(first) }
    }
}

impl Iterator for Curve<'_> {
    type Item = usize;

    fn next(&mut self) -> Option<usize> {
        let at = self.next?;
        self.next = match self.neighbors[at][..] {
            [a, b] => {
                let next = if a as usize == self.last { b } else { a } as usize;
                (next != self.start).then_some(next)
            }
            _ => None,
        };
        self.last = at;
        Some(at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::mesh::Vec3;

    /// Passages of three curves of two edges from node 0, which are seen from a radius of 0.5.
    fn passages_of(places: [[f64; 2]; 6], radii: [f64; 3]) -> Vec<Passage> {
        let places = places.iter().map(|it| Vec3::new(it[0], it[1], 0.0));
        let places: Vec<Vec3> = std::iter::once(Vec3::zeros()).chain(places).collect();
        let radii = std::iter::once(0.5).chain(radii.iter().flat_map(|it| [*it; 2])).collect();
        let edges = vec![[0, 1], [1, 2], [0, 3], [3, 4], [0, 5], [5, 6]];
        let curves = CurveSkeleton::new(places, radii, edges, vec![]).unwrap();
        passages(&curves, &curves.neighbors(), &[true; 7])
    }

    #[test]
    fn a_trunk_goes_on_in_the_only_curve_that_is_opposite_from_a_radius_away() {
        // Beside the junction the limb, not the neck, seems to be opposite to the trunk.
        let places = [[-1.0, 0.0], [-2.0, 0.0], [0.0, 0.1], [2.0, 0.0], [0.1, 0.0], [0.0, 2.0]];
        let found = passages_of(places, [0.5, 0.3, 0.2]);
        assert_eq!(found[0], Passage::Trunk([1, 3]));
        assert_eq!(found[1], Passage::Between([0, 2]));
        assert_eq!(found[3], Passage::Between([0, 4]));
        assert_eq!(found[5], Passage::Root([0, 6]));
        assert_eq!([found[2], found[4], found[6]], [Passage::None; 3]);
    }

    #[test]
    fn a_trunk_ends_in_two_legs() {
        let places = [[0.2, -0.9], [0.4, -1.8], [0.0, 0.3], [0.0, 1.5], [-0.1, -0.3], [-0.4, -1.8]];
        let found = passages_of(places, [0.2, 0.5, 0.2]);
        assert_eq!(found[0], Passage::TrunkEnd(3));
        // The one in the trunk; the other leg's is farther away.
        assert_eq!(found[5], Passage::Root([0, 6]));
        assert_eq!(found[1], Passage::Between([0, 2]));
    }
}
