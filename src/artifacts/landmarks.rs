use crate::engine::artifact::{Artifact, ArtifactType, DecodeError, Decoder, Encoder};
use crate::kernels::geometry::landmarks::Landmarks;

impl Artifact for Landmarks {
    const TYPE: ArtifactType = ArtifactType {
        name: "landmarks",
        version: 1,
        doc: "Vertices that correspond across shapes: `vertices` (indices) and `names`.",
    };

    fn encode<'a>(&'a self, to: &mut Encoder<'a>) {
        to.array("vertices", &[self.vertices.len()], &self.vertices);
        to.texts("names", &self.names);
    }

    fn decode(from: &Decoder<'_>) -> Result<Self, DecodeError> {
        let names = from.texts("names")?;
        let vertices = from.vector::<u32>("vertices")?.into_owned();
        if names.len() != vertices.len() {
            let message = format!("{} names for {} vertices", names.len(), vertices.len());
            return Err(DecodeError(message));
        }
        Ok(Self { names, vertices })
    }

    fn summary(&self) -> Vec<(String, String)> {
        let mut lines = vec![("landmarks".to_owned(), self.len().to_string())];
        for (name, vertex) in self.names.iter().zip(&self.vertices) {
            lines.push((name.clone(), format!("vertex {vertex}")));
        }
        lines
    }
}
