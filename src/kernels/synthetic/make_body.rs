//! Rigged people from MakeHuman's base mesh and macro targets.

use std::{
    collections::{BTreeMap, BTreeSet},
    fmt,
};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::kernels::{
    files::FileSet,
    geometry::{
        landmarks::Landmarks,
        mesh::{MeshError, TriMesh, Vec3},
    },
    rigs::{
        skeleton::{Skeleton, SkeletonError},
        weights::{SkinWeights, WeightsError},
    },
};

/// Where the files lie in the set that [`make_body`] takes.
const BASE: &str = "3dobjs/base.obj";
pub const RIG: &str = "rig.cmu_mb.json";
pub const WEIGHTS: &str = "weights.cmu_mb.json";
const TARGETS: &str = "targets/macrodetails";

const METRES_PER_UNIT: f64 = 0.1;

/// Vertices of the body in the base mesh `hm08`.
const N_BODY_VERTICES: usize = 13380;

/// The same vertices on every body of the base mesh `hm08`.
const LANDMARKS: [(&str, u32); 7] = [
    ("head_top", 881),
    ("hand_left", 8787),
    ("hand_right", 2119),
    ("foot_left", 11551),
    ("foot_right", 4933),
    ("chest_front", 1472),
    ("chest_back", 1598),
];

/// MakeHuman's macro parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyParameters {
    /// 1 to 90.
    pub age_years: f64,
    /// 0 female to 1 male.
    pub gender: f64,
    /// 0 to 1.
    pub weight: f64,
    /// 0 to 1.
    pub muscle: f64,
    /// 0 to 1.
    pub height: f64,
    /// 0 uncommon to 1 ideal. Other values than 0.5 need the targets of proportions.
    pub proportions: f64,
    /// Caucasian, asian, african; divided by their sum.
    pub races: [f64; 3],
    pub height_targets: HeightTargets,
}

impl Default for BodyParameters {
    fn default() -> Self {
        Self {
            age_years: 25.0,
            gender: 1.0,
            weight: 0.5,
            muscle: 0.5,
            height: 0.5,
            proportions: 0.5,
            races: [1.0; 3],
            height_targets: HeightTargets::default(),
        }
    }
}

/// Which targets change the height.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, schemars::JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum HeightTargets {
    /// Those of average muscle and weight, for every build: 16 files.
    #[default]
    AverageBuild,
    /// Those of the body's own build, as MakeHuman itself does: 144 files. Differs from
    /// `average_build` by less than a millimetre.
    EveryBuild,
}

/// A person in metres, Y up, looking along +Z, feet on y = 0.
#[derive(Debug, Clone, PartialEq)]
pub struct Body {
    pub mesh: TriMesh,
    pub skeleton: Skeleton,
    pub weights: SkinWeights,
    /// Only on the base mesh `hm08`.
    pub landmarks: Option<Landmarks>,
}

/// Why there is no body.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MakeBodyError {
    #[error("`{name}` is {value}, but must be from {low} to {high}")]
    Range { name: &'static str, value: f64, low: f64, high: f64 },
    #[error("`race` has the parts {0:?}, but they must be at least 0 and not all 0")]
    Races([f64; 3]),
    #[error("{} needed files are missing: {}", .0.len(), Names(.0))]
    Missing(Vec<String>),
    #[error("`{file}`, line {line}: {what}")]
    Line { file: String, line: usize, what: String },
    #[error("`{file}`: {what}")]
    File { file: String, what: String },
    #[error(transparent)]
    Mesh(#[from] MeshError),
    #[error(transparent)]
    Skeleton(#[from] SkeletonError),
    #[error(transparent)]
    Weights(#[from] WeightsError),
}

/// At most five names.
struct Names<'a>(&'a [String]);

impl fmt::Display for Names<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let shown: Vec<String> = self.0.iter().take(5).map(|it| format!("`{it}`")).collect();
        let more = if self.0.len() > shown.len() { ", ..." } else { "" };
        write!(f, "{}{more}", shown.join(", "))
    }
}

