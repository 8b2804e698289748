//! Two groups of faces in a frame, and the joints that can part them.

use nalgebra::UnitQuaternion;

use super::body::{Body, GroupPose, largest_move};
use crate::kernels::mesh::Vec3;

/// A frame of a motion.
pub struct Key<'a> {
    pub body: &'a Body<'a>,
    /// Of all joints from their parents.
    pub offsets: &'a [Vec3],
    /// Rotations of the frame before.
    pub safe: &'a [UnitQuaternion<f64>],
    /// Joints that must not be turned.
    pub fixed: Vec<bool>,
}

/// Joints that turn together towards other rotations, as far as needed.
struct Way<'a> {
    joints: Vec<usize>,
    towards: &'a [UnitQuaternion<f64>],
    /// How far a joint may go from there, from 0 to 1.
    along: f64,
    /// How far points of the groups move.
    moves: f64,
}

/// Bisections to compare ways, and those after them for the best.
const ROUGH: usize = 4;
const FINE: usize = 8;

impl Key<'_> {
    /// Turns joints so that two groups do not cross, if there is a way; whether anything was turned.
    pub fn free_pair(&self, pair: [usize; 2], rotations: &mut [UnitQuaternion<f64>]) -> bool {
        let start = pair.map(|it| self.posed(it, rotations));
        if !self.body.pair_crosses(pair, &start) {
            return false;
        }
        let rest = vec![UnitQuaternion::identity(); rotations.len()];
        for towards in [self.safe, &rest] {
            let ways = self.ways(pair, towards).into_iter();
            let tried = ways.filter_map(|it| self.tried(it, pair, &start, rotations));
            let best = tried.reduce(|a, b| if b.moves < a.moves { b } else { a });
            if let Some(mut way) = best {
                let step = 0.5_f64.powi(ROUGH as i32);
                self.bisect(&mut way, pair, rotations, step, FINE);
                rotations.copy_from_slice(&way.turned(rotations));
                return true;
            }
        }
        false
    }

    /// The single joints and the chains from the last common joint to both groups.
    fn ways<'b>(&self, pair: [usize; 2], towards: &'b [UnitQuaternion<f64>]) -> Vec<Way<'b>> {
        let chains = self
            .chains(pair)
            .map(|chain| chain.into_iter().filter(|&it| !self.fixed[it]).collect::<Vec<usize>>());
        let mut sets: Vec<Vec<usize>> = chains.iter().flatten().map(|&it| vec![it]).collect();
        sets.extend(chains.iter().filter(|it| it.len() > 1).cloned());
        sets.push(chains.concat());
        let way = |joints| Way { joints, towards, along: 0.0, moves: 0.0 };
        sets.into_iter().filter(|it| !it.is_empty()).map(way).collect()
    }

    /// The joints below the last common one, down to each of two.
    fn chains(&self, pair: [usize; 2]) -> [Vec<usize>; 2] {
        let parents = self.body.skeleton.parents();
        let up = |joint: usize| {
            let mut path: Vec<usize> =
                std::iter::successors(Some(joint), |&it| parents[it]).collect();
            path.reverse();
            path
        };
        let [a, b] = pair.map(up);
        let n_common = a.iter().zip(&b).take_while(|it| it.0 == it.1).count();
        [a[n_common..].to_vec(), b[n_common..].to_vec()]
    }

    /// How far a way must be gone, roughly; `None` if it does not help.
    fn tried<'b>(
        &self,
        mut way: Way<'b>,
        pair: [usize; 2],
        start: &[GroupPose; 2],
        rotations: &[UnitQuaternion<f64>],
    ) -> Option<Way<'b>> {
        let poses = pair.map(|it| self.posed(it, &way.turned(rotations)));
        if self.body.pair_crosses(pair, &poses) {
            return None;
        }
        self.bisect(&mut way, pair, rotations, 1.0, ROUGH);
        let poses = pair.map(|it| self.posed(it, &way.turned(rotations)));
        way.moves = (0..2).map(|it| largest_move(&start[it], &poses[it])).fold(0.0, f64::max);
        Some(way)
    }

    /// Looks for the largest free `along` between its value and that and a step more.
    fn bisect(
        &self,
        way: &mut Way<'_>,
        pair: [usize; 2],
        rotations: &[UnitQuaternion<f64>],
        mut step: f64,
        rounds: usize,
    ) {
        let free = way.along;
        for _ in 0..rounds {
            step *= 0.5;
            let before = way.along;
            way.along += step;
            let poses = pair.map(|it| self.posed(it, &way.turned(rotations)));
            if self.body.pair_crosses(pair, &poses) {
                way.along = before;
            }
        }
        debug_assert!(way.along >= free);
    }

    fn posed(&self, group: usize, rotations: &[UnitQuaternion<f64>]) -> GroupPose {
        let mut pose = GroupPose::default();
        let transforms = self.body.world_from_rest(rotations, self.offsets);
        self.body.pose_group(group, &transforms, &mut pose);
        pose
    }
}

impl Way<'_> {
    /// The rotations of all joints when those of the way are turned.
    fn turned(&self, rotations: &[UnitQuaternion<f64>]) -> Vec<UnitQuaternion<f64>> {
        let mut res = rotations.to_vec();
        for &joint in &self.joints {
            let from = self.towards[joint];
            let turn = (from.inverse() * rotations[joint]).scaled_axis();
            res[joint] = from * UnitQuaternion::from_scaled_axis(turn * self.along);
        }
        res
    }
}
