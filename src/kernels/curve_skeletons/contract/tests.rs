use super::*;
use crate::kernels::curve_skeletons::skeleton_error::fit_of;
use crate::kernels::geometry::isosurface::{Grid, isosurface};
use crate::kernels::geometry::shapes::{icosphere, moved, torus, tube, union};
use crate::kernels::numerics::random::Random;
use crate::kernels::remeshing::sample_points::{SampleOptions, Spread, sample_points};

/// A ball moved along a segment.
pub(super) type Capsule = (Vec3, Vec3, f64);

/// The surface of some capsules together.
pub(super) fn body(capsules: &[Capsule], cell: f64) -> TriMesh {
    let value = |place: Vec3| {
        let distance = |(from, to, radius): &Capsule| distance_to(&place, from, to) - radius;
        capsules.iter().map(distance).fold(f64::INFINITY, f64::min)
    };
    let ends = capsules.iter().flat_map(|(a, b, r)| [(a, *r), (b, *r)]);
    let (mut low, mut high) = (Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY));
    for (end, radius) in ends {
        low = low.inf(&(end - Vec3::repeat(radius + 2.1 * cell)));
        high = high.sup(&(end + Vec3::repeat(radius + 2.1 * cell)));
    }
    let n_cells = [0, 1, 2].map(|axis| ((high - low)[axis] / cell).ceil() as usize);
    isosurface(&Grid { origin: low, cell, n_cells }, &value).unwrap()
}

