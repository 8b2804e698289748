//! The joints of a figure from its surface in several poses.

mod parts;
mod recut;
mod samples;
mod solve;

use super::find_joints::Joint;
use super::mesh::{TriMesh, Vec3};
use super::skeleton::Skeleton;
use super::triangle_tree::TriangleTree;
use parts::{Parts, curve_pairs, motions_of_curves, on_bone};
use samples::{Sample, labels, samples};
use solve::{Point, Pose, State, Weights, step};

/// How joints are fitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FitOptions {
    /// Points of the surface at rest.
    pub n_samples: usize,
    /// Skin counts little within this share of the skeleton's extent around a joint.
    pub ramp: f64,
    /// A joint turns by more than this in some pose, in degrees.
    pub min_angle: f64,
    pub joint: f64,
    pub prior: f64,
    pub curve: f64,
    pub slide: f64,
    pub rounds: usize,
}

impl Default for FitOptions {
    fn default() -> Self {
        Self { n_samples: 3000, ramp: 0.04, min_angle: 20.0, joint: 0.02, prior: 1e-4, curve: 1e-3, slide: 0.05, rounds: 2 }
    }
}

/// What a fit finds.
#[derive(Debug, Clone)]
pub struct Fit {
    pub joints: Vec<Joint>,
    /// How each of the given joints turned, in degrees, when it was looked at.
    pub distances: Vec<f64>,
}

/// surfaces: one a pose, with `rest` the one at rest.
pub fn fit_joints(
    skeleton: &Skeleton,
    poses: &[Vec<Vec3>],
    surfaces: &[&TriMesh],
    rest: usize,
    joints: &[Joint],
    options: &FitOptions,
) -> Fit {
    let positions = skeleton.positions();
    let (low, high) = positions.iter().fold((positions[0], positions[0]), |(l, h), it| (l.inf(it), h.sup(it)));
    let extent = (high - low).max();
    // All in parts of the extent.
    let unit = 1.0 / extent;
    let scaled = |it: &[Vec3]| it.iter().map(|it| it * unit).collect::<Vec<Vec3>>();
    let skeleton = skeleton.with_positions(scaled(positions)).expect("finite");
    let meshes: Vec<TriMesh> = surfaces.iter().map(|it| it.with_vertices(scaled(it.vertices())).expect("same")).collect();
    let trees: Vec<TriangleTree> = meshes.iter().map(TriangleTree::new).collect();
    let normals: Vec<Vec<Vec3>> = meshes.iter().map(|mesh| (0..mesh.n_faces()).map(|it| mesh.area_vector(it).try_normalize(0.0).unwrap_or_else(Vec3::zeros)).collect()).collect();
    let others: Vec<usize> = (0..poses.len()).filter(|&it| it != rest).collect();
    let places: Vec<Vec<Vec3>> = others.iter().map(|&it| scaled(&poses[it])).collect();
    let all = samples(&meshes[rest], &trees[rest], &skeleton, options.n_samples);
    let mut current: Vec<Joint> = joints.to_vec();
    let mut distances = vec![];
    let mut recuts = 0;
    loop {
        let state = fit(&skeleton, &places, &others, &trees, &normals, &all, &current, options, &mut distances);
        let parts = Parts::new(&skeleton, &current);
        let swings = swings(&skeleton, &parts, &state);
        for (joint, (turns, place)) in current.iter_mut().zip(swings.iter().zip(&state.joints)) {
            joint.angle = turns.iter().map(|it| it.norm()).fold(0.0, f64::max).to_degrees();
            joint.position = place * extent;
        }
        let least = (0..current.len()).min_by(|&a, &b| current[a].angle.total_cmp(&current[b].angle));
        match least {
            Some(it) if current[it].angle < options.min_angle => { current.remove(it); }
            _ if recuts + 1 < options.rounds => { recuts += 1; recut::recut(&skeleton, &mut current, &state.joints); }
            _ => break,
        }
    }
    Fit { joints: current, distances }
}

#[allow(clippy::too_many_arguments)]
fn fit(skeleton: &Skeleton, places: &[Vec<Vec3>], others: &[usize], trees: &[TriangleTree], normals: &[Vec<Vec3>], all: &[Sample], joints: &[Joint], options: &FitOptions, distances: &mut Vec<f64>) -> State {
    let parts = Parts::new(skeleton, joints);
    let cuts: Vec<Vec3> = joints.iter().map(|it| on_bone(skeleton, skeleton.positions(), it.bone, it.share)).collect();
    let labels = labels(all, skeleton, &parts, &cuts, options.ramp);
    let points: Vec<Point> = all.iter().zip(&labels).map(|(it, &(part, weight))| Point { place: it.point, normal: it.normal, part, weight }).collect();
    let curves: Vec<_> = places.iter().map(|it| curve_pairs(skeleton, &parts, it, 0.01)).collect();
    let motions = curves.iter().map(|it| motions_of_curves(&parts, it)).collect();
    let poses: Vec<Pose<'_>> = others.iter().zip(&curves).map(|(&it, curve)| Pose { surface: &trees[it], normals: &normals[it], curve }).collect();
    let mut state = State { motions, joints: cuts.clone() };
    for round in 0..20 {
        let reach = (0.04 * 0.8f64.powi(round)).max(0.01);
        let weights = Weights { slide: options.slide, curve: options.curve, joint: options.joint, prior: options.prior, reach };
        let distance = step(&mut state, &points, &poses, &parts.sides, &cuts, &weights);
        distances.push(distance);
    }
    state
}

/// How the part behind every joint swings against the part before it, in all poses; its roll is left out.
fn swings(skeleton: &Skeleton, parts: &Parts, state: &State) -> Vec<Vec<Vec3>> {
    let mut directions = vec![Vec3::zeros(); parts.n_parts()];
    for piece in &parts.pieces {
        let [a, b] = piece.shares.map(|it| on_bone(skeleton, skeleton.positions(), piece.bone, it));
        directions[piece.part] += b - a;
    }
    parts.sides.iter().map(|&[a, b]| {
        state.motions.iter().map(|motions| {
            let turn = motions[a].rotation.inverse() * motions[b].rotation;
            super::kabsch::shortest_arc(directions[b], turn * directions[b]).scaled_axis()
        }).collect()
    }).collect()
}
