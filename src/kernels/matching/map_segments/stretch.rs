//! Parts of matched branches, with the target's nodes beside the source's joints.

use super::{Assignment, Insertion, MapSegmentsOptions};
use crate::kernels::curve_skeletons::growing_skeleton::GrowingSkeleton;
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::rigs::segment_map::Segment;
use crate::kernels::rigs::skeleton::Skeleton;

/// The most rounds of [`Insertion::Midpoints`].
const MOST_ROUNDS: usize = 10;

/// A part of a matched branch that leads away from the source's root: joints of the source, and nodes of
/// the target with their places from 0 to 1.
pub struct Stretch {
    pub source: Vec<u32>,
    pub source_places: Vec<f64>,
    pub target: Vec<u32>,
    target_places: Vec<f64>,
}

impl Stretch {
    pub fn new(
        source: &Skeleton,
        joints: Vec<u32>,
        target: Vec<u32>,
        grown: &GrowingSkeleton,
    ) -> Self {
        let source_points: Vec<Vec3> =
            joints.iter().map(|&it| source.positions()[it as usize]).collect();
        let target_points: Vec<Vec3> = target.iter().map(|&it| grown.position(it)).collect();
        Self {
            source: joints,
            source_places: places_along(&source_points),
            target,
            target_places: places_along(&target_points),
        }
    }

    /// The index of the target's node at a place; a new one if none is near.
    pub fn insert_at(&mut self, place: f64, grown: &mut GrowingSkeleton, threshold: f64) -> usize {
        let is_near = |it: &f64| (it - place).abs() <= threshold;
        if let Some(index) = self.target_places.iter().position(is_near) {
            return index;
        }
        let next = self.target_places.partition_point(|&it| it < place);
        let [from, to] = [self.target_places[next - 1], self.target_places[next]];
        let share = (place - from) / (to - from);
        let node = grown.insert(self.target[next - 1], self.target[next], share);
        self.target.insert(next, node);
        self.target_places.insert(next, place);
        next
    }

    /// The bone of the source, from 1, for every bone of the target.
    fn bones(&self, options: &MapSegmentsOptions) -> Vec<usize> {
        let places = &self.source_places;
        let last = places.len() - 1;
        let end = |bone: usize| match options.assignment {
            _ if bone == last => f64::INFINITY,
            Assignment::End => places[bone],
            Assignment::Nearest => (places[bone] + places[bone + 1]) / 2.0,
        };
        let mut bone = 1;
        let mut res = Vec::with_capacity(self.target.len() - 1);
        for &place in &self.target_places[1..] {
            while place > end(bone) + options.threshold {
                bone += 1;
            }
            res.push(bone);
        }
        // The ends belong together, also where several joints are in one place.
        if let Some(it) = res.last_mut() {
            *it = last;
        }
        res
    }

    /// Writes down what the bones follow, and the nodes that they begin at.
    pub fn follow(
        &self,
        options: &MapSegmentsOptions,
        followed: &mut [Option<(Segment, Option<u32>)>],
    ) {
        for (index, bone) in self.bones(options).into_iter().enumerate() {
            let [from, to] = [self.source_places[bone - 1], self.source_places[bone]];
            let share = |place: f64| match to > from {
                true => ((place - from) / (to - from)).clamp(0.0, 1.0),
                false => 0.0,
            };
            let [from, to] = [index, index + 1].map(|it| share(self.target_places[it]));
            let segment = Segment { source: self.source[bone], from, to };
            followed[self.target[index + 1] as usize] = Some((segment, Some(self.target[index])));
        }
    }

    /// Bones of the source that none of the target follows.
    pub fn empty(&self, options: &MapSegmentsOptions) -> Vec<usize> {
        let bones = self.bones(options);
        (1..self.source.len()).filter(|it| !bones.contains(it)).collect()
    }
}

/// The share of a line's length before each of its points; of its points if it has no length.
pub fn places_along(points: &[Vec3]) -> Vec<f64> {
    let mut places = vec![0.0];
    for pair in points.windows(2) {
        places.push(places[places.len() - 1] + (pair[1] - pair[0]).norm());
    }
    let last = points.len().saturating_sub(1);
    let total = places[last];
    for (index, place) in places.iter_mut().enumerate() {
        *place = match total > 0.0 {
            true => *place / total,
            false => index as f64 / last.max(1) as f64,
        };
    }
    places[last] = if last == 0 { 0.0 } else { 1.0 };
    places
}

/// Gives the target new nodes as the options say.
pub fn insert(stretch: &mut Stretch, grown: &mut GrowingSkeleton, options: &MapSegmentsOptions) {
    let last = stretch.source.len() - 1;
    match options.insertion {
        Insertion::Never => {}
        Insertion::Joints => {
            for joint in 1..last {
                stretch.insert_at(stretch.source_places[joint], grown, options.threshold);
            }
        }
        Insertion::Empty => {
            for bone in stretch.empty(options) {
                stretch.insert_at(stretch.source_places[bone], grown, options.threshold);
            }
        }
        Insertion::Midpoints => {
            for _ in 0..MOST_ROUNDS {
                if stretch.empty(options).is_empty() {
                    break;
                }
                for pair in stretch.target_places.clone().windows(2) {
                    stretch.insert_at((pair[0] + pair[1]) / 2.0, grown, 0.0);
                }
            }
        }
    }
}
