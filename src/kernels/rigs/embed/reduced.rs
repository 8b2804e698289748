//! The joints that are matched: ends and branchings of a skeleton.

use crate::kernels::geometry::mesh::Vec3;

/// A skeleton under work: one tree, no bone without length.
#[derive(Debug, Clone)]
pub struct Working {
    /// The joint of the given skeleton, for every joint here. Parents come first.
    pub joints: Vec<usize>,
    pub parents: Vec<Option<usize>>,
    /// In the frame of the target, but for a shift.
    pub positions: Vec<Vec3>,
}

/// Bones up to this length, where bodies are 0.9 large, have none: their joints become one.
const ZERO_LENGTH: f64 = 1e-4;

impl Working {
    /// Joins joints at the same place to the first of them. Returns also the joint here that every
    /// given joint became part of.
    pub fn new(parents: &[Option<usize>], positions: &[Vec3]) -> (Self, Vec<usize>) {
        let mut res = Self { joints: vec![], parents: vec![], positions: vec![] };
        let mut new_of_old: Vec<usize> = Vec::with_capacity(parents.len());
        for (joint, parent) in parents.iter().enumerate() {
            let parent = parent.map(|it| new_of_old[it]);
            let at_parent =
                parent.filter(|&it| (positions[joint] - res.positions[it]).norm() <= ZERO_LENGTH);
            new_of_old.push(at_parent.unwrap_or(res.joints.len()));
            if at_parent.is_none() {
                res.joints.push(joint);
                res.parents.push(parent);
                res.positions.push(positions[joint]);
            }
        }
        (res, new_of_old)
    }

    pub fn n(&self) -> usize {
        self.joints.len()
    }

    pub fn children(&self) -> Vec<Vec<usize>> {
        let mut children = vec![Vec::new(); self.n()];
        for (child, parent) in self.parents.iter().enumerate() {
            if let Some(parent) = parent {
                children[*parent].push(child);
            }
        }
        children
    }

    /// The tree without a joint and everything below it.
    pub fn without(&self, removed: usize) -> Self {
        let mut is_gone = vec![false; self.n()];
        let mut new_of_old = vec![usize::MAX; self.n()];
        let mut res = Self { joints: vec![], parents: vec![], positions: vec![] };
        for joint in 0..self.n() {
            let parent = self.parents[joint];
            is_gone[joint] = joint == removed || parent.is_some_and(|it| is_gone[it]);
            if !is_gone[joint] {
                new_of_old[joint] = res.n();
                res.joints.push(self.joints[joint]);
                res.parents.push(parent.map(|it| new_of_old[it]));
                res.positions.push(self.positions[joint]);
            }
        }
        res
    }
}

impl Working {
    /// The tree without one joint, whose children hang on its parent then. The root stays.
    pub fn without_only(&self, removed: usize) -> Self {
        let Some(heir) = self.parents[removed] else { return self.clone() };
        let kept: Vec<usize> = (0..self.n()).filter(|&it| it != removed).collect();
        let new_of_old = |it: usize| it - usize::from(it > removed);
        let parent = |it: usize| if it == removed { heir } else { it };
        Self {
            joints: kept.iter().map(|&it| self.joints[it]).collect(),
            parents: kept
                .iter()
                .map(|&it| self.parents[it].map(|it| new_of_old(parent(it))))
                .collect(),
            positions: kept.iter().map(|&it| self.positions[it]).collect(),
        }
    }
}

/// The root, the ends and the branchings, with the chains of bones between them. Joints are in depth
/// first order, so parents come first.
#[derive(Debug, Clone)]
pub struct Reduced {
    /// The joint of the working skeleton.
    pub joints: Vec<usize>,
    pub parents: Vec<Option<usize>>,
    pub children: Vec<Vec<usize>>,
    pub positions: Vec<Vec3>,
    /// What leads from the parent to every joint; empty for the root.
    pub chains: Vec<Chain>,
    /// The last common ancestor of every pair of joints, `n x n`.
    ancestors: Vec<usize>,
}

/// The bones between a reduced joint and its parent, from the parent on.
#[derive(Debug, Clone, Default)]
pub struct Chain {
    /// The working joints at the ends of the bones; the last is the reduced joint.
    pub joints: Vec<usize>,
    pub bones: Vec<Vec3>,
    /// How much of the chain's length lies before the end of every bone; the last is 1.
    pub fractions: Vec<f64>,
    pub length: f64,
}

impl Reduced {
    pub fn new(working: &Working) -> Self {
        let children = working.children();
        let mut res = Self {
            joints: vec![0],
            parents: vec![None],
            children: vec![vec![]],
            positions: vec![working.positions[0]],
            chains: vec![Chain::default()],
            ancestors: vec![],
        };
        // Reversed, so that the first child is taken first.
        let mut stack: Vec<(usize, usize)> =
            children[0].iter().rev().map(|&child| (0, child)).collect();
        while let Some((parent, first)) = stack.pop() {
            let mut chain = vec![first];
            let mut end = first;
            while let [only] = children[end][..] {
                chain.push(only);
                end = only;
            }
            let joint = res.n();
            res.joints.push(end);
            res.parents.push(Some(parent));
            res.children.push(vec![]);
            res.children[parent].push(joint);
            res.positions.push(working.positions[end]);
            res.chains.push(Chain::new(working, res.joints[parent], chain));
            stack.extend(children[end].iter().rev().map(|&child| (joint, child)));
        }
        res.ancestors = res.common_ancestors();
        res
    }

