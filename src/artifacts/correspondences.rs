use crate::engine::artifact::{Artifact, ArtifactType, DecodeError, Decoder, Encoder};
use crate::kernels::maps::correspondences::Correspondences;

impl Artifact for Correspondences {
    const TYPE: ArtifactType = ArtifactType {
        name: "correspondences",
        version: 1,
        doc: "For every vertex of a mesh a place on a reference: `faces` (V indices) and `barycentric` \
              (V x 3).",
    };

    fn encode<'a>(&'a self, to: &mut Encoder<'a>) {
        to.array("faces", &[self.faces.len()], &self.faces);
        let flat = self.barycentric.as_flattened();
        to.array("barycentric", &[self.barycentric.len(), 3], flat);
        to.text("n_faces", self.n_faces.to_string());
    }

    fn decode(from: &Decoder<'_>) -> Result<Self, DecodeError> {
        let n_faces = from.text("n_faces")?.parse().map_err(|_| DecodeError::new("`n_faces`"))?;
        let faces = from.vector::<u32>("faces")?.into_owned();
        let array = from.array::<f64>("barycentric")?;
        if array.shape != [faces.len(), 3] {
            let shape = &array.shape;
            return Err(DecodeError(format!("{} faces, but coordinates {shape:?}", faces.len())));
        }
        if let Some(face) = faces.iter().find(|&&it| it as usize >= n_faces) {
            return Err(DecodeError(format!("face {face} of {n_faces}")));
        }
        let barycentric = array.values.as_chunks::<3>().0.to_vec();
        let inside = |it: &[f64; 3]| {
            it.iter().all(|it| *it >= 0.0) && (it.iter().sum::<f64>() - 1.0).abs() < 1e-6
        };
        match barycentric.iter().position(|it| !inside(it)) {
            Some(vertex) => Err(DecodeError(format!(
                "the place of vertex {vertex} has the coordinates {:?}, which leave the face",
                barycentric[vertex]
            ))),
            None => Ok(Self { faces, barycentric, n_faces }),
        }
    }

    fn summary(&self) -> Vec<(String, String)> {
        vec![
            ("vertices".to_owned(), self.faces.len().to_string()),
            ("faces of the reference".to_owned(), self.n_faces.to_string()),
        ]
    }
}
