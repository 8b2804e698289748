use std::f64::consts::PI;

use super::*;
use crate::kernels::numerics::random::Random;
use crate::kernels::rigs::segments_by_name::segments_by_name;
use crate::kernels::rigs::skeleton::Skeleton;
use crate::kernels::synthetic::synthesize::{Body, SynthesizeOptions, synthesize};

fn walker(body: Body) -> (Skeleton, Clip) {
    let it = synthesize(&SynthesizeOptions { body, n_vertices: 1000, ..Default::default() });
    let it = it.unwrap();
    (it.skeleton, it.clip)
}

/// Joints and offsets of a clip moved about at random.
fn shaken(clip: &Clip, amount: f64) -> Clip {
    let mut random = Random::new(11);
    let mut res = clip.clone();
    for rotation in &mut res.rotations {
        let vector = Vec3::from_fn(|_, _| random.normal());
        *rotation *= UnitQuaternion::from_scaled_axis(vector * amount);
    }
    res
}

/// The same joints in another pose and of other lengths.
fn reposed(skeleton: &Skeleton, amount: f64, seed: u64) -> Skeleton {
    let mut random = Random::new(seed);
    let mut places: Vec<Vec3> = Vec::new();
    for joint in 0..skeleton.n_joints() {
        let turn = Vec3::from_fn(|_, _| random.normal()) * amount;
        let moved = UnitQuaternion::from_scaled_axis(turn) * offset(skeleton, joint);
        let moved = moved * random.between(0.5, 2.0);
        places.push(skeleton.parents()[joint].map_or(Vec3::x(), |it| places[it] + moved));
    }
    skeleton.with_positions(places).unwrap()
}

#[test]
fn the_same_skeleton_gets_the_same_clip() {
    for body in [Body::Biped, Body::Quadruped] {
        let (skeleton, clip) = walker(body);
        let clip = shaken(&clip, 0.3);
        let map = segments_by_name(&skeleton, &skeleton);
        let options = TransferAnimationOptions::default();
        let res = transfer_animation(&skeleton, &clip, &skeleton, &map, &options).unwrap();
        assert_eq!(res.scale, 1.0);
        assert!(res.rest_angles_rad.iter().all(|&it| it < 1e-7));
        for (a, b) in res.clip.rotations.iter().zip(&clip.rotations) {
            assert!(
                (a.into_inner() - b.into_inner())
                    .norm()
                    .min((a.into_inner() + b.into_inner()).norm())
                    < 1e-12
            );
        }
        for (a, b) in res.clip.translations.iter().zip(&clip.translations) {
            assert!((a - b).norm() < 1e-12);
        }
    }
}

#[test]
fn bones_point_where_the_source_s_do_and_keep_their_lengths() {
    for (body, seed) in [(Body::Biped, 1), (Body::Quadruped, 2), (Body::Biped, 3)] {
        let (source, clip) = walker(body);
        let clip = shaken(&clip, 0.3);
        let target = reposed(&source, 0.4, seed);
        let map = segments_by_name(&source, &target);
        let root = RootPath::Grounded;
        let options = TransferAnimationOptions { root, least_bone: 0.0, ..Default::default() };
        let res = transfer_animation(&source, &clip, &target, &map, &options).unwrap();
        for frame in 0..clip.n_frames() {
            let (_, from) = world_frames(&clip, frame, source.parents());
            let (_, to) = world_frames(&res.clip, frame, target.parents());
            for (parent, child) in target.bones() {
                let length = offset(&target, child).norm();
                let (wanted, found) = (from[child] - from[parent], to[child] - to[parent]);
                assert!((found.norm() - length).abs() < 1e-12);
                assert!((found / length - wanted.normalize()).norm() < 1e-12);
            }
        }
    }
}

