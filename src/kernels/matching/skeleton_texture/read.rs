//! Weights of a target's joints, read from its texture.

use super::atlas::Atlas;
use super::copy::{Copy, Piece};
use super::rectangle::Rectangle;
use super::{SkeletonTextureOptions, Texels};
use crate::kernels::rigs::segment_map::SegmentMap;
use crate::kernels::rigs::skeleton::Skeleton;
use crate::kernels::rigs::weights::{SkinWeights, WeightsError};

/// The target's rectangles, with weights of the source's joints.
pub struct Copied {
    pub rectangles: Vec<Option<Rectangle>>,
    /// By target bone: the bone whose rectangle is read, itself or one above.
    read_from: Vec<Option<usize>>,
    /// By target bone: the joint of the source that moves the bone that it follows.
    mover: Vec<Option<usize>>,
    nearest: bool,
}

impl Copied {
    pub fn new(
        source: &Atlas<'_>,
        target: &Atlas<'_>,
        drawn: &[Option<Rectangle>],
        pieces: &[Vec<Piece>],
        shifts: &[f64],
        options: &SkeletonTextureOptions,
    ) -> Self {
        let nearest = options.texels == Texels::TopFour;
        let rectangle = |index: usize| {
            let shift = shifts[index];
            let copy = Copy { source_bones: &source.bones, rectangles: drawn, shift };
            let of = &pieces[index];
            (!of.is_empty()).then(|| copy.rectangle(of, target.grid(index), nearest))
        };
        let rectangles: Vec<Option<Rectangle>> = (0..pieces.len()).map(rectangle).collect();
        let above = |bone: usize| {
            let joint = target.bones[bone].joint;
            target.bones.iter().position(|it| it.end == Some(joint))
        };
        let read_from = |bone: usize| {
            std::iter::successors(Some(bone), |&it| above(it)).find(|&it| rectangles[it].is_some())
        };
        let mover = |of: &Vec<Piece>| of.last().map(|it| source.bones[it.bone].joint);
        Self {
            read_from: (0..pieces.len()).map(read_from).collect(),
            mover: pieces.iter().map(mover).collect(),
            rectangles,
            nearest,
        }
    }

    /// Weights of the source's joints at a place around a target's bone, and the bone that they are from.
    fn read(&self, bone: usize, along: f64, around: f64) -> Option<(usize, Vec<(u32, f64)>)> {
        let from = self.read_from[bone]?;
        let along = if from == bone { along } else { 1.0 };
        let rectangle = self.rectangles[from].as_ref().expect("it is read from bones with one");
        let values = match self.nearest {
            true => rectangle.nearest(along, around).to_vec(),
            false => rectangle.sample(along, around),
        };
        Some((from, rectangle.channels.iter().copied().zip(values).collect()))
    }
}

/// What turns texels into weights of the target's joints.
pub struct Reader<'a> {
    pub source: &'a Skeleton,
    pub target: &'a Skeleton,
    pub map: &'a SegmentMap,
    pub atlas: &'a Atlas<'a>,
    pub copied: &'a Copied,
}

impl Reader<'_> {
    /// The weights of all vertices of the target.
    ///
    /// # Errors
    /// See [`WeightsError`].
    pub fn weights(&self, options: &SkeletonTextureOptions) -> Result<SkinWeights, WeightsError> {
        let namesakes = self.joints_of_source();
        let row = |vertex: usize| {
            let bone = self.atlas.assignment.bone_of_vertex[vertex] as usize;
            let place = self.atlas.place(vertex);
            let Some((from, texel)) = self.copied.read(bone, place.along, place.around) else {
                return vec![(self.atlas.bones[bone].joint as u32, 1.0)];
            };
            let own = self.atlas.bones[from].joint;
            let joint = |source: u32| match self.copied.mover[from] == Some(source as usize) {
                true => own,
                false => namesakes[source as usize],
            };
            let mut row: Vec<(u32, f64)> =
                texel.iter().map(|&(source, weight)| (joint(source) as u32, weight)).collect();
            let sum: f64 = row.iter().map(|it| it.1).sum();
            row.retain(|it| it.1 >= options.least_weight * sum);
            row
        };
        let rows: Vec<_> = (0..self.atlas.mesh.n_vertices()).map(row).collect();
        SkinWeights::from_rows(self.target.n_joints(), &rows)
    }

    /// The target's joint for every one of the source's: where a bone of the target ends together with
    /// the source's, or ends last on it; otherwise that of the joint above; the first root for the rest.
    fn joints_of_source(&self) -> Vec<usize> {
        let mut res: Vec<usize> = Vec::with_capacity(self.source.n_joints());
        for (joint, parent) in self.source.parents().iter().enumerate() {
            let mut best: Option<(usize, f64)> = None;
            for (target, segment) in self.map.segments().iter().enumerate() {
                let Some(it) = segment.filter(|it| it.source as usize == joint) else { continue };
                if best.is_none_or(|best| it.to > best.1) {
                    best = Some((target, it.to));
                }
            }
            let above = parent.map_or(0, |it| res[it]);
            res.push(best.map_or(above, |it| it.0));
        }
        res
    }
}
