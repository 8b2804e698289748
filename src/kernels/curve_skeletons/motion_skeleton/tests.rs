use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion};

use super::connect::connect_over_time;
use super::moments::Moments;
use super::split::{Bones, best_cut};
use super::*;
use crate::kernels::curve_skeletons::curve_skeleton::NO_NODE;
use crate::kernels::geometry::kabsch::best_rotation;
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::motion::fit_clip::world_positions;
use crate::kernels::numerics::random::Random;
use crate::kernels::rigs::skinning::skin;

/// A bar along x with a node at every slice of 8 vertices.
fn bar(n_slices: usize) -> (Vec<Vec3>, Vec<[u32; 3]>, CurveSkeleton) {
    let mut rest = vec![];
    for slice in 0..n_slices {
        for corner in 0..8 {
            let angle = f64::from(corner) * std::f64::consts::FRAC_PI_4 + 0.2;
            rest.push(Vec3::new(0.1 * slice as f64, 0.2 * angle.cos(), 0.15 * angle.sin()));
        }
    }
    let mut faces = vec![];
    for slice in 0..n_slices as u32 - 1 {
        for corner in 0..8 {
            let [a, b] = [8 * slice + corner, 8 * slice + (corner + 1) % 8];
            faces.extend([[a, b, b + 8], [a, b + 8, a + 8]]);
        }
    }
    let nodes = (0..n_slices).map(|it| Vec3::x() * 0.1 * it as f64).collect();
    let edges = (1..n_slices as u32).map(|it| [it - 1, it]).collect();
    let labels = (0..rest.len() as u32).map(|it| it / 8).collect();
    (rest, faces, CurveSkeleton::new(nodes, vec![0.2; n_slices], edges, labels).unwrap())
}

fn rigid(random: &mut Random) -> Isometry3<f64> {
    let mut vector = || Vec3::from_fn(|_, _| random.between(-0.7, 0.7));
    Isometry3::from_parts(Translation3::from(vector()), UnitQuaternion::from_scaled_axis(vector()))
}

/// What turns about z at a place on the x axis.
fn hinge(x: f64, angle: f64) -> Isometry3<f64> {
    let at = Translation3::new(x, 0.0, 0.0);
    at * UnitQuaternion::from_axis_angle(&Vec3::z_axis(), angle) * at.inverse()
}

/// Frames of vertices that move rigidly, each by one of several motions.
fn frames(
    rest: &[Vec3],
    n: usize,
    motion: impl Fn(usize, &Vec3) -> Isometry3<f64>,
) -> Vec<Vec<Vec3>> {
    let moved = |frame: usize, it: &Vec3| (motion(frame, it) * Point3::from(*it)).coords;
    (0..n).map(|frame| rest.iter().map(|it| moved(frame, it)).collect()).collect()
}

fn slices(frames: &[Vec<Vec3>]) -> Vec<&[Vec3]> {
    frames.iter().map(Vec::as_slice).collect()
}

#[test]
fn sums_along_a_curve_give_what_kabsch_gives() {
    let mut random = Random::new(3);
    let rest: Vec<Vec3> = (0..90).map(|_| Vec3::from_fn(|_, _| random.normal() + 5.0)).collect();
    let frames: Vec<Vec<Vec3>> = (0..4)
        .map(|_| {
            let motion = rigid(&mut random);
            let noise = |random: &mut Random| Vec3::from_fn(|_, _| 0.3 * random.normal());
            rest.iter().map(|it| (motion * Point3::from(*it)).coords + noise(&mut random)).collect()
        })
        .collect();
    let frames = slices(&frames);
    let moving = Moving::new(&rest, &frames);
    let direct = |set: &[u32]| -> f64 {
        let mean =
            |of: &[Vec3]| set.iter().map(|&it| of[it as usize]).sum::<Vec3>() / set.len() as f64;
        let cost = |frame: &&[Vec3]| {
            let (a, b) = (mean(&rest), mean(frame));
            let pairs = set.iter().map(|&it| (rest[it as usize] - a, frame[it as usize] - b));
            let rotation = best_rotation(&pairs.clone().map(|(v, y)| y * v.transpose()).sum());
            pairs.map(|(v, y)| (y - rotation * v).norm_squared()).sum::<f64>()
        };
        frames.iter().map(cost).sum()
    };
    let nodes: Vec<Vec<u32>> = (0..9).map(|it| (10 * it..10 * it + 10).collect()).collect();
    let mut prefix = Moments::none(frames.len());
    let mut total = Moments::none(frames.len());
    nodes.iter().for_each(|it| total.add(&Moments::of(&moving, it)));
    for cut in 1..9 {
        prefix.add(&Moments::of(&moving, &nodes[cut - 1]));
        let (first, second) = (nodes[..cut].concat(), nodes[cut..].concat());
        assert!((prefix.rigid_cost() - direct(&first)).abs() < 1e-9);
        assert!((total.without(&prefix).rigid_cost() - direct(&second)).abs() < 1e-9);
    }
}