/// Twist about a bone has no direction, but turns what hangs on it.
#[test]
fn twist_is_kept() {
    let names = ["root", "middle", "end"].map(str::to_owned).to_vec();
    let parents = vec![None, Some(0), Some(1)];
    let bar = |axis: Vec3| {
        let places = vec![Vec3::zeros(), axis, axis * 2.0];
        Skeleton::new(names.clone(), parents.clone(), places).unwrap()
    };
    let (source, target) = (bar(Vec3::x()), bar(Vec3::y() * 3.0));
    let twist = UnitQuaternion::from_axis_angle(&Vec3::x_axis(), 1.0);
    let mut clip = empty_clip(&still(3), 3);
    push_frame(
        &mut clip,
        source.parents(),
        &[UnitQuaternion::identity(), twist, twist],
        source.positions(),
    );
    let map = segments_by_name(&source, &target);
    let options = TransferAnimationOptions::default();
    let res = transfer_animation(&source, &clip, &target, &map, &options).unwrap();
    let (turns, places) = world_frames(&res.clip, 0, target.parents());
    assert!((places[2] - Vec3::x() * 6.0).norm() < 1e-12);
    // A fin along z at the middle of the target: laid along x, then twisted.
    let fin = turns[1] * Vec3::z();
    assert!((fin - twist * Vec3::z()).norm() < 1e-12, "{fin}");
    assert!((res.rest_angles_rad[1] - PI / 2.0).abs() < 1e-12 && res.rest_angles_rad[2] < 1e-7);
}

fn still(n_joints: usize) -> Clip {
    Clip {
        name: "still".to_owned(),
        frames_per_second: 30.0,
        n_joints,
        rotations: vec![UnitQuaternion::identity(); n_joints],
        translations: vec![Vec3::zeros(); n_joints],
    }
}

#[test]
fn opposite_bones_are_turned_half_way_round() {
    let names = vec!["a".to_owned(), "b".to_owned()];
    let bar = |end: Vec3| {
        Skeleton::new(names.clone(), vec![None, Some(0)], vec![Vec3::zeros(), end]).unwrap()
    };
    let (source, target) = (bar(Vec3::x()), bar(-Vec3::x() * 2.0));
    let clip = Clip { translations: vec![Vec3::zeros(), Vec3::x()], ..still(2) };
    let map = segments_by_name(&source, &target);
    let options = TransferAnimationOptions::default();
    let res = transfer_animation(&source, &clip, &target, &map, &options).unwrap();
    let (_, places) = world_frames(&res.clip, 0, target.parents());
    assert!((places[1] - Vec3::x() * 2.0).norm() < 1e-12);
    assert!((res.rest_angles_rad[1] - PI).abs() < 1e-12);
}

/// The last joint lies beside the one before: that says nothing about where the limb points.
#[test]
fn joints_that_nearly_coincide_turn_nothing() {
    let names = ["a", "b", "c"].map(str::to_owned).to_vec();
    let limb = |tip: Vec3| {
        let places = vec![Vec3::zeros(), Vec3::y(), Vec3::y() + tip];
        Skeleton::new(names.clone(), vec![None, Some(0), Some(1)], places).unwrap()
    };
    let (source, target) = (limb(Vec3::y() * 0.3), limb(Vec3::x() * 0.01));
    let clip = Clip { translations: vec![Vec3::zeros(), Vec3::y(), Vec3::y() * 0.3], ..still(3) };
    let map = segments_by_name(&source, &target);
    let turn = |least_bone| {
        let options = TransferAnimationOptions { least_bone, ..Default::default() };
        let res = transfer_animation(&source, &clip, &target, &map, &options).unwrap();
        world_frames(&res.clip, 0, target.parents()).0[2].angle()
    };
    assert!(turn(0.15) < 1e-7 && (turn(0.0) - PI / 2.0).abs() < 1e-7);
}

