//! No bytes make a reader panic: every beginning of small files, and files with flipped bits.

use super::{
    character::CoreJoints,
    glb::{GlbScene, write_glb},
    gltf::GltfOptions,
    obj::write_obj,
    off::write_off,
    ply::{PlyExtras, write_ply},
    read::read_character,
    stl::write_stl,
    table_file::{TABLE_EXTENSIONS, TableFileOptions, read_table},
};
use crate::kernels::{
    geometry::mesh::{TriMesh, Vec3},
    numerics::random::Random,
};

fn files() -> Vec<(&'static str, Vec<u8>)> {
    let vertices = vec![Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z()];
    let mesh = TriMesh::new(vertices, vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]).unwrap();
    let ascii =
        b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n\
        endloop\nendfacet\nendsolid a\n";
    let text = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
        property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
        0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    vec![
        ("obj", write_obj(&mesh)),
        ("off", write_off(&mesh)),
        ("ply", write_ply(&mesh, PlyExtras::default())),
        ("ply", text.to_vec()),
        ("xyz", b"0 0 0\n1 0 0 255 0 0\n0 1 0.5\n".to_vec()),
        ("stl", write_stl(&mesh)),
        ("stl", ascii.to_vec()),
        ("glb", super::glb::small_rig()),
        ("csv", b"name,\"error [mm]\"\r\n\"a,\"\"b\"\"\",0.5\r\nb,\n".to_vec()),
        ("toml", b"[[rows]]\nname = \"a\"\nerror = 1_0.5\n[[rows]]\nerror = -2\n".to_vec()),
        (
            "glb",
            write_glb(GlbScene { mesh: &mesh, colours: None, rig: None, max_influences: 4 }).bytes,
        ),
    ]
}

fn read(extension: &str, bytes: &[u8]) -> Result<(), String> {
    if TABLE_EXTENSIONS.contains(&extension) {
        let table = read_table(extension, bytes, &TableFileOptions::default());
        return table.map(drop).map_err(|it| it.to_string());
    }
    let options = GltfOptions::default();
    let character =
        read_character(extension, bytes, &|_| None, options).map_err(|it| it.to_string())?;
    character.clone().keep_core_joints(CoreJoints::DEFORMING);
    Ok(())
}

#[test]
fn beginnings_of_files_are_errors_or_meshes() {
    for (extension, bytes) in files() {
        assert_eq!(read(extension, &bytes), Ok(()), "{extension}");
        for len in 0..bytes.len() {
            let result = read(extension, &bytes[..len]);
            let is_text = ["csv", "obj", "off", "toml", "xyz"].contains(&extension)
                || bytes.starts_with(b"solid");
            assert!(is_text || len + 2 > bytes.len() || result.is_err(), "{extension} {len}");
            assert!(result.err().is_none_or(|it| !it.contains('\n')));
        }
    }
}

#[test]
fn flipped_bits_never_panic() {
    let mut random = Random::new(1);
    let mut random = move |below: usize| random.next_u64() as usize % below;
    for (extension, bytes) in files() {
        for _ in 0..1000 {
            let mut damaged = bytes.clone();
            for _ in 0..=random(4) {
                let at = random(damaged.len());
                damaged[at] =
                    if random(2) == 0 { damaged[at] ^ (1 << random(8)) } else { random(256) as u8 };
            }
            let _ = read(extension, &damaged);
        }
    }
}
