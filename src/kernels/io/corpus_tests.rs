//! Readers on the files of the corpus, where there is one.

use std::path::PathBuf;

use serde_json::Value;

use super::{
    character::Character,
    gltf::{GltfOptions, RestPose},
    read::read_character,
};
use crate::kernels::mesh::{MeshError, Vec3};

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
    error(
        &at("points_ascii.ply"),
        "the PLY file has 5 points but no faces: it is a point cloud, no mesh",
    );
    error("meshes_plain/defective/adult_m25_nan.ply", &{
        let vertex = 1894;
        format!("PLY file: {}", MeshError::NotFinite { vertex, value: f64::NAN })
    });
}

#[test]
fn animals_have_the_core_joints_of_the_corpus() {
    for (name, n_vertices) in [("horse", 1093), ("cow", 1237), ("wolf", 983), ("fox", 0)] {
        let path = format!("animals/{name}.glb");
        let Some(character) = read(&path, GltfOptions::default()) else { return };
        let mut character = character.unwrap();
        println!(
            "{name}: {} vertices, {} faces",
            character.mesh.n_vertices(),
            character.mesh.n_faces()
        );
        if n_vertices > 0 {
            assert_eq!(character.mesh.n_vertices(), n_vertices);
        }
        let truth = json(&format!("animals/{name}.joints.json"));
        assert_joints(&character, &truth["joints"], name);
        character.keep_core_joints();
        assert_joints(&character, &truth["core_joints"], name);
        assert!(character.clips.len() > 5);
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
        "animated/cesium_man_embedded.gltf",
        "animated/cesium_man_external/CesiumMan.gltf",
        "animated/cesium_man_unnamed_nodes.glb",
        "animated/kenney_character_rigid_nodes.glb",
        "animated/q_robot.glb",
        "animated/rigged_simple.glb",
        "animated/simple_skin.gltf",
        "characters/q_man_casual.glb",
        "humans_rigged/adult_m25.glb",
        "humans_children/child_m06.glb",
        "animals/khronos_fox.glb",
        "meshes_plain/loader_edge_cases/mode5.gltf",
        "meshes_plain/loader_edge_cases/no_indices_3storybuilding.glb",
    ];
    for file in files {
        for rest in [RestPose::Scene, RestPose::Bind] {
            let options = GltfOptions { rest, ..GltfOptions::default() };
            let Some(character) = read(file, options) else { return };
            let character = character.unwrap_or_else(|e| panic!("{file}: {e}"));
            let n_joints = character.skeleton.as_ref().map_or(0, |it| it.n_joints());
            let clips: Vec<_> =
                character.clips.iter().map(|it| format!("{} {}", it.name, it.n_frames())).collect();
            println!(
                "{file}: {} v {} f {n_joints} q {clips:?} {:?}",
                character.mesh.n_vertices(),
                character.mesh.n_faces(),
                character.notes
            );
        }
    }
}
