use super::*;
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::geometry::shapes::{bumpy_sphere, moved, union};
use crate::kernels::rigs::skinning::{blend, skin};
use crate::kernels::synthetic::synthesize::{SynthesizeOptions, synthesize};

fn slices(frames: &[Vec<Vec3>]) -> Vec<&[Vec3]> {
    frames.iter().map(Vec::as_slice).collect()
}

fn exact(n_bones: usize) -> SsdrOptions {
    SsdrOptions { n_bones, affinity: 0.0, smoothness: 0.0, ..Default::default() }
}

/// Two bumpy bodies, the second turning about a hinge between them, both carried about.
fn hinged() -> (TriMesh, Vec<Vec<Vec3>>, usize) {
    let first = bumpy_sphere(5);
    let second = moved(&first, Vec3::x() * 3.0);
    let hinge = nalgebra::Point3::new(1.5, 0.0, 0.0);
    let mesh = union(&first, &second);
    let frames = (0..12).map(|frame| {
        let t = f64::from(frame) / 11.0;
        let turn = |axis: Vec3| UnitQuaternion::from_scaled_axis(axis);
        let carry = Isometry3::from_parts(
            Translation3::new(t, 2.0 * t * t, -t),
            turn(Vec3::new(0.3, 0.5, 0.1) * t),
        );
        let bend = Translation3::from(hinge)
            * turn(Vec3::z() * 1.2 * t)
            * Translation3::from(-hinge.coords);
        let place = |(index, it): (usize, &Vec3)| {
            let own = if index < first.n_vertices() { carry } else { carry * bend };
            (own * nalgebra::Point3::from(*it)).coords
        };
        mesh.vertices().iter().enumerate().map(place).collect()
    });
    let frames = frames.collect();
    (mesh, frames, first.n_vertices())
}

#[test]
fn two_bodies_with_a_hinge_are_two_bones() {
    let (mesh, frames, n_first) = hinged();
    for options in [exact(2), exact(7), SsdrOptions { n_bones: 2, ..Default::default() }] {
        let res = ssdr(mesh.vertices(), mesh.faces(), &slices(&frames), None, &options).unwrap();
        assert!(res.rmse < 1e-6, "{}", res.rmse);
        // More bones than motions are not made.
        assert_eq!(res.weights.n_joints(), 2);
        let bone = |vertex: usize| res.weights.row(vertex).next().unwrap().0;
        for vertex in 0..mesh.n_vertices() {
            assert_eq!(bone(vertex), bone(if vertex < n_first { 0 } else { n_first }));
        }
        assert_ne!(bone(0), bone(n_first));
    }
}

/// A tube that bends smoothly needs blended weights.
fn bending() -> (Vec<Vec3>, Vec<[u32; 3]>, Vec<Vec<Vec3>>) {
    let (n_along, n_around) = (40, 10);
    let at = |ring: usize, it: usize| (ring * n_around + it % n_around) as u32;
    let mut rest = Vec::new();
    let mut faces = Vec::new();
    for ring in 0..=n_along {
        for it in 0..n_around {
            let angle = std::f64::consts::TAU * it as f64 / n_around as f64;
            let x = ring as f64 / n_along as f64 * 4.0;
            rest.push(Vec3::new(x, 0.3 * angle.cos(), 0.3 * angle.sin()));
            if ring < n_along {
                faces.push([at(ring, it), at(ring + 1, it), at(ring, it + 1)]);
                faces.push([at(ring + 1, it), at(ring + 1, it + 1), at(ring, it + 1)]);
            }
        }
    }
    let bent = |curvature: f64, it: &Vec3| {
        let (sine, cosine) = (curvature * it.x).sin_cos();
        let along = if curvature == 0.0 { it.x } else { sine / curvature };
        let up = if curvature == 0.0 { 0.0 } else { (1.0 - cosine) / curvature };
        Vec3::new(along - it.y * sine, up + it.y * cosine, it.z)
    };
    let frames = (0..10)
        .map(|frame| rest.iter().map(|it| bent(0.06 * f64::from(frame), it)).collect())
        .collect();
    (rest, faces, frames)
}

