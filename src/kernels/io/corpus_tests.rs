//! Readers on the files of the corpus, where there is one.

use std::path::PathBuf;

use serde_json::Value;

use super::{
    character::{Character, CoreJoints},
    glb::{GlbRig, GlbScene, write_glb},
    gltf::{GltfOptions, RestPose, read_gltf},
    read::read_character,
};
use crate::kernels::{
    geometry::mesh::{MeshError, Vec3},
    rigs::skinning::skin,
};

/// The corpus: `SINEW_CORPUS`, or `../shared/data` beside the checkout.
pub fn corpus() -> Option<PathBuf> {
    let beside = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    let folder = std::env::var_os("SINEW_CORPUS").map_or_else(beside, PathBuf::from);
    if !folder.is_dir() {
        println!("skipped: there is no corpus at `{}`", folder.display());
        return None;
    }
    Some(folder)
}

fn read(path: &str, options: GltfOptions) -> Option<Result<Character, String>> {
    let path = corpus()?.join(path);
    let bytes = std::fs::read(&path).expect("a file of the corpus");
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    let side_file = |name: &str| std::fs::read(path.with_file_name(name)).ok();
    Some(read_character(&extension, &bytes, &side_file, options).map_err(|it| it.to_string()))
}

fn json(path: &str) -> Value {
    let path = corpus().expect("checked before").join(path);
    serde_json::from_slice(&std::fs::read(path).expect("a file of the corpus")).expect("JSON")
}

fn counts(path: &str, expected: (usize, usize)) {
    let Some(character) = read(path, GltfOptions::default()) else { return };
    let mesh = character.unwrap_or_else(|e| panic!("{path}: {e}")).mesh;
    assert_eq!((mesh.n_vertices(), mesh.n_faces()), expected, "{path}");
}

fn error(path: &str, expected: &str) {
    let Some(character) = read(path, GltfOptions::default()) else { return };
    assert_eq!(character.unwrap_err(), expected, "{path}");
}

#[test]
fn edge_cases_of_loaders() {
    let at = |it| format!("meshes_plain/loader_edge_cases/{it}");
    counts(&at("cube_binary.ply"), (8, 12));
    counts(&at("cube_binary_header_with_RN_newline.ply"), (8, 12));
    counts(&at("cube_binary_starts_with_nl.ply"), (8, 12));
    counts(&at("cube_uv.ply"), (24, 12));
    counts(&at("float-color.ply"), (3, 1));
    counts(&at("nancolor.obj"), (8, 12));
    counts(&at("negative_indices.obj"), (8, 12));
    counts(&at("polygonfaces.obj"), (5, 3));
    counts(&at("points_ascii.ply"), (5, 0));
    error("meshes_plain/defective/adult_m25_nan.ply", &{
        let vertex = 1894;
        format!("PLY file: {}", MeshError::NotFinite { vertex, value: f64::NAN })
    });
}

#[test]
fn animals_have_the_core_joints_of_the_corpus() {
    for (name, n_vertices) in [("horse", 1093), ("cow", 1237), ("wolf", 983), ("fox", 926)] {
        let path = format!("animals/{name}.glb");
        let Some(character) = read(&path, GltfOptions::default()) else { return };
        let mut character = character.unwrap();
        assert_eq!(character.mesh.n_vertices(), n_vertices);
        let truth = json(&format!("animals/{name}.joints.json"));
        assert_joints(&character, &truth["joints"], name);
        character.keep_core_joints(CoreJoints::default());
        assert_joints(&character, &truth["core_joints"], name);
        assert!(character.clips.len() > 5);
    }
}

#[test]
fn ankles_of_an_animal_are_joints_of_its_legs() {
    let Some(character) = read("animals/horse.glb", GltfOptions::default()) else { return };
    let mut character = character.unwrap();
    character.keep_core_joints(CoreJoints::SKINNED);
    let skeleton = character.skeleton.unwrap();
    for (leg, ankle, hoof) in
        [("FrontLowerLeg.L", "IKFrontLeg.L", "FF.L"), ("BackLowerLeg.R", "IKBackLeg.R", "FFB.R")]
    {
        let [leg, ankle, hoof] = [leg, ankle, hoof].map(|it| skeleton.joint(it));
        assert!(leg.is_some() && ankle.is_some() && hoof.is_some());
        let parents = [ankle, hoof].map(|it| skeleton.parents()[it.unwrap()]);
        assert_eq!(parents, [leg, ankle]);
    }
}

/// The same names, parents and, to 1e-4, positions; in any order.
fn assert_joints(character: &Character, truth: &Value, name: &str) {
    let skeleton = character.skeleton.as_ref().unwrap();
    let truth = truth.as_array().unwrap();
    assert_eq!(skeleton.n_joints(), truth.len(), "{name}: {:?}", skeleton.names());
    for joint in truth {
        let joint_name = joint["name"].as_str().unwrap();
        let found =
            skeleton.joint(joint_name).unwrap_or_else(|| panic!("{name} lacks {joint_name}"));
        let parent = skeleton.parents()[found].map(|it| skeleton.names()[it].as_str());
        assert_eq!(parent, joint["parent"].as_str(), "{name}: {joint_name}");
        let position: Vec<f64> = serde_json::from_value(joint["position"].clone()).unwrap();
        let distance = (skeleton.positions()[found] - Vec3::from_column_slice(&position)).norm();
        assert!(distance < 1e-4, "{name}: {joint_name} is {distance} off");
    }
}

