//! A mesh with what moves it, as it comes from one file.

use std::collections::HashMap;

use nalgebra::UnitQuaternion;

use crate::kernels::{
    geometry::mesh::{TriMesh, Vec3},
    rigs::{clip::Clip, skeleton::Skeleton, weights::SkinWeights},
};

/// What a file holds: a mesh, and a rig if there is one.
#[derive(Debug, Clone, PartialEq)]
pub struct Character {
    pub mesh: TriMesh,
    pub skeleton: Option<Skeleton>,
    /// `V x Q`, present whenever the skeleton is.
    pub weights: Option<SkinWeights>,
    /// Clips of the skeleton.
    pub clips: Vec<Clip>,
    /// What a reader left out or mended, for the user.
    pub notes: Vec<String>,
}

impl Character {
    pub fn of_mesh(mesh: TriMesh) -> Self {
        Self { mesh, skeleton: None, weights: None, clips: Vec::new(), notes: Vec::new() }
    }

    /// Keeps the joints that deform the mesh, as one tree.
    ///
    /// Rigs made for keyframing carry control bones: pole targets that move nothing, and inverse
    /// kinematics handles that stand beside the tree although the feet hang on them. In this order:
    ///
    /// 1. the tree is the one whose joints carry the most weight;
    /// 2. of every other root, the children that carry weight are hung on the joint of the tree that
    ///    is nearest at rest among those with weight (the root itself, if it has no such children);
    /// 3. joints are dropped if nothing in their subtree carries weight.
    ///
    /// The weight of a dropped joint goes to the nearest joint of what remains of its subtree, or
    /// else of the whole tree. World motion of the joints that stay is unchanged. Does nothing
    /// without a skeleton.
    ///
    /// `which` tells of other starts of the tree, and of roots that are joints themselves.
    pub fn keep_core_joints(&mut self, which: CoreJoints) {
        let (Some(skeleton), Some(weights)) = (&self.skeleton, &self.weights) else { return };
        let core = Core::of(skeleton, weights, which);
        let new_of_old: HashMap<usize, u32> =
            core.kept.iter().enumerate().map(|(new, &old)| (old, new as u32)).collect();
        let n_dropped = skeleton.n_joints() - core.kept.len();
        if n_dropped == 0 && core.parents == skeleton.parents() {
            return;
        }
        let names = core.kept.iter().map(|&it| skeleton.names()[it].clone()).collect();
        let parents: Vec<_> = core
            .kept
            .iter()
            .map(|&it| core.parents[it].map(|parent| new_of_old[&parent] as usize))
            .collect();
        let positions = core.kept.iter().map(|&it| skeleton.positions()[it]).collect();
        let heir_of: Vec<u32> =
            (0..skeleton.n_joints()).map(|it| new_of_old[&core.heir(skeleton, it)]).collect();
        let rows: Vec<Vec<(u32, f64)>> = (0..weights.n_vertices())
            .map(|it| weights.row(it).map(|(j, w)| (heir_of[j as usize], w)).collect())
            .collect();
        let weights = SkinWeights::from_rows(core.kept.len(), &rows).expect("sums are unchanged");
        for clip in &mut self.clips {
            *clip = reparented(clip, skeleton.parents(), &core.kept, &parents);
        }
        if n_dropped > 0 {
            let note = format!("{n_dropped} of {} joints are no core joints", skeleton.n_joints());
            self.notes.push(note);
        }
        let skeleton = Skeleton::new(names, parents, positions).expect("a part of a skeleton");
        (self.skeleton, self.weights) = (Some(skeleton), Some(weights));
    }
}

/// What counts as a joint that deforms the mesh.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct CoreJoints {
    /// The tree starts below a root without weight that has a single child: it often stands on the floor, outside
    /// of the body.
    pub no_loose_root: bool,
    /// Other roots that carry weight are hung on the tree themselves, with their children.
    pub skinned_roots: bool,
}

impl CoreJoints {
    pub const DEFORMING: Self = Self { no_loose_root: true, skinned_roots: false };
    pub const SKINNED: Self = Self { no_loose_root: true, skinned_roots: true };
}

/// Which joints stay, and where they hang.
struct Core {
    /// Old indices, parents first.
    kept: Vec<usize>,
    /// By old index, old indices; only right for joints that stay.
    parents: Vec<Option<usize>>,
}

