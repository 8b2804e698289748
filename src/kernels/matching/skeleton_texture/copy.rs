//! Rectangles of a source, brought to the bones of a target.

use super::bones::Bone;
use super::rectangle::{Grid, Rectangle};
use crate::kernels::rigs::segment_map::SegmentMap;
use crate::kernels::rigs::skeleton::Skeleton;

/// A part of a source's bone that a target's bone follows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    /// The index of the bone.
    pub bone: usize,
    pub from: f64,
    pub to: f64,
}

/// What every bone of the target follows, in order from its beginning: one part of a bone, or several
/// bones where the target has fewer. Empty for bones that follow nothing.
///
/// A bone of the target begins on the source where the bone above it ends, if that lies on the way.
pub fn pieces(
    (source, source_bones): (&Skeleton, &[Bone]),
    (target, target_bones): (&Skeleton, &[Bone]),
    map: &SegmentMap,
) -> Vec<Vec<Piece>> {
    let segments = map.segments();
    let of_end = |joint: usize| source_bones.iter().position(|it| it.end == Some(joint));
    let of_bone = |bone: &Bone| -> Vec<Piece> {
        let Some(end) = bone.end else {
            // The continuation of a leaf follows that of the leaf that its bone ends at.
            let leaf = segments[bone.joint].filter(|it| it.to == 1.0);
            let follows = leaf.and_then(|leaf| {
                source_bones
                    .iter()
                    .position(|it| it.end.is_none() && it.joint == leaf.source as usize)
            });
            return follows.map(|bone| Piece { bone, from: 0.0, to: 1.0 }).into_iter().collect();
        };
        let Some(segment) = segments[end] else { return Vec::new() };
        let last = segment.source as usize;
        let start = segments[bone.joint].map(|it| it.source as usize);
        let own = of_end(last).map(|bone| Piece { bone, from: segment.from, to: segment.to });
        let way =
            (segment.from == 0.0).then(|| start.and_then(|it| way(source, it, last))).flatten();
        let before = way.into_iter().flatten().filter_map(of_end);
        let before = before.map(|bone| Piece { bone, from: 0.0, to: 1.0 });
        before.chain(own).collect()
    };
    debug_assert_eq!(segments.len(), target.n_joints());
    target_bones.iter().map(of_bone).collect()
}

/// The joints between one and a later one of its descendants, from above; `None` if it is none.
fn way(skeleton: &Skeleton, from: usize, to: usize) -> Option<Vec<usize>> {
    let mut res = Vec::new();
    let mut at = skeleton.parents()[to]?;
    while at != from {
        res.push(at);
        at = skeleton.parents()[at]?;
    }
    res.reverse();
    Some(res)
}

/// What a target's rectangle is filled from.
pub struct Copy<'a> {
    pub source_bones: &'a [Bone],
    pub rectangles: &'a [Option<Rectangle>],
    /// In turns, by which the target's angles differ.
    pub shift: f64,
}

impl Copy<'_> {
    /// The rectangle of a target's bone, texel by texel from the pieces that it follows, each as long as
    /// its part of the whole. What lies beyond the ends of the bone is stretched to what the source has
    /// there. `nearest` takes texels as they are.
    pub fn rectangle(&self, pieces: &[Piece], grid: Grid, nearest: bool) -> Rectangle {
        let mut channels: Vec<u32> = pieces.iter().flat_map(|it| self.channels(it.bone)).collect();
        channels.sort_unstable();
        channels.dedup();
        let mut values = vec![0.0; grid.n_rows * grid.n_columns * channels.len()];
        let n = channels.len();
        for row in 0..grid.n_rows {
            let (bone, along) = self.source_place(pieces, grid, grid.along(row));
            for column in 0..grid.n_columns {
                let first = (row * grid.n_columns + column) * n;
                let around = grid.around(column) + self.shift;
                for (channel, value) in self.texel(bone, along, around, nearest) {
                    let at = channels.binary_search(&channel).expect("all are listed");
                    values[first + at] += value;
                }
            }
        }
        Rectangle { grid, channels, values }
    }

    fn channels(&self, bone: usize) -> Vec<u32> {
        match &self.rectangles[bone] {
            Some(it) => it.channels.clone(),
            None => vec![self.source_bones[bone].joint as u32],
        }
    }

    /// Bones without vertices have the weights of a stiff bone.
    fn texel(&self, bone: usize, along: f64, around: f64, nearest: bool) -> Vec<(u32, f64)> {
        let Some(it) = &self.rectangles[bone] else {
            return vec![(self.source_bones[bone].joint as u32, 1.0)];
        };
        let values =
            if nearest { it.nearest(along, around).to_vec() } else { it.sample(along, around) };
        it.channels.iter().copied().zip(values).collect()
    }

    /// The bone of the source, and where along it.
    fn source_place(&self, pieces: &[Piece], grid: Grid, along: f64) -> (usize, f64) {
        let (first, last) = (pieces[0], pieces[pieces.len() - 1]);
        let span =
            |bone: usize| self.rectangles[bone].as_ref().map_or([0.0, 1.0], |it| it.grid.span);
        if along < 0.0 {
            let share = along / grid.span[0];
            let beyond = if first.from == 0.0 { span(first.bone)[0] * share } else { 0.0 };
            return (first.bone, first.from + beyond);
        }
        if along > 1.0 {
            let share = (along - 1.0) / (grid.span[1] - 1.0);
            let beyond = if last.to == 1.0 { (span(last.bone)[1] - 1.0) * share } else { 0.0 };
            return (last.bone, last.to + beyond);
        }
        let length = |it: &Piece| self.source_bones[it.bone].length * (it.to - it.from);
        let total: f64 = pieces.iter().map(length).sum();
        let mut left = along * total;
        for piece in pieces {
            let own = length(piece);
            if left <= own || piece == &last {
                let share = if own > 0.0 { (left / own).min(1.0) } else { 0.0 };
                return (piece.bone, piece.from + (piece.to - piece.from) * share);
            }
            left -= own;
        }
        (last.bone, last.to)
    }
}
