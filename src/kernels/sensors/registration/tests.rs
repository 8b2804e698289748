//! Known motions, filmed and tracked.

use nalgebra::{Rotation3, Unit};

use super::error::registration_errors;
use super::{NrrError, NrrOptions, PaperOptions, Solver, Tracked, track};
use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::geometry::mesh_sequence::MeshSequence;
use crate::kernels::geometry::shapes;
use crate::kernels::sensors::depth::camera::Orbit;
use crate::kernels::sensors::depth::film::{Film, FilmOptions, film};
use crate::kernels::sensors::depth::mesh::depth_mesh;
use crate::kernels::sensors::depth::{DepthVideo, Intrinsics};

const CAMERA: Intrinsics = Intrinsics { fx: 288.0, fy: 288.0, cx: 159.5, cy: 119.5 };

fn filmed(mesh: &TriMesh, frames: Vec<Vec<Vec3>>) -> Film {
    let sequence = MeshSequence::from_frames(frames, mesh.faces().to_vec(), 30.0).unwrap();
    let orbit = Orbit { distance: 2.6, azimuth_deg: 0.0, elevation_deg: 0.0 };
    let options =
        FilmOptions { width: 320, height: 240, intrinsics: CAMERA, orbit, noise: None, seed: 1 };
    film(&sequence, &options).unwrap()
}

fn tracked(film: &Film, source: usize, stride: usize) -> (Tracked, TriMesh) {
    let (mesh, _) = depth_mesh(&film.video, source, 0.1, stride).unwrap();
    (track(&film.video, &mesh, source, &NrrOptions::default()).unwrap(), mesh)
}

/// A body without symmetry, 2 m in diagonal.
fn body() -> TriMesh {
    let mesh = shapes::bumpy_sphere(24);
    let vertices = mesh.vertices().iter().map(|it| Vec3::new(it.x, it.z, it.y) * 0.45).collect();
    mesh.with_vertices(vertices).unwrap()
}

#[test]
fn what_stands_still_stays() {
    let mesh = body();
    let film = filmed(&mesh, vec![mesh.vertices().to_vec(); 3]);
    let (source, _) = depth_mesh(&film.video, 1, 0.1, 1).unwrap();
    // Averaged depths lie behind a convex surface by part of a millimetre; plain ones do not.
    for (smoothing, bound) in [(0, 1e-5), (2, 1e-3)] {
        let options = NrrOptions { smoothing, ..NrrOptions::default() };
        let tracked = track(&film.video, &source, 1, &options).unwrap();
        for frame in 0..3 {
            let moved = tracked.sequence.frame(frame).iter().zip(source.vertices());
            let mean = moved.map(|(a, b)| (a - b).norm()).sum::<f64>() / source.n_vertices() as f64;
            assert!(mean < bound, "{mean}");
            let report = &tracked.reports[frame];
            assert!(report.iou > 0.9 && report.coverage > 0.9 && !report.is_lost, "{report:?}");
        }
    }
}

#[test]
fn a_rigid_motion_turns_all_nodes_alike() {
    let mesh = body();
    let axis = Unit::new_normalize(Vec3::new(0.2, 1.0, 0.1));
    let pose = |frame: usize| -> Vec<Vec3> {
        let turn = Rotation3::from_axis_angle(&axis, 0.05 * frame as f64);
        let shift = Vec3::new(0.03, 0.01, -0.02) * frame as f64;
        mesh.vertices().iter().map(|it| turn * it + shift).collect()
    };
    let film = filmed(&mesh, (0..6).map(pose).collect());
    let (source, _) = depth_mesh(&film.video, 0, 0.1, 2).unwrap();
    let options = NrrOptions { smoothness: 10.0, reverse: 0.0, ..NrrOptions::default() };
    let tracked = track(&film.video, &source, 0, &options).unwrap();
    let errors = registration_errors(&tracked.sequence, &film.video, Some(&film.truth), 0).unwrap();
    for (frame, error) in errors.iter().enumerate() {
        assert!(error.mean < 0.01, "frame {frame}: {error:?}");
    }
    // The whole surface is one rigid motion of the source.
    let pairs: Vec<(Vec3, Vec3)> = (source.vertices().iter().copied())
        .zip(tracked.sequence.frame(5).iter().copied())
        .collect();
    let (rotation, shift) = super::warp::fit_rigid(&pairs);
    let off = pairs.iter().map(|it| (rotation * it.0 + shift - it.1).norm()).sum::<f64>();
    assert!(off / (pairs.len() as f64) < 0.003, "{}", off / pairs.len() as f64);
    assert!((rotation.angle() - 0.25).abs() < 0.01, "{}", rotation.angle());
}

