use std::f64::consts::FRAC_PI_2;

use super::*;
use crate::kernels::geometry::shapes::{geodesic_sphere, rectangle};
use crate::kernels::rigs::joint_error::{HeightAxis, joint_errors};
use crate::kernels::synthetic::synthesize::{Body, Character, SynthesizeOptions, synthesize};

/// A ball of radius 0.2, drawn out to 1.6 along y.
fn capsule() -> TriMesh {
    let ball = geodesic_sphere(12);
    let drawn = ball.vertices().iter().map(|it| it * 0.2 + Vec3::y() * 0.6 * it.y.signum());
    ball.with_vertices(drawn.collect()).unwrap()
}

fn chain(positions: &[Vec3]) -> Skeleton {
    let names = (0..positions.len()).map(|it| format!("joint{it}")).collect();
    let parents = (0..positions.len()).map(|it: usize| it.checked_sub(1)).collect();
    Skeleton::new(names, parents, positions.to_vec()).unwrap()
}

fn upright(length: f64) -> Skeleton {
    chain(&[Vec3::zeros(), Vec3::y() * length])
}

fn body(body: Body, seed: u64) -> Character {
    let options = SynthesizeOptions { body, n_vertices: 2000, seed, ..Default::default() };
    synthesize(&options).unwrap()
}

fn extent_of(mesh: &TriMesh) -> Option<f64> {
    Some(extent(mesh.vertices()).2)
}

fn message(mesh: &TriMesh, skeleton: &Skeleton, options: &EmbedOptions) -> String {
    embed(mesh, skeleton, options).unwrap_err().to_string()
}

#[test]
fn a_bone_lies_along_the_axis_of_a_capsule() {
    let options = EmbedOptions { source_extent: Some(1.6), ..Default::default() };
    let res = embed(&capsule(), &upright(1.2), &options).unwrap();
    let [a, b] = res.skeleton.positions() else { panic!("both joints are matched") };
    for joint in [a, b] {
        assert!(joint.x.hypot(joint.z) < 0.02, "{joint}");
    }
    assert!(b.y - a.y > 0.9 && b.y < 0.8 && a.y > -0.8, "{} to {}", a.y, b.y);
    assert!(res.penalty < 0.1, "{}", res.penalty);
}

#[test]
fn a_body_gets_its_own_skeleton_back() {
    let cases = [(Body::Biped, 1, 5.0), (Body::Biped, 2, 5.0), (Body::Quadruped, 3, 7.0)];
    for (kind, seed, limit) in cases {
        let it = body(kind, seed);
        let options = EmbedOptions { source_extent: extent_of(&it.mesh), ..Default::default() };
        let res = embed(&it.mesh, &it.skeleton, &options).unwrap();
        let errors =
            joint_errors(&res.skeleton, &it.skeleton, &it.mesh, HeightAxis::Largest).unwrap();
        let (mean, n) = (errors.percent(errors.mean()), errors.names.len());
        println!("{kind:?}: {n} of {} joints, mean {mean:.2} %", it.skeleton.n_joints());
        assert!(mean < limit, "{kind:?}: {mean} %");
        assert!(n + 4 >= it.skeleton.n_joints(), "{n} joints");
    }
}

/// Unit, place, orientation of the faces and the skeleton's own place do not matter.
#[test]
fn the_result_moves_with_the_mesh() {
    let it = body(Body::Biped, 1);
    let options = EmbedOptions { source_extent: extent_of(&it.mesh), ..Default::default() };
    let expected = embed(&it.mesh, &it.skeleton, &options).unwrap();
    let moved = |it: &Vec3| it * 1e5 + Vec3::new(3e4, -2e4, 1e4);
    let vertices = it.mesh.vertices().iter().map(moved).collect();
    let other = it.mesh.inverted().with_vertices(vertices).unwrap();
    let shifted = it.skeleton.positions().iter().map(|it| it + Vec3::x() * 5.0).collect();
    let shifted = it.skeleton.with_positions(shifted).unwrap();
    let res = embed(&other, &shifted, &options).unwrap();
    assert_eq!(res.skeleton.names(), expected.skeleton.names());
    for (a, b) in res.skeleton.positions().iter().zip(expected.skeleton.positions()) {
        assert!((a - moved(b)).norm() < 0.03 * 1.75e5, "{a} {b}");
    }
}

