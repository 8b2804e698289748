use super::*;
use crate::kernels::motion::fit_clip::world_positions;
use crate::kernels::numerics::random::Random;

fn skeleton(points: &[Vec3], parents: &[Option<usize>]) -> Skeleton {
    let names = (0..points.len()).map(|it| format!("j{it}")).collect();
    Skeleton::new(names, parents.to_vec(), points.to_vec()).unwrap()
}

/// A figure of straight limbs from a pelvis (0) and a chest; every limb has `n` bones.
fn figure(n: usize, with_tail: bool) -> Skeleton {
    let mut points = vec![Vec3::new(0.0, 1.0, 0.0)];
    let mut parents = vec![None];
    let mut limb = |from: usize, to: [f64; 3]| {
        let (start, end) = (points[from], Vec3::from(to));
        for step in 1..=n {
            parents.push(Some(if step == 1 { from } else { points.len() - 1 }));
            points.push(start + (end - start) * (step as f64 / n as f64));
        }
        points.len() - 1
    };
    let chest = limb(0, [0.0, 1.5, 0.0]);
    limb(chest, [0.0, 1.8, 0.05]);
    limb(chest, [0.7, 1.2, 0.0]);
    limb(chest, [-0.7, 1.2, 0.0]);
    limb(0, [0.2, 0.0, 0.0]);
    limb(0, [-0.2, 0.0, 0.0]);
    if with_tail {
        limb(0, [0.0, 0.9, -0.4]);
    }
    skeleton(&points, &parents)
}

fn united(poses: &[&Skeleton]) -> Union {
    let union = union_skeleton(poses, &UnionOptions::default()).unwrap();
    let n_joints = union.skeleton.n_joints();
    assert!(union.places.iter().all(|it| it.len() == n_joints));
    let clip = clip_of_places(&union.skeleton, &union.places, "poses");
    for (pose, places) in union.places.iter().enumerate() {
        for (a, b) in world_positions(&clip, pose, union.skeleton.parents()).iter().zip(places) {
            assert!((a - b).norm() < 1e-9);
        }
    }
    union
}

#[test]
fn a_skeleton_with_itself_stays_as_it_is() {
    let one = figure(5, false);
    let union = united(&[&one, &one, &one]);
    assert_eq!(union.skeleton.n_joints(), one.n_joints());
    assert_eq!((&union.counts[..], union.reference), (&vec![3; one.n_joints()][..], 0));
    for (joint, place) in union.skeleton.positions().iter().enumerate() {
        let nearest = one.positions().iter().map(|it| (it - place).norm()).fold(9.0, f64::min);
        assert!(nearest < 1e-9, "joint {joint}");
    }
    assert!(union.is_observed.iter().flatten().all(|it| *it));
}

#[test]
fn coarse_and_fine_give_the_fine_one() {
    let (coarse, fine) = (figure(2, false), figure(10, false));
    for poses in [[&coarse, &fine], [&fine, &coarse]] {
        let union = united(&poses);
        assert_eq!(union.skeleton.n_joints(), fine.n_joints());
        for place in union.places.iter().flatten() {
            let nearest = fine.positions().iter().map(|it| (it - place).norm()).fold(9.0, f64::min);
            assert!(nearest < 1e-9);
        }
    }
}

#[test]
fn a_limb_of_some_poses_is_there_once() {
    let (without, with) = (figure(4, false), figure(4, true));
    let union = united(&[&without, &with, &without, &with]);
    assert_eq!(union.skeleton.n_joints(), with.n_joints());
    let n_unobserved = |pose: usize| union.is_observed[pose].iter().filter(|it| !**it).count();
    assert_eq!([0, 1, 2, 3].map(n_unobserved), [4, 0, 4, 0]);
    // Where it is not seen, it hangs at its place.
    let tip = (0..with.n_joints()).find(|&it| !union.is_observed[0][it]).unwrap();
    assert!((union.places[0][tip] - union.places[1][tip]).norm() < 1e-9);
}

#[test]
fn a_limb_within_a_branch_is_grafted_there() {
    let line: Vec<Vec3> = (0..=8).map(|it| Vec3::y() * f64::from(it)).collect();
    let parents: Vec<Option<usize>> = (0..9_usize).map(|it| it.checked_sub(1)).collect();
    let plain = skeleton(&line, &parents);
    let (mut points, mut branched) = (line.clone(), parents.clone());
    points.extend([Vec3::new(1.0, 3.0, 0.0), Vec3::new(2.0, 3.0, 0.0)]);
    branched.extend([Some(3), Some(9)]);
    let spurred = skeleton(&points, &branched);
    for poses in [[&plain, &spurred], [&spurred, &plain]] {
        let union = united(&poses);
        assert_eq!(union.skeleton.n_joints(), 11);
        assert_eq!(union.skeleton.children().iter().filter(|it| it.len() > 1).count(), 1);
    }
}

