//! Ends of a skeleton that do not lie in the body.

use super::{Joint, extent};
use crate::kernels::geometry::distance_field::DistanceField;
use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::rigs::skeleton::Skeleton;

/// How many places of a bone are looked at…
const PLACES: usize = 16;

/// … and the share of them that lies in the body if the bone does.
const MOST: f64 = 0.9;

/// Images may be outside by this share of the skeleton's greatest extent.
const OUTSIDE: f64 = 0.005;

/// Limbs without joints go if less than this share of them is left.
const LEAST_LEFT: f64 = 0.4;

/// Shortens limbs behind their last joint, and leaves limbs without joints out, until the straight bones that
/// [`joint_skeleton`](super::joint_skeleton) gives them lie inside the surface.
///
/// A curve that one pose alone has, and another place than it should, ends outside the body at rest; and a
/// straight bone to the end of a bent limb leaves it. Joints stay, on bones of the new skeleton, but images that are
/// outside of the surface go to their curve: limbs are never quite alike. A surface that holds less than half of the
/// skeleton says nothing, and nothing is changed.
pub fn trim_to_surface(
    skeleton: &Skeleton,
    joints: &[Joint],
    surface: &TriMesh,
) -> (Skeleton, Vec<Joint>) {
    let field = DistanceField::new(surface);
    let places = skeleton.positions();
    let n_inside = places.iter().filter(|it| field.is_inside(**it)).count();
    let mut is_kept = vec![true; places.len()];
    let mut joints = joints.to_vec();
    if 2 * n_inside >= places.len() {
        let margin = OUTSIDE * extent(places);
        let is_outside = |it: &&mut Joint| it.is_mirrored && field.distance(it.position) > margin;
        for image in joints.iter_mut().filter(is_outside) {
            image.position = image.on_curve(skeleton);
        }
        let children = skeleton.children();
        for leaf in (0..places.len()).filter(|it| children[*it].is_empty()) {
            let limb = Limb::new(skeleton, &joints, &children, leaf);
            let n_kept = limb.n_inside(places, &field);
            limb.nodes[n_kept..].iter().for_each(|it| is_kept[*it] = false);
        }
    }
    without(skeleton, &joints, &is_kept)
}

/// The end of a limb, behind its last joint or the branch that it begins at.
struct Limb {
    start: Vec3,
    /// Whether nothing of it has to stay: it begins at a branch, not at a joint.
    may_vanish: bool,
    /// From the start to the leaf.
    nodes: Vec<usize>,
}

impl Limb {
    fn new(skeleton: &Skeleton, joints: &[Joint], children: &[Vec<usize>], leaf: usize) -> Self {
        let mut nodes = Vec::new();
        let mut node = leaf;
        loop {
            let Some(parent) = skeleton.parents()[node] else {
                return Self::from(skeleton.positions()[node], false, nodes);
            };
            nodes.push(node);
            let last = joints
                .iter()
                .filter(|it| it.bone == node)
                .max_by(|a, b| a.share.total_cmp(&b.share));
            if let Some(joint) = last {
                return Self::from(joint.position, false, nodes);
            }
            if children[parent].len() > 1 {
                return Self::from(skeleton.positions()[parent], true, nodes);
            }
            node = parent;
        }
    }

    fn from(start: Vec3, may_vanish: bool, mut nodes: Vec<usize>) -> Self {
        nodes.reverse();
        Self { start, may_vanish, nodes }
    }

    /// So many nodes, from its start on, lead to one that a straight bone reaches within the body.
    fn n_inside(&self, places: &[Vec3], field: &DistanceField) -> usize {
        let is_reached = |end: Vec3| {
            let place = |it: usize| self.start.lerp(&end, (it as f64 + 0.5) / PLACES as f64);
            let n_inside = (0..PLACES).filter(|it| field.is_inside(place(*it))).count();
            n_inside as f64 >= MOST * PLACES as f64
        };
        let reached = self.nodes.iter().rposition(|it| is_reached(places[*it]));
        let n_kept = reached.map_or(0, |it| it + 1);
        if !self.may_vanish {
            return n_kept.max(1).min(self.nodes.len());
        }
        let [left, whole] = [n_kept, self.nodes.len()].map(|it| self.length(places, it));
        if left < LEAST_LEFT * whole { 0 } else { n_kept }
    }

    /// Of its first nodes.
    fn length(&self, places: &[Vec3], n: usize) -> f64 {
        let mut last = self.start;
        let step = |it: &usize| (places[*it] - std::mem::replace(&mut last, places[*it])).norm();
        self.nodes[..n].iter().map(step).sum()
    }
}

