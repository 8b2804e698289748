//! A motion on another skeleton of the same joints.

use nalgebra::UnitQuaternion;

use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::rigs::clip::Clip;
use crate::kernels::rigs::skeleton::Skeleton;

/// Makes a clip fit a skeleton that has the same joints and other proportions.
///
/// Rotations stay: rest frames are aligned with the world, so they mean the same on both. Every joint
/// keeps the skeleton's own offset from its parent. Roots walk the clip's path, scaled by the ratio of
/// the skeletons' heights: sideways from where the skeleton stands, and upward from its lowest joint,
/// which stands for the lowest place that any joint reaches in the clip.
///
/// # Panics
/// If the numbers of joints differ.
pub fn fit_clip(clip: &Clip, skeleton: &Skeleton) -> Clip {
    let n_joints = skeleton.n_joints();
    assert_eq!(clip.n_joints, n_joints, "a clip of these joints");
    if clip.n_frames() == 0 {
        return clip.clone();
    }
    let (parents, rest) = (skeleton.parents(), skeleton.positions());
    let clip_rest = accumulated(&clip.translations[..n_joints], parents);
    let (own, foreign) = (extent_y(rest), extent_y(&clip_rest));
    let height = |it: (f64, f64)| it.1 - it.0;
    let ratio = if height(foreign) > 0.0 { height(own) / height(foreign) } else { 1.0 };
    let floor = (0..clip.n_frames())
        .flat_map(|frame| world_positions(clip, frame, parents))
        .fold(f64::INFINITY, |low, it| low.min(it.y));
    let mut fitted = clip.clone();
    for (index, translation) in fitted.translations.iter_mut().enumerate() {
        let joint = index % n_joints;
        *translation = match parents[joint] {
            Some(parent) => rest[joint] - rest[parent],
            None => {
                let path = (*translation - clip.translations[joint]) * ratio;
                let height = own.0 + (translation.y - floor) * ratio;
                Vec3::new(rest[joint].x + path.x, height, rest[joint].z + path.z)
            }
        };
    }
    fitted
}

/// Where the joints of a frame are in the world.
pub fn world_positions(clip: &Clip, frame: usize, parents: &[Option<usize>]) -> Vec<Vec3> {
    let first = frame * clip.n_joints;
    let mut world: Vec<(UnitQuaternion<f64>, Vec3)> = Vec::with_capacity(clip.n_joints);
    for (joint, parent) in parents.iter().enumerate() {
        let rotation = clip.rotations[first + joint];
        let translation = clip.translations[first + joint];
        world.push(match parent.map(|it| world[it]) {
            Some((turn, place)) => (turn * rotation, place + turn * translation),
            None => (rotation, translation),
        });
    }
    world.into_iter().map(|it| it.1).collect()
}

/// Offsets added up from the roots, without rotations: a rest pose.
fn accumulated(offsets: &[Vec3], parents: &[Option<usize>]) -> Vec<Vec3> {
    let mut positions: Vec<Vec3> = Vec::with_capacity(offsets.len());
    for (offset, parent) in offsets.iter().zip(parents) {
        positions.push(parent.map_or_else(Vec3::zeros, |it| positions[it]) + offset);
    }
    positions
}

fn extent_y(points: &[Vec3]) -> (f64, f64) {
    points.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), it| (l.min(it.y), h.max(it.y)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn skeleton(scale: f64, place: Vec3) -> Skeleton {
        let names = ["hip", "knee", "foot", "head"].map(str::to_owned).to_vec();
        let positions = [[0.0, 1.0, 0.0], [0.1, 0.5, 0.0], [0.1, 0.0, 0.05], [0.0, 1.7, 0.0]];
        let positions = positions.map(|[x, y, z]| Vec3::new(x, y, z) * scale + place).to_vec();
        Skeleton::new(names, vec![None, Some(0), Some(1), Some(0)], positions).unwrap()
    }

    /// The hip moves forward and bobs; the knee bends.
    fn walk(skeleton: &Skeleton) -> Clip {
        let mut clip = Clip {
            name: "walk".to_owned(),
            frames_per_second: 30.0,
            n_joints: 4,
            rotations: Vec::new(),
            translations: Vec::new(),
        };
        for frame in 0..10 {
            let t = f64::from(frame);
            for joint in 0..4 {
                let angle = if joint == 1 { 0.05 * t } else { 0.0 };
                let turn = UnitQuaternion::from_axis_angle(&Vec3::x_axis(), angle);
                clip.rotations.push(turn);
                let position = skeleton.positions()[joint];
                clip.translations.push(match skeleton.parents()[joint] {
                    Some(parent) => position - skeleton.positions()[parent],
                    None => position + Vec3::new(0.0, 0.01 * (t * 0.7).sin().abs(), 0.1 * t),
                });
            }
        }
        clip
    }

    #[test]
    fn a_clip_fits_its_own_skeleton_already() {
        let own = skeleton(1.0, Vec3::zeros());
        let clip = walk(&own);
        let fitted = fit_clip(&clip, &own);
        for (a, b) in fitted.translations.iter().zip(&clip.translations) {
            assert!((a - b).norm() < 1e-12, "{a} instead of {b}");
        }
    }

    #[test]
    fn a_clip_on_a_skeleton_of_half_the_size_is_half_as_large_in_every_frame() {
        let (own, place) = (skeleton(1.0, Vec3::zeros()), Vec3::new(3.0, -1.0, 2.0));
        let half = skeleton(0.5, place);
        let clip = walk(&own);
        let fitted = fit_clip(&clip, &half);
        assert_eq!(fitted.rotations, clip.rotations);
        for frame in 0..clip.n_frames() {
            let before = world_positions(&clip, frame, own.parents());
            let after = world_positions(&fitted, frame, own.parents());
            for (a, b) in after.iter().zip(&before) {
                assert!((a - (b * 0.5 + place)).norm() < 1e-12);
            }
        }
    }
}