/// A copy with joints at random places along its limbs, in another order of limbs.
fn resampled(random: &mut Random, n: usize) -> Skeleton {
    let even = figure(n, false);
    let mut points = even.positions().to_vec();
    let children = even.children();
    for joint in 1..points.len() {
        let parent = even.parents()[joint].unwrap();
        if children[joint].len() == 1 {
            let share = random.between(-0.3, 0.3);
            points[joint] += (even.positions()[joint] - even.positions()[parent]) * share;
        }
    }
    skeleton(&points, even.parents())
}

#[test]
fn the_order_of_poses_hardly_matters() {
    let mut random = Random::new(1);
    let poses: Vec<Skeleton> = [6, 8, 7, 6].map(|it| resampled(&mut random, it)).to_vec();
    let mut counts = Vec::new();
    for order in [[0, 1, 2, 3], [3, 2, 1, 0], [1, 3, 0, 2], [2, 0, 3, 1]] {
        let union = united(&order.map(|it| &poses[it]));
        counts.push(union.skeleton.n_joints());
        for places in &union.places {
            for (joint, parent) in union.skeleton.parents().iter().enumerate() {
                let Some(parent) = *parent else { continue };
                assert!((places[joint] - places[parent]).norm() > 1e-6, "no bone of no length");
            }
        }
    }
    let (low, high) = (counts.iter().min().unwrap(), counts.iter().max().unwrap());
    assert!(*high - *low <= *low / 8, "{counts:?}");
    assert!(*high <= 2 * poses[1].n_joints(), "{counts:?}");
}

/// A trunk along z with a limb to each side, at these places along it.
fn trunk([left, right]: [f64; 2]) -> Skeleton {
    let mut points = vec![Vec3::zeros()];
    let mut parents = vec![None];
    let mut limb = |from: usize, to: Vec3| {
        let start = points[from];
        for step in 1..=4 {
            parents.push(Some(if step == 1 { from } else { points.len() - 1 }));
            points.push(start.lerp(&to, 0.25 * f64::from(step)));
        }
        points.len() - 1
    };
    let mut forks = [(left, 1.0), (right, -1.0)];
    forks.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut at = 0;
    for (z, side) in forks {
        at = limb(at, Vec3::z() * z);
        limb(at, Vec3::new(side, 0.3, z));
    }
    limb(at, Vec3::z() * 2.0);
    skeleton(&points, &parents)
}

#[test]
fn the_order_of_limbs_that_leave_a_trunk_at_one_place_does_not_matter() {
    let poses = [trunk([0.95, 1.05]), trunk([1.04, 0.97]), trunk([0.98, 1.01])];
    let poses: Vec<&Skeleton> = poses.iter().collect();
    let is_right = |hub: f64| {
        let union = union_skeleton(&poses, &UnionOptions { hub, ..Default::default() }).unwrap();
        let ends: Vec<usize> = (0..union.skeleton.n_joints())
            .filter(|&it| union.skeleton.children()[it].is_empty())
            .collect();
        let sides =
            |it: &usize| union.places.iter().map(|pose| pose[*it].x.round() as i32).collect();
        let mut sides: Vec<Vec<i32>> = ends.iter().map(sides).collect();
        sides.sort();
        // The root is the fourth end.
        sides == [[-1; 3], [0; 3], [1; 3]] && union.is_observed.iter().flatten().all(|it| *it)
    };
    assert!(is_right(UnionOptions::default().hub));
    assert!(!is_right(0.0), "where branch nodes stay apart, their order has to be the same");
}

#[test]
fn a_hub_lies_in_the_middle_of_its_branch_nodes_and_far_ones_stay() {
    let near = with_hubs(&trunk([0.95, 1.05]), 0.08);
    assert_eq!(near.n_joints(), trunk([0.95, 1.05]).n_joints() - 4);
    let hub = (0..near.n_joints()).find(|&it| near.children()[it].len() == 3).unwrap();
    assert!((near.positions()[hub] - Vec3::z()).norm() < 1e-12);
    let far = trunk([0.6, 1.4]);
    assert_eq!(with_hubs(&far, 0.08), far);
    assert_eq!(with_hubs(&near, 0.08), near);
}

#[test]
fn odd_inputs() {
    let error = union_skeleton(&[], &UnionOptions::default()).unwrap_err();
    assert_eq!(error, UnionError::Nothing);
    let point = skeleton(&[Vec3::x()], &[None]);
    let union = united(&[&point, &point]);
    assert_eq!((union.skeleton.n_joints(), union.counts[0]), (1, 2));
    let union = united(&[&point, &figure(3, false)]);
    assert_eq!(union.skeleton.n_joints(), figure(3, false).n_joints());
    let two = skeleton(&[Vec3::x(), Vec3::y(), Vec3::z() * 5.0], &[None, Some(0), None]);
    assert_eq!(united(&[&two, &two]).skeleton.n_joints(), 3);
    assert_eq!(united(&[&figure(2, false), &two]).places.len(), 2);
    let options = UnionOptions { reference: Some(2), ..Default::default() };
    let error = union_skeleton(&[&point, &point], &options).unwrap_err();
    assert_eq!(error.to_string(), "the reference is pose 2, but there are 2, from 0");
}