impl Core {
    fn of(skeleton: &Skeleton, weights: &SkinWeights, which: CoreJoints) -> Self {
        let n_joints = skeleton.n_joints();
        let mut own = vec![0.0; n_joints];
        for vertex in 0..weights.n_vertices() {
            for (joint, value) in weights.row(vertex) {
                own[joint as usize] += value;
            }
        }
        let mut parents = skeleton.parents().to_vec();
        let mut below = own.clone();
        for (parent, child) in skeleton.bones().collect::<Vec<_>>().into_iter().rev() {
            below[parent] += below[child];
        }
        let mut root_of: Vec<usize> = (0..n_joints).collect();
        for (parent, child) in skeleton.bones() {
            root_of[child] = root_of[parent];
        }
        let roots = || (0..n_joints).filter(|&it| skeleton.parents()[it].is_none());
        // The first of equals, so that a rig without any difference keeps its first tree.
        let root = roots().rev().max_by(|&a, &b| below[a].total_cmp(&below[b])).unwrap_or(0);
        let mut dropped: Vec<bool> = below.iter().map(|&it| it == 0.0).collect();
        dropped[root] = false;
        let children = skeleton.children();
        let tree: Vec<usize> =
            (0..n_joints).filter(|&it| root_of[it] == root && own[it] > 0.0).collect();
        for other in roots().filter(|&it| it != root && below[it] > 0.0) {
            let is_joint = which.skinned_roots && own[other] > 0.0;
            let is_hung = |it: &usize| !is_joint && below[*it] > 0.0;
            let hung: Vec<usize> = children[other].iter().copied().filter(is_hung).collect();
            dropped[other] = !hung.is_empty();
            for joint in if hung.is_empty() { vec![other] } else { hung } {
                parents[joint] = nearest(skeleton, joint, tree.iter().copied()).or(Some(root));
            }
        }
        let mut first = root;
        while which.no_loose_root && own[first] == 0.0 {
            let below_first = |it: &usize| parents[*it] == Some(first) && !dropped[*it];
            let [child] = (0..n_joints).filter(below_first).collect::<Vec<_>>()[..] else { break };
            dropped[first] = true;
            parents[child] = None;
            first = child;
        }
        Self { kept: ordered(&parents, &dropped), parents }
    }

    /// The joint that takes the weight of `joint`.
    fn heir(&self, skeleton: &Skeleton, joint: usize) -> usize {
        if self.kept.contains(&joint) {
            return joint;
        }
        let below = self.kept.iter().copied().filter(|&it| is_below(skeleton, it, joint));
        nearest(skeleton, joint, below)
            .or_else(|| nearest(skeleton, joint, self.kept.iter().copied()))
            .expect("the root stays")
    }
}

/// Sorts joints so that parents come first, otherwise in their old order.
fn ordered(parents: &[Option<usize>], dropped: &[bool]) -> Vec<usize> {
    let mut res = Vec::new();
    let mut placed = vec![false; parents.len()];
    loop {
        let before = res.len();
        for joint in (0..parents.len()).filter(|&it| !dropped[it]) {
            if !placed[joint] && parents[joint].is_none_or(|it| placed[it]) {
                placed[joint] = true;
                res.push(joint);
            }
        }
        if res.len() == before {
            return res;
        }
    }
}

fn is_below(skeleton: &Skeleton, joint: usize, ancestor: usize) -> bool {
    std::iter::successors(Some(joint), |&it| skeleton.parents()[it]).any(|it| it == ancestor)
}

fn nearest(
    skeleton: &Skeleton,
    joint: usize,
    candidates: impl Iterator<Item = usize>,
) -> Option<usize> {
    let at = skeleton.positions();
    let distance = |it: &usize| (at[*it] - at[joint]).norm();
    candidates.min_by(|a, b| distance(a).total_cmp(&distance(b)))
}

/// The clip of some of the joints with other parents: world motion stays, local motion changes.
fn reparented(
    clip: &Clip,
    old_parents: &[Option<usize>],
    kept: &[usize],
    parents: &[Option<usize>],
) -> Clip {
    let mut res = Clip {
        name: clip.name.clone(),
        frames_per_second: clip.frames_per_second,
        n_joints: kept.len(),
        rotations: Vec::new(),
        translations: Vec::new(),
    };
    for frame in 0..clip.n_frames() {
        let (rotations, positions) = world_frames(clip, old_parents, frame);
        let rotations: Vec<_> = kept.iter().map(|&it| rotations[it]).collect();
        let positions: Vec<_> = kept.iter().map(|&it| positions[it]).collect();
        push_local_frames(&mut res, parents, &rotations, &positions);
    }
    res
}

/// `world_from_joint` of one frame: rotations and positions.
pub(super) fn world_frames(
    clip: &Clip,
    parents: &[Option<usize>],
    frame: usize,
) -> (Vec<UnitQuaternion<f64>>, Vec<Vec3>) {
    let mut rotations: Vec<UnitQuaternion<f64>> = Vec::with_capacity(clip.n_joints);
    let mut positions: Vec<Vec3> = Vec::with_capacity(clip.n_joints);
    for joint in 0..clip.n_joints {
        let rotation = clip.rotations[frame * clip.n_joints + joint];
        let translation = clip.translations[frame * clip.n_joints + joint];
        let (rotation, position) = match parents[joint] {
            None => (rotation, translation),
            Some(it) => (rotations[it] * rotation, positions[it] + rotations[it] * translation),
        };
        rotations.push(rotation);
        positions.push(position);
    }
    (rotations, positions)
}

/// Adds a frame, given `world_from_joint`.
pub(super) fn push_local_frames(
    clip: &mut Clip,
    parents: &[Option<usize>],
    rotations: &[UnitQuaternion<f64>],
    positions: &[Vec3],
) {
    for (joint, &parent) in parents.iter().enumerate() {
        let (rotation, translation) = match parent {
            None => (rotations[joint], positions[joint]),
            Some(parent) => {
                let parent_from_world = rotations[parent].inverse();
                (
                    parent_from_world * rotations[joint],
                    parent_from_world * (positions[joint] - positions[parent]),
                )
            }
        };
        clip.rotations.push(rotation);
        clip.translations.push(translation);
    }
}