/// A strip of 1.6 m bent to an arc of a growing angle, without stretching.
fn strip() -> (TriMesh, Vec<Vec<Vec3>>) {
    let mesh = shapes::rectangle(80, 20, 1.6, 0.4);
    let (low, high) = mesh.bounds();
    let middle = (low + high) / 2.0;
    let bend = |frame: usize| -> Vec<Vec3> {
        let curvature = 0.12 * frame as f64;
        let at = |it: &Vec3| {
            let along = it.x - middle.x;
            let angle = curvature * along;
            let (x, z) = match curvature == 0.0 {
                true => (along, 0.0),
                false => (angle.sin() / curvature, (angle.cos() - 1.0) / curvature),
            };
            Vec3::new(x, it.y - middle.y, z)
        };
        mesh.vertices().iter().map(at).collect()
    };
    let frames = (0..8).map(bend).collect();
    (mesh, frames)
}

#[test]
fn a_bending_strip_is_followed_to_half_a_spacing() {
    let (mesh, frames) = strip();
    let film = filmed(&mesh, frames);
    let (tracked, _) = tracked(&film, 0, 2);
    let errors = registration_errors(&tracked.sequence, &film.video, Some(&film.truth), 0).unwrap();
    // Half of sigma = 0.05 for a diagonal of 2 m.
    let half_spacing = 0.025 * 1.65 / 2.0;
    for (frame, error) in errors.iter().enumerate() {
        assert!(error.mean < half_spacing, "frame {frame}: {error:?}");
        assert!(error.point_to_plane < 0.004 && error.iou > 0.9, "frame {frame}: {error:?}");
    }
}

/// A ball that moves behind a wide plate: `(mesh, frames)`.
fn ball_and_plate(shifts: &[f64]) -> (TriMesh, Vec<Vec<Vec3>>) {
    let plate = shapes::moved(&shapes::rectangle(30, 30, 0.6, 0.8), Vec3::new(0.1, -0.4, 0.0));
    let ball = shapes::icosphere(3);
    let ball = ball.with_vertices(ball.vertices().iter().map(|it| it * 0.12).collect()).unwrap();
    let ball = shapes::moved(&ball, Vec3::new(-0.8, 0.0, -0.4));
    let both = shapes::union(&plate, &ball);
    let n_plate = plate.n_vertices();
    let pose = |shift: &f64| {
        let at = |it: (usize, &Vec3)| it.1 + Vec3::x() * if it.0 < n_plate { 0.0 } else { *shift };
        both.vertices().iter().enumerate().map(at).collect()
    };
    let frames = shifts.iter().map(pose).collect();
    (both, frames)
}

/// How far the ball has come.
fn way_of_ball(tracked: &MeshSequence, frame: usize) -> f64 {
    let is_ball = |it: &usize| tracked.frame(0)[*it].x < -0.3;
    let ways: Vec<f64> = (0..tracked.n_vertices())
        .filter(is_ball)
        .map(|it| tracked.frame(frame)[it].x - tracked.frame(0)[it].x)
        .collect();
    ways.iter().sum::<f64>() / ways.len() as f64
}

#[test]
fn fast_motions_are_met_ahead() {
    // Steps grow to more than the ball is wide.
    let shifts = [0.0, 0.06, 0.17, 0.32, 0.52];
    let (mesh, frames) = ball_and_plate(&shifts);
    let film = filmed(&mesh, frames);
    let (source, _) = depth_mesh(&film.video, 0, 0.1, 2).unwrap();
    let off = |momentum: f64| {
        let options = NrrOptions { momentum, ..NrrOptions::default() };
        let tracked = track(&film.video, &source, 0, &options).unwrap().sequence;
        (way_of_ball(&tracked, 4) - shifts[4]).abs()
    };
    let (with, without) = (off(1.0), off(0.0));
    assert!(with < 0.06 && without > 0.2, "{with} {without}");
}