/// Three bones of the target share one of the source, and a fourth follows nothing.
#[test]
fn several_bones_of_one_move_together_and_others_are_stiff() {
    let names = |n: usize| (0..n).map(|it| it.to_string()).collect::<Vec<_>>();
    let line = |n: usize, step: f64| {
        let parents = (0..n).map(|it| it.checked_sub(1)).collect();
        let places = (0..n).map(|it| Vec3::x() * (step * it as f64)).collect();
        Skeleton::new(names(n), parents, places).unwrap()
    };
    let (source, target) = (line(3, 1.0), line(5, 0.5));
    let part = |source, from, to| Some(Segment { source, from, to });
    let map =
        vec![part(0, 0.0, 0.0), part(1, 0.0, 0.5), part(1, 0.5, 1.0), part(2, 0.0, 0.5), None];
    let map = SegmentMap::new(3, map).unwrap();
    let bend = |it: f64| UnitQuaternion::from_axis_angle(&Vec3::z_axis(), it);
    let rotations = vec![bend(0.5), bend(0.7), bend(0.3)];
    let clip =
        Clip { rotations, translations: vec![Vec3::zeros(), Vec3::x(), Vec3::x()], ..still(3) };
    let options = TransferAnimationOptions::default();
    let res = transfer_animation(&source, &clip, &target, &map, &options).unwrap();
    assert!((res.scale - 0.5 * 3.0 / 1.5).abs() < 1e-12);
    let angles: Vec<f64> = res.clip.rotations.iter().map(|it| it.angle()).collect();
    let expected = [0.5, 0.0, 0.7, 0.0, 0.0];
    assert!(angles.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-7), "{angles:?}");
    let (_, places) = world_frames(&res.clip, 0, target.parents());
    let direction = (places[4] - places[3]).normalize();
    assert!((direction - bend(1.2) * Vec3::x()).norm() < 1e-12);
}

#[test]
fn a_grounded_motion_stands_on_the_floor() {
    let (source, clip) = walker(Body::Biped);
    // As in motion capture files: the rest pose hangs from the origin.
    let hips = source.positions()[0];
    let hung = source.with_positions(source.positions().iter().map(|it| it - hips).collect());
    let target = reposed(&source, 0.1, 5);
    let map = segments_by_name(&source, &target);
    let options = TransferAnimationOptions { root: RootPath::Grounded, ..Default::default() };
    let res = transfer_animation(&hung.unwrap(), &clip, &target, &map, &options).unwrap();
    let lowest = |places: &[Vec3]| places.iter().fold(f64::INFINITY, |low, it| low.min(it.y));
    let reached =
        (0..clip.n_frames()).map(|it| lowest(&world_frames(&res.clip, it, target.parents()).1));
    let reached = reached.fold(f64::INFINITY, f64::min);
    assert!((reached - lowest(target.positions())).abs() < 1e-12);
}

#[test]
fn what_does_not_fit_is_told() {
    let (source, clip) = walker(Body::Biped);
    let map = segments_by_name(&source, &source);
    let options = TransferAnimationOptions::default();
    let message = |clip: &Clip, map: &SegmentMap| {
        transfer_animation(&source, clip, &source, map, &options).unwrap_err().to_string()
    };
    assert_eq!(message(&still(3), &map), "the clip moves 3 joints, but the source skeleton has 22");
    let other = SegmentMap::new(4, vec![None; 22]).unwrap();
    assert_eq!(
        message(&clip, &other),
        "the map leads to a source of 4 joints, but the source skeleton has 22"
    );
    let short = SegmentMap::new(22, vec![None; 3]).unwrap();
    assert_eq!(
        message(&clip, &short),
        "the map is for 3 target joints, but the target skeleton has 22"
    );
    let nothing = SegmentMap::new(22, vec![None; 22]).unwrap();
    assert_eq!(message(&clip, &nothing), "no bone of the target follows one of the source");
    let empty = Clip { rotations: vec![], translations: vec![], ..clip };
    assert_eq!(message(&empty, &map), "the clip has no frames");
}