/// Makes a rigged body.
///
/// The base mesh is moved by a weighted sum of macro targets, with the weights of MakeHuman's
/// `human.py` (see [`macro_targets`]). Joints are means of vertices, most of them of helper cubes that
/// move along, so that every body has true joints. The body is the group `body` with its quads
/// cut along the diagonal from their first corner; other vertices are left out and the rest keeps
/// its order. Joints stand level by level below the root, siblings by name.
///
/// # Errors
/// [`MakeBodyError::Missing`] names the files that these parameters need and `files` lacks.
pub fn make_body(files: &FileSet, parameters: &BodyParameters) -> Result<Body, MakeBodyError> {
    check(parameters)?;
    let targets = macro_targets(parameters);
    let paths = [BASE, RIG, WEIGHTS].map(str::to_owned).into_iter();
    let missing: Vec<String> = paths
        .chain(targets.iter().map(|it| it.0.clone()))
        .filter(|it| !files.files.contains_key(it))
        .collect();
    if !missing.is_empty() {
        return Err(MakeBodyError::Missing(missing));
    }
    let base = BaseMesh::parse(text(files, BASE)?)?;
    let mut vertices = base.vertices.clone();
    for (path, weight) in &targets {
        add_target(&mut vertices, path, text(files, path)?, *weight)?;
    }
    let body: BTreeSet<u32> = base.body.iter().flatten().copied().collect();
    let floor = body.iter().map(|&it| vertices[it as usize].y).fold(f64::INFINITY, f64::min);
    for vertex in &mut vertices {
        *vertex = (*vertex - Vec3::y() * floor) * METRES_PER_UNIT;
    }
    let skeleton = read_rig(text(files, RIG)?, &base, &vertices)?;
    let weights = read_weights(text(files, WEIGHTS)?, &skeleton, &body, vertices.len())?;
    let new_of_old: BTreeMap<u32, u32> =
        body.iter().zip(0..).map(|(&old, new)| (old, new)).collect();
    let faces = base.body.iter().map(|it| it.map(|it| new_of_old[&it])).collect();
    let mesh = TriMesh::new(body.iter().map(|&it| vertices[it as usize]).collect(), faces)?;
    let landmarks = (mesh.n_vertices() == N_BODY_VERTICES).then(|| Landmarks {
        names: LANDMARKS.iter().map(|it| it.0.to_owned()).collect(),
        vertices: LANDMARKS.iter().map(|it| it.1).collect(),
    });
    Ok(Body { mesh, skeleton, weights, landmarks })
}

/// The targets that make up a body, by path, with their weights (MakeHuman, `apps/human.py`).
///
/// Age is made of baby, child, young and old, which blend linearly between 1, 10, 25 and 90 years (the
/// constant 5.333 is MakeHuman's own). Weight, muscle, height and proportions are made of a lower,
/// a middle and an upper part that blend over 0, 0.5 and 1. A target's weight is the product of
/// the parts in its name.
pub fn macro_targets(parameters: &BodyParameters) -> Vec<(String, f64)> {
    let race_sum: f64 = parameters.races.iter().sum();
    let races = ["caucasian", "asian", "african"];
    let genders = [("male", parameters.gender), ("female", 1.0 - parameters.gender)];
    let muscles = thirds(parameters.muscle, ["minmuscle", "averagemuscle", "maxmuscle"]);
    let weights = thirds(parameters.weight, ["minweight", "averageweight", "maxweight"]);
    let heights = thirds(parameters.height, ["minheight", "", "maxheight"]);
    let proportions =
        thirds(parameters.proportions, ["uncommonproportions", "", "idealproportions"]);
    let average = [("averagemuscle-averageweight".to_owned(), 1.0)];
    let builds: Vec<(String, f64)> = muscles
        .iter()
        .flat_map(|m| weights.iter().map(move |w| (format!("{}-{}", m.0, w.0), m.1 * w.1)))
        .collect();
    let tall_builds = match parameters.height_targets {
        HeightTargets::AverageBuild => average.as_slice(),
        HeightTargets::EveryBuild => builds.as_slice(),
    };
    let mut res = Vec::new();
    let mut add = |name: String, weight: f64| {
        if weight > 0.0 {
            res.push((format!("{TARGETS}/{name}.target"), weight));
        }
    };
    for (gender, gender_part) in genders {
        for (age, age_part) in ages(parameters.age_years) {
            let part = gender_part * age_part;
            for (race, race_part) in races.iter().zip(parameters.races) {
                add(format!("{race}-{gender}-{age}"), part * race_part / race_sum);
            }
            for (build, build_part) in &builds {
                add(format!("universal-{gender}-{age}-{build}"), part * build_part);
            }
            for (ends, folder, builds) in
                [(&heights, "height", tall_builds), (&proportions, "proportions", &builds[..])]
            {
                for (build, build_part) in builds {
                    for (end, end_part) in ends.iter().filter(|it| !it.0.is_empty()) {
                        let name = format!("{folder}/{gender}-{age}-{build}-{end}");
                        add(name, part * build_part * end_part);
                    }
                }
            }
        }
    }
    res
}