#[test]
fn the_error_never_grows_and_weights_stay_on_the_simplex() {
    let (rest, faces, frames) = bending();
    let options = SsdrOptions { tolerance: 0.0, max_iterations: 25, ..exact(6) };
    let res = ssdr(&rest, &faces, &slices(&frames), None, &options).unwrap();
    for pair in res.history.windows(2) {
        assert!(pair[1] <= pair[0] * (1.0 + 1e-9), "{} after {}", pair[1], pair[0]);
    }
    assert!(res.history.len() > 5 && res.rmse < 0.02, "{}", res.rmse);
    let last = res.history.iter().fold(f64::INFINITY, |a, &b| a.min(b));
    assert!((res.rmse / last - 1.0).abs() < 1e-6, "{} {last}", res.rmse);
    assert!(res.weights.max_influences() <= 4);
    for vertex in 0..rest.len() {
        let sum: f64 = res.weights.row(vertex).map(|it| it.1).sum();
        assert!((sum - 1.0).abs() < 1e-12);
    }
}

#[test]
fn more_bones_and_more_influences_fit_better() {
    let (rest, faces, frames) = bending();
    let error = |n_bones, max_influences| {
        let options = SsdrOptions { max_influences, ..exact(n_bones) };
        ssdr(&rest, &faces, &slices(&frames), None, &options).unwrap().rmse
    };
    assert!(error(6, 4) < 0.8 * error(6, 1), "{} {}", error(6, 4), error(6, 1));
    assert!(error(10, 4) < error(4, 4));
    // One bone is a rigid fit.
    assert!(error(1, 4) > 0.1);
}

#[test]
fn more_bones_are_never_worse() {
    let (rest, faces, frames) = bending();
    let error = |n| ssdr(&rest, &faces, &slices(&frames), None, &exact(n)).unwrap().rmse;
    let errors: Vec<f64> = [1, 2, 4, 8, 16].map(error).to_vec();
    for pair in errors.windows(2) {
        assert!(pair[1] < 0.7 * pair[0], "{errors:?}");
    }
}

/// From clusters alone a body keeps some pairs of bones where one would do, and lacks others.
#[test]
fn bones_go_where_the_error_is() {
    let (mesh, frames) = walking();
    let (rest, frames) = (mesh.vertices(), slices(&frames));
    let moving = Moving::new(rest, &frames);
    for n_bones in [14, 16, 20] {
        let error = |labels: Option<&[u32]>| {
            ssdr(rest, mesh.faces(), &frames, labels, &exact(n_bones)).unwrap().rmse
        };
        let from_clusters = error(Some(&clusters::clusters(&moving, n_bones)));
        let found = error(None);
        assert!(found < 0.5 * from_clusters, "{n_bones} bones: {found} {from_clusters}");
    }
}

/// Seams of textures cut meshes: every face with corners of its own is the same surface.
#[test]
fn a_mesh_in_pieces_that_touch_is_one() {
    let (rest, faces, frames) = bending();
    let corners: Vec<u32> = faces.iter().flatten().copied().collect();
    let apart = |points: &Vec<Vec3>| -> Vec<Vec3> {
        corners.iter().map(|&it| points[it as usize]).collect()
    };
    let pieces: Vec<[u32; 3]> =
        (0..faces.len() as u32).map(|it| [3 * it, 3 * it + 1, 3 * it + 2]).collect();
    let moved: Vec<Vec<Vec3>> = frames.iter().map(apart).collect();
    let whole = ssdr(&rest, &faces, &slices(&frames), None, &exact(6)).unwrap().rmse;
    let cut = ssdr(&apart(&rest), &pieces, &slices(&moved), None, &exact(6)).unwrap().rmse;
    assert!(cut < 1.3 * whole, "{cut} {whole}");
}

/// A vertex that no face has takes the bones that fit it best.
#[test]
fn loose_vertices_are_moved() {
    let (mesh, frames, _) = hinged();
    let options = SsdrOptions { n_bones: 2, ..Default::default() };
    let res = ssdr(mesh.vertices(), &[], &slices(&frames), None, &options).unwrap();
    assert!(res.rmse < 1e-6, "{}", res.rmse);
}

fn walking() -> (TriMesh, Vec<Vec<Vec3>>) {
    let body = synthesize(&SynthesizeOptions { n_vertices: 1000, ..Default::default() }).unwrap();
    let frames = (0..body.clip.n_frames())
        .step_by(2)
        .map(|frame| skin(&body.mesh, &body.skeleton, &body.weights, &body.clip, frame).unwrap())
        .collect();
    (body.mesh, frames)
}

