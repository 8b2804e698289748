use std::collections::BTreeMap;

use nalgebra::UnitQuaternion;

use super::*;
use crate::kernels::matching::find_joints::find_joints;
use crate::kernels::motion::fit_clip::world_positions;
use crate::kernels::motion::pose::{Turn, pose};
use crate::kernels::rigs::skinning::skin;
use crate::kernels::synthetic::synthesize::{Body, Character, SynthesizeOptions, synthesize};

/// A capsule of elliptic rings along x from 0 to 2, thinner at its end.
fn arm() -> TriMesh {
    let (n_rings, n_around) = (41, 24);
    let mut vertices = Vec::new();
    for ring in 0..n_rings {
        let along = ring as f64 / (n_rings - 1) as f64;
        let radius = (0.25 - 0.08 * along) * (1.0 - (2.0 * along - 1.0).powi(8)).max(0.05);
        for step in 0..n_around {
            let angle = std::f64::consts::TAU * step as f64 / n_around as f64;
            let (sin, cos) = angle.sin_cos();
            vertices.push(Vec3::new(2.0 * along, 1.3 * radius * cos, radius * sin));
        }
    }
    let mut faces = Vec::new();
    for ring in 0..n_rings - 1 {
        for step in 0..n_around {
            let next = (step + 1) % n_around;
            let at = |ring: usize, step: usize| (ring * n_around + step) as u32;
            let [a, b] = [at(ring, step), at(ring, next)];
            let [c, d] = [at(ring + 1, step), at(ring + 1, next)];
            faces.extend([[a, b, c], [c, b, d]]);
        }
    }
    TriMesh::new(vertices, faces).unwrap()
}

fn line(n: usize) -> Skeleton {
    let names = (0..n).map(|it| format!("n{it}")).collect();
    let parents = (0..n).map(|it| it.checked_sub(1)).collect();
    let places = (0..n).map(|it| Vec3::x() * (0.1 + 1.8 * it as f64 / (n - 1) as f64)).collect();
    Skeleton::new(names, parents, places).unwrap()
}

/// Bent at a place beside the axis, the skin softly, and the curve as the skin.
fn bent(points: &[Vec3], center: Vec3, turn: Vec3) -> Vec<Vec3> {
    let bend = |place: &Vec3| {
        let share = ((place.x - center.x) / 0.2 + 0.5).clamp(0.0, 1.0);
        let moved = center + UnitQuaternion::new(turn) * (place - center);
        place.lerp(&moved, share)
    };
    points.iter().map(bend).collect()
}

/// A curve and a surface in poses that are bent at one place.
fn bent_figure(
    mesh: &TriMesh,
    skeleton: &Skeleton,
    center: Vec3,
    turns: &[Vec3],
) -> (Vec<Vec<Vec3>>, Vec<TriMesh>) {
    let moved = |turn: &Vec3| {
        let places = bent(skeleton.positions(), center, *turn);
        (places, mesh.with_vertices(bent(mesh.vertices(), center, *turn)).unwrap())
    };
    turns.iter().map(moved).unzip()
}

fn joint_at(bone: usize) -> Joint {
    seeds::unknown(bone, 0.5, Vec3::zeros())
}

#[test]
fn a_joint_beside_the_curve_is_found_from_the_surface() {
    let (mesh, skeleton) = (arm(), line(19));
    let center = Vec3::new(1.0, 0.06, 0.05);
    let turns = [Vec3::zeros(), Vec3::y() * 0.9, Vec3::z() * 0.8, Vec3::new(0.0, -0.7, 0.5)];
    let (poses, surfaces) = bent_figure(&mesh, &skeleton, center, &turns);
    let surfaces: Vec<&TriMesh> = surfaces.iter().collect();
    // At three scales, and with a candidate that is too near to the tip, and one that is none.
    for scale in [1.0, 1e6, 1e-6] {
        let large = |it: &[Vec3]| it.iter().map(|it| it * scale).collect::<Vec<Vec3>>();
        let skeleton = skeleton.with_positions(large(skeleton.positions())).unwrap();
        let poses: Vec<Vec<Vec3>> = poses.iter().map(|it| large(it)).collect();
        let meshes: Vec<TriMesh> =
            surfaces.iter().map(|it| it.with_vertices(large(it.vertices())).unwrap()).collect();
        let meshes: Vec<&TriMesh> = meshes.iter().collect();
        let candidates = [joint_at(4), joint_at(11)];
        let options = FitOptions::default();
        let fit = fit_joints(&skeleton, &poses, &meshes, &candidates, &options).unwrap();
        assert_eq!(fit.joints.len(), 1, "{:#?}", fit.joints);
        let off = (fit.joints[0].position / scale - center).norm();
        assert!(off < 0.03, "{off} at {scale}");
        assert!((fit.joints[0].angle - 0.9_f64.to_degrees()).abs() < 4.0);
        assert_eq!((fit.motions.len(), fit.motions[0].len()), (4, 2));
        assert!(fit.fits.iter().all(|it| *it > 0.8), "{:?}", fit.fits);
    }
}

