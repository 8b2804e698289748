//! Truths about all characters.

use super::*;
use crate::kernels::geometry::corner_table::CornerTable;

const BODIES: [Body; 2] = [Body::Biped, Body::Quadruped];

fn make(options: SynthesizeOptions) -> Character {
    synthesize(&options).unwrap()
}

fn small(body: Body, seed: u64) -> SynthesizeOptions {
    SynthesizeOptions { body, seed, n_vertices: 1_000, ..SynthesizeOptions::default() }
}

/// Closed, manifold, one piece, genus 0, facing outwards.
fn check_closed(character: &Character) {
    let mesh = &character.mesh;
    CornerTable::new(mesh).unwrap();
    assert_eq!(meshing::n_components(mesh), 1);
    assert_eq!(mesh.n_faces(), 2 * mesh.n_vertices() - 4, "genus 0");
    let volume: f64 = (0..mesh.n_faces())
        .map(|face| mesh.area_vector(face).dot(&mesh.corners(face)[0]) / 3.0)
        .sum();
    assert!(volume > 0.01, "{volume} cubic metres");
}

/// How often the surface winds around a point (van Oosterom & Strackee 1983).
fn winding_number(mesh: &TriMesh, point: Vec3) -> f64 {
    let solid_angle = |face: usize| {
        let [a, b, c] = mesh.corners(face).map(|it| it - point);
        let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
        let below = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
        2.0 * a.dot(&b.cross(&c)).atan2(below)
    };
    (0..mesh.n_faces()).map(solid_angle).sum::<f64>() / (4.0 * std::f64::consts::PI)
}

fn check_joints_inside(character: &Character, what: &str) {
    let skeleton = &character.skeleton;
    for (name, &position) in skeleton.names().iter().zip(skeleton.positions()) {
        let winding = winding_number(&character.mesh, position);
        assert!(winding > 0.9, "{what}: `{name}` is outside ({winding})");
    }
}

#[test]
fn all_individuals_are_closed_with_their_joints_inside() {
    for body in BODIES {
        for seed in 0..5 {
            let character = make(small(body, seed));
            assert_eq!(character.mesh.n_vertices(), 1_000);
            check_closed(&character);
            check_joints_inside(&character, &format!("{body:?} {seed}"));
        }
    }
}

#[test]
fn every_connectivity_is_closed_and_well_shaped() {
    for connectivity in [Connectivity::Isotropic, Connectivity::Adaptive, Connectivity::Irregular] {
        for body in BODIES {
            let character =
                make(SynthesizeOptions { connectivity, n_vertices: 3_000, ..small(body, 20) });
            assert_eq!(character.mesh.n_vertices(), 3_000);
            check_closed(&character);
            let mesh = &character.mesh;
            let sharp = (0..mesh.n_faces()).filter(|&it| least_angle(mesh.corners(it)) < 0.35);
            let sharp = sharp.count() as f64 / mesh.n_faces() as f64;
            assert!(
                sharp < 0.01,
                "{connectivity:?} {body:?}: {sharp} of faces are below 20 degrees"
            );
        }
    }
}

fn least_angle([a, b, c]: [Vec3; 3]) -> f64 {
    let angles = [(b - a).angle(&(c - a)), (c - b).angle(&(a - b)), (a - c).angle(&(b - c))];
    angles.into_iter().fold(f64::INFINITY, f64::min)
}

#[test]
fn joints_stay_inside_in_every_pose() {
    for body in BODIES {
        for stance in [Stance::T, Stance::Walk(0.0), Stance::Walk(0.7), Stance::Random(1.0)] {
            let character = make(SynthesizeOptions { stance, ..small(body, 7) });
            check_closed(&character);
            check_joints_inside(&character, &format!("{body:?} {stance:?}"));
            let lowest = character.mesh.bounds().0.y;
            assert!(lowest.abs() < 1e-12, "stands on the ground");
        }
    }
}

#[test]
fn rest_joints_mirror_each_other() {
    for body in BODIES {
        let Character { skeleton, .. } = make(small(body, 3));
        for (joint, name) in skeleton.names().iter().enumerate() {
            let other = match name.strip_prefix("left_") {
                Some(name) => skeleton.joint(&format!("right_{name}")).unwrap(),
                None if name.starts_with("right_") => continue,
                None => joint,
            };
            let (p, q) = (skeleton.positions()[joint], skeleton.positions()[other]);
            assert!((p - Vec3::new(-q.x, q.y, q.z)).norm() < 1e-12, "{name}");
        }
    }
}

#[test]
fn surface_is_symmetric_at_rest_but_front_and_back_differ() {
    for body in BODIES {
        let plan = plan(&small(body, 5));
        let mut asymmetry = 0.0_f64;
        for point in make(small(body, 5)).mesh.vertices() {
            let mirrored = plan.surface.value(Vec3::new(-point.x, point.y, point.z));
            assert!(mirrored.abs() < 3e-3, "the mirror image of {point} is {mirrored} m away");
            let turned = plan.surface.value(Vec3::new(point.x, point.y, -point.z));
            asymmetry = asymmetry.max(turned.abs());
        }
        assert!(asymmetry > 0.05);
    }
}

