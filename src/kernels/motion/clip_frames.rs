//! Frames of clips, from where joints are in the world.

use nalgebra::UnitQuaternion;

use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::rigs::clip::Clip;

/// Makes a clip without frames for a skeleton of so many joints, with another's name and rate.
pub fn empty_clip(like: &Clip, n_joints: usize) -> Clip {
    let capacity = like.n_frames() * n_joints;
    Clip {
        name: like.name.clone(),
        frames_per_second: like.frames_per_second,
        n_joints,
        rotations: Vec::with_capacity(capacity),
        translations: Vec::with_capacity(capacity),
    }
}

/// Appends a frame to a clip, from how all joints are turned and where they are in the world.
pub fn push_frame(
    clip: &mut Clip,
    parents: &[Option<usize>],
    turns: &[UnitQuaternion<f64>],
    places: &[Vec3],
) {
    for (joint, parent) in parents.iter().enumerate() {
        let (rotation, translation) = match *parent {
            Some(parent) => {
                let back = turns[parent].inverse();
                (back * turns[joint], back * (places[joint] - places[parent]))
            }
            None => (turns[joint], places[joint]),
        };
        clip.rotations.push(rotation);
        clip.translations.push(translation);
    }
}

/// How all joints are turned, and where they are, in the world.
pub fn world_frames(
    clip: &Clip,
    frame: usize,
    parents: &[Option<usize>],
) -> (Vec<UnitQuaternion<f64>>, Vec<Vec3>) {
    let first = frame * clip.n_joints;
    let mut turns: Vec<UnitQuaternion<f64>> = Vec::with_capacity(clip.n_joints);
    let mut places: Vec<Vec3> = Vec::with_capacity(clip.n_joints);
    for (joint, parent) in parents.iter().enumerate() {
        let rotation = clip.rotations[first + joint];
        let translation = clip.translations[first + joint];
        match *parent {
            Some(parent) => {
                places.push(places[parent] + turns[parent] * translation);
                turns.push(turns[parent] * rotation);
            }
            None => {
                turns.push(rotation);
                places.push(translation);
            }
        }
    }
    (turns, places)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::numerics::random::Random;

    #[test]
    fn frames_of_the_world_and_of_the_parents_say_the_same() {
        let parents = [None, Some(0), Some(1), Some(1), Some(0), None];
        let mut random = Random::new(3);
        let mut vector = || Vec3::from_fn(|_, _| random.normal());
        let turns = parents.map(|_| UnitQuaternion::from_scaled_axis(vector()));
        let places = parents.map(|_| vector());
        let like = Clip {
            name: "all".to_owned(),
            frames_per_second: 25.0,
            n_joints: 2,
            rotations: vec![UnitQuaternion::identity(); 2],
            translations: vec![Vec3::zeros(); 2],
        };
        let mut clip = empty_clip(&like, parents.len());
        push_frame(&mut clip, &parents, &turns, &places);
        assert_eq!((clip.n_frames(), clip.frames_per_second), (1, 25.0));
        let found = world_frames(&clip, 0, &parents);
        for joint in 0..parents.len() {
            assert!((found.1[joint] - places[joint]).norm() < 1e-12);
            assert!(found.0[joint].angle_to(&turns[joint]) < 1e-7);
        }
    }
}