#[test]
fn a_joint_that_the_curve_does_not_tell_of_is_found() {
    // The curve stays straight, and so tells of no joint; the surface bends.
    let (mesh, skeleton) = (arm(), line(19));
    let turns = [Vec3::zeros(), Vec3::y() * 0.5, Vec3::z() * -0.6];
    let poses = vec![skeleton.positions().to_vec(); 3];
    let (_, surfaces) = bent_figure(&mesh, &skeleton, Vec3::x(), &turns);
    let surfaces: Vec<&TriMesh> = surfaces.iter().collect();
    let fit = fit_joints(&skeleton, &poses, &surfaces, &[], &FitOptions::default()).unwrap();
    assert_eq!(fit.joints.len(), 1);
    assert!((fit.joints[0].position - Vec3::x()).norm() < 0.06, "{}", fit.joints[0].position);
}

#[test]
fn two_joints_with_hardly_anything_but_skin_between_them_are_both_found() {
    let (mesh, skeleton) = (arm(), line(19));
    let centers = [Vec3::new(0.91, 0.0, 0.03), Vec3::new(1.09, 0.0, -0.03)];
    let turns = [
        [Vec3::zeros(); 2],
        [Vec3::y() * 0.8, Vec3::z() * 0.6],
        [Vec3::z() * -0.7, Vec3::y() * 0.8],
        [Vec3::y() * -0.6, Vec3::y() * 0.9],
    ];
    // The farther joint first, so that the nearer one carries it.
    let moved =
        |points: &[Vec3], it: &[Vec3; 2]| bent(&bent(points, centers[1], it[1]), centers[0], it[0]);
    let poses: Vec<Vec<Vec3>> = turns.iter().map(|it| moved(skeleton.positions(), it)).collect();
    let surfaces: Vec<TriMesh> =
        turns.iter().map(|it| mesh.with_vertices(moved(mesh.vertices(), it)).unwrap()).collect();
    let surfaces: Vec<&TriMesh> = surfaces.iter().collect();
    let candidates = [joint_at(8), joint_at(11)];
    let options = FitOptions::default();
    let fit = fit_joints(&skeleton, &poses, &surfaces, &candidates, &options).unwrap();
    assert_eq!(fit.joints.len(), 2, "{:#?}", fit.joints);
    for (joint, center) in fit.joints.iter().zip(&centers) {
        let off = (joint.position - center).norm();
        assert!(off < 0.01, "{} is off by {off}", joint.position);
    }
    assert!(fit.fits.iter().all(|it| *it > 0.95), "{:?}", fit.fits);
}

#[test]
fn a_joint_that_would_be_outside_of_the_body_stays_on_its_curve() {
    let (mesh, skeleton) = (arm(), line(19));
    // About an axis that is twice as far away as the skin.
    let center = Vec3::new(1.0, 0.0, 0.4);
    let turns = [Vec3::zeros(), Vec3::y() * 0.4, Vec3::y() * -0.4];
    let (poses, surfaces) = bent_figure(&mesh, &skeleton, center, &turns);
    let surfaces: Vec<&TriMesh> = surfaces.iter().collect();
    let options = FitOptions::default();
    let fit = fit_joints(&skeleton, &poses, &surfaces, &[joint_at(10)], &options).unwrap();
    assert!(!fit.joints.is_empty());
    for joint in &fit.joints {
        let beside = Vec3::new(0.0, joint.position.y, joint.position.z).norm();
        assert!(beside < 0.05, "{}", joint.position);
    }
}

#[test]
fn a_joint_stays_on_its_curve_along_the_axis_that_its_turns_share() {
    let (mesh, skeleton) = (arm(), line(19));
    // Hardly anything tells that it is beside the curve along y.
    let center = Vec3::new(1.0, 0.1, 0.05);
    let turns = [[0.0, 0.0], [0.9, 0.03], [-0.8, 0.03], [0.5, -0.03]];
    let turns = turns.map(|[y, z]| Vec3::new(0.0, y, z));
    let (poses, surfaces) = bent_figure(&mesh, &skeleton, center, &turns);
    let surfaces: Vec<&TriMesh> = surfaces.iter().collect();
    let options = FitOptions::default();
    let fit = fit_joints(&skeleton, &poses, &surfaces, &[joint_at(10)], &options).unwrap();
    let [joint] = &fit.joints[..] else { panic!("{:#?}", fit.joints) };
    let off = joint.position - Vec3::new(1.0, 0.0, 0.05);
    assert!(off.norm() < 0.02, "{off}");
}

#[test]
fn rigid_motions_need_no_joint() {
    let (mesh, skeleton) = (arm(), line(19));
    let turn = UnitQuaternion::new(Vec3::new(0.4, 0.9, -0.3));
    let moved = |it: &[Vec3]| it.iter().map(|it| turn * it + Vec3::x()).collect::<Vec<Vec3>>();
    let poses = [skeleton.positions().to_vec(), moved(skeleton.positions())];
    let other = mesh.with_vertices(moved(mesh.vertices())).unwrap();
    let candidates = [joint_at(6), joint_at(12)];
    let options = FitOptions::default();
    let fit = fit_joints(&skeleton, &poses, &[&mesh, &other], &candidates, &options).unwrap();
    assert_eq!(fit.joints, []);
    assert_eq!(fit.sides.len(), 0);
}

