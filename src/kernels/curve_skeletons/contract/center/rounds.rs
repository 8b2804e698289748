//! One round of moves to the middle.

use rayon::prelude::*;

use super::super::super::curve_skeleton::CurveSkeleton;
use super::folds::turns_back;
use super::passages::Passage;
use super::{Look, Surroundings, View};
use crate::kernels::geometry::mesh::Vec3;

/// A node whose step would be less than this part of its reach, as those of its neighbours, rests.
const SETTLED: f64 = 0.02;

/// The part of a move that is that of the neighbours, for which curves stay smooth.
const BLEND: f64 = 0.3;

/// How much of its way to the middle of its neighbours, along the curve, a node goes.
const SLIDE: f64 = 0.5;

/// Moves all nodes through which a curve passes once; `looks` is what they saw the last time, and then
/// what they see now.
pub fn moved(
    curves: &CurveSkeleton,
    passages: &[Passage],
    looks: &mut Vec<Option<Look>>,
    shape: &dyn Surroundings,
) -> CurveSkeleton {
    let round = Round { curves, passages, shape };
    let nodes = 0..curves.n_nodes();
    *looks = nodes.clone().into_par_iter().map(|it| round.look(it, looks)).collect();
    let places = nodes.into_par_iter().map(|it| round.moved(it, looks)).collect();
    curves.with_positions(round.without_crossings(places)).expect("moved by finite steps")
}

/// All that moving the nodes once needs to know.
struct Round<'a> {
    curves: &'a CurveSkeleton,
    passages: &'a [Passage],
    shape: &'a dyn Surroundings,
}

impl Round<'_> {
    fn place(&self, node: usize) -> Vec3 {
        self.curves.positions()[node]
    }

    fn look(&self, node: usize, last: &[Option<Look>]) -> Option<Look> {
        let [from, to] = match self.passages[node] {
            Passage::None | Passage::Root(_) => return None,
            Passage::Between(ends) | Passage::Trunk(ends) => ends,
            Passage::TrunkEnd(from) => [from, node],
        };
        let is_settled = |it: Look| it.shift.norm() < SETTLED * it.reach;
        let rests = |it: usize| last[it].map_or(self.passages[it] == Passage::None, is_settled);
        if let Some(look) = last[node]
            && [from, node, to].into_iter().all(rests)
        {
            return Some(Look { shift: Vec3::zeros(), ..look });
        }
        self.shape.look(&View {
            node,
            place: self.place(node),
            along: (self.place(to) - self.place(from)).try_normalize(0.0)?,
            radius: self.curves.radii()[node],
            last_reach: last[node].map_or(f64::INFINITY, |it| it.reach),
        })
    }

    /// Where a node goes: to the middle, unless that folds the curve or is behind the surface.
    fn moved(&self, node: usize, looks: &[Option<Look>]) -> Vec3 {
        let place = self.place(node);
        let step = |it: usize| looks[it].map_or(Vec3::zeros(), |it| it.shift);
        let blended = |[a, b]: [usize; 2]| step(node).lerp(&((step(a) + step(b)) * 0.5), BLEND);
        let middle = |ends: [usize; 2]| (self.place(ends[0]) + self.place(ends[1])) * 0.5;
        let folds = |[a, b]: [usize; 2], new: Vec3| turns_back([self.place(a), new, self.place(b)]);
        let new = match self.passages[node] {
            Passage::None => place,
            Passage::Root(ends) => middle(ends),
            Passage::TrunkEnd(from) => place + blended([from; 2]),
            Passage::Trunk(ends) => place + blended(ends),
            Passage::Between(ends) if folds(ends, place) => middle(ends),
            Passage::Between(ends) => {
                let along = self.place(ends[1]) - self.place(ends[0]);
                let along = along.try_normalize(0.0).unwrap_or_default();
                let slide = along * along.dot(&(middle(ends) - place)) * SLIDE;
                let new = place + blended(ends) + slide;
                if folds(ends, new) { place } else { new }
            }
        };
        if self.shape.is_crossed(place, new) { place } else { new }
    }

    /// The new places, but the ends of edges that would leave the shape, and did not, stay.
    ///
    /// Both ends of an edge move at a time; each alone cannot tell.
    fn without_crossings(&self, mut new: Vec<Vec3>) -> Vec<Vec3> {
        let old = self.curves.positions();
        loop {
            let leaves = |ends: &&[u32; 2]| {
                let [a, b] = ends.map(|it| it as usize);
                let is_moved = new[a] != old[a] || new[b] != old[b];
                is_moved
                    && self.shape.is_crossed(new[a], new[b])
                    && !self.shape.is_crossed(old[a], old[b])
            };
            let found: Vec<&[u32; 2]> = self.curves.edges().par_iter().filter(leaves).collect();
            if found.is_empty() {
                return new;
            }
            found.into_iter().flatten().for_each(|&it| new[it as usize] = old[it as usize]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall at `x = 0`, below `y = 1`, and steps that are the same everywhere.
    struct Wall {
        step: Vec3,
    }

    impl Surroundings for Wall {
        fn look(&self, _: &View) -> Option<Look> {
            Some(Look { shift: self.step, reach: 1.0 })
        }

        fn is_crossed(&self, from: Vec3, to: Vec3) -> bool {
            let share = from.x / (from.x - to.x);
            (from.x < 0.0) != (to.x < 0.0) && from.lerp(&to, share).y < 1.0
        }

        fn is_outside(&self, _: Vec3) -> bool {
            false
        }
    }

    fn moved_once(places: &[[f64; 2]], step: Vec3) -> Vec<Vec3> {
        let places: Vec<Vec3> = places.iter().map(|it| Vec3::new(it[0], it[1], 0.0)).collect();
        let n_nodes = places.len();
        let edges = (1..n_nodes as u32).map(|it| [it - 1, it]).collect();
        let curves = CurveSkeleton::new(places, vec![1.0; n_nodes], edges, vec![]).unwrap();
        let passage = |it: usize| match it > 0 && it + 1 < n_nodes {
            true => Passage::Between([it - 1, it + 1]),
            false => Passage::None,
        };
        let passages: Vec<Passage> = (0..n_nodes).map(passage).collect();
        moved(&curves, &passages, &mut vec![None; n_nodes], &Wall { step }).positions().to_vec()
    }

    #[test]
    fn an_edge_that_would_leave_the_shape_keeps_its_ends() {
        let step = Vec3::x() * 0.2;
        // Over the wall there is nothing to leave.
        let high = moved_once(&[[-0.1, 1.2], [-0.1, 1.5], [-0.1, 1.8], [-0.1, 2.1]], step);
        assert!(high[1].x > 0.0 && high[2].x > 0.0, "{high:?}");
        // Here the first moves over it, too, but its edge to the end, which stays, would not.
        let low = moved_once(&[[-0.1, 0.4], [-0.1, 1.1], [-0.1, 1.8], [-0.1, 2.5]], step);
        assert!(low[1].x == -0.1 && low[2].x > 0.0, "{low:?}");
    }

    #[test]
    fn nodes_that_are_crowded_slide_apart() {
        let line = moved_once(&[[1.0, 0.0], [1.0, 0.2], [1.0, 0.4], [1.0, 2.0]], Vec3::zeros());
        assert!((line[2] - Vec3::new(1.0, 0.75, 0.0)).norm() < 1e-12, "{line:?}");
    }
}