#[test]
fn two_boxes_on_a_hinge_are_split_there() {
    let (rest, faces, curves) = bar(20);
    let mut random = Random::new(5);
    let whole: Vec<Isometry3<f64>> = (0..6).map(|_| rigid(&mut random)).collect();
    let at = 1.15;
    let frames = frames(&rest, 6, |frame, it| match it.x < at {
        true => whole[frame],
        false => whole[frame] * hinge(at, 0.15 * frame as f64),
    });
    let frames = slices(&frames);
    let options = MotionSkeletonOptions::default();
    let res = motion_skeleton(&rest, &faces, &frames, 30.0, &curves, &options).unwrap();
    assert_eq!((res.n_bones, res.n_splits, res.n_links), (2, 1, 0));
    assert!(res.rmse < 1e-6 && res.rigid_rmse < 1e-6 && res.curves_rmse > 0.01, "{res:?}");
    // The joint is the last node before the hinge, and the root as the middle of the path.
    assert_eq!(res.skeleton.positions()[0], curves.positions()[11]);
    assert_eq!(res.skeleton.parents(), [None, Some(0), Some(0)]);
    for (frame, motion) in whole.iter().enumerate() {
        let places = world_positions(&res.clip, frame, res.skeleton.parents());
        let expected = (motion * Point3::from(res.skeleton.positions()[0])).coords;
        assert!((places[0] - expected).norm() < 1e-6);
    }
    // The rig of skeleton, weights and clip plays the motion.
    let mesh = TriMesh::new(rest.clone(), faces).unwrap();
    for (frame, truth) in frames.iter().enumerate() {
        let posed = skin(&mesh, &res.skeleton, &res.weights, &res.clip, frame).unwrap();
        assert!(posed.iter().zip(*truth).all(|(a, b)| (a - b).norm() < 1e-5));
    }
}

#[test]
fn a_rigid_body_is_not_split() {
    let (rest, faces, curves) = bar(12);
    let mut random = Random::new(1);
    let whole: Vec<Isometry3<f64>> = (0..5).map(|_| rigid(&mut random)).collect();
    let frames = frames(&rest, 5, |frame, _| whole[frame]);
    let options = MotionSkeletonOptions::default();
    let res = motion_skeleton(&rest, &faces, &slices(&frames), 30.0, &curves, &options).unwrap();
    assert_eq!((res.n_bones, res.n_splits, res.skeleton.n_joints()), (1, 0, 2));
    assert!(res.rmse < 1e-6);
}

#[test]
fn small_sides_and_many_bones_are_not_made() {
    let (rest, faces, curves) = bar(30);
    // Every slice turns against the one before.
    let frames = frames(&rest, 4, |frame, it| hinge(0.0, frame as f64 * 0.2 * it.x));
    let frames = slices(&frames);
    let mut options = MotionSkeletonOptions::default();
    let made = |options: &MotionSkeletonOptions| {
        motion_skeleton(&rest, &faces, &frames, 30.0, &curves, options).unwrap()
    };
    let free = made(&options);
    assert_eq!(free.n_bones, 8, "every bone is split in each of three rounds");
    assert!(free.rigid_rmse < 0.2 * free.curves_rmse);
    options.max_bones = 5;
    assert_eq!(made(&options).n_bones, 5);
    options.min_side = 121;
    assert_eq!(made(&options).n_bones, 1);
    options.min_side = 10;
    options.threshold = 1.0;
    assert_eq!(made(&options).n_bones, 1);
}