/// `name`, or `name_2`, `name_3`, ... if it is taken; takes it.
pub(super) fn unique_name(taken: &mut std::collections::BTreeSet<String>, name: &str) -> String {
    let mut res = name.to_owned();
    let mut number = 2;
    while !taken.insert(res.clone()) {
        res = format!("{name}_{number}");
        number += 1;
    }
    res
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A spine with a leg; a foot that hangs on a handle beside the tree; a pole target.
    fn rigged() -> Character {
        let at = |x: f64, y: f64| Vec3::new(x, y, 0.0);
        let joints = [
            ("root", None, at(0.0, 0.0)),
            ("spine", Some(0), at(0.0, 2.0)),
            ("leg", Some(1), at(1.0, 1.0)),
            ("pole", Some(0), at(5.0, 0.0)),
            ("handle", None, at(1.0, 0.2)),
            ("foot", Some(4), at(1.0, 0.1)),
        ];
        let skeleton = Skeleton::new(
            joints.iter().map(|it| it.0.to_owned()).collect(),
            joints.iter().map(|it| it.1).collect(),
            joints.iter().map(|it| it.2).collect(),
        )
        .unwrap();
        let rows = [vec![(1, 1.0)], vec![(2, 1.0)], vec![(2, 0.5), (4, 0.5)], vec![(5, 1.0)]];
        let vertices = vec![at(0.0, 2.0), at(1.0, 1.0), at(1.0, 0.5), at(1.0, 0.0)];
        let mut clip = Clip {
            name: "step".to_owned(),
            frames_per_second: 30.0,
            n_joints: 6,
            rotations: vec![],
            translations: vec![],
        };
        let turned = UnitQuaternion::from_scaled_axis(Vec3::new(0.0, 0.3, 0.4));
        let positions: Vec<_> = joints.iter().map(|it| it.2 + Vec3::z()).collect();
        push_local_frames(&mut clip, skeleton.parents(), &[turned; 6], &positions);
        Character {
            mesh: TriMesh::new(vertices, vec![[0, 1, 2], [1, 2, 3]]).unwrap(),
            weights: Some(SkinWeights::from_rows(6, &rows).unwrap()),
            skeleton: Some(skeleton),
            clips: vec![clip],
            notes: vec![],
        }
    }

    #[test]
    fn core_joints_are_one_tree_that_moves_as_before() {
        let mut character = rigged();
        character.keep_core_joints(CoreJoints::default());
        let (skeleton, weights) = (character.skeleton.unwrap(), character.weights.unwrap());
        assert_eq!(skeleton.names(), ["root", "spine", "leg", "foot"]);
        assert_eq!(skeleton.parents(), [None, Some(0), Some(1), Some(2)]);
        assert_eq!(weights.row(2).collect::<Vec<_>>(), [(2, 0.5), (3, 0.5)]);
        let (rotations, positions) = world_frames(&character.clips[0], skeleton.parents(), 0);
        let original = rigged();
        let parents = original.skeleton.unwrap().parents().to_vec();
        let (before, before_at) = world_frames(&original.clips[0], &parents, 0);
        for (new, old) in [0, 1, 2, 5].into_iter().enumerate() {
            assert!(rotations[new].angle_to(&before[old]) < 1e-7);
            assert!((positions[new] - before_at[old]).norm() < 1e-12);
        }
        assert_eq!(character.notes, ["2 of 6 joints are no core joints"]);
    }

    #[test]
    fn a_loose_root_is_dropped_on_demand() {
        let mut character = rigged();
        character.keep_core_joints(CoreJoints::DEFORMING);
        let skeleton = character.skeleton.unwrap();
        assert_eq!(skeleton.names(), ["spine", "leg", "foot"]);
        assert_eq!(skeleton.parents(), [None, Some(0), Some(1)]);
        let (_, positions) = world_frames(&character.clips[0], skeleton.parents(), 0);
        assert!((positions[0] - Vec3::new(0.0, 2.0, 1.0)).norm() < 1e-12);
    }

    #[test]
    fn a_handle_with_weight_is_an_ankle_on_demand() {
        let mut character = rigged();
        character.keep_core_joints(CoreJoints::SKINNED);
        let (skeleton, weights) = (character.skeleton.unwrap(), character.weights.unwrap());
        assert_eq!(skeleton.names(), ["spine", "leg", "handle", "foot"]);
        assert_eq!(skeleton.parents(), [None, Some(0), Some(1), Some(2)]);
        assert_eq!(weights.row(2).collect::<Vec<_>>(), [(1, 0.5), (2, 0.5)]);
    }

    #[test]
    fn names_are_made_unique() {
        let mut taken = Default::default();
        let names = ["a", "a", "a_2", "a"].map(|it| unique_name(&mut taken, it));
        assert_eq!(names, ["a", "a_2", "a_2_2", "a_3"]);
    }
}
