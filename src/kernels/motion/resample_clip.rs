//! Clips at other rates, from fewer keys.

use nalgebra::UnitQuaternion;

use super::quaternion_spline::{Keys, PointSpline, QuaternionSpline};
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::rigs::clip::Clip;

/// What [`resample_clip`] does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ResampleClipOptions {
    /// Of the result; that of the clip if it is `None`.
    pub frames_per_second: Option<f64>,
    /// Every so many frames there is a key, from the first frame on.
    pub key_every: usize,
    pub keys: Keys,
}

/// A clip at another rate, and what became of its frames.
#[derive(Debug, Clone, PartialEq)]
pub struct Resampled {
    pub clip: Clip,
    pub n_keys: usize,
    /// Frames after the last key, which are left out.
    pub n_left_out: usize,
    /// The largest angle in radians by which a joint's curve misses a key that it should pass.
    pub largest_miss_rad: f64,
}

/// Lays smooth curves through keys of a clip and samples them at a rate: cubic B-splines of rotations
/// and of offsets, on the times of the keys (Madaras et al. 2014, section 5.2).
///
/// The result goes from the first key to the last.
///
/// # Panics
/// If the clip has no frames, `key_every` is 0, or the rate is not above 0.
pub fn resample_clip(clip: &Clip, options: &ResampleClipOptions) -> Resampled {
    let (n_frames, n_joints, every) = (clip.n_frames(), clip.n_joints, options.key_every);
    let rate = options.frames_per_second.unwrap_or(clip.frames_per_second);
    assert!(n_frames > 0 && every > 0 && rate > 0.0, "frames, keys and a rate");
    let keys: Vec<usize> = (0..n_frames).step_by(every).collect();
    let last = keys[keys.len() - 1];
    // In lengths from key to key.
    let step = clip.frames_per_second / (rate * every as f64);
    let n_samples = ((keys.len() - 1) as f64 / step + 1e-9).floor() as usize + 1;
    let identity = UnitQuaternion::identity();
    let mut rotations = vec![identity; n_samples * n_joints];
    let mut translations = vec![Vec3::zeros(); n_samples * n_joints];
    let mut largest_miss_rad: f64 = 0.0;
    for joint in 0..n_joints {
        let of = |it: &usize| it * n_joints + joint;
        let turns: Vec<_> = keys.iter().map(|it| clip.rotations[of(it)]).collect();
        let places: Vec<_> = keys.iter().map(|it| clip.translations[of(it)]).collect();
        let (turns, miss) = QuaternionSpline::new(&turns, options.keys);
        let places = PointSpline::new(&places, options.keys);
        largest_miss_rad = largest_miss_rad.max(miss);
        for sample in 0..n_samples {
            let time = sample as f64 * step;
            rotations[of(&sample)] = turns.at(time);
            translations[of(&sample)] = places.at(time);
        }
    }
    let name = clip.name.clone();
    let clip = Clip { name, frames_per_second: rate, n_joints, rotations, translations };
    Resampled { clip, n_keys: keys.len(), n_left_out: n_frames - 1 - last, largest_miss_rad }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::synthetic::synthesize::{SynthesizeOptions, synthesize};

    fn walk() -> Clip {
        synthesize(&SynthesizeOptions { n_vertices: 1000, ..Default::default() }).unwrap().clip
    }

    fn resampled(rate: Option<f64>, key_every: usize) -> Resampled {
        let options =
            ResampleClipOptions { frames_per_second: rate, key_every, keys: Keys::Passed };
        resample_clip(&walk(), &options)
    }

    #[test]
    fn keys_at_all_frames_and_the_same_rate_change_nothing() {
        let (clip, res) = (walk(), resampled(None, 1));
        assert_eq!((res.n_keys, res.n_left_out), (clip.n_frames(), 0));
        assert_eq!(res.clip.n_frames(), clip.n_frames());
        for (a, b) in res.clip.rotations.iter().zip(&clip.rotations) {
            assert!(a.angle_to(b) < 1e-7);
        }
        for (a, b) in res.clip.translations.iter().zip(&clip.translations) {
            assert!((a - b).norm() < 1e-9);
        }
    }

    #[test]
    fn every_second_frame_at_twice_the_rate_is_a_frame_of_the_clip() {
        let (clip, res) = (walk(), resampled(Some(2.0 * walk().frames_per_second), 2));
        assert_eq!(res.n_left_out, (clip.n_frames() - 1) % 2);
        for key in 0..res.n_keys {
            for joint in 0..clip.n_joints {
                let a = res.clip.rotations[4 * key * clip.n_joints + joint];
                assert!(a.angle_to(&clip.rotations[2 * key * clip.n_joints + joint]) < 1e-7);
            }
        }
        // What lies between is near, as a walk is smooth.
        let between = res.clip.rotations[2 * clip.n_joints + 1];
        assert!(between.angle_to(&clip.rotations[clip.n_joints + 1]) < 0.02);
    }
}
