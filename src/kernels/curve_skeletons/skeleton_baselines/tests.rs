//! Known mechanisms and a walking body.

use nalgebra::{Isometry3, Translation3};

use super::keypoints::{KeypointOptions, skeletonize_kmeans};
use super::le::{LeOptions, skeletonize_le};
use super::zhang::{ZhangOptions, skeletonize_zhang};
use super::*;
use crate::kernels::geometry::shapes::{moved, tube, union};
use crate::kernels::motion::fit_clip::world_positions;
use crate::kernels::rigs::skinning::skin;
use crate::kernels::synthetic::synthesize::{SynthesizeOptions, synthesize};

/// A surface in motion with the bone of every vertex.
struct Mechanism {
    rest: TriMesh,
    sequence: MeshSequence,
    bones: Vec<u32>,
}

fn turned(axis: Vec3, about: Vec3) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(axis);
    Translation3::from(about) * turn * Translation3::from(-about)
}

/// A box of `length x 0.4 x 0.3` from the origin along x, its faces cut into a fine grid.
fn bar(length: f64) -> TriMesh {
    let (n_x, n_y, n_z) = (12_usize, 4_usize, 3_usize);
    let mut number = std::collections::BTreeMap::new();
    let mut vertices = Vec::new();
    let mut faces = Vec::new();
    let mut vertex = |it: [usize; 3]| {
        *number.entry(it).or_insert_with(|| {
            let part = |axis: usize, n: usize| it[axis] as f64 / n as f64;
            let (y, z) = (part(1, n_y) - 0.5, part(2, n_z) - 0.5);
            vertices.push(Vec3::new(length * part(0, n_x), 0.4 * y, 0.3 * z));
            vertices.len() as u32 - 1
        })
    };
    let counts = [n_x, n_y, n_z];
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for side in [0, counts[axis]] {
            for a in 0..counts[u] {
                for b in 0..counts[v] {
                    let mut at = |a: usize, b: usize| {
                        let mut it = [0; 3];
                        (it[axis], it[u], it[v]) = (side, a, b);
                        vertex(it)
                    };
                    let quad = [at(a, b), at(a + 1, b), at(a + 1, b + 1), at(a, b + 1)];
                    faces.push([quad[0], quad[1], quad[2]]);
                    faces.push([quad[0], quad[2], quad[3]]);
                }
            }
        }
    }
    TriMesh::new(vertices, faces).unwrap()
}

/// Two boxes with a gap of 0.1 and a hinge in it, whose axis turns a little over time.
fn hinge() -> (Mechanism, Vec3) {
    let first = bar(1.0);
    let second = moved(&first, Vec3::x() * 1.1);
    let rest = union(&first, &second);
    let at = Vec3::x() * 1.05;
    let motions = |t: f64| {
        let carry =
            Translation3::new(0.3 * t, t * t, 0.0) * turned(Vec3::new(0.4, 0.2, 0.0) * t, at);
        vec![carry, carry * turned(Vec3::new(0.0, 0.5 * t, 1.4 * t), at)]
    };
    let bones: Vec<u32> =
        (0..rest.n_vertices()).map(|it| u32::from(it >= first.n_vertices())).collect();
    (rigid(rest, bones, motions), at)
}

/// A tube of three bones that bends at two places.
fn chain() -> (Mechanism, [Vec3; 2]) {
    let upright = tube(0.15, 3.0, 12, 45, 1.0);
    let (low, high) = upright.bounds();
    let axis = (high - low).imax();
    let along = |it: &Vec3| it[axis] - low[axis];
    let bones: Vec<u32> = upright.vertices().iter().map(|it| (along(it) / 1.01) as u32).collect();
    let place = |at: f64| {
        let mut place = (low + high) / 2.0;
        place[axis] = low[axis] + at;
        place
    };
    let joints = [place(1.01), place(2.02)];
    let motions = move |t: f64| {
        let (a, b) = (Vec3::new(0.9, 0.5, 0.3), Vec3::new(-0.5, 1.0, -0.6));
        let carry = turned(Vec3::new(0.1, 0.2, 0.3) * t, joints[0]);
        let middle = carry * turned(a * t, joints[0]);
        vec![carry, middle, middle * turned(b * (t * 3.0).sin(), joints[1])]
    };
    (rigid(upright, bones, motions), joints)
}

fn rigid(
    rest: TriMesh,
    bones: Vec<u32>,
    motions: impl Fn(f64) -> Vec<Isometry3<f64>>,
) -> Mechanism {
    let frame = |frame: usize| -> Vec<Vec3> {
        let motions = motions(frame as f64 / 11.0);
        let place = |(it, bone): (&Vec3, &u32)| {
            (motions[*bone as usize] * nalgebra::Point3::from(*it)).coords
        };
        rest.vertices().iter().zip(&bones).map(place).collect()
    };
    let frames = (0..12).map(frame).collect();
    let sequence = MeshSequence::from_frames(frames, rest.faces().to_vec(), 30.0).unwrap();
    Mechanism { rest, sequence, bones }
}