#[test]
fn what_gets_hidden_does_not_run_on() {
    // The ball gets behind the plate, and stays there.
    let shifts: Vec<f64> = (0..14).map(|it| 0.11 * f64::from(it.min(10))).collect();
    let (mesh, frames) = ball_and_plate(&shifts);
    let film = filmed(&mesh, frames);
    let (tracked, _) = tracked(&film, 0, 2);
    for frame in 10..14 {
        let way = way_of_ball(&tracked.sequence, frame);
        assert!(way > 0.7 && way < 1.4, "{way}");
    }
}

/// The paper's solver follows the strip, too, and the same at any number of threads; the default is
/// nearer to the truth.
#[test]
fn the_papers_solver_follows_a_bending_strip() {
    let (mesh, frames) = strip();
    let film = filmed(&mesh, frames[..4].to_vec());
    let (source, _) = depth_mesh(&film.video, 0, 0.1, 2).unwrap();
    let paper = PaperOptions { n_samples: 800, ..PaperOptions::default() };
    let options = NrrOptions { solver: Solver::Paper(paper), ..NrrOptions::default() };
    let with = |n: usize, options: &NrrOptions| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        pool.install(|| track(&film.video, &source, 0, options).unwrap().sequence)
    };
    let (own, again) = (with(1, &options), with(3, &options));
    assert_eq!(own, again);
    let mean = |it: &MeshSequence| -> Vec<f64> {
        let errors = registration_errors(it, &film.video, Some(&film.truth), 0).unwrap();
        errors.iter().map(|it| it.mean).collect()
    };
    let (paper, default) = (mean(&own), mean(&with(2, &NrrOptions::default())));
    assert!(paper[3] < 0.04, "{paper:?}");
    assert!(default[3] < paper[3], "{default:?} {paper:?}");
}

#[test]
fn a_jump_is_found_and_an_empty_frame_is_lost() {
    let mesh = body();
    let far = |shift: Vec3| -> Vec<Vec3> { mesh.vertices().iter().map(|it| it + shift).collect() };
    let jump = Vec3::new(0.55, 0.0, 0.0);
    let film = filmed(&mesh, vec![far(Vec3::zeros()), far(jump), far(jump), far(jump)]);
    let mut frames: Vec<Vec<f32>> = (0..4).map(|it| film.video.frame(it).to_vec()).collect();
    frames[2].fill(0.0);
    let video = film.video.with_frames(frames).unwrap();
    let (source, _) = depth_mesh(&video, 0, 0.1, 2).unwrap();
    let tracked = track(&video, &source, 0, &NrrOptions::default()).unwrap();
    let lost: Vec<bool> = tracked.reports.iter().map(|it| it.is_lost).collect();
    assert_eq!(lost, [false, false, true, false]);
    assert!(tracked.reports[1].is_relocalized, "{:?}", tracked.reports[1]);
    assert_eq!(tracked.sequence.frame(2), tracked.sequence.frame(1));
    let errors = registration_errors(&tracked.sequence, &video, Some(&film.truth), 0).unwrap();
    assert!(errors[1].mean < 0.02 && errors[3].mean < 0.02, "{errors:?}");
}

#[test]
fn what_cannot_be_tracked_is_told() {
    let depths = vec![vec![0.0; 16]; 2];
    let video = DepthVideo::new([4, 4], CAMERA, 30.0, depths).unwrap();
    let mesh = shapes::moved(&shapes::icosphere(1), Vec3::z() * 3.0);
    let options = NrrOptions::default();
    let error = track(&video, &mesh, 2, &options).unwrap_err();
    assert_eq!(error.to_string(), "frame 2 is the source, but the video has 2 frames");
    let behind = shapes::icosphere(1);
    assert!(matches!(track(&video, &behind, 0, &options), Err(NrrError::Behind { .. })));
    let nan = NrrOptions { reach: f64::NAN, ..options.clone() };
    let error = track(&video, &mesh, 0, &nan).unwrap_err();
    assert_eq!(error.to_string(), "`reach` is NaN");
    let tracked = track(&video, &mesh, 0, &options).unwrap();
    assert!(tracked.reports.iter().all(|it| it.is_lost), "all frames are empty");
}
