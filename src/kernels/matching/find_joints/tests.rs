use std::collections::BTreeMap;

use nalgebra::UnitQuaternion;

use super::*;
use crate::kernels::motion::fit_clip::world_positions;
use crate::kernels::motion::pose::{Turn, pose};
use crate::kernels::numerics::random::Random;

/// Joints of a rig with `n` nodes along every bone; names are kept.
fn figure(rig: &[(&str, Option<usize>, [f64; 3])], n: usize) -> Skeleton {
    let (mut names, mut parents, mut points) = (Vec::new(), Vec::new(), Vec::new());
    let mut node_of: Vec<usize> = Vec::new();
    for (name, parent, place) in rig {
        let end = Vec3::from(*place);
        let mut last = parent.map(|it: usize| node_of[it]);
        if let Some(from) = last {
            let start: Vec3 = points[from];
            for step in 1..n {
                names.push(format!("{name}.{step}"));
                parents.push(last);
                last = Some(points.len());
                points.push(start + (end - start) * (step as f64 / n as f64));
            }
        }
        names.push((*name).to_owned());
        parents.push(last);
        node_of.push(points.len());
        points.push(end);
    }
    Skeleton::new(names, parents, points).unwrap()
}

fn arm() -> Skeleton {
    let rig = [
        ("shoulder", None, [0.0, 0.0, 0.0]),
        ("elbow", Some(0), [1.0, 0.0, 0.0]),
        ("hand", Some(1), [2.0, 0.0, 0.0]),
    ];
    figure(&rig, 12)
}

fn body() -> Skeleton {
    let rig = [
        ("pelvis", None, [0.0, 1.0, 0.0]),
        ("chest", Some(0), [0.0, 1.5, 0.0]),
        ("head", Some(1), [0.0, 1.8, 0.0]),
        ("elbow_l", Some(1), [0.4, 1.5, 0.0]),
        ("hand_l", Some(3), [0.8, 1.5, 0.0]),
        ("elbow_r", Some(1), [-0.4, 1.5, 0.0]),
        ("hand_r", Some(5), [-0.8, 1.5, 0.0]),
        ("foot_l", Some(0), [0.2, 0.0, 0.0]),
        ("foot_r", Some(0), [-0.2, 0.0, 0.0]),
    ];
    figure(&rig, 10)
}

fn posed(skeleton: &Skeleton, turns: &[(&str, Turn)]) -> Vec<Vec3> {
    let turns: BTreeMap<String, Turn> = turns.iter().map(|it| (it.0.to_owned(), it.1)).collect();
    let clip = pose(skeleton, &turns, None).unwrap();
    world_positions(&clip, 0, skeleton.parents())
}

#[test]
fn an_arm_of_two_bones_has_one_joint_with_one_hinge() {
    let arm = arm();
    let axis = Vec3::new(0.0, 0.6, 0.8);
    let bent = |degrees: f64| {
        let turn = UnitQuaternion::new(axis * f64::to_radians(degrees));
        let elbow = Vec3::x();
        let place = |it: &Vec3| if it.x > 1.0 { elbow + turn * (it - elbow) } else { *it };
        arm.positions().iter().map(place).collect::<Vec<_>>()
    };
    for window in [0.0, 0.05, 0.1] {
        let options = JointOptions { window, ..Default::default() };
        let joints = find_joints(&arm, &[bent(0.0), bent(45.0), bent(90.0)], &options).unwrap();
        assert_eq!((joints.len(), joints[0].n_freedoms), (1, 1));
        assert!((joints[0].position - Vec3::x()).norm() < 1e-6);
        assert!((joints[0].angle - 90.0).abs() < 1e-6);
        assert!(joints[0].axis.angle(&axis).to_degrees() < 1.0);
    }
}

#[test]
fn a_root_of_two_bones_may_be_a_joint() {
    let rig = [
        ("elbow", None, [0.0, 0.0, 0.0]),
        ("shoulder", Some(0), [-1.0, 0.0, 0.0]),
        ("hand", Some(0), [1.0, 0.0, 0.0]),
    ];
    let skeleton = figure(&rig, 8);
    let turn = UnitQuaternion::new(Vec3::z() * 1.0);
    let place = |it: &Vec3| if it.x > 0.0 { turn * it } else { *it };
    let bent: Vec<Vec3> = skeleton.positions().iter().map(place).collect();
    let joints = find_joints(&skeleton, &[bent], &JointOptions::default()).unwrap();
    assert_eq!(joints.len(), 1);
    assert!(joints[0].position.norm() < 1e-9);
}

#[test]
fn two_axes_are_two_freedoms() {
    let arm = arm();
    let poses: Vec<Vec<Vec3>> = [[0.0, 0.0, 50.0], [0.0, 50.0, 0.0], [0.0, 0.0, -40.0]]
        .iter()
        .map(|&turn| posed(&arm, &[("elbow", turn)]))
        .collect();
    let joints = find_joints(&arm, &poses, &JointOptions::default()).unwrap();
    assert_eq!((joints.len(), joints[0].n_freedoms), (1, 2));
    assert!(joints[0].spreads[2] < 1e-6, "roll cannot be seen");
}