fn walker(every: usize) -> (TriMesh, MeshSequence) {
    let body = synthesize(&SynthesizeOptions { n_vertices: 1000, ..Default::default() }).unwrap();
    let frames = (0..body.clip.n_frames()).step_by(every);
    let pose = |it: usize| skin(&body.mesh, &body.skeleton, &body.weights, &body.clip, it).unwrap();
    let faces = body.mesh.faces().to_vec();
    let sequence = MeshSequence::from_frames(frames.map(pose).collect(), faces, 30.0).unwrap();
    (body.mesh, sequence)
}

fn zhang(n_clusters: usize) -> ZhangOptions {
    ZhangOptions { n_clusters, n_samples: 600, ..Default::default() }
}

fn le(n_bones: usize) -> LeOptions {
    LeOptions { n_bones, first_bones: 3 * n_bones / 2, ..Default::default() }
}

/// The vertices' parts, as sets: whether they are the true ones.
fn parts_are_true(weights: &SkinWeights, bones: &[u32]) -> bool {
    let own: Vec<u32> = (0..bones.len())
        .map(|it| weights.row(it).max_by(|a, b| a.1.total_cmp(&b.1)).unwrap().0)
        .collect();
    k_means::by_first(&own) == k_means::by_first(bones)
}

fn joint_at(found: &MovingSkeleton, frame: usize, joint: usize) -> Vec3 {
    world_positions(&found.clip, frame, found.skeleton.parents())[joint]
}

#[test]
fn two_boxes_on_a_hinge_are_two_bones() {
    let (it, at) = hinge();
    let moving = Moving::new(&it.sequence, Some(&it.rest)).unwrap();
    let found = skeletonize_zhang(&moving, &zhang(2)).unwrap();
    assert!(parts_are_true(&found.weights, &it.bones));
    assert_eq!(found.skeleton.n_joints(), 2);
    assert!(found.error < 1e-9, "{}", found.error);
    let found = skeletonize_le(&moving, &le(2)).unwrap();
    assert!(parts_are_true(&found.weights, &it.bones));
    // The root, the hinge, and both ends.
    assert_eq!(found.skeleton.n_joints(), 4);
    assert!(found.error < 1e-9, "{}", found.error);
    let hinge = (0..4).map(|it| (found.skeleton.positions()[it] - at).norm());
    // The border of boxes that do not touch is between their faces, where the hinge is, too.
    assert!(hinge.fold(1.0, f64::min) < 0.01);
    let free = LeOptions { pull: 0.0, ..le(2) };
    let found = skeletonize_le(&moving, &free).unwrap();
    let hinge = (0..4).map(|it| (found.skeleton.positions()[it] - at).norm());
    assert!(hinge.fold(1.0, f64::min) < 1e-5);
}

#[test]
fn a_chain_of_three_is_found() {
    let (it, joints) = chain();
    let moving = Moving::new(&it.sequence, Some(&it.rest)).unwrap();
    let found = skeletonize_zhang(&moving, &zhang(3)).unwrap();
    let share = |weights: &SkinWeights| {
        let mut counts = std::collections::BTreeMap::new();
        for (vertex, bone) in it.bones.iter().enumerate() {
            let own = weights.row(vertex).max_by(|a, b| a.1.total_cmp(&b.1)).unwrap().0;
            *counts.entry((*bone, own)).or_insert(0) += 1;
        }
        let most = |bone: u32| {
            counts.iter().filter(|it| it.0.0 == bone).map(|it| *it.1).max().unwrap_or(0)
        };
        f64::from((0..3).map(most).sum::<i32>()) / it.bones.len() as f64
    };
    assert!(share(&found.weights) > 0.93, "{}", share(&found.weights));
    // A chain has the middle bone between the others, and that is nearest to the centroid.
    assert_eq!(found.skeleton.parents(), [None, Some(0), Some(0)]);
    let found = skeletonize_le(&moving, &LeOptions { iterations: 20, ..le(3) }).unwrap();
    assert_eq!(share(&found.weights), 1.0);
    assert!(found.error < 1e-6, "{}", found.error);
    assert_eq!(found.skeleton.n_joints(), 5);
    // The middle of the border, to which joints are pulled, is that of the few weights that bars in
    // truth do not share.
    for joint in joints {
        let off = found.skeleton.positions().iter().map(|it| (it - joint).norm());
        let off = off.fold(1.0, f64::min);
        assert!(off < 0.1, "{off}");
    }
    let found =
        skeletonize_kmeans(&moving, &KeypointOptions { n_keypoints: 6, ..Default::default() });
    let found = found.unwrap();
    let n_children: Vec<usize> = found.skeleton.children().iter().map(Vec::len).collect();
    assert_eq!(
        (found.skeleton.n_joints(), n_children.iter().filter(|it| **it > 1).count()),
        (6, 1)
    );
}

