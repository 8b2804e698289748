//! Skeletons carried between real shapes that share no connectivity, against their true joints.
//!
//! Needs the corpus (`SINEW_CORPUS`, or `../shared/data` beside the checkout) and is skipped without.
//! `cargo test --release --test real_pairs -- --nocapture` prints errors and times.

use std::{collections::BTreeMap, path::PathBuf, time::Instant};

use sinew::kernels::{
    geometry::mesh::{TriMesh, Vec3},
    io::{
        gltf::{GltfOptions, read_gltf},
        ply::read_ply,
    },
    maps::{
        chirality::chirality,
        fmap::{FitOptions, fit_functional_map},
        landmark_files::read_landmarks,
        map_quality::{coverage, orthogonality},
        zoomout::{ZoomOutOptions, zoomout},
    },
    rigs::{
        joint_error::{HeightAxis, JointErrors, joint_errors},
        skeleton::Skeleton,
    },
    spectral::{
        basis::Basis,
        descriptors::{DescriptorOptions, Descriptors, descriptors},
        eigs::{Disconnected, EigsOptions, eigs},
        laplacian::{MassLumping, cotangent_laplacian},
    },
    transfer::{
        exact_regressor::{RegressorOptions, exact_regressor},
        skeleton_transfer::{spectral_regressor, transfer_by_functions, transfer_by_points},
    },
};

/// A rigged `.glb` and, of another shape, a mesh with its true joints.
struct Pair {
    source: &'static str,
    target: &'static str,
    /// `target` is `<stem>.<remesh>.ply`, with joints in `<stem>.joints.json`.
    remesh: &'static str,
    /// The largest mean error that is accepted, in percent of the target's height.
    limit: f64,
}

const SEVEN: [&str; 7] =
    ["head_top", "hand_left", "hand_right", "foot_left", "foot_right", "chest_front", "chest_back"];

#[test]
fn people_get_the_joints_of_another() {
    let pair =
        |target, remesh, limit| Pair { source: "humans_rigged/adult_m25", target, remesh, limit };
    for pair in [
        pair("humans_rigged/adult_f30_heavy", "remesh-qem", 1.4),
        pair("humans_children/child_f08_heavy", "remesh-iso", 1.7),
    ] {
        check(&pair);
    }
}

fn check(pair: &Pair) {
    let Some(corpus) = corpus() else { return };
    let outcome = outcome(&corpus, pair);
    println!("{}", outcome.line);
    let errors = outcome.functional;
    let mean = errors.percent(errors.mean());
    assert!(mean < pair.limit, "{mean} % in the mean, worst {:?}", worst(&errors));
    assert!(outcome.chirality > 0.7, "{}", outcome.chirality);
}

struct Outcome {
    functional: JointErrors,
    chirality: f64,
    line: String,
}