pub(super) fn distance_to(place: &Vec3, from: &Vec3, to: &Vec3) -> f64 {
    let along = to - from;
    let share = ((place - from).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
    (from + along * share - place).norm()
}

pub(super) fn cloud_of(mesh: &TriMesh, n_points: usize) -> TriMesh {
    let options = SampleOptions { n_points, spread: Spread::Even, seed: 4, kept: vec![] };
    sample_points(mesh, &options).unwrap().mesh
}

/// Noise of a part of the diagonal, and every fifth point left out.
fn worse(cloud: &TriMesh, noise: f64, dropped: f64, seed: u64) -> TriMesh {
    let mut random = Random::new(seed);
    let (low, high) = cloud.bounds();
    let deviation = noise * (high - low).norm();
    let mut points = Vec::new();
    for point in cloud.vertices() {
        let shift = Vec3::from_fn(|_, _| deviation * random.normal());
        if random.uniform() >= dropped {
            points.push(point + shift);
        }
    }
    TriMesh::from_points(points).unwrap()
}

fn skeleton_of(shape: &TriMesh) -> CurveSkeleton {
    let found = contraction_skeleton(shape, &ContractOptions::default()).unwrap();
    finish(&found, shape, &FinishOptions::default()).unwrap()
}

/// Parts, leaves, junctions, cycles.
pub(super) fn topology(it: &CurveSkeleton) -> [usize; 4] {
    [it.n_components(), it.leaves().len(), it.junctions().len(), it.n_cycles()]
}

fn stick() -> [Capsule; 1] {
    [(Vec3::new(-1.0, 0.1, 0.2), Vec3::new(1.0, 0.4, 0.0), 0.15)]
}

pub(super) fn fork() -> [Capsule; 3] {
    let tip = |x: f64, y: f64| (Vec3::zeros(), Vec3::new(x, y, 0.1 * x), 0.14);
    [tip(0.0, -1.2), tip(0.9, 0.8), tip(-0.8, 1.0)]
}

#[test]
fn a_capsule_has_its_axis() {
    // From pole to pole.
    let [(from, to, radius)] = stick();
    let along = (to - from).normalize() * radius;
    let (from, to) = (from - along, to + along);
    let mesh = body(&stick(), 0.04);
    let cloud = cloud_of(&mesh, 4000);
    for shape in [&mesh, &cloud] {
        let skeleton = skeleton_of(shape);
        assert_eq!(topology(&skeleton), [1, 2, 0, 0], "{}", shape.n_faces());
        let length = (to - from).norm();
        for node in skeleton.positions() {
            let off = distance_to(node, &from, &to);
            assert!(off < 0.03 * length, "{off} of {length}");
        }
        assert!(skeleton.total_length() > 0.8 * length);
        assert_eq!(skeleton.node_of_vertex().len(), shape.n_vertices());
        let fit = fit_of(&skeleton, &mesh);
        assert!(fit.inside == 1.0 && fit.off_center < 0.1, "{fit:?}");
    }
}

#[test]
fn a_fork_has_a_junction_and_three_leaves_also_with_noise_and_gaps() {
    let mesh = body(&fork(), 0.04);
    let cloud = cloud_of(&mesh, 4000);
    for (name, shape) in
        [("mesh", &mesh), ("cloud", &cloud), ("noisy", &worse(&cloud, 0.005, 0.2, 1))]
    {
        let skeleton = skeleton_of(shape);
        assert_eq!(topology(&skeleton), [1, 3, 1, 0], "{name}");
        let junction = skeleton.positions()[skeleton.junctions()[0] as usize];
        assert!(junction.norm() < 0.18, "{name}: {}", junction.norm());
        assert!(fit_of(&skeleton, &mesh).inside == 1.0, "{name}");
    }
}

#[test]
fn a_torus_keeps_its_cycle() {
    let mesh = torus(1.0, 0.3, 60, 24);
    let cloud = cloud_of(&mesh, 3000);
    for (name, shape) in
        [("mesh", &mesh), ("cloud", &cloud), ("noisy", &worse(&cloud, 0.005, 0.2, 2))]
    {
        let skeleton = skeleton_of(shape);
        assert_eq!(topology(&skeleton), [1, 0, 0, 1], "{name}");
        for node in skeleton.positions() {
            let radius = node.x.hypot(node.z);
            assert!((radius - 1.0).abs() < 0.1 && node.y.abs() < 0.1, "{name}: {node}");
        }
    }
}

/// Two fingers on a palm, as far apart as one and a half times the points are.
#[test]
fn fingers_stay_apart() {
    let (radius, n_points) = (0.2, 5000);
    let finger = |x: f64| (Vec3::new(x, 0.0, 0.0), Vec3::new(x, 2.0, 0.0), radius);
    let spacing = 0.04;
    let half = radius + 0.75 * spacing;
    let palm = (Vec3::new(-half, -0.3, 0.0), Vec3::new(half, -0.3, 0.0), 0.35);
    let mesh = body(&[finger(-half), finger(half), palm], 0.02);
    let cloud = cloud_of(&mesh, n_points);
    let found = (mesh.area() / n_points as f64).sqrt();
    assert!((found / spacing - 1.0).abs() < 0.1, "points are {found} apart");
    let skeleton = skeleton_of(&cloud);
    let [parts, leaves, junctions, cycles] = topology(&skeleton);
    assert_eq!((parts, cycles), (1, 0), "{leaves} leaves, {junctions} junctions");
    let tips = skeleton.leaves();
    let tips = tips.iter().filter(|&&it| skeleton.positions()[it as usize].y > 1.7).count();
    assert_eq!(tips, 2);
    // No node has points of both fingers.
    for members in skeleton.vertices_of_nodes() {
        let high = members.iter().map(|&it| cloud.vertices()[it as usize]).filter(|it| it.y > 0.5);
        let (left, right): (Vec<Vec3>, Vec<Vec3>) = high.partition(|it| it.x < 0.0);
        assert!(left.is_empty() || right.is_empty(), "{} and {}", left.len(), right.len());
    }
}

#[test]
fn parts_have_skeletons_of_their_own_and_open_tubes_paths() {
    let two =
        union(&torus(1.0, 0.25, 60, 20), &moved(&tube(0.2, 3.0, 20, 60, 1.0), Vec3::z() * 3.0));
    let skeleton = skeleton_of(&two);
    assert_eq!(topology(&skeleton), [2, 2, 0, 1]);
    let half = tube(0.2, 3.0, 24, 60, 0.5);
    let path = skeleton_of(&half);
    assert_eq!(topology(&path), [1, 2, 0, 0]);
    assert!(path.total_length() > 2.4, "{}", path.total_length());
}

#[test]
fn a_ball_is_a_node_or_a_short_curve() {
    let skeleton = skeleton_of(&icosphere(4));
    assert_eq!(topology(&skeleton)[2..], [0, 0]);
    // Two halves have their means half a radius off the middle.
    assert!(skeleton.total_length() < 1.1, "{}", skeleton.total_length());
}

#[test]
fn sizes_fall_and_rows_say_so() {
    let mesh = body(&fork(), 0.05);
    let found = contraction_skeleton(&mesh, &ContractOptions::default()).unwrap();
    let [part] = &found.parts[..] else { panic!("one part") };
    assert!(matches!(part.stop, Stop::Thin | Stop::Settled), "{:?}", part.stop);
    let ratios: Vec<f64> = part.steps.iter().map(|it| it.size_ratio).collect();
    assert!(ratios[0] < 1.0 && ratios.is_sorted_by(|a, b| a > b), "{ratios:?}");
    assert!(*ratios.last().unwrap() < 0.1, "{ratios:?}");
}

#[test]
fn place_and_scale_do_not_matter() {
    let mesh = body(&fork(), 0.06);
    let one = skeleton_of(&mesh);
    for factor in [1e-4, 1e4] {
        let shift = Vec3::new(3.0, -7.0, 2.0);
        let place = |it: &Vec3| (it + shift) * factor;
        let other = mesh.with_vertices(mesh.vertices().iter().map(place).collect()).unwrap();
        let other = skeleton_of(&other);
        assert_eq!(topology(&one), topology(&other));
        let change = (other.total_length() / factor / one.total_length() - 1.0).abs();
        assert!(change < 0.02, "{change}");
    }
}

#[test]
fn duplicates_count_once_and_too_few_points_are_refused() {
    let cloud = cloud_of(&body(&stick(), 0.06), 600);
    let twice = [cloud.vertices(), &cloud.vertices()[..50]].concat();
    let found =
        contraction_skeleton(&TriMesh::from_points(twice).unwrap(), &ContractOptions::default());
    let found = found.unwrap();
    assert_eq!(found.n_duplicates, 50);
    let labels = found.skeleton.node_of_vertex();
    assert_eq!(labels[600..], labels[..50]);
    let error = |points: Vec<Vec3>| {
        let shape = TriMesh::from_points(points).unwrap();
        contraction_skeleton(&shape, &ContractOptions::default()).unwrap_err().to_string()
    };
    let few = cloud.vertices()[..7].to_vec();
    assert_eq!(
        error([&few[..], &few[..]].concat()),
        "the 14 points are at 7 places; a skeleton needs 8"
    );
    let line: Vec<Vec3> = (0..20).map(|it| Vec3::x() * f64::from(it)).collect();
    assert!(error(line).starts_with("no part has the 8 points that a skeleton needs"));
}

#[test]
fn threads_do_not_matter_and_large_shapes_may_be_thinned() {
    let cloud = cloud_of(&body(&fork(), 0.04), 3000);
    let run = |n_threads: usize, n_points: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
        pool.install(|| coarse_contraction(&cloud, n_points, &ContractOptions::default()).unwrap())
    };
    assert_eq!(run(1, usize::MAX), run(3, usize::MAX));
    let coarse = finish(&run(1, 1000), &cloud, &FinishOptions::default()).unwrap();
    assert_eq!(topology(&coarse), [1, 3, 1, 0]);
    assert_eq!(coarse.node_of_vertex().len(), 3000);
}