fn check(parameters: &BodyParameters) -> Result<(), MakeBodyError> {
    let ranges = [
        ("age", parameters.age_years, 1.0, 90.0),
        ("gender", parameters.gender, 0.0, 1.0),
        ("weight", parameters.weight, 0.0, 1.0),
        ("muscle", parameters.muscle, 0.0, 1.0),
        ("height", parameters.height, 0.0, 1.0),
        ("proportions", parameters.proportions, 0.0, 1.0),
    ];
    for (name, value, low, high) in ranges {
        if !(low..=high).contains(&value) {
            return Err(MakeBodyError::Range { name, value, low, high });
        }
    }
    let races = parameters.races;
    let are_parts = races.iter().all(|&it| it >= 0.0 && it.is_finite());
    if are_parts && races.iter().any(|&it| it > 0.0) {
        Ok(())
    } else {
        Err(MakeBodyError::Races(races))
    }
}

fn ages(years: f64) -> [(&'static str, f64); 4] {
    // From 0 at one year over 0.5 at 25 to 1 at 90.
    let age = if years < 25.0 { (years - 1.0) / 48.0 } else { (years - 25.0) / 130.0 + 0.5 };
    if age < 0.5 {
        let baby = (1.0 - age * 5.333f64).max(0.0);
        let young = ((age - 0.1875) * 3.2).max(0.0);
        let child = ((5.333 * age).min(1.0) - young).max(0.0);
        [("baby", baby), ("child", child), ("young", young), ("old", 0.0)]
    } else {
        let old = (age * 2.0 - 1.0).max(0.0);
        [("baby", 0.0), ("child", 0.0), ("young", 1.0 - old), ("old", old)]
    }
}

fn thirds(value: f64, names: [&'static str; 3]) -> [(&'static str, f64); 3] {
    let upper = (value * 2.0 - 1.0).max(0.0);
    let lower = (1.0 - value * 2.0).max(0.0);
    [(names[0], lower), (names[1], 1.0 - upper - lower), (names[2], upper)]
}

fn text<'a>(files: &'a FileSet, path: &str) -> Result<&'a str, MakeBodyError> {
    let bytes =
        files.files.get(path).ok_or_else(|| MakeBodyError::Missing(vec![path.to_owned()]))?;
    std::str::from_utf8(bytes).map_err(|e| file_error(path, format!("no text: {e}")))
}

fn file_error(file: &str, what: impl Into<String>) -> MakeBodyError {
    MakeBodyError::File { file: file.to_owned(), what: what.into() }
}

struct BaseMesh {
    vertices: Vec<Vec3>,
    /// Triangles of the group `body`.
    body: Vec<[u32; 3]>,
    /// The vertices of the other groups: helpers.
    groups: BTreeMap<String, BTreeSet<u32>>,
}

