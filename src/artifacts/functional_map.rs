use super::matrix::{matrix, put_matrix, show_range};
use crate::engine::artifact::{Artifact, ArtifactType, DecodeError, Decoder, Encoder};
use crate::kernels::functional_map::FunctionalMap;

impl Artifact for FunctionalMap {
    const TYPE: ArtifactType = ArtifactType {
        name: "functional_map",
        version: 1,
        doc: "A linear map of functions on the target to functions on the source: \
              `source_from_target` (k_source x k_target), in the bases at total area one.",
    };

    fn encode<'a>(&'a self, to: &mut Encoder<'a>) {
        put_matrix(to, "source_from_target", &self.source_from_target);
    }

    fn decode(from: &Decoder<'_>) -> Result<Self, DecodeError> {
        Ok(Self { source_from_target: matrix(from, "source_from_target")? })
    }

    fn summary(&self) -> Vec<(String, String)> {
        let map = &self.source_from_target;
        let diagonal = (0..map.nrows().min(map.ncols())).map(|it| map[(it, it)].abs());
        let first: Vec<String> = diagonal.take(6).map(|it| format!("{it:.3}")).collect();
        vec![
            ("size".to_owned(), format!("{} x {} (source x target)", map.nrows(), map.ncols())),
            ("range".to_owned(), show_range(map)),
            ("diagonal".to_owned(), format!("{} … (absolute)", first.join(" "))),
        ]
    }
}
