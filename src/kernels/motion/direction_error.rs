//! How far bones point away from those that they follow.

use super::fit_clip::world_positions;
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::rigs::clip::Clip;
use crate::kernels::rigs::segment_map::SegmentMap;
use crate::kernels::rigs::skeleton::Skeleton;

/// The angles of one bone over all frames, in radians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DirectionError {
    /// The target's joint at the bone's end.
    pub joint: usize,
    /// The source's.
    pub follows: usize,
    pub mean_rad: f64,
    pub largest_rad: f64,
}

/// Why directions cannot be compared.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DirectionErrorError {
    #[error("the {whose} clip moves {clip} joints, but its skeleton has {skeleton}")]
    Clip { whose: &'static str, clip: usize, skeleton: usize },
    #[error("the clips have {source_frames} and {target_frames} frames")]
    Frames { source_frames: usize, target_frames: usize },
    #[error(
        "the map leads from {map_target} joints to {map_source}, but the target has {target} and the \
         source {source_joints}"
    )]
    Map { map_target: usize, map_source: usize, target: usize, source_joints: usize },
}

/// Measures the angles between bones of a target and those of the source that they follow, frame by
/// frame. Bones without length, or that follow nothing, are left out.
///
/// # Errors
/// See [`DirectionErrorError`].
pub fn direction_errors(
    (source, source_clip): (&Skeleton, &Clip),
    (target, target_clip): (&Skeleton, &Clip),
    map: &SegmentMap,
) -> Result<Vec<DirectionError>, DirectionErrorError> {
    check((source, source_clip), (target, target_clip), map)?;
    let n_frames = source_clip.n_frames();
    let motion = |clip: &Clip, skeleton: &Skeleton| -> Vec<Vec<Vec3>> {
        (0..n_frames).map(|it| world_positions(clip, it, skeleton.parents())).collect()
    };
    let (from, to) = (motion(source_clip, source), motion(target_clip, target));
    let mut res = Vec::new();
    for (parent, joint) in target.bones() {
        let Some(follows) = map.segments()[joint].map(|it| it.source as usize) else { continue };
        let Some(above) = source.parents()[follows] else { continue };
        let angles = (0..n_frames).filter_map(|it| {
            angle(to[it][joint] - to[it][parent], from[it][follows] - from[it][above])
        });
        let angles: Vec<f64> = angles.collect();
        if angles.is_empty() {
            continue;
        }
        let mean_rad = angles.iter().sum::<f64>() / angles.len() as f64;
        let largest_rad = angles.iter().copied().fold(0.0, f64::max);
        res.push(DirectionError { joint, follows, mean_rad, largest_rad });
    }
    Ok(res)
}

/// Accurate for small angles, too; `None` for a direction of no length.
fn angle(a: Vec3, b: Vec3) -> Option<f64> {
    let (a, b) = (a.try_normalize(0.0)?, b.try_normalize(0.0)?);
    Some(2.0 * (a - b).norm().atan2((a + b).norm()))
}

fn check(
    (source, source_clip): (&Skeleton, &Clip),
    (target, target_clip): (&Skeleton, &Clip),
    map: &SegmentMap,
) -> Result<(), DirectionErrorError> {
    use DirectionErrorError as E;
    let sides = [("source", source, source_clip), ("target", target, target_clip)];
    for (whose, skeleton, clip) in sides {
        let (clip, skeleton) = (clip.n_joints, skeleton.n_joints());
        if clip != skeleton {
            return Err(E::Clip { whose, clip, skeleton });
        }
    }
    let (source_frames, target_frames) = (source_clip.n_frames(), target_clip.n_frames());
    if source_frames != target_frames {
        return Err(E::Frames { source_frames, target_frames });
    }
    let (map_target, map_source) = (map.segments().len(), map.n_source());
    let (target, source_joints) = (target.n_joints(), source.n_joints());
    match map_target == target && map_source == source_joints {
        true => Ok(()),
        false => Err(E::Map { map_target, map_source, target, source_joints }),
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;

    use super::*;
    use crate::kernels::rigs::segments_by_name::segments_by_name;

    fn bar() -> Skeleton {
        let names = vec!["a".to_owned(), "b".to_owned()];
        Skeleton::new(names, vec![None, Some(0)], vec![Vec3::zeros(), Vec3::x()]).unwrap()
    }

    fn turned(angles: &[f64]) -> Clip {
        let about = |it: &f64| UnitQuaternion::from_axis_angle(&Vec3::z_axis(), *it);
        Clip {
            name: "turn".to_owned(),
            frames_per_second: 30.0,
            n_joints: 2,
            rotations: angles.iter().flat_map(|it| [about(it), about(&0.0)]).collect(),
            translations: angles.iter().flat_map(|_| [Vec3::zeros(), Vec3::x()]).collect(),
        }
    }

    #[test]
    fn angles_are_those_between_the_bones() {
        let (bar, still) = (bar(), turned(&[0.0, 0.0, 0.0]));
        let map = segments_by_name(&bar, &bar);
        let moved = turned(&[1e-9, 0.5, 1.0]);
        let found = direction_errors((&bar, &still), (&bar, &moved), &map).unwrap();
        assert_eq!((found.len(), found[0].joint, found[0].follows), (1, 1, 1));
        assert!((found[0].mean_rad - (1.5 + 1e-9) / 3.0).abs() < 1e-12);
        assert!((found[0].largest_rad - 1.0).abs() < 1e-12);
        let short = turned(&[0.0]);
        let error = direction_errors((&bar, &still), (&bar, &short), &map).unwrap_err();
        assert_eq!(error.to_string(), "the clips have 3 and 1 frames");
    }
}