#[test]
fn rigid_motions_have_no_joints() {
    let mut random = Random::new(4);
    for skeleton in [arm(), body()] {
        let mut moved = || {
            let turn = UnitQuaternion::from_scaled_axis(Vec3::from_fn(|_, _| random.normal()));
            let by = Vec3::from_fn(|_, _| random.normal());
            skeleton.positions().iter().map(|it| turn * it + by).collect::<Vec<_>>()
        };
        let poses = [moved(), moved(), moved()];
        for window in [0.0, 0.08] {
            let options = JointOptions { window, ..Default::default() };
            assert_eq!(find_joints(&skeleton, &poses, &options).unwrap(), []);
        }
    }
}

#[test]
fn an_elbow_that_moves_tells_of_the_other() {
    let body = body();
    let poses = [posed(&body, &[]), posed(&body, &[("elbow_l", [0.0, 0.0, 60.0])])];
    let joints = find_joints(&body, &poses, &JointOptions::default()).unwrap();
    let places: Vec<f64> = joints.iter().map(|it| it.position.x).collect();
    assert!((places[0] - 0.4).abs() < 1e-6 && (places[1] + 0.4).abs() < 1e-6, "{places:?}");
    assert_eq!(joints.iter().map(|it| it.is_mirrored).collect::<Vec<_>>(), [false, true]);
    let options = JointOptions { is_symmetric: false, ..Default::default() };
    assert_eq!(find_joints(&body, &poses, &options).unwrap().len(), 1);
}

#[test]
fn limbs_bend_at_branch_nodes_too() {
    let body = body();
    // Each of several turns, on a figure that is turned as a whole: only the limbs that move bend.
    let turns = [("foot_l.1", [40.0, 0.0, 0.0]), ("elbow_r", [0.0, 50.0, 0.0])];
    let whole = [("pelvis", [0.0, 130.0, 0.0]), turns[0], turns[1]];
    let options = JointOptions { is_symmetric: false, at_forks: true, ..Default::default() };
    let joints = find_joints(&body, &[posed(&body, &whole)], &options).unwrap();
    assert_eq!(joints.len(), 2, "{joints:#?}");
    assert!((joints.iter().map(|it| it.angle).fold(0.0, f64::max) - 50.0).abs() < 1.0);
}

#[test]
fn odd_skeletons_have_no_joints() {
    let point = Skeleton::new(vec!["a".to_owned()], vec![None], vec![Vec3::x()]).unwrap();
    let options = JointOptions::default();
    assert_eq!(find_joints(&point, &[vec![Vec3::zeros()]], &options).unwrap(), []);
    assert_eq!(find_joints(&arm(), &[], &options).unwrap(), []);
    let names = ["a", "b", "c"].map(str::to_owned).to_vec();
    let same = vec![Vec3::x(); 3];
    let flat = Skeleton::new(names, vec![None, Some(0), Some(1)], same.clone()).unwrap();
    assert_eq!(find_joints(&flat, &[same], &options).unwrap(), []);
    let error = find_joints(&point, &[vec![]], &options).unwrap_err();
    assert_eq!(error.to_string(), "pose 0 has 0 joints, but the skeleton 1");
}

