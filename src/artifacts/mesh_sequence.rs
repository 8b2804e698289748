use super::mesh::{points, put_points};
use crate::engine::artifact::{Artifact, ArtifactType, DecodeError, Decoder, Encoder, Format};
use crate::kernels::geometry::mesh_sequence::MeshSequence;
use crate::kernels::io::anime::{read_anime, write_anime};

impl Artifact for MeshSequence {
    const TYPE: ArtifactType = ArtifactType {
        name: "mesh_sequence",
        version: 1,
        doc: "A mesh in motion: `positions` (T*V x 3, frame by frame), `faces` (F x 3 indices), \
              `n_vertices` and `frames_per_second`.",
    };

    const FORMATS: &'static [Format] = &[Format {
        extension: "anime",
        doc: "DeformingThings4D, single precision, without the rate.",
    }];

    const IMPORTS: &'static [&'static str] = &["anime"];

    fn encode<'a>(&'a self, to: &mut Encoder<'a>) {
        put_points(to, "positions", self.positions());
        let faces = self.faces();
        to.array("faces", &[faces.len(), 3], bytemuck::cast_slice::<_, u32>(faces));
        to.owned("n_vertices", &[1], vec![self.n_vertices() as u64]);
        to.owned("frames_per_second", &[1], vec![self.frames_per_second()]);
    }

    fn decode(from: &Decoder<'_>) -> Result<Self, DecodeError> {
        let positions = points(from, "positions")?;
        let (_, 3, faces) = from.matrix::<u32>("faces")? else {
            return Err(DecodeError::new("`faces` has no three columns"));
        };
        let faces = faces.chunks_exact(3).map(|it| [it[0], it[1], it[2]]).collect();
        let n_vertices = from.vector::<u64>("n_vertices")?;
        let rate = from.vector::<f64>("frames_per_second")?;
        let (&[n_vertices], &[rate]) = (&n_vertices[..], &rate[..]) else {
            return Err(DecodeError::new(
                "`n_vertices` and `frames_per_second` are one number each",
            ));
        };
        let n_vertices = usize::try_from(n_vertices).unwrap_or(0);
        Self::new(rate, n_vertices, faces, positions).map_err(|e| DecodeError::new(e.to_string()))
    }

    fn export(&self, extension: &str) -> Result<Vec<u8>, String> {
        match extension {
            "anime" => Ok(write_anime(self)),
            _ => Err(format!("a mesh sequence cannot be written as .{extension}")),
        }
    }

    fn import(_extension: &str, bytes: &[u8]) -> Result<Self, String> {
        read_anime(bytes, 30.0).map_err(|e| e.to_string())
    }

    fn summary(&self) -> Vec<(String, String)> {
        vec![
            ("vertices".to_owned(), self.n_vertices().to_string()),
            ("faces".to_owned(), self.faces().len().to_string()),
            ("frames".to_owned(), self.n_frames().to_string()),
            ("frames a second".to_owned(), self.frames_per_second().to_string()),
        ]
    }
}