impl BaseMesh {
    fn parse(text: &str) -> Result<Self, MakeBodyError> {
        let mut res = Self { vertices: Vec::new(), body: Vec::new(), groups: BTreeMap::new() };
        let mut group = String::new();
        for (index, content) in text.lines().enumerate() {
            let fail =
                |what: String| MakeBodyError::Line { file: BASE.to_owned(), line: index + 1, what };
            let mut tokens = content.split_whitespace();
            match tokens.next() {
                Some("v") => {
                    let position: Vec<f64> = tokens.filter_map(|it| it.parse().ok()).collect();
                    if position.len() != 3 {
                        return Err(fail("a vertex without three numbers".to_owned()));
                    }
                    res.vertices.push(Vec3::from_column_slice(&position));
                }
                Some("g") => group = tokens.next().unwrap_or_default().to_owned(),
                Some("f") => {
                    let mut corners = Vec::new();
                    for token in tokens {
                        let index = token.split('/').next().and_then(|it| it.parse::<u32>().ok());
                        let index = index.filter(|&it| it > 0 && it as usize <= res.vertices.len());
                        corners
                            .push(index.ok_or_else(|| fail(format!("no vertex `{token}`")))? - 1);
                    }
                    if group == "body" {
                        let fan = corners.windows(2).skip(1).map(|it| [corners[0], it[0], it[1]]);
                        res.body.extend(fan);
                    } else {
                        res.groups.entry(group.clone()).or_default().extend(corners);
                    }
                }
                _ => {}
            }
        }
        if res.body.is_empty() {
            return Err(file_error(BASE, "there is no group `body`"));
        }
        Ok(res)
    }
}

fn add_target(
    vertices: &mut [Vec3],
    path: &str,
    text: &str,
    weight: f64,
) -> Result<(), MakeBodyError> {
    for (index, content) in text.lines().enumerate() {
        let content = content.trim();
        if content.is_empty() || content.starts_with('#') {
            continue;
        }
        let fail =
            |what: String| MakeBodyError::Line { file: path.to_owned(), line: index + 1, what };
        let mut tokens = content.split_whitespace();
        let vertex: Option<usize> = tokens.next().and_then(|it| it.parse().ok());
        let offset: Vec<f64> = tokens.filter_map(|it| it.parse().ok()).collect();
        let n_vertices = vertices.len();
        match (vertex, offset.len()) {
            (Some(vertex), 3) if vertex < n_vertices => {
                vertices[vertex] += Vec3::from_column_slice(&offset) * weight;
            }
            (Some(vertex), 3) => {
                return Err(fail(format!("it moves vertex {vertex} of {n_vertices}")));
            }
            _ => return Err(fail(format!("`{content}` is no vertex with an offset"))),
        }
    }
    Ok(())
}

/// The joints' heads, level by level.
fn read_rig(text: &str, base: &BaseMesh, vertices: &[Vec3]) -> Result<Skeleton, MakeBodyError> {
    let rig: BTreeMap<String, Value> =
        serde_json::from_str(text).map_err(|e| file_error(RIG, e.to_string()))?;
    let (mut names, mut parents, mut positions) = (Vec::new(), Vec::new(), Vec::new());
    let mut add_children_of =
        |name: &str, parent: Option<usize>| -> Result<Vec<String>, MakeBodyError> {
            let mut added = Vec::new();
            for (child, joint) in rig.iter().filter(|it| it.1["parent"].as_str() == Some(name)) {
                positions.push(joint_position(child, &joint["head"], base, vertices)?);
                parents.push(parent);
                added.push(child.clone());
            }
            Ok(added)
        };
    names.extend(add_children_of("", None)?);
    let mut next = 0;
    while next < names.len() {
        let name: String = names[next].clone();
        names.extend(add_children_of(&name, Some(next))?);
        next += 1;
    }
    if names.len() < rig.len() {
        let n_left = rig.len() - names.len();
        return Err(file_error(RIG, format!("{n_left} joints hang on no root")));
    }
    Ok(Skeleton::new(names, parents, positions)?)
}