#[test]
fn hips_beside_the_curve_are_found_from_the_legs() {
    // The curve of each leg begins at the pelvis and joins the leg's axis below the hip.
    let (hip, corner) = ([0.15, 1.0], [0.15, 0.85]);
    let leg = |side: f64, swing: f64| -> Vec<Vec3> {
        let turn = UnitQuaternion::new(Vec3::x() * swing);
        let center = Vec3::new(side * hip[0], hip[1], 0.0);
        let at = |y: f64| center + turn * (Vec3::new(side * corner[0], y, 0.0) - center);
        let mut points: Vec<Vec3> = (1..6)
            .map(|it| Vec3::new(0.0, 0.95, 0.0).lerp(&at(corner[1]), f64::from(it) / 6.0))
            .collect();
        points.extend((0..=20).map(|it| at(corner[1] - 0.8 * f64::from(it) / 20.0)));
        points
    };
    let arm = |side: f64, lift: f64| -> Vec<Vec3> {
        let turn = UnitQuaternion::new(Vec3::z() * lift * side);
        let shoulder = Vec3::new(side * 0.2, 1.5, 0.0);
        let mut points: Vec<Vec3> = (1..6)
            .map(|it| Vec3::y() * 1.5 + Vec3::x() * side * 0.2 * f64::from(it) / 6.0)
            .collect();
        points
            .extend((0..=20).map(|it| shoulder + turn * (Vec3::x() * side * 0.04 * f64::from(it))));
        points
    };
    let figure = |swings: [f64; 2], lifts: [f64; 2]| -> Vec<Vec3> {
        let mut points: Vec<Vec3> =
            (0..=11).map(|it| Vec3::y() * (0.95 + 0.05 * f64::from(it))).collect();
        points.extend((1..8).map(|it| Vec3::y() * (1.5 + 0.05 * f64::from(it))));
        points.extend([leg(1.0, swings[0]), leg(-1.0, swings[1])].concat());
        points.extend([arm(1.0, lifts[0]), arm(-1.0, lifts[1])].concat());
        points
    };
    let mut parents: Vec<Option<usize>> = (0..19_usize).map(|it| it.checked_sub(1)).collect();
    for start in [0, 0, 11, 11] {
        for step in 0..26 {
            parents.push(Some(if step == 0 { start } else { parents.len() - 1 }));
        }
    }
    let rest = figure([0.0; 2], [0.0; 2]);
    let names = (0..rest.len()).map(|it| format!("n{it}")).collect();
    let skeleton = Skeleton::new(names, parents, rest.clone()).unwrap();
    let poses = [
        rest,
        figure([-0.9, 0.2], [0.5, -0.4]),
        figure([0.4, -1.1], [-0.7, 0.3]),
        figure([-0.5, -0.6], [0.9, 0.8]),
    ];
    let distance = |is_centered: bool| {
        let options = JointOptions { is_centered, is_symmetric: false, ..Default::default() };
        let joints = find_joints(&skeleton, &poses, &options).unwrap();
        let hip = Vec3::new(hip[0], hip[1], 0.0);
        let distances = joints.iter().map(|it| (it.position - hip).norm());
        distances.fold(f64::INFINITY, f64::min)
    };
    let (on_curve, centered) = (distance(false), distance(true));
    assert!(on_curve > 0.1 && centered < 0.03, "{on_curve} {centered}");
}

#[test]
fn a_joint_beside_its_curve_has_its_image_beside_the_other() {
    let body = body();
    let poses = [posed(&body, &[]), posed(&body, &[("elbow_l", [0.0, 0.0, 60.0])])];
    let options = JointOptions { is_symmetric: false, ..Default::default() };
    let mut joints = find_joints(&body, &poses, &options).unwrap();
    joints[0].position += Vec3::new(0.02, 0.03, 0.04);
    add_images(&body, &mut joints, &options);
    assert_eq!(joints.len(), 2);
    let image = joints.iter().find(|it| it.is_mirrored).unwrap();
    let expected = Vec3::new(-0.42, 1.53, 0.04);
    assert!((image.position - expected).norm() < 1e-6, "{}", image.position);
}

/// The legs of a horse are alike, and its neck and tail are as long.
#[test]
fn the_front_of_a_horse_is_no_image_of_its_back() {
    let nodes: [(&str, Option<usize>, [f64; 3]); 13] = [
        ("chest", None, [0.0, 1.0, 0.6]),
        ("pelvis", Some(0), [0.0, 1.0, -0.6]),
        ("neck", Some(0), [0.0, 1.3, 0.9]),
        ("head", Some(2), [0.0, 1.6, 1.2]),
        ("rump", Some(1), [0.0, 0.8, -0.95]),
        ("tail", Some(4), [0.0, 0.4, -1.05]),
        ("elbow_l", Some(0), [0.3, 0.6, 0.6]),
        ("hoof_l", Some(6), [0.3, 0.0, 0.6]),
        ("elbow_r", Some(0), [-0.3, 0.6, 0.6]),
        ("hoof_r", Some(8), [-0.3, 0.0, 0.6]),
        ("knee_l", Some(1), [0.3, 0.58, -0.6]),
        ("foot_l", Some(10), [0.3, 0.0, -0.6]),
        ("foot_r", Some(1), [-0.3, 0.0, -0.6]),
    ];
    let horse = Skeleton::new(
        nodes.iter().map(|it| it.0.to_owned()).collect(),
        nodes.iter().map(|it| it.1).collect(),
        nodes.iter().map(|it| it.2.into()).collect(),
    )
    .unwrap();
    let seen = |bone: usize| Joint {
        bone,
        share: 1.0,
        position: horse.positions()[bone],
        angle: 60.0,
        n_freedoms: 1,
        axis: Vec3::x(),
        spreads: [60.0, 0.0, 0.0],
        is_mirrored: false,
    };
    let mut joints = vec![seen(2), seen(6)];
    add_images(&horse, &mut joints, &JointOptions::default());
    let images: Vec<Vec3> =
        joints.iter().filter(|it| it.is_mirrored).map(|it| it.position).collect();
    assert_eq!(images.len(), 1, "{images:?}");
    assert!((images[0] - Vec3::new(-0.3, 0.6, 0.6)).norm() < 1e-6, "{}", images[0]);
}
