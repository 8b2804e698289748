//! Cutting a subject out of a depth video.

use std::collections::VecDeque;

use rayon::prelude::*;

use super::{DepthError, DepthVideo};

/// What belongs to the subject.
#[derive(Debug, Clone, PartialEq)]
pub struct SegmentOptions {
    /// Nearer is not the subject, in metres.
    pub near: f64,
    /// Farther is not the subject, in metres.
    pub far: f64,
    /// The largest step between neighbouring pixels of one object, in metres.
    pub step: f64,
    /// Only pixels in `[left, top, right, bottom]`, the last two excluded.
    pub region: Option<[usize; 4]>,
    /// Whether only the largest connected component stays.
    pub largest: bool,
}

impl Default for SegmentOptions {
    fn default() -> Self {
        Self { near: 0.1, far: 10.0, step: 0.05, region: None, largest: true }
    }
}

/// A video of one subject.
#[derive(Debug, Clone, PartialEq)]
pub struct Segmented {
    pub video: DepthVideo,
    /// The frames in which another component was at least half as large as the one that stayed.
    pub rivalled: Vec<usize>,
}

/// Sets to 0 whatever is outside the depth range, the region, or the largest connected component
/// (8 neighbours) of its frame. Of equally large components the one that a scan meets first stays.
///
/// # Errors
/// [`DepthError`] does not occur for a valid video.
pub fn segment(video: &DepthVideo, options: &SegmentOptions) -> Result<Segmented, DepthError> {
    let width = video.width();
    let (frames, shares): (Vec<Vec<f32>>, Vec<f64>) = (0..video.n_frames())
        .into_par_iter()
        .map(|frame| {
            let mut depths = video.frame(frame).to_vec();
            cut(&mut depths, width, options);
            let share = match options.largest {
                true => keep_largest(&mut depths, width, options.step),
                false => 0.0,
            };
            (depths, share)
        })
        .unzip();
    let rivalled = (0..shares.len()).filter(|&it| shares[it] >= RIVAL).collect();
    Ok(Segmented { video: video.with_frames(frames)?, rivalled })
}

/// From this share of the largest component's pixels on, another one may as well be the subject.
const RIVAL: f64 = 0.5;

/// Applies the depth range and the region.
fn cut(depths: &mut [f32], width: usize, options: &SegmentOptions) {
    for (pixel, depth) in depths.iter_mut().enumerate() {
        let (column, row) = (pixel % width, pixel / width);
        let is_inside = options.region.is_none_or(|[left, top, right, bottom]| {
            (left..right).contains(&column) && (top..bottom).contains(&row)
        });
        if !is_inside || !(options.near..=options.far).contains(&f64::from(*depth)) {
            *depth = 0.0;
        }
    }
}

/// Keeps the largest component of pixels whose neighbours are less than `step` nearer or farther; returns
/// the size of the next one as a share of it.
fn keep_largest(depths: &mut [f32], width: usize, step: f64) -> f64 {
    let height = depths.len() / width;
    let mut labels = vec![0_u32; depths.len()];
    let (mut n_labels, mut best, mut best_size, mut next_size) = (0, 0, 0_usize, 0_usize);
    let mut queue = VecDeque::new();
    for seed in 0..depths.len() {
        if depths[seed] == 0.0 || labels[seed] != 0 {
            continue;
        }
        n_labels += 1;
        labels[seed] = n_labels;
        queue.push_back(seed);
        let mut size = 0;
        while let Some(pixel) = queue.pop_front() {
            size += 1;
            let (column, row) = (pixel % width, pixel / width);
            for y in row.saturating_sub(1)..=(row + 1).min(height - 1) {
                for x in column.saturating_sub(1)..=(column + 1).min(width - 1) {
                    let other = y * width + x;
                    let is_near = f64::from((depths[other] - depths[pixel]).abs()) < step;
                    if depths[other] != 0.0 && labels[other] == 0 && is_near {
                        labels[other] = n_labels;
                        queue.push_back(other);
                    }
                }
            }
        }
        if size > best_size {
            next_size = best_size;
            (best, best_size) = (n_labels, size);
        } else {
            next_size = next_size.max(size);
        }
    }
    for (depth, label) in depths.iter_mut().zip(labels) {
        if label != best {
            *depth = 0.0;
        }
    }
    next_size as f64 / best_size.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::super::Intrinsics;
    use super::*;

    #[test]
    fn the_largest_object_in_range_stays() {
        let camera = Intrinsics { fx: 10.0, fy: 10.0, cx: 2.0, cy: 1.0 };
        #[rustfmt::skip]
        let depths = vec![
            1.0, 1.01, 0.0, 2.0, 2.02,
            1.0, 0.0, 0.0, 2.0, 9.0,
            0.0, 0.0, 2.03, 0.0, 9.0,
        ];
        let video = DepthVideo::new([5, 3], camera, 30.0, vec![depths, vec![0.0; 15]]).unwrap();
        let options = SegmentOptions { far: 5.0, ..SegmentOptions::default() };
        let Segmented { video: cut, rivalled } = segment(&video, &options).unwrap();
        assert_eq!(rivalled, [0], "three pixels beside four");
        #[rustfmt::skip]
        let expected = [
            0.0, 0.0, 0.0, 2.0, 2.02,
            0.0, 0.0, 0.0, 2.0, 0.0,
            0.0, 0.0, 2.03, 0.0, 0.0,
        ];
        assert_eq!(cut.frame(0), expected);
        assert_eq!(cut.frame(1), [0.0; 15], "an empty frame stays empty");
        let options = SegmentOptions { region: Some([0, 0, 2, 2]), ..options };
        let left = segment(&video, &options).unwrap();
        assert!(left.rivalled.is_empty());
        assert_eq!(left.video.frame(0).iter().filter(|it| **it > 0.0).count(), 3);
    }
}