/// The mean of a helper cube or of listed vertices.
fn joint_position(
    joint: &str,
    head: &Value,
    base: &BaseMesh,
    vertices: &[Vec3],
) -> Result<Vec3, MakeBodyError> {
    let fail = |what: String| file_error(RIG, format!("joint `{joint}`: {what}"));
    let of: Vec<usize> = match head["strategy"].as_str() {
        Some("CUBE") => {
            let cube = head["cube_name"].as_str().unwrap_or_default();
            let cube = base.groups.get(cube).ok_or_else(|| fail(format!("no group `{cube}`")))?;
            cube.iter().map(|&it| it as usize).collect()
        }
        Some("MEAN") => {
            let listed = head["vertex_indices"].as_array().cloned().unwrap_or_default();
            listed.iter().filter_map(Value::as_u64).map(|it| it as usize).collect()
        }
        other => return Err(fail(format!("the strategy {other:?} is unknown"))),
    };
    if of.is_empty() || of.iter().any(|&it| it >= vertices.len()) {
        return Err(fail(format!("its vertices {of:?} are none or out of range")));
    }
    Ok(of.iter().map(|&it| vertices[it]).sum::<Vec3>() / of.len() as f64)
}

fn read_weights(
    text: &str,
    skeleton: &Skeleton,
    body: &BTreeSet<u32>,
    n_vertices: usize,
) -> Result<SkinWeights, MakeBodyError> {
    #[derive(Deserialize)]
    struct File {
        weights: BTreeMap<String, Vec<(u32, f64)>>,
    }
    let file: File = serde_json::from_str(text).map_err(|e| file_error(WEIGHTS, e.to_string()))?;
    let mut rows = vec![Vec::new(); n_vertices];
    for (name, influences) in &file.weights {
        let joint = skeleton
            .joint(name)
            .ok_or_else(|| file_error(WEIGHTS, format!("there is no joint `{name}`")))?;
        for &(vertex, weight) in influences {
            let row = rows.get_mut(vertex as usize).ok_or_else(|| {
                file_error(WEIGHTS, format!("vertex {vertex} of {n_vertices} has a weight"))
            })?;
            row.push((joint as u32, weight));
        }
    }
    let rows: Vec<_> = body.iter().map(|&it| std::mem::take(&mut rows[it as usize])).collect();
    Ok(SkinWeights::from_rows(skeleton.n_joints(), &rows)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::io::{
        corpus_tests::corpus,
        gltf::{GltfOptions, read_gltf},
    };
    use crate::kernels::rigs::limit_influences::limit_influences;

    fn files() -> Option<FileSet> {
        let folder = corpus()?.join("makehuman");
        let mut files = FileSet::default();
        let mut folders = vec![folder.clone()];
        while let Some(next) = folders.pop() {
            for entry in std::fs::read_dir(next).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() {
                    folders.push(path);
                    continue;
                }
                let name = path.strip_prefix(&folder).unwrap().to_string_lossy().replace('\\', "/");
                files.files.insert(name, std::fs::read(path).unwrap());
            }
        }
        Some(files)
    }

    #[test]
    fn bodies_equal_those_of_the_corpus() {
        let Some(files) = files() else { return };
        // With the height targets of average build, those of strong builds differ a little.
        let subjects = [
            ("humans_rigged/adult_m25", 1e-6),
            ("humans_rigged/adult_f30_heavy", 5e-5),
            ("humans_rigged/adult_n35_androgyne", 1e-6),
            ("humans_rigged/adult_m45_tall", 1e-6),
            ("humans_children/child_f01_baby", 1e-6),
            ("humans_children/child_f12_slim", 1e-6),
        ];
        for (subject, tolerance) in subjects {
            let folder = corpus().unwrap();
            let truth = std::fs::read(folder.join(format!("{subject}.joints.json"))).unwrap();
            let truth: Value = serde_json::from_slice(&truth).unwrap();
            let of = |name: &str| truth["parameters"][name].as_f64();
            let race = |name: &str| truth["parameters"]["race"][name].as_f64().unwrap();
            let parameters = BodyParameters {
                age_years: of("age").unwrap(),
                gender: of("gender").unwrap(),
                weight: of("weight").unwrap(),
                muscle: of("muscle").unwrap(),
                height: of("height").unwrap(),
                proportions: of("proportions").unwrap_or(0.5),
                races: ["caucasian", "asian", "african"].map(race),
                ..BodyParameters::default()
            };
            let body = make_body(&files, &parameters).unwrap();
            let glb = std::fs::read(folder.join(format!("{subject}.glb"))).unwrap();
            let options = GltfOptions { weld: false, ..GltfOptions::default() };
            let expected = read_gltf(&glb, &|_| None, options).unwrap();
            assert_eq!(body.mesh.faces(), expected.mesh.faces());
            let farthest = |a: &[Vec3], b: &[Vec3]| {
                a.iter().zip(b).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
            };
            let vertices = farthest(body.mesh.vertices(), expected.mesh.vertices());
            let (ours, theirs) = (&body.skeleton, expected.skeleton.as_ref().unwrap());
            assert_eq!((ours.names(), ours.parents()), (theirs.names(), theirs.parents()));
            let joints = farthest(ours.positions(), theirs.positions());
            // The corpus keeps four influences of up to seven, in places as 16-bit numbers.
            let theirs = expected.weights.as_ref().unwrap();
            let (four, _) = limit_influences(&body.weights, 4);
            let mut weights = 0.0f64;
            for vertex in 0..body.mesh.n_vertices() {
                for joint in 0..ours.n_joints() {
                    let difference = four.get(vertex, joint) - theirs.get(vertex, joint);
                    weights = weights.max(difference.abs());
                }
            }
            println!("{subject}: {vertices:.1e} m, joints {joints:.1e} m, weights {weights:.1e}");
            assert!(vertices < tolerance && joints < tolerance, "{subject}");
            assert!(weights < 1e-4, "{subject}: {weights}");
            assert_eq!(body.landmarks.unwrap().len(), 7);
        }
    }

    #[test]
    fn the_parts_of_every_name_sum_to_one() {
        for age_years in [1.0, 5.5, 13.0, 25.0, 60.0, 90.0] {
            let parameters = BodyParameters { age_years, gender: 0.3, ..BodyParameters::default() };
            let targets = macro_targets(&parameters);
            let sum = |part: &str| -> f64 {
                targets.iter().filter(|it| it.0.contains(part)).map(|it| it.1).sum()
            };
            // 5.333 stands for 16/3.
            assert!((sum("universal-") - 1.0).abs() < 1e-4, "{age_years}");
            assert!((sum("universal-male") - 0.3).abs() < 1e-4);
            assert!((sum("asian-") - 2.0 / 3.0).abs() < 1e-4, "asian and caucasian");
            assert_eq!(sum("height/"), 0.0);
        }
    }

    #[test]
    fn what_is_missing_and_what_is_out_of_range_is_named() {
        let none = FileSet::default();
        let error = make_body(&none, &BodyParameters::default()).unwrap_err().to_string();
        assert_eq!(
            error,
            "7 needed files are missing: `3dobjs/base.obj`, `rig.cmu_mb.json`, \
             `weights.cmu_mb.json`, `targets/macrodetails/caucasian-male-young.target`, \
             `targets/macrodetails/asian-male-young.target`, ..."
        );
        let parameters = BodyParameters { age_years: 0.5, ..BodyParameters::default() };
        let error = make_body(&none, &parameters).unwrap_err().to_string();
        assert_eq!(error, "`age` is 0.5, but must be from 1 to 90");
    }
}
