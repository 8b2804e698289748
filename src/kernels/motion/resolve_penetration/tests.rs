use std::f64::consts::{FRAC_PI_2, PI};

use super::*;
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::motion::clip_frames::world_frames;
use crate::kernels::motion::transfer_animation::{TransferAnimationOptions, transfer_animation};
use crate::kernels::rigs::segments_by_name::segments_by_name;
use crate::kernels::synthetic::synthesize::{Stance, SynthesizeOptions, synthesize};

/// A closed square tube along an axis, as points and faces that begin at `first`.
fn tube(from: Vec3, to: Vec3, half_width: f64, first: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let n_rings = 9;
    let side = (to - from).cross(&Vec3::new(0.3, 0.5, 0.9)).normalize() * half_width;
    let other = (to - from).normalize().cross(&side);
    let corners = [side + other, side - other, -side - other, other - side];
    let (mut points, mut faces) = (Vec::new(), Vec::new());
    for ring in 0..n_rings {
        let center = from + (to - from) * (f64::from(ring) / f64::from(n_rings - 1));
        points.extend(corners.map(|it| center + it));
        for it in 0..4_u32 {
            let (a, b) = (4 * ring as u32 + it, 4 * ring as u32 + (it + 1) % 4);
            if ring + 1 < n_rings {
                faces.extend([[a, b, b + 4], [a, b + 4, a + 4]]);
            }
        }
    }
    let last = 4 * (n_rings as u32 - 1);
    faces.extend([[0, 1, 2], [0, 2, 3], [last, last + 2, last + 1], [last, last + 3, last + 2]]);
    (points, faces.iter().map(|it| it.map(|it| it + first)).collect())
}

/// A trunk along +Y, and an arm of two bones that hangs beside it from a shoulder.
fn arm_and_trunk() -> (TriMesh, Skeleton, SkinWeights) {
    let names = ["root", "chest", "shoulder", "elbow", "wrist"].map(str::to_owned).to_vec();
    let parents = vec![None, Some(0), Some(1), Some(2), Some(3)];
    let places = [[0.0, 0.0], [0.0, 2.0], [1.0, 2.0], [2.0, 2.0], [3.0, 2.0]];
    let places: Vec<Vec3> = places.map(|[x, y]| Vec3::new(x, y, 0.0)).to_vec();
    let bones = [(0, 0, 1, 0.4), (2, 2, 3, 0.1), (3, 3, 4, 0.1)];
    let (mut points, mut faces, mut rows) = (Vec::new(), Vec::new(), Vec::new());
    for (joint, from, to, half_width) in bones {
        let (own, triangles) = tube(places[from], places[to], half_width, points.len() as u32);
        rows.extend(vec![vec![(joint, 1.0)]; own.len()]);
        points.extend(own);
        faces.extend(triangles);
    }
    let skeleton = Skeleton::new(names, parents, places).unwrap();
    (TriMesh::new(points, faces).unwrap(), skeleton, SkinWeights::from_rows(5, &rows).unwrap())
}

/// The arm swings down by so much a frame at the shoulder and the elbow.
fn swing(skeleton: &Skeleton, angles: &[(f64, f64)]) -> Clip {
    let about = |angle: f64| UnitQuaternion::from_axis_angle(&Vec3::z_axis(), -angle);
    let identity = UnitQuaternion::identity();
    let places = skeleton.positions();
    let offsets =
        (0..5).map(|it| places[it] - skeleton.parents()[it].map_or(Vec3::zeros(), |it| places[it]));
    let offsets: Vec<Vec3> = offsets.collect();
    Clip {
        name: "swing".to_owned(),
        frames_per_second: 30.0,
        n_joints: 5,
        rotations: (angles.iter())
            .flat_map(|it| [identity, identity, about(it.0), about(it.1), identity])
            .collect(),
        translations: angles.iter().flat_map(|_| offsets.clone()).collect(),
    }
}

fn resolved(clip: &Clip, options: &ResolvePenetrationOptions) -> ResolvedPenetration {
    let (mesh, skeleton, weights) = arm_and_trunk();
    resolve_penetration(&mesh, &skeleton, &weights, clip, options).unwrap()
}

#[test]
fn a_motion_without_penetration_stays() {
    let (_, skeleton, _) = arm_and_trunk();
    let clip = swing(&skeleton, &[(0.0, 0.0), (0.5, 0.2), (1.0, 0.3)]);
    let res = resolved(&clip, &ResolvePenetrationOptions::default());
    assert_eq!(res.clip, clip);
    assert!(res.keys.iter().all(|it| *it == KeyReport::default()));
    assert_eq!(
        (res.n_pairs, res.n_crossing_at_rest),
        (2, 0),
        "both parts of the arm, and the trunk"
    );
}