/// A body that was skinned is decomposed to nearly nothing from the true bones.
#[test]
fn a_skinned_body_is_decomposed() {
    let body = synthesize(&SynthesizeOptions { n_vertices: 1000, ..Default::default() }).unwrap();
    let frames: Vec<Vec<Vec3>> = (0..body.clip.n_frames())
        .step_by(2)
        .map(|frame| skin(&body.mesh, &body.skeleton, &body.weights, &body.clip, frame).unwrap())
        .collect();
    let heaviest = |vertex: usize| {
        let row = body.weights.row(vertex);
        row.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap().0
    };
    let labels: Vec<u32> = (0..body.mesh.n_vertices()).map(heaviest).collect();
    let (rest, faces) = (body.mesh.vertices(), body.mesh.faces());
    let run = |labels, options: &SsdrOptions| {
        ssdr(rest, faces, &slices(&frames), labels, options).unwrap()
    };
    let from_truth = run(Some(&labels[..]), &exact(1));
    let found = run(None, &exact(20));
    println!("from true labels {:.5}, from clusters {:.5}", from_truth.rmse, found.rmse);
    assert!(from_truth.rmse < 1e-3 && found.rmse < 2e-4);
    let again = rmse(rest, &slices(&frames), &found.weights, &found.motions);
    assert_eq!(again, found.rmse);
}

/// The bones' motions as joints of a rig give the same positions.
#[test]
fn motions_are_world_from_rest() {
    let (mesh, frames, _) = hinged();
    let res = ssdr(mesh.vertices(), &[], &slices(&frames), None, &exact(2)).unwrap();
    let n_bones = res.weights.n_joints();
    let names = (0..n_bones).map(|it| format!("bone{it}")).collect();
    let bones = crate::kernels::rigs::skeleton::Skeleton::new(
        names,
        vec![None; n_bones],
        res.centers.clone(),
    );
    let bones = bones.unwrap();
    let last = frames.len() - 1;
    let world: Vec<Isometry3<f64>> = (0..n_bones)
        .map(|it| res.motions[last * n_bones + it] * Translation3::from(res.centers[it]))
        .collect();
    let posed = blend(mesh.vertices(), &bones, &res.weights, &world);
    for (a, b) in posed.iter().zip(&frames[last]) {
        assert!((a - b).norm() < 1e-6);
    }
}

#[test]
fn results_are_the_same_at_any_number_of_threads() {
    let (rest, faces, frames) = bending();
    let options = SsdrOptions { n_bones: 5, max_iterations: 5, ..Default::default() };
    let with = |n: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        pool.install(|| ssdr(&rest, &faces, &slices(&frames), None, &options).unwrap())
    };
    assert_eq!(with(1), with(3));
}

#[test]
fn poor_input_is_told_or_decomposed() {
    let (rest, faces, frames) = bending();
    let options = SsdrOptions::default();
    let message = |rest: &[Vec3], frames: &[Vec<Vec3>], labels: Option<&[u32]>, options| {
        ssdr(rest, &faces, &slices(frames), labels, options).unwrap_err().to_string()
    };
    let short = vec![rest.clone(), rest[1..].to_vec()];
    assert_eq!(
        message(&rest, &short, None, &options),
        "frame 1 has 409 points, but the rest pose has 410"
    );
    let mut nan = frames.clone();
    nan[3][7].y = f64::NAN;
    assert_eq!(message(&rest, &nan, None, &options), "vertex 7 has the coordinate NaN in frame 3");
    assert_eq!(
        message(&rest, &frames, Some(&[0, 1]), &options),
        "2 labels were given for 410 vertices"
    );
    let none = SsdrOptions { n_bones: 0, ..options.clone() };
    assert_eq!(
        message(&rest, &frames, None, &none),
        "the option `n_bones` is 0, but must be at least 1"
    );
    assert!(ssdr(&rest, &faces, &[], None, &options).is_err());
    assert!(ssdr(&rest, &[[0, 1, 999]], &slices(&frames), None, &options).is_err());
    let far: Vec<Vec3> = rest.iter().map(|it| it * 1e200).collect();
    let error = ssdr(&far, &faces, &[&far], None, &options).unwrap_err();
    assert_eq!(error, SsdrError::Range);
    // One vertex, all at one place, a mesh that stands still.
    let one = [Vec3::x()];
    assert_eq!(ssdr(&one, &[], &[&one], None, &options).unwrap().rmse, 0.0);
    let same = vec![Vec3::y(); 20];
    assert!(ssdr(&same, &[], &[&same, &same], None, &options).unwrap().rmse < 1e-12);
    let still = ssdr(&rest, &faces, &[&rest, &rest], None, &options).unwrap();
    assert!(still.rmse < 1e-9 && still.weights.n_joints() == 1);
}