#[test]
fn weights_are_local_and_few() {
    for body in BODIES {
        let character = make(small(body, 1));
        let (weights, skeleton) = (&character.weights, &character.skeleton);
        assert!(weights.max_influences() <= 4);
        let children = skeleton.children();
        let mut most = vec![0.0_f64; skeleton.n_joints()];
        for (vertex, &position) in character.mesh.vertices().iter().enumerate() {
            for (joint, weight) in weights.row(vertex) {
                let joint = joint as usize;
                most[joint] = most[joint].max(weight);
                let bones = children[joint].iter().map(|&it| skeleton.positions()[it]);
                let from = skeleton.positions()[joint];
                let distance = bones
                    .map(|to| distance_to_segment(position, from, to))
                    .fold((position - from).norm(), f64::min);
                assert!(
                    distance < 0.55,
                    "`{}` moves what is {distance} m away",
                    skeleton.names()[joint]
                );
            }
        }
        for (name, weight) in skeleton.names().iter().zip(most) {
            assert!(weight > 0.4, "`{name}` has a weight of {weight} at most");
        }
    }
}

fn distance_to_segment(point: Vec3, from: Vec3, to: Vec3) -> f64 {
    let along = ((point - from).dot(&(to - from)) / (to - from).norm_squared()).clamp(0.0, 1.0);
    (point - from.lerp(&to, along)).norm()
}

#[test]
fn landmarks_are_at_the_tips() {
    for body in BODIES {
        let character = make(SynthesizeOptions { n_vertices: 4_000, ..small(body, 2) });
        let at = |name: &str| {
            let index = character.landmarks.names.iter().position(|it| it == name).unwrap();
            character.mesh.vertices()[character.landmarks.vertices[index] as usize]
        };
        let (low, high) = character.mesh.bounds();
        assert!(at("hand_left").x > 0.0 && at("foot_left").x > 0.0);
        assert!(at("hand_right").x < 0.0 && at("foot_right").x < 0.0);
        assert!(at("chest_front").z > at("chest_back").z);
        assert!(at("chest_front").x.abs() < 0.03 && at("chest_back").x.abs() < 0.03);
        match body {
            Body::Biped => {
                assert_eq!(character.landmarks.names.len(), 7);
                assert!(high.y - at("head_top").y < 0.01);
                assert!(high.x - at("hand_left").x < 0.03 && at("hand_right").x - low.x < 0.03);
                assert!(high.z - at("foot_left").z < 0.03);
            }
            Body::Quadruped => {
                assert_eq!(character.landmarks.names.len(), 9);
                assert!(high.z - at("nose").z < 0.05);
                assert!(at("tail_tip").z - low.z < 0.08);
                assert!(at("hand_left").z > 0.0 && at("foot_left").z < 0.0);
            }
        }
    }
}

#[test]
fn the_walk_continues_with_its_first_frame() {
    for body in BODIES {
        let Character { mesh, skeleton, clip, .. } = make(small(body, 4));
        let n_frames = clip.n_frames();
        let positions: Vec<Vec<Vec3>> = (0..n_frames)
            .map(|frame| skinning::world_from_joint(&skeleton, &clip, frame).unwrap())
            .map(|it| it.iter().map(|it| it.translation.vector).collect())
            .collect();
        let step = |frame: usize| {
            let next = &positions[(frame + 1) % n_frames];
            let pairs = positions[frame].iter().zip(next);
            pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
        };
        let inner = (0..n_frames - 1).map(step).fold(0.0, f64::max);
        assert!(step(n_frames - 1) <= 1.2 * inner, "{} after {inner}", step(n_frames - 1));
        assert!(inner < 0.08 * (mesh.bounds().1.y), "{inner} m from frame to frame");
    }
}

/// While a foot is flat on the ground, it moves with the ground: backwards at one speed.
#[test]
fn feet_do_not_slide_or_sink() {
    for (body, foot) in [(Body::Biped, "left_foot"), (Body::Quadruped, "left_toe")] {
        let Character { mesh, skeleton, weights, clip, .. } = make(small(body, 6));
        let joint = skeleton.joint(foot).unwrap();
        let place = |frame: usize| {
            let transforms = skinning::world_from_joint(&skeleton, &clip, frame).unwrap();
            transforms[joint].translation.vector
        };
        let steps: Vec<Vec3> = (4..10).map(|it| place(it + 1) - place(it)).collect();
        for step in &steps {
            assert!((step - steps[0]).norm() < 0.004, "{body:?}: {step} after {}", steps[0]);
            assert!(step.z < -0.01, "{body:?}: {step}");
        }
        for frame in 0..clip.n_frames() {
            let posed = skinning::skin(&mesh, &skeleton, &weights, &clip, frame).unwrap();
            let lowest = posed.iter().map(|it| it.y).fold(f64::INFINITY, f64::min);
            assert!(
                lowest.abs() < 0.03,
                "{body:?}, frame {frame}: the lowest vertex is at {lowest}"
            );
        }
    }
}