#[test]
fn the_best_cut_is_the_best_of_all() {
    let (rest, _, curves) = bar(15);
    let frames = frames(&rest, 3, |frame, it| hinge(0.9, frame as f64 * (it.x - 0.9).max(0.0)));
    let frames = slices(&frames);
    let moving = Moving::new(&rest, &frames);
    let sets = curves.vertices_of_nodes();
    let moments: Vec<Moments> = sets.iter().map(|it| Moments::of(&moving, it)).collect();
    let bones = Bones::new(15, super::curves(&curves));
    let cut = best_cut(&moving, &moments, &bones, 0, &MotionSkeletonOptions::default()).unwrap();
    let of = |nodes: &[Vec<u32>]| Moments::of(&moving, &nodes.concat()).rigid_cost();
    let costs: Vec<f64> = (2..14).map(|it| of(&sets[..it]) + of(&sets[it..])).collect();
    let best = (0..costs.len()).min_by(|&a, &b| costs[a].total_cmp(&costs[b])).unwrap();
    assert_eq!(cut.at, best + 1);
    assert!((cut.gain - (of(&sets) - costs[best])).abs() < 1e-9);
}

/// A cross of four bars in one body, in three components; the arm that is near at rest moves away.
#[test]
fn components_are_joined_where_they_stay_close() {
    let (one, _, _) = bar(6);
    let part = |offset: Vec3| one.iter().map(move |it| it + offset);
    let rest: Vec<Vec3> = part(Vec3::zeros())
        .chain(part(Vec3::new(0.7, 0.0, 0.0)))
        .chain(part(Vec3::new(0.0, 0.45, 0.0)))
        .collect();
    let mut nodes = vec![];
    let mut edges = vec![];
    for (index, offset) in [Vec3::zeros(), Vec3::x() * 0.7, Vec3::y() * 0.45].iter().enumerate() {
        nodes.extend((0..6).map(|it| offset + Vec3::x() * 0.1 * f64::from(it)));
        edges.extend((0..5).map(|it| [it, it + 1].map(|it| it + 6 * index as u32)));
    }
    let labels: Vec<u32> = (0..rest.len() as u32).map(|it| it / 8).collect();
    let curves = CurveSkeleton::new(nodes, vec![0.2; 18], edges, labels).unwrap();
    // The third part turns about where it meets the end of the first, and swings far from its beginning.
    let pivot = Vec3::new(0.5, 0.2, 0.0);
    let frames = frames(&rest, 5, |frame, it| match it.y > 0.21 {
        true => {
            let at = Translation3::from(pivot);
            let turn = UnitQuaternion::from_axis_angle(&Vec3::z_axis(), -0.5 * frame as f64);
            at * turn * at.inverse()
        }
        false => Isometry3::identity(),
    });
    let frames = slices(&frames);
    let moving = Moving::new(&rest, &frames);
    // Between the parts that turn against each other, the distances of other nodes change by 2.4.
    for (max_variation, expected) in [(4.0, [[5, 6], [0, 12]]), (2.0, [[5, 6], [5, 17]])] {
        let (joined, n_links) = connect_over_time(&curves, &moving, max_variation);
        assert_eq!((n_links, joined.n_components(), joined.n_cycles()), (2, 1, 0));
        let added = joined.edges().iter().copied().filter(|it| !curves.edges().contains(it));
        let mut added: Vec<[u32; 2]> = added.collect();
        added.sort_by_key(|it| it[1]);
        assert_eq!(added, expected);
    }
}

#[test]
fn nothing_and_single_nodes() {
    let (rest, faces, _) = bar(4);
    let frames = [rest.as_slice(), rest.as_slice()];
    let options = MotionSkeletonOptions::default();
    let made = |skeleton: &CurveSkeleton| {
        motion_skeleton(&rest, &faces, &frames, 30.0, skeleton, &options)
    };
    let single = |labels: Vec<u32>| {
        CurveSkeleton::new(vec![Vec3::zeros()], vec![0.1], vec![], labels).unwrap()
    };
    let res = made(&single(vec![0; 32])).unwrap();
    assert_eq!((res.skeleton.n_joints(), res.n_bones, res.weights.n_joints()), (1, 0, 1));
    let error = made(&CurveSkeleton::default()).unwrap_err();
    assert_eq!(error, MotionSkeletonError::NoNodes);
    let error = made(&single(vec![0; 3])).unwrap_err();
    assert_eq!(error, MotionSkeletonError::Labels { n_labels: 3, n_vertices: 32 });
    let error = made(&single(vec![NO_NODE; 32])).unwrap_err();
    assert_eq!(error, MotionSkeletonError::NoLabels { n_nodes: 1 });
}
