//! The segments that a surface is unrolled around, with a direction to count angles from.

use crate::kernels::geometry::kabsch::shortest_arc;
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::geometry::triangle_tree::TriangleTree;
use crate::kernels::motion::transfer_animation::{LEAST_BONE, align_rest, mean_length};
use crate::kernels::rigs::segment_map::SegmentMap;
use crate::kernels::rigs::skeleton::Skeleton;

/// A segment of a skeleton.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bone {
    /// The joint at its beginning, which moves it.
    pub joint: usize,
    /// The joint at its end; `None` where a leaf is continued to the surface.
    pub end: Option<usize>,
    pub from: Vec3,
    pub to: Vec3,
    pub length: f64,
    /// From `from` to `to`, of length 1.
    pub direction: Vec3,
    /// Perpendicular to the direction: where angles are zero.
    pub reference: Vec3,
}

/// Where a point is around a bone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// In lengths of the bone from its beginning; below 0 and above 1 beyond its ends.
    pub along: f64,
    /// In turns, from 0 to 1.
    pub around: f64,
    /// The distance from the axis.
    pub radius: f64,
}

/// How much of the way to the surface the continuation of a leaf goes.
const REACH: f64 = 0.9;

/// The bones of a skeleton, joints in order, then the continuations of leaves. Where joints nearly
/// coincide there is no bone: its direction would mean nothing.
///
/// References are carried from bone to bone by the smallest rotations; where there is no bone above
/// they point forward (+Z), or up for bones that point forward themselves.
pub fn bones(skeleton: &Skeleton, tree: &TriangleTree) -> Vec<Bone> {
    let places = skeleton.positions();
    let shortest = (LEAST_BONE * mean_length(skeleton)).max(f64::MIN_POSITIVE);
    // By joint: the direction and the reference of the last bone with a length that leads to it.
    let mut frames: Vec<Option<(Vec3, Vec3)>> = Vec::with_capacity(places.len());
    let mut res = Vec::new();
    for (joint, parent) in skeleton.parents().iter().enumerate() {
        let above = parent.and_then(|it| frames[it]);
        let parent = parent.filter(|&it| (places[joint] - places[it]).norm() >= shortest);
        let Some(parent) = parent else {
            frames.push(above);
            continue;
        };
        let bone = Bone::new(parent, Some(joint), [places[parent], places[joint]], above);
        frames.push(Some((bone.direction, bone.reference)));
        res.push(bone);
    }
    for (joint, children) in skeleton.children().iter().enumerate() {
        let (true, Some(frame)) = (children.is_empty(), frames[joint]) else { continue };
        let hit = tree.first_hit(places[joint], frame.0, [1e-9, f64::INFINITY]);
        if let Some(length) = hit.map(|it| REACH * it.along) {
            let ends = [places[joint], places[joint] + frame.0 * length];
            res.push(Bone::new(joint, None, ends, Some(frame)));
        }
    }
    res
}

/// Gives a target's bones the references of the source's that they follow, turned back to the target's
/// rest pose; others carry on that of the bone above.
pub fn follow_references(
    target: &mut [Bone],
    skeleton: &Skeleton,
    (source, source_skeleton): (&[Bone], &Skeleton),
    map: &SegmentMap,
) {
    let (alignment, _) = align_rest(source_skeleton, skeleton, map.segments(), LEAST_BONE);
    let mut frames: Vec<Option<(Vec3, Vec3)>> = vec![None; skeleton.n_joints()];
    for bone in target {
        let followed = bone.end.and_then(|end| {
            let joint = map.segments()[end]?.source as usize;
            let followed = source.iter().find(|it| it.end == Some(joint))?;
            Some(alignment[end].inverse() * followed.reference)
        });
        let mut up = std::iter::successors(Some(bone.joint), |&it| skeleton.parents()[it]);
        let carried = up.find_map(|it| frames[it]);
        let carried = carried.map(|(before, it)| shortest_arc(before, bone.direction) * it);
        if let Some(reference) = followed.or(carried) {
            bone.set_reference(reference);
        }
        if let Some(end) = bone.end {
            frames[end] = Some((bone.direction, bone.reference));
        }
    }
}

/// Forward, or up for what points forward, without its part along a direction.
fn perpendicular(direction: Vec3) -> Vec3 {
    let axis = if direction.z.abs() > 0.9 { Vec3::y() } else { Vec3::z() };
    (axis - direction * direction.dot(&axis)).normalize()
}

impl Bone {
    fn new(
        joint: usize,
        end: Option<usize>,
        [from, to]: [Vec3; 2],
        above: Option<(Vec3, Vec3)>,
    ) -> Self {
        let length = (to - from).norm();
        let direction = (to - from) / length;
        let reference = match above {
            Some((before, reference)) => shortest_arc(before, direction) * reference,
            None => perpendicular(direction),
        };
        let mut res = Self { joint, end, from, to, length, direction, reference };
        res.set_reference(reference);
        res
    }

    fn set_reference(&mut self, reference: Vec3) {
        let flat = reference - self.direction * self.direction.dot(&reference);
        self.reference = flat.try_normalize(1e-9).unwrap_or(perpendicular(self.direction));
    }

    /// The nearest point of the bone, exactly an end where it is one.
    pub fn closest(&self, place: Vec3) -> Vec3 {
        let along = (place - self.from).dot(&self.direction);
        if along <= 0.0 {
            self.from
        } else if along >= self.length {
            self.to
        } else {
            self.from + self.direction * along
        }
    }

    pub fn place(&self, point: Vec3) -> Place {
        let offset = point - self.from;
        let along = offset.dot(&self.direction);
        let (x, y) =
            (offset.dot(&self.reference), offset.dot(&self.direction.cross(&self.reference)));
        let turns = y.atan2(x) / std::f64::consts::TAU;
        Place { along: along / self.length, around: turns.rem_euclid(1.0), radius: x.hypot(y) }
    }
    /// The inverse of [`Bone::place`].
    pub fn point(&self, place: Place) -> Vec3 {
        let (sin, cos) = (place.around * std::f64::consts::TAU).sin_cos();
        let side = self.direction.cross(&self.reference);
        let off_axis = (self.reference * cos + side * sin) * place.radius;
        self.from + self.direction * (place.along * self.length) + off_axis
    }
}
