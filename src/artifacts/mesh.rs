use crate::engine::artifact::{Artifact, ArtifactType, DecodeError, Decoder, Encoder, Format};
use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::io::{
    glb,
    gltf::GltfOptions,
    obj, off, ply,
    read::{EXTENSIONS, read_character},
    stl,
};

impl Artifact for TriMesh {
    const TYPE: ArtifactType = ArtifactType {
        name: "mesh",
        version: 1,
        doc: "Triangle mesh: `vertices` (V x 3 positions) and `faces` (F x 3 indices); without faces, \
              a point cloud.",
    };

    const FORMATS: &'static [Format] = &[
        Format { extension: "ply", doc: "Binary, double precision." },
        Format { extension: "obj", doc: "Text; coordinates read back exactly." },
        Format { extension: "off", doc: "Text; coordinates read back exactly." },
        Format { extension: "stl", doc: "Binary, single precision, corners not joined." },
        Format { extension: "glb", doc: "glTF, single precision." },
    ];

    const IMPORTS: &'static [&'static str] = &EXTENSIONS;

    fn encode<'a>(&'a self, to: &mut Encoder<'a>) {
        put_points(to, "vertices", self.vertices());
        to.array("faces", &[self.n_faces(), 3], bytemuck::cast_slice::<_, u32>(self.faces()));
    }

    fn decode(from: &Decoder<'_>) -> Result<Self, DecodeError> {
        let vertices = points(from, "vertices")?;
        let (_, 3, faces) = from.matrix::<u32>("faces")? else {
            return Err(DecodeError::new("`faces` has no three columns"));
        };
        let faces = faces.chunks_exact(3).map(|it| [it[0], it[1], it[2]]).collect();
        Self::new(vertices, faces).map_err(|e| DecodeError::new(e.to_string()))
    }

    fn export(&self, extension: &str) -> Result<Vec<u8>, String> {
        match extension {
            "ply" => Ok(ply::write_ply(self, ply::PlyExtras::default())),
            "obj" => Ok(obj::write_obj(self)),
            "off" => Ok(off::write_off(self)),
            "stl" if self.is_point_cloud() => {
                Err("stl files hold faces, and this is a point cloud".to_owned())
            }
            "stl" => Ok(stl::write_stl(self)),
            "glb" => Ok(glb::write_glb(glb::GlbScene {
                mesh: self,
                colours: None,
                rig: None,
                max_influences: 4,
            })
            .bytes),
            _ => Err(format!("a mesh cannot be written as .{extension}")),
        }
    }

    fn import(extension: &str, bytes: &[u8]) -> Result<Self, String> {
        let character = read_character(extension, bytes, &|_| None, GltfOptions::default());
        character.map(|it| it.mesh).map_err(|e| e.to_string())
    }

    fn summary(&self) -> Vec<(String, String)> {
        let (low, high) = self.bounds();
        vec![
            ("vertices".to_owned(), self.n_vertices().to_string()),
            ("faces".to_owned(), self.n_faces().to_string()),
            ("from".to_owned(), show_point(&low)),
            ("to".to_owned(), show_point(&high)),
            ("area".to_owned(), format!("{:.6}", self.area())),
        ]
    }
}

/// Writes `n x 3` coordinates.
pub fn put_points<'a>(to: &mut Encoder<'a>, name: &'static str, points: &'a [Vec3]) {
    to.array(name, &[points.len(), 3], bytemuck::cast_slice::<_, f64>(points));
}

/// Reads `n x 3` coordinates.
///
/// # Errors
/// If the array is missing or has no three columns.
pub fn points(from: &Decoder<'_>, name: &str) -> Result<Vec<Vec3>, DecodeError> {
    let (_, 3, values) = from.matrix::<f64>(name)? else {
        return Err(DecodeError(format!("`{name}` has no three columns")));
    };
    Ok(values.chunks_exact(3).map(|it| Vec3::new(it[0], it[1], it[2])).collect())
}

pub fn show_point(point: &Vec3) -> String {
    format!("{:.4} {:.4} {:.4}", point.x, point.y, point.z)
}