#[test]
fn a_lying_skeleton_is_stood_up() {
    let it = body(Body::Biped, 1);
    let lay = UnitQuaternion::from_axis_angle(&Vec3::x_axis(), FRAC_PI_2);
    let lying = it.skeleton.positions().iter().map(|it| lay * it).collect();
    let lying = it.skeleton.with_positions(lying).unwrap();
    let source_extent = extent_of(&it.mesh);
    let options = EmbedOptions { source_extent, align: true, ..Default::default() };
    let res = embed(&it.mesh, &lying, &options).unwrap();
    assert!(res.rotation.angle_to(&lay.inverse()) < 1e-6, "{}", res.rotation);
    let told = EmbedOptions { source_extent, rotation: lay.inverse(), ..Default::default() };
    assert_eq!(embed(&it.mesh, &lying, &told).unwrap().skeleton, res.skeleton);
}

#[test]
fn a_limb_that_the_body_lacks_is_given_up() {
    let it = body(Body::Biped, 1);
    let (mut names, mut parents, mut positions) = (
        it.skeleton.names().to_vec(),
        it.skeleton.parents().to_vec(),
        it.skeleton.positions().to_vec(),
    );
    for step in 1..=2 {
        names.push(format!("wing{step}"));
        parents.push(Some(if step == 1 { 0 } else { positions.len() - 1 }));
        positions.push(positions[0] - Vec3::z() * 0.5 * f64::from(step));
    }
    let winged = Skeleton::new(names, parents, positions).unwrap();
    let options = EmbedOptions { source_extent: extent_of(&it.mesh), ..Default::default() };
    let res = embed(&it.mesh, &winged, &options).unwrap();
    let n = winged.n_joints();
    assert!(!res.joints[n - 1].is_matched && res.joints[n - 1].terms.is_none());
    assert_eq!(res.skeleton.joint("wing2"), None);
    assert!(res.n_searches > 1);
    let n_matched = res.joints.iter().filter(|it| it.is_matched).count();
    assert_eq!(n_matched, res.skeleton.n_joints());
    assert!(n_matched > n - 7, "{n_matched} of {n}");
}

/// A search that may take few steps goes on with the best, and gives nothing up that has a place.
#[test]
fn a_search_without_time_still_finds_places_for_all_joints() {
    for (kind, seed) in [(Body::Biped, 1), (Body::Quadruped, 3)] {
        let it = body(kind, seed);
        let (low, high) = it.mesh.bounds();
        let options = EmbedOptions {
            source_extent: extent_of(&it.mesh),
            source_center: Some((low + high) / 2.0),
            ..Default::default()
        };
        let found = embed(&it.mesh, &it.skeleton, &options).unwrap();
        let hasty = EmbedOptions { max_steps: 1, ..options };
        let res = embed(&it.mesh, &it.skeleton, &hasty).unwrap();
        assert!(res.joints.iter().all(|it| it.is_matched), "{kind:?}: {:?}", res.joints);
        assert_eq!(res.n_searches, 1);
        let (least, penalty) = (found.penalty, res.penalty);
        assert!(penalty >= least - 1e-12 && penalty < 1.2 * least, "{penalty} of {least}");
    }
}

#[test]
fn penalties_of_joints_add_up_to_the_penalty() {
    let it = body(Body::Biped, 1);
    let options = EmbedOptions { source_extent: extent_of(&it.mesh), ..Default::default() };
    let res = embed(&it.mesh, &it.skeleton, &options).unwrap();
    let sum: f64 = res.joints.iter().filter_map(|it| it.terms).flatten().sum();
    assert!((sum - res.penalty).abs() < 1e-9, "{sum} {}", res.penalty);
}