#[test]
fn characters_of_many_kinds_are_read() {
    let files = [
        ("animated/cesium_man_embedded.gltf", (2338, 19, 1)),
        ("animated/cesium_man_external/CesiumMan.gltf", (2338, 19, 1)),
        ("animated/cesium_man_unnamed_nodes.glb", (2338, 19, 1)),
        ("animated/kenney_character_rigid_nodes.glb", (310, 0, 0)),
        ("animated/q_robot.glb", (1820, 58, 14)),
        ("animated/rigged_simple.glb", (96, 2, 1)),
        ("animated/simple_skin.gltf", (10, 2, 1)),
        ("characters/q_man_casual.glb", (3199, 49, 0)),
        ("humans_rigged/adult_m25.glb", (13380, 31, 3)),
        ("humans_children/child_m06.glb", (13380, 31, 1)),
        ("animals/khronos_fox.glb", (290, 24, 3)),
        ("meshes_plain/loader_edge_cases/mode5.gltf", (1476, 0, 0)),
        ("meshes_plain/loader_edge_cases/no_indices_3storybuilding.glb", (24, 0, 0)),
    ];
    for (file, expected) in files {
        for rest in [RestPose::Scene, RestPose::Bind] {
            let options = GltfOptions { rest, ..GltfOptions::default() };
            let Some(character) = read(file, options) else { return };
            let character = character.unwrap_or_else(|e| panic!("{file}: {e}"));
            let found = (
                character.mesh.n_vertices(),
                character.skeleton.as_ref().map_or(0, |it| it.n_joints()),
                character.clips.len(),
            );
            assert_eq!(found, expected, "{file}");
            if let Some(weights) = &character.weights {
                assert_eq!(weights.n_vertices(), character.mesh.n_vertices());
            }
        }
    }
}

#[test]
fn rigs_written_and_read_again_move_as_before() {
    for (path, core) in [("animals/horse.glb", true), ("humans_rigged/adult_m25.glb", false)] {
        let Some(character) = read(path, GltfOptions::default()) else { return };
        let mut before = character.unwrap();
        if core {
            before.keep_core_joints(CoreJoints::default());
        }
        let (skeleton, weights) = (before.skeleton.as_ref().unwrap(), before.weights.as_ref());
        let rig = GlbRig { skeleton, weights, clips: &before.clips };
        let scene =
            GlbScene { mesh: &before.mesh, colours: None, rig: Some(rig), max_influences: 4 };
        let glb = write_glb(scene);
        assert_eq!(glb.n_cut_vertices, 0);
        let after = read_gltf(&glb.bytes, &|_| None, GltfOptions::default()).unwrap();
        assert_eq!(after.skeleton.as_ref().unwrap().names(), skeleton.names());
        assert_eq!(after.skeleton.as_ref().unwrap().parents(), skeleton.parents());
        let (low, high) = before.mesh.bounds();
        for clip in 0..before.clips.len() {
            let n_frames = before.clips[clip].n_frames();
            assert_eq!(after.clips[clip].n_frames(), n_frames);
            for frame in [0, n_frames / 2, n_frames - 1] {
                let worst = posed(&before, clip, frame)
                    .iter()
                    .zip(posed(&after, clip, frame))
                    .map(|(a, b)| (a - b).norm())
                    .fold(0.0, f64::max);
                assert!(worst < 2e-7 * (high - low).norm(), "{path}: {worst}");
            }
        }
    }
}

fn posed(character: &Character, clip: usize, frame: usize) -> Vec<Vec3> {
    let (skeleton, weights) = (character.skeleton.as_ref(), character.weights.as_ref());
    let clip = &character.clips[clip];
    skin(&character.mesh, skeleton.unwrap(), weights.unwrap(), clip, frame).unwrap()
}

/// The `tobj` crate numbers vertices by first use, but must see the same triangles.
#[test]
fn obj_files_have_the_triangles_that_tobj_sees() {
    let files = [
        "meshes_plain/spot_low_resolution.obj",
        "meshes_plain/spot_control_mesh.obj",
        "meshes_plain/penguin.obj",
        "meshes_plain/defective/gc_dodecahedron_poly.obj",
        "meshes_plain/loader_edge_cases/negative_indices.obj",
        "humans_smpl_ccby/human_man.obj",
    ];
    for file in files {
        let Some(character) = read(file, GltfOptions::default()) else { return };
        let mesh = character.unwrap().mesh;
        let path = corpus().unwrap().join(file);
        let options = tobj::LoadOptions { triangulate: true, ..tobj::LoadOptions::default() };
        let mut bytes = std::io::BufReader::new(std::fs::File::open(path).unwrap());
        let no_material = |_: &std::path::Path| Err(tobj::LoadError::OpenFileFailed);
        let (models, _) = tobj::load_obj_buf(&mut bytes, &options, no_material).unwrap();
        let theirs: Vec<f32> = models
            .iter()
            .flat_map(|it| {
                it.mesh.indices.iter().map(|&index| (&it.mesh.positions, index as usize))
            })
            .flat_map(|(positions, index)| positions[3 * index..3 * index + 3].to_vec())
            .collect();
        let ours = mesh.faces().iter().flatten().map(|&it| mesh.vertices()[it as usize]);
        let ours: Vec<f32> = ours.flat_map(|it| [it.x as f32, it.y as f32, it.z as f32]).collect();
        assert!(ours == theirs, "{file}: {} and {} numbers", ours.len(), theirs.len());
    }
}