fn without(skeleton: &Skeleton, joints: &[Joint], is_kept: &[bool]) -> (Skeleton, Vec<Joint>) {
    let mut new_of_old = vec![usize::MAX; is_kept.len()];
    let kept: Vec<usize> = (0..is_kept.len()).filter(|it| is_kept[*it]).collect();
    kept.iter().enumerate().for_each(|(new, old)| new_of_old[*old] = new);
    let name = |it: &usize| skeleton.names()[*it].clone();
    // Nodes go with all that is behind them, so parents stay.
    let parent = |it: &usize| skeleton.parents()[*it].map(|it| new_of_old[it]);
    let trimmed = Skeleton::new(
        kept.iter().map(name).collect(),
        kept.iter().map(parent).collect(),
        kept.iter().map(|it| skeleton.positions()[*it]).collect(),
    );
    let joints = joints.iter().map(|it| Joint { bone: new_of_old[it.bone], ..it.clone() });
    (trimmed.expect("parents come first and names differ"), joints.collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes::icosphere;

    fn skeleton(nodes: &[(Option<usize>, [f64; 3])]) -> Skeleton {
        let names = (0..nodes.len()).map(|it| format!("n{it}")).collect();
        let parents = nodes.iter().map(|it| it.0).collect();
        Skeleton::new(names, parents, nodes.iter().map(|it| it.1.into()).collect()).unwrap()
    }

    fn joint(bone: usize, position: Vec3) -> Joint {
        Joint {
            bone,
            share: 0.5,
            position,
            angle: 90.0,
            n_freedoms: 1,
            axis: Vec3::z(),
            spreads: [90.0, 0.0, 0.0],
            is_mirrored: false,
        }
    }

    /// In the unit ball: a limb with a joint that ends outside, a spur that soon leaves it, a limb inside.
    fn star() -> Skeleton {
        skeleton(&[
            (None, [0.0, 0.0, 0.0]),
            (Some(0), [0.0, 0.9, 0.0]),
            (Some(1), [0.0, 3.0, 0.0]),
            (Some(0), [0.4, 0.0, 0.0]),
            (Some(3), [0.8, 0.0, 0.0]),
            (Some(4), [1.8, 0.0, 0.0]),
            (Some(0), [-0.8, 0.0, 0.0]),
        ])
    }

    #[test]
    fn ends_outside_are_cut_and_spurs_go() {
        let elbow = joint(4, Vec3::new(0.6, 0.0, 0.0));
        let (trimmed, joints) = trim_to_surface(&star(), &[elbow], &icosphere(3));
        assert_eq!(trimmed.names(), ["n0", "n3", "n4", "n6"]);
        assert_eq!(trimmed.parents(), [None, Some(0), Some(1), Some(0)]);
        assert_eq!(joints[0].bone, 2);
    }

    /// There is always a bone behind a joint, be it outside.
    #[test]
    fn a_joint_keeps_its_limb() {
        let wrist = joint(5, Vec3::new(0.9, 0.0, 0.0));
        let (trimmed, joints) = trim_to_surface(&star(), &[wrist], &icosphere(3));
        assert_eq!(trimmed.names(), ["n0", "n3", "n4", "n5", "n6"]);
        assert_eq!(trimmed.names()[joints[0].bone], "n5");
    }

    #[test]
    fn an_image_outside_goes_to_its_curve() {
        let seen = joint(4, Vec3::new(0.6, 0.0, 1.5));
        let near = Joint { is_mirrored: true, ..joint(1, Vec3::new(0.0, 0.5, 0.3)) };
        let far = Joint { position: Vec3::new(0.0, 0.5, 1.3), ..near.clone() };
        let places = |it: &TriMesh| {
            let joints = [seen.clone(), near.clone(), far.clone()];
            trim_to_surface(&star(), &joints, it).1.iter().map(|it| it.position).collect::<Vec<_>>()
        };
        let on_curve = Vec3::new(0.0, 0.45, 0.0);
        assert_eq!(places(&icosphere(3)), [seen.position, near.position, on_curve]);
    }

    #[test]
    fn a_surface_elsewhere_changes_nothing() {
        let far = icosphere(2).vertices().iter().map(|it| it + Vec3::x() * 9.0).collect();
        let far = icosphere(2).with_vertices(far).unwrap();
        assert_eq!(trim_to_surface(&star(), &[], &far).0, star());
    }
}