#[test]
fn joints_at_one_place_stay_together_and_a_single_joint_is_in_the_thick() {
    let mesh = capsule();
    let options = EmbedOptions { source_extent: Some(1.6), ..Default::default() };
    let doubled = chain(&[Vec3::zeros(), Vec3::zeros(), Vec3::y() * 1.2]);
    let res = embed(&mesh, &doubled, &options).unwrap();
    assert_eq!(res.skeleton.positions()[0], res.skeleton.positions()[1]);
    assert!(res.joints.iter().all(|it| it.is_matched));
    let single = embed(&mesh, &chain(&[Vec3::x() * 9.0]), &options).unwrap();
    let place = single.skeleton.positions()[0];
    assert!(place.x.hypot(place.z) < 0.01 && place.y.abs() < 0.61, "{place}");
    let nothing = chain(&[Vec3::x(), Vec3::x()]);
    assert_eq!(embed(&mesh, &nothing, &options).unwrap().skeleton.n_joints(), 2);
}

#[test]
fn what_cannot_be_embedded_is_told() {
    let mesh = capsule();
    let options = EmbedOptions::default();
    let names = ["a", "b"].map(str::to_owned).to_vec();
    let two = Skeleton::new(names, vec![None, None], vec![Vec3::zeros(), Vec3::y()]).unwrap();
    assert_eq!(
        message(&mesh, &two, &options),
        "the skeleton has 2 roots (`a`, `b`), but must be one tree"
    );
    let feet = EmbedOptions { feet: vec!["toe".into()], ..Default::default() };
    assert_eq!(
        message(&mesh, &upright(1.0), &feet),
        "there is no joint `toe` among the skeleton's 2"
    );
    let sheet = rectangle(4, 4, 1.0, 1.0);
    assert!(message(&sheet, &upright(1.0), &options).starts_with("no ball of 1/150"));
    let nan = EmbedOptions { source_extent: Some(f64::NAN), ..Default::default() };
    assert_eq!(
        message(&mesh, &upright(1.0), &nan),
        "the option `source_extent` is NaN, but must be a positive number"
    );
    // A skeleton many times larger than its body.
    let large = EmbedOptions { source_extent: Some(0.1), ..Default::default() };
    assert!(message(&mesh, &upright(1.0), &large).starts_with("none of the skeleton's 2 joints"));
    let cloud = TriMesh::from_points(vec![Vec3::zeros()]).unwrap();
    assert!(embed(&cloud, &upright(1.0), &options).is_err());
}

#[test]
fn holes_and_parts_are_no_obstacle() {
    let it = body(Body::Biped, 1);
    let options = EmbedOptions { source_extent: extent_of(&it.mesh), ..Default::default() };
    let open = it.mesh.faces().iter().enumerate().filter(|it| it.0 % 200 != 7).map(|it| *it.1);
    let mut faces: Vec<[u32; 3]> = open.collect();
    let mut vertices = it.mesh.vertices().to_vec();
    let first = vertices.len() as u32;
    vertices.extend([Vec3::y(), Vec3::y() * 1.01, Vec3::new(0.01, 1.0, 0.0)]);
    faces.push([first, first + 1, first + 2]);
    let torn = TriMesh::new(vertices, faces).unwrap();
    let res = embed(&torn, &it.skeleton, &options).unwrap();
    let errors = joint_errors(&res.skeleton, &it.skeleton, &it.mesh, HeightAxis::Y).unwrap();
    assert!(errors.percent(errors.mean()) < 6.0, "{}", errors.percent(errors.mean()));
}

#[test]
fn embeddings_are_the_same_at_any_number_of_threads() {
    let it = body(Body::Quadruped, 1);
    let options = EmbedOptions { source_extent: extent_of(&it.mesh), ..Default::default() };
    let with = |n: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        pool.install(|| embed(&it.mesh, &it.skeleton, &options).unwrap())
    };
    let (one, three) = (with(1), with(3));
    assert_eq!((one.skeleton, one.joints), (three.skeleton, three.joints));
}
