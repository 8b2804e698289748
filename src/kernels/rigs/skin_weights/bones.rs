//! The segments that give heat.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::geometry::triangle_tree::TriangleTree;
use crate::kernels::rigs::skeleton::Skeleton;

/// What joints without children move.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Leaves {
    /// The rest of their limb: they get a bone that goes on straight to the surface.
    #[default]
    Extend,
    /// Nothing: they only mark the ends of their parents' bones.
    Ends,
}

/// A segment that moves with a joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bone {
    pub joint: usize,
    from: Vec3,
    to: Vec3,
}

/// How much of the way to the surface the bone of a leaf goes.
const REACH: f64 = 0.9;

/// The bones of a skeleton: one for every joint but the roots, which moves with the joint's parent,
/// and one for every leaf if leaves are to move something. A joint alone is a bone of no length.
pub fn bones(skeleton: &Skeleton, tree: &TriangleTree, leaves: Leaves) -> Vec<Bone> {
    let positions = skeleton.positions();
    let has_children: Vec<bool> = skeleton.children().iter().map(|it| !it.is_empty()).collect();
    let mut res: Vec<Bone> = skeleton
        .bones()
        .filter(|&(parent, child)| positions[parent] != positions[child])
        .map(|(joint, child)| Bone { joint, from: positions[joint], to: positions[child] })
        .collect();
    for joint in (0..skeleton.n_joints()).filter(|&it| !has_children[it]) {
        let from = positions[joint];
        let parent = skeleton.parents()[joint];
        let direction = parent.and_then(|it| (from - positions[it]).try_normalize(0.0));
        match (direction, leaves) {
            (Some(direction), Leaves::Extend) => {
                let hit = tree.first_hit(from, direction, [0.0, f64::INFINITY]);
                let length = hit.map_or(0.0, |it| REACH * it.along);
                res.push(Bone { joint, from, to: from + direction * length });
            }
            (Some(_), Leaves::Ends) => {}
            // A root alone, or a leaf at the place of its parent: it would have no bone at all.
            (None, _) if parent.is_none() || leaves == Leaves::Extend => {
                res.push(Bone { joint, from, to: from });
            }
            (None, _) => {}
        }
    }
    if res.is_empty() {
        res.push(Bone { joint: 0, from: positions[0], to: positions[0] });
    }
    res
}

impl Bone {
    /// The point of the bone that is nearest to a place.
    pub fn closest(&self, place: Vec3) -> Vec3 {
        let along = self.to - self.from;
        let square = along.norm_squared();
        if square == 0.0 {
            return self.from;
        }
        self.from + along * ((place - self.from).dot(&along) / square).clamp(0.0, 1.0)
    }
}

/// The bone that is nearest to a place; of equally near ones the first.
pub fn nearest(bones: &[Bone], place: Vec3) -> &Bone {
    let squares = bones.iter().map(|it| (it.closest(place) - place).norm_squared());
    let best = squares.enumerate().min_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
    &bones[best.expect("there is a bone").0]
}