#[test]
fn seeds_are_all_along_the_limbs_and_apart_from_what_is_known() {
    let skeleton = line(19);
    let known = seeds::unknown(7, 0.5, Vec3::x() * 0.75);
    let all = seeds::seeded(&skeleton, std::slice::from_ref(&known), 0.1, 1.8);
    assert!(all.contains(&known));
    for joint in &all {
        assert!((joint.on_curve(&skeleton) - joint.position).norm() < 1e-12);
        assert!(joint.position.x < 1.9 - 0.1 * 1.8);
    }
    for pair in all.windows(2) {
        let step = pair[1].position.x - pair[0].position.x;
        assert!((0.6 * 0.18..1.7 * 0.18).contains(&step), "{step}");
    }
}

/// The surfaces and places of a rig in poses.
fn posed(it: &Character, turns: &[&[(&str, Turn)]]) -> (Vec<Vec<Vec3>>, Vec<TriMesh>) {
    let one = |turns: &&[(&str, Turn)]| {
        let turns: BTreeMap<String, Turn> =
            turns.iter().map(|it| (it.0.to_owned(), it.1)).collect();
        let clip = pose(&it.skeleton, &turns, None).unwrap();
        let vertices = skin(&it.mesh, &it.skeleton, &it.weights, &clip, 0).unwrap();
        let places = world_positions(&clip, 0, it.skeleton.parents());
        (places, it.mesh.with_vertices(vertices).unwrap())
    };
    turns.iter().map(one).unzip()
}

#[test]
fn joints_of_a_body_are_within_a_hundredth_and_the_same_at_any_number_of_threads() {
    let options = SynthesizeOptions { n_vertices: 1500, seed: 3, ..Default::default() };
    let body = synthesize(&SynthesizeOptions { body: Body::Biped, ..options }).unwrap();
    let (poses, meshes) = posed(
        &body,
        &[
            &[],
            &[("left_arm", [0.0, 0.0, 50.0]), ("left_leg", [70.0, 0.0, 0.0])],
            &[("left_arm", [-45.0, 0.0, 0.0]), ("left_leg", [35.0, 0.0, 0.0])],
        ],
    );
    let surfaces: Vec<&TriMesh> = meshes.iter().collect();
    let on_bones = crate::kernels::matching::find_joints::JointOptions {
        window: 0.0,
        at_forks: true,
        is_symmetric: false,
        ..Default::default()
    };
    let mut candidates = find_joints(&body.skeleton, &poses, &on_bones).unwrap();
    // As if the curves told of another place.
    for joint in &mut candidates {
        joint.share *= 0.9;
    }
    let fitted = |n_threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
        let options = FitOptions { n_samples: 1000, ..Default::default() };
        pool.install(|| {
            fit_joints(&body.skeleton, &poses, &surfaces, &candidates, &options).unwrap()
        })
    };
    let fit = fitted(1);
    assert_eq!(fit, fitted(2));
    for name in ["left_arm", "left_leg"] {
        let truth = body.skeleton.positions()[body.skeleton.joint(name).unwrap()];
        let off = fit.joints.iter().map(|it| (it.position - truth).norm());
        let off = off.fold(f64::INFINITY, f64::min);
        assert!(off < 0.0175, "{name} is off by {off}");
    }
    assert_eq!(fit.joints.len(), 2);
}

#[test]
fn what_does_not_belong_together_is_told() {
    let (mesh, skeleton) = (arm(), line(5));
    let rest = skeleton.positions().to_vec();
    let check = |poses: &[Vec<Vec3>], surfaces: &[&TriMesh], expected: &str| {
        let found = fit_joints(&skeleton, poses, surfaces, &[], &FitOptions::default());
        assert_eq!(found.unwrap_err().to_string(), expected);
    };
    let points = TriMesh::from_points(vec![Vec3::x()]).unwrap();
    check(std::slice::from_ref(&rest), &[], "there are 0 surfaces, but the skeleton is in 1 poses");
    check(std::slice::from_ref(&rest), &[&points], "surface 0 has no faces");
    check(&[vec![]], &[&mesh], "pose 0 has 0 joints, but the skeleton 5");
    let other: Vec<Vec3> = rest.iter().map(|it| it + Vec3::y()).collect();
    let off = "the skeleton is in none of the poses: it is off by 1 in the nearest one, 0";
    check(&[other], &[&mesh], off);
    let flat = skeleton.with_positions(vec![Vec3::x(); 5]).unwrap();
    let poses = [vec![Vec3::x(); 5]];
    let found = fit_joints(&flat, &poses, &[&mesh], &[], &FitOptions::default()).unwrap_err();
    assert_eq!(found.to_string(), "a skeleton of the extent 0 cannot be fitted");
    // One pose alone moves nothing.
    let fit = fit_joints(&skeleton, &[rest], &[&mesh], &[joint_at(2)], &FitOptions::default());
    assert_eq!(fit.unwrap().joints, []);
}