#[test]
fn a_clip_looks_the_same_from_every_pose() {
    let rest = make(small(Body::Biped, 8));
    let posed = make(SynthesizeOptions { stance: Stance::Random(1.0), ..small(Body::Biped, 8) });
    for frame in [0, 11] {
        let of =
            |it: &Character| skinning::world_from_joint(&it.skeleton, &it.clip, frame).unwrap();
        for (one, other) in of(&rest).iter().zip(of(&posed)) {
            assert!((one.translation.vector - other.translation.vector).norm() < 1e-9);
        }
    }
}

#[test]
fn same_options_same_bytes_at_any_number_of_threads() {
    let with_threads = |n: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        pool.install(|| {
            make(SynthesizeOptions { noise: 0.05, n_holes: 2, ..small(Body::Biped, 9) })
        })
    };
    let one = with_threads(1);
    assert_eq!(one, with_threads(2));
    let other = make(small(Body::Biped, 10));
    assert_ne!(one.skeleton, other.skeleton);
}

#[test]
fn individuals_differ_by_their_variation_and_factors() {
    let height = |options: SynthesizeOptions| make(options).mesh.bounds().1.y;
    let nominal = SynthesizeOptions { variation: 0.0, ..small(Body::Biped, 1) };
    assert!((height(nominal.clone()) - biped::HEIGHT).abs() < 0.01);
    assert!(
        (height(SynthesizeOptions { seed: 2, ..nominal.clone() }) - biped::HEIGHT).abs() < 0.01
    );
    let tall = SynthesizeOptions { height: 1.1, ..nominal.clone() };
    assert!((height(tall) - 1.1 * biped::HEIGHT).abs() < 0.01);
    let volume_like = |girth: f64| make(SynthesizeOptions { girth, ..nominal.clone() }).mesh.area();
    assert!(volume_like(1.2) > 1.08 * volume_like(1.0));
}

#[test]
fn holes_are_cut_and_counted() {
    let character =
        make(SynthesizeOptions { n_holes: 3, n_vertices: 3_000, ..small(Body::Biped, 3) });
    let mesh = &character.mesh;
    assert_eq!(meshing::n_components(mesh), 1);
    let mut edges: Vec<(u32, u32)> = Vec::new();
    for &[a, b, c] in mesh.faces() {
        edges.extend([(a, b), (b, c), (c, a)].map(|(p, q)| (p.min(q), p.max(q))));
    }
    edges.sort_unstable();
    edges.dedup();
    let euler = mesh.n_vertices() as i64 - edges.len() as i64 + mesh.n_faces() as i64;
    assert_eq!(euler, 2 - 3, "a sphere with three holes");
    assert_eq!(character.weights.n_vertices(), mesh.n_vertices());
    let error = synthesize(&SynthesizeOptions { n_holes: 5_000, ..small(Body::Biped, 3) });
    assert!(matches!(error, Err(SynthesizeError::Holes { asked: 5_000, .. })));
}

#[test]
fn noise_moves_vertices_by_a_fraction_of_an_edge() {
    let smooth = make(small(Body::Quadruped, 3));
    let noisy = make(SynthesizeOptions { noise: 0.1, ..small(Body::Quadruped, 3) });
    let pairs = smooth.mesh.vertices().iter().zip(noisy.mesh.vertices());
    let square = pairs.map(|(a, b)| (a - b).norm_squared()).sum::<f64>() / 1_000.0;
    let face = smooth.mesh.area() / smooth.mesh.n_faces() as f64;
    let edge = (face * 4.0 / 3.0_f64.sqrt()).sqrt();
    assert!((square.sqrt() / (0.1 * edge) - 1.0).abs() < 0.1);
}

#[test]
fn a_wrong_number_of_vertices_is_told() {
    let error = synthesize(&SynthesizeOptions { n_vertices: 10, ..small(Body::Biped, 0) });
    assert_eq!(error.unwrap_err(), SynthesizeError::VertexCount { n_vertices: 10 });
}

/// Factors at the ends of their ranges still give bodies in one piece.
#[test]
fn extreme_factors_are_closed_too() {
    for body in BODIES {
        for (girth, limb_length, head_size) in [(1.25, 0.8, 1.4), (0.8, 1.25, 0.8)] {
            let options = SynthesizeOptions { girth, limb_length, head_size, ..small(body, 12) };
            let what = format!("{body:?} of girth {girth}");
            let character = synthesize(&options).unwrap_or_else(|e| panic!("{what}: {e}"));
            check_closed(&character);
            check_joints_inside(&character, &what);
        }
    }
}
