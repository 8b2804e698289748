//! Reading by extension.

use super::{
    ReadError,
    character::Character,
    gltf::{GltfOptions, read_gltf},
    obj::read_obj,
    off::read_off,
    ply::read_ply,
    stl::read_stl,
    xyz::read_xyz,
};

/// The extensions that can be read, in lower case.
pub const EXTENSIONS: [&str; 7] = ["glb", "gltf", "obj", "off", "ply", "stl", "xyz"];

/// Reads a file of any known format; the extension (in lower case, without dot) decides.
///
/// `side_file` finds the buffers that a `.gltf` names. `options` matters for glTF only.
///
/// # Errors
/// See the readers; [`ReadError::Unknown`] for another extension.
pub fn read_character(
    extension: &str,
    bytes: &[u8],
    side_file: &dyn Fn(&str) -> Option<Vec<u8>>,
    options: GltfOptions,
) -> Result<Character, ReadError> {
    match extension {
        "glb" | "gltf" => read_gltf(bytes, side_file, options),
        "obj" => read_obj(bytes).map(Character::of_mesh),
        "off" => read_off(bytes).map(Character::of_mesh),
        "ply" => read_ply(bytes).map(Character::of_mesh),
        "stl" => read_stl(bytes).map(Character::of_mesh),
        "xyz" => read_xyz(bytes).map(Character::of_mesh),
        _ => Err(ReadError::Unknown {
            extension: extension.to_owned(),
            known: EXTENSIONS.map(|it| format!("`.{it}`")).join(", "),
        }),
    }
}