#[test]
fn a_walking_body_is_explained_better_by_more_bones() {
    let (rest, sequence) = walker(3);
    let moving = Moving::new(&sequence, Some(&rest)).unwrap();
    let scale = moving.scale();
    let errors = |n: usize| {
        [
            skeletonize_zhang(&moving, &zhang(n)).unwrap(),
            skeletonize_le(&moving, &le(n)).unwrap(),
            skeletonize_kmeans(&moving, &KeypointOptions { n_keypoints: n, ..Default::default() })
                .unwrap(),
        ]
        .map(|it| it.error / scale)
    };
    let (few, many) = (errors(3), errors(16));
    println!("3: {few:?}, 16: {many:?}");
    for (few, many) in few.iter().zip(&many) {
        assert!(*many < 0.7 * few && *many < 0.06, "{few} {many}");
    }
    // Bones by motion explain it better than keypoints by place.
    assert!(many[1] < many[2]);
}

#[test]
fn joints_stay_with_the_surface() {
    let (rest, sequence) = walker(6);
    let moving = Moving::new(&sequence, None).unwrap();
    let _ = &rest;
    for found in [
        skeletonize_zhang(&moving, &zhang(12)).unwrap(),
        skeletonize_le(&moving, &le(12)).unwrap(),
        skeletonize_kmeans(&moving, &KeypointOptions::default()).unwrap(),
    ] {
        let n = found.skeleton.n_joints();
        assert_eq!(found.weights.n_joints(), n);
        assert_eq!(found.clip.translations.len(), n * sequence.n_frames());
        assert_eq!(found.skeleton.names()[0], "joint_00");
        assert_eq!(found.skeleton.bones().count(), n - 1, "one tree");
        for joint in 0..n {
            // Without a rest pose the first frame is it.
            let rest = found.skeleton.positions()[joint];
            assert!((joint_at(&found, 0, joint) - rest).norm() < 0.02);
            let last = sequence.n_frames() - 1;
            let place = joint_at(&found, last, joint);
            let gap = sequence.frame(last).iter().map(|it| (it - place).norm());
            assert!(gap.fold(9.0, f64::min) < 0.3);
        }
    }
}

#[test]
fn results_are_the_same_at_any_number_of_threads() {
    let (rest, sequence) = walker(8);
    let with = |n: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        pool.install(|| {
            let moving = Moving::new(&sequence, Some(&rest)).unwrap();
            [
                skeletonize_zhang(&moving, &zhang(8)).unwrap(),
                skeletonize_le(&moving, &le(8)).unwrap(),
                skeletonize_kmeans(&moving, &KeypointOptions::default()).unwrap(),
            ]
        })
    };
    assert_eq!(with(1), with(3));
}

#[test]
fn poor_input_is_told() {
    let (it, _) = hinge();
    let still = MeshSequence::from_frames(
        vec![it.rest.vertices().to_vec()],
        it.rest.faces().to_vec(),
        30.0,
    );
    let still = still.unwrap();
    let error = Moving::new(&still, None).err().unwrap().to_string();
    assert_eq!(error, "the sequence has 1 frames, but motion needs 2");
    let other = bar(1.0);
    let error = Moving::new(&it.sequence, Some(&other)).err().unwrap().to_string();
    assert!(error.starts_with("the rest pose has"), "{error}");
    let few = vec![Vec3::zeros(), Vec3::x(), Vec3::y()];
    let tiny = MeshSequence::from_frames(vec![few.clone(), few], vec![[0, 1, 2]], 30.0).unwrap();
    let moving = Moving::new(&tiny, None).unwrap();
    let message = "4 clusters are wanted of 3 vertices";
    assert_eq!(skeletonize_zhang(&moving, &zhang(4)).unwrap_err().to_string(), message);
    assert_eq!(skeletonize_le(&moving, &le(4)).unwrap_err().to_string(), message);
    let four = KeypointOptions { n_keypoints: 4, ..Default::default() };
    assert_eq!(skeletonize_kmeans(&moving, &four).unwrap_err().to_string(), message);
    let flat = ZhangOptions { scale: 0.0, ..zhang(2) };
    let error = skeletonize_zhang(&moving, &flat).unwrap_err().to_string();
    assert_eq!(error, "the option `scale` is 0, but must be a positive number");
    // What can be done with three vertices that stand still is done.
    assert!(skeletonize_zhang(&moving, &zhang(2)).is_ok());
    assert!(skeletonize_le(&moving, &le(2)).is_ok());
    let two = KeypointOptions { n_keypoints: 2, ..Default::default() };
    assert!(skeletonize_kmeans(&moving, &two).is_ok());
    // All at one place, and a cloud without faces.
    let same = MeshSequence::from_frames(vec![vec![Vec3::y(); 9]; 3], vec![], 30.0).unwrap();
    let moving = Moving::new(&same, None).unwrap();
    assert_eq!(skeletonize_zhang(&moving, &zhang(2)).unwrap().error, 0.0);
    assert_eq!(skeletonize_le(&moving, &le(2)).unwrap().error, 0.0);
    assert_eq!(skeletonize_kmeans(&moving, &two).unwrap().error, 0.0);
}