    pub fn n(&self) -> usize {
        self.joints.len()
    }

    pub fn is_leaf(&self, joint: usize) -> bool {
        self.children[joint].is_empty()
    }

    pub fn common_ancestor(&self, a: usize, b: usize) -> usize {
        self.ancestors[a * self.n() + b]
    }

    fn common_ancestors(&self) -> Vec<usize> {
        let n = self.n();
        let mut res = vec![0; n * n];
        for a in 0..n {
            for b in 0..=a {
                // A parent has a smaller index than its children.
                let common = match self.parents[a] {
                    _ if a == b => a,
                    Some(parent) => res[parent * n + b],
                    None => 0,
                };
                res[a * n + b] = common;
                res[b * n + a] = common;
            }
        }
        res
    }
}

impl Chain {
    fn new(working: &Working, from: usize, joints: Vec<usize>) -> Self {
        let mut previous = working.positions[from];
        let mut bones = Vec::with_capacity(joints.len());
        for &joint in &joints {
            bones.push(working.positions[joint] - previous);
            previous = working.positions[joint];
        }
        let length: f64 = bones.iter().map(|it| it.norm()).sum();
        let mut sum = 0.0;
        let mut fractions: Vec<f64> = bones
            .iter()
            .map(|it| {
                sum += it.norm();
                sum / length
            })
            .collect();
        *fractions.last_mut().expect("a chain has a bone") = 1.0;
        Self { joints, bones, fractions, length }
    }
}

/// Places along a polyline, at fractions of its length.
pub fn along(polyline: &[Vec3], fractions: &[f64]) -> Vec<Vec3> {
    let length: f64 = polyline.windows(2).map(|it| (it[1] - it[0]).norm()).sum();
    let mut segment = 0;
    let mut before = 0.0;
    let at = |&fraction: &f64| {
        let wanted = fraction * length;
        while segment + 2 < polyline.len() {
            let step = (polyline[segment + 1] - polyline[segment]).norm();
            if before + step >= wanted {
                break;
            }
            before += step;
            segment += 1;
        }
        let Some(ends) = polyline.get(segment..segment + 2) else { return polyline[0] };
        let step = (ends[1] - ends[0]).norm();
        let share = if step > 0.0 { ((wanted - before) / step).clamp(0.0, 1.0) } else { 0.0 };
        ends[0] + (ends[1] - ends[0]) * share
    };
    fractions.iter().map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A root with a doubled joint, a chain of two bones, a branching with two ends.
    fn working() -> (Working, Vec<usize>) {
        let parents = [None, Some(0), Some(1), Some(2), Some(3), Some(3)];
        let places = [(0.0, 0.0), (0.0, 0.0), (1.0, 0.0), (3.0, 0.0), (4.0, 1.0), (4.0, -1.0)];
        let positions: Vec<Vec3> = places.iter().map(|it| Vec3::new(it.0, it.1, 0.0)).collect();
        Working::new(&parents, &positions)
    }

    #[test]
    fn joints_at_one_place_become_one_and_chains_are_joined() {
        let (working, new_of_old) = working();
        assert_eq!(new_of_old, [0, 0, 1, 2, 3, 4]);
        let reduced = Reduced::new(&working);
        assert_eq!(reduced.joints, [0, 2, 3, 4]);
        assert_eq!(reduced.parents, [None, Some(0), Some(1), Some(1)]);
        assert_eq!(reduced.chains[1].fractions, [1.0 / 3.0, 1.0]);
        assert_eq!(reduced.chains[1].length, 3.0);
        let common = |a, b| reduced.common_ancestor(a, b);
        assert_eq!((common(2, 3), common(3, 1), common(0, 3), common(2, 2)), (1, 1, 0, 2));
    }

    #[test]
    fn without_an_end_the_branching_is_none() {
        let (working, _) = working();
        let reduced = Reduced::new(&working.without(4));
        assert_eq!(reduced.joints, [0, 3]);
        assert_eq!(reduced.chains[1].bones.len(), 3);
        assert_eq!(working.without(1).n(), 1);
    }

    #[test]
    fn the_children_of_a_joint_that_is_given_up_hang_on_its_parent() {
        let (working, _) = working();
        let smaller = working.without_only(2);
        assert_eq!(smaller.joints, [0, 2, 4, 5]);
        assert_eq!(smaller.parents, [None, Some(0), Some(1), Some(1)]);
        assert_eq!(working.without_only(4).joints, [0, 2, 3, 4]);
        assert_eq!(working.without_only(0).n(), 5);
    }

    #[test]
    fn places_along_a_polyline() {
        let line = [Vec3::zeros(), Vec3::x(), Vec3::x() + Vec3::y()];
        let places = along(&line, &[0.0, 0.25, 0.75, 1.0]);
        let expected = [[0.0, 0.0], [0.5, 0.0], [1.0, 0.5], [1.0, 1.0]];
        for (place, [x, y]) in places.iter().zip(expected) {
            assert!((place - Vec3::new(x, y, 0.0)).norm() < 1e-15);
        }
        assert_eq!(along(&[Vec3::y()], &[0.3, 1.0]), [Vec3::y(); 2]);
    }
}
