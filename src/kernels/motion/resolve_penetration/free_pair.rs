//! Two groups of faces in a frame, and the joints that can part them.

use nalgebra::UnitQuaternion;
use rayon::prelude::*;

use super::body::{Body, GroupPose, largest_move};
use crate::kernels::geometry::mesh::Vec3;

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
        let trial = Trial { key: self, pair, rotations, start: self.posed(pair, rotations) };
        if !self.body.pair_crosses(pair, &trial.start) {
            return false;
        }
        let rest = vec![UnitQuaternion::identity(); rotations.len()];
        for towards in [self.safe, &rest] {
            let ways = self.ways(pair, towards);
            let tried: Vec<Option<Way<'_>>> =
                ways.into_par_iter().map(|it| trial.tried(it)).collect();
            let best = tried.into_iter().flatten();
            let best = best.reduce(|a, b| if b.moves < a.moves { b } else { a });
            if let Some(mut way) = best {
                trial.bisect(&mut way, 0.5_f64.powi(ROUGH as i32), FINE);
                let turned = way.turned(rotations);
                rotations.copy_from_slice(&turned);
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

    fn posed(&self, pair: [usize; 2], rotations: &[UnitQuaternion<f64>]) -> [GroupPose; 2] {
        let transforms = self.body.world_from_rest(rotations, self.offsets);
        pair.map(|group| {
            let mut pose = GroupPose::default();
            self.body.pose_group(group, &transforms, &mut pose);
            pose
        })
    }
}

/// Two groups that cross, and ways to part them.
struct Trial<'a> {
    key: &'a Key<'a>,
    pair: [usize; 2],
    rotations: &'a [UnitQuaternion<f64>],
    start: [GroupPose; 2],
}

impl Trial<'_> {
    /// How far a way must be gone, roughly; `None` if it does not help.
    fn tried<'b>(&self, mut way: Way<'b>) -> Option<Way<'b>> {
        let mut poses = self.start.clone();
        let body = self.key.body;
        let follows = self.pair.map(|it| body.follows(it, &way.joints));
        if self.crosses(&way, follows, &mut poses) {
            return None;
        }
        self.bisect(&mut way, 1.0, ROUGH);
        self.pose(&way, follows, &mut poses);
        way.moves = (0..2).map(|it| largest_move(&self.start[it], &poses[it])).fold(0.0, f64::max);
        Some(way)
    }

    /// Looks for the largest free `along` between its value and that and a step more.
    fn bisect(&self, way: &mut Way<'_>, mut step: f64, rounds: usize) {
        let mut poses = self.start.clone();
        let follows = self.pair.map(|it| self.key.body.follows(it, &way.joints));
        for _ in 0..rounds {
            step *= 0.5;
            let before = way.along;
            way.along += step;
            if self.crosses(way, follows, &mut poses) {
                way.along = before;
            }
        }
    }

    fn crosses(&self, way: &Way<'_>, follows: [bool; 2], poses: &mut [GroupPose; 2]) -> bool {
        self.pose(way, follows, poses);
        self.key.body.pair_crosses(self.pair, poses)
    }

    /// Poses the groups that follow joints of the way.
    fn pose(&self, way: &Way<'_>, follows: [bool; 2], poses: &mut [GroupPose; 2]) {
        let turned = way.turned(self.rotations);
        let transforms = self.key.body.world_from_rest(&turned, self.key.offsets);
        for it in (0..2).filter(|&it| follows[it]) {
            self.key.body.pose_group(self.pair[it], &transforms, &mut poses[it]);
        }
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