fn outcome(corpus: &std::path::Path, pair: &Pair) -> Outcome {
    let read = |path: String| std::fs::read(corpus.join(path)).expect("a file of the corpus");
    let mut clock = Clock::new();
    let glb = read(format!("{}.glb", pair.source));
    let source = read_gltf(&glb, &|_| None, GltfOptions::default()).unwrap();
    let (skeleton, weights) = (source.skeleton.unwrap(), source.weights.unwrap());
    let target = read_ply(&read(format!("{}.{}.ply", pair.target, pair.remesh))).unwrap();
    let truth = joints(&read(format!("{}.joints.json", pair.target)));
    clock.lap("read");

    let (source_basis, target_basis) = (basis(&source.mesh), basis(&target));
    clock.lap("eigs");
    let source_landmarks = read(format!("{}.landmarks.json", pair.source));
    let target_landmarks = read(format!("{}.{}.landmarks.json", pair.target, pair.remesh));
    let g = described(&source_basis, &source_landmarks);
    let f = described(&target_basis, &target_landmarks);
    clock.lap("descriptors");
    let fit = FitOptions::default();
    let map = fit_functional_map((&source_basis, &g), (&target_basis, &f), &fit).unwrap();
    clock.lap("fmap");
    let refine = ZoomOutOptions::default();
    let places = (Some(source.mesh.vertices()), Some(target.vertices()));
    let (map, matches) =
        zoomout((&source_basis, places.0), (&target_basis, places.1), &map, &refine).unwrap();
    clock.lap("zoomout");
    let options = RegressorOptions::default();
    let (regressor, _) = exact_regressor(&source.mesh, &skeleton, &weights, &options).unwrap();
    let spectral = spectral_regressor(&regressor, &source_basis, refine.k).unwrap();
    clock.lap("regressor");
    let functional =
        transfer_by_functions(&spectral, &map, &target_basis, target.vertices()).unwrap();
    let pointwise = transfer_by_points(&regressor, &matches, target.vertices()).unwrap();
    clock.lap("transfer");

    let meshes = ((&source_basis, &source.mesh), (&target_basis, &target));
    let chirality = chirality(meshes.0, meshes.1, &map).expect("two meshes");
    let judge = |joints: &Skeleton| joint_errors(joints, &truth, &target, HeightAxis::Y).unwrap();
    let (functional, pointwise) = (judge(&functional), judge(&pointwise));
    let show = |errors: &JointErrors| {
        let (mean, most) = (errors.percent(errors.mean()), errors.percent(errors.greatest()));
        format!("{mean:.2} % / {most:.2} %")
    };
    let line = format!(
        "{} -> {}: functional {}, pointwise {} (mean / max), chirality {:.0} %, \
         orthogonality {:.2}, coverage {:.0} %, {}",
        pair.source,
        pair.target,
        show(&functional),
        show(&pointwise),
        100.0 * chirality,
        orthogonality(map.source_from_target.as_ref()),
        100.0 * coverage(&matches, &target_basis.mass),
        clock.laps.join(", ")
    );
    Outcome { functional, chirality, line }
}

fn worst(errors: &JointErrors) -> (String, f64) {
    let worst = (0..errors.names.len())
        .max_by(|&a, &b| errors.distances[a].total_cmp(&errors.distances[b]))
        .expect("there are joints");
    (errors.names[worst].clone(), errors.percent(errors.distances[worst]))
}

fn basis(mesh: &TriMesh) -> Basis {
    let operator = cotangent_laplacian(mesh, MassLumping::default()).unwrap();
    let options =
        EigsOptions { k: 200, disconnected: Disconnected::Refuse, ..EigsOptions::default() };
    eigs(&operator, &options).unwrap().0
}

fn described(basis: &Basis, landmarks: &[u8]) -> Descriptors {
    let names = SEVEN.map(str::to_owned);
    let landmarks = read_landmarks(landmarks, "json", &names).unwrap();
    let pairs: Vec<(String, u32)> = landmarks.names.into_iter().zip(landmarks.vertices).collect();
    descriptors(basis, &pairs, &DescriptorOptions::default()).unwrap()
}

fn joints(json: &[u8]) -> Skeleton {
    let json: serde_json::Value = serde_json::from_slice(json).unwrap();
    let (mut names, mut parents, mut positions) = (Vec::new(), Vec::new(), Vec::new());
    let mut known = BTreeMap::new();
    for joint in json["joints"].as_array().unwrap() {
        let name = joint["name"].as_str().unwrap().to_owned();
        parents.push(joint["parent"].as_str().map(|it| known[it]));
        known.insert(name.clone(), names.len());
        names.push(name);
        let coordinate = |axis: usize| joint["position"][axis].as_f64().unwrap();
        positions.push(Vec3::new(coordinate(0), coordinate(1), coordinate(2)));
    }
    Skeleton::new(names, parents, positions).unwrap()
}

/// Seconds between laps.
struct Clock {
    last: Instant,
    laps: Vec<String>,
}

impl Clock {
    fn new() -> Self {
        Self { last: Instant::now(), laps: Vec::new() }
    }

    fn lap(&mut self, name: &str) {
        self.laps.push(format!("{name} {:.2} s", self.last.elapsed().as_secs_f64()));
        self.last = Instant::now();
    }
}

fn corpus() -> Option<PathBuf> {
    let beside = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    let folder = std::env::var_os("SINEW_CORPUS").map_or_else(beside, PathBuf::from);
    if !folder.is_dir() {
        println!("skipped: there is no corpus at `{}`", folder.display());
        return None;
    }
    Some(folder)
}