/// The forearm folds into the trunk; it is stopped at its side. The last frame is free again.
#[test]
fn a_forearm_stops_at_the_trunk() {
    let (_, skeleton, _) = arm_and_trunk();
    let clip =
        swing(&skeleton, &[(FRAC_PI_2, 0.0), (FRAC_PI_2, 0.6), (FRAC_PI_2, 1.2), (0.2, 0.0)]);
    let res = resolved(&clip, &ResolvePenetrationOptions::default());
    let pairs: Vec<_> = res.keys.iter().map(|it| (it.before.n_pairs, it.after.n_pairs)).collect();
    assert_eq!(pairs, [(0, 0), (1, 0), (1, 0), (0, 0)]);
    assert_eq!(res.clip.rotations[..5], clip.rotations[..5]);
    assert_eq!(res.clip.rotations[15..], clip.rotations[15..]);
    for frame in [1, 2] {
        let (_, places) = world_frames(&res.clip, frame, skeleton.parents());
        // It nearly touches: the trunk's corner is less than 0.57 from its axis, the arm's 0.15 from its.
        let [elbow, wrist] = [places[3], places[4]];
        let reach = elbow.x.min(wrist.x).abs();
        assert!(reach > 0.4 && reach < 0.8, "frame {frame}: {elbow} {wrist}");
        assert!(res.keys[frame].largest_turn_rad > 0.05);
    }
}

#[test]
fn what_the_user_sets_is_kept_and_told_if_it_penetrates() {
    let (_, skeleton, _) = arm_and_trunk();
    let clip = swing(&skeleton, &[(FRAC_PI_2, 0.0), (0.0, 0.0)]);
    let set = UnitQuaternion::from_axis_angle(&Vec3::z_axis(), -1.0);
    let mut overrides: BTreeMap<(usize, usize), _> = BTreeMap::from([((0, 3), set)]);
    let options = |overrides| ResolvePenetrationOptions { overrides, ..Default::default() };
    let res = resolved(&clip, &options(overrides.clone()));
    assert_eq!(res.clip.rotations[3], set);
    assert_eq!(res.keys[0].after, Crossings::default(), "the shoulder gives way");
    overrides.extend((0..5).map(|it| ((0, it), clip.rotations[it])));
    overrides.insert((0, 3), set);
    let res = resolved(&clip, &options(overrides));
    assert_eq!(res.keys[0].unresolved, [[0, 3]]);
    assert_eq!(res.keys[0].before, res.keys[0].after);
}

#[test]
fn joints_turn_no_farther_than_their_limits() {
    let (_, skeleton, _) = arm_and_trunk();
    let clip = swing(&skeleton, &[(0.3, 1.2)]);
    let limits_rad = BTreeMap::from([(3, 0.25)]);
    let res = resolved(&clip, &ResolvePenetrationOptions { limits_rad, ..Default::default() });
    assert!((res.clip.rotations[3].angle() - 0.25).abs() < 1e-12);
    assert!((res.clip.rotations[2].angle() - 0.3).abs() < 1e-12);
}

/// A walk on a much stouter body, with arms turned inwards: fewer penetrations, never more, and the
/// same clip at any number of threads.
#[test]
fn a_stout_body_walks_without_penetration() {
    let make = |girth, stance| {
        let options = SynthesizeOptions { girth, stance, n_vertices: 2000, ..Default::default() };
        synthesize(&options).unwrap()
    };
    let (slim, stout) = (make(1.0, Stance::Rest), make(1.35, Stance::T));
    let map = segments_by_name(&slim.skeleton, &stout.skeleton);
    let mut clip = slim.clip.clone();
    let arm = slim.skeleton.joint("left_arm").unwrap();
    for frame in 0..clip.n_frames() {
        let turn = UnitQuaternion::from_axis_angle(&Vec3::z_axis(), -0.1 * PI);
        clip.rotations[frame * clip.n_joints + arm] *= turn;
    }
    let options = TransferAnimationOptions::default();
    let moved = transfer_animation(&slim.skeleton, &clip, &stout.skeleton, &map, &options).unwrap();
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let options = ResolvePenetrationOptions::default();
        let it = (&stout.mesh, &stout.skeleton, &stout.weights);
        pool.install(|| resolve_penetration(it.0, it.1, it.2, &moved.clip, &options).unwrap())
    };
    let res = run(1);
    assert_eq!(res, run(2));
    let sum = |of: fn(&KeyReport) -> usize| res.keys.iter().map(of).sum::<usize>();
    assert!(sum(|it| it.before.n_pairs) > 10);
    assert_eq!(sum(|it| it.after.n_pairs), 0);
}
