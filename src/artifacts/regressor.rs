use super::skeleton::{parents, put_parents};
use super::sparse::{csr, put_csr};
use crate::engine::artifact::{Artifact, ArtifactType, DecodeError, Decoder, Encoder};
use crate::kernels::transfer::regressor::Regressor;

impl Artifact for Regressor {
    const TYPE: ArtifactType = ArtifactType {
        name: "regressor",
        version: 1,
        doc: "Joints as sums of vertices, Q x V, sparse by rows: `offsets` (Q + 1), `columns`, \
              `values`; with `names` and `parents` (-1 for a root).",
    };

    fn encode<'a>(&'a self, to: &mut Encoder<'a>) {
        put_csr(to, &self.matrix);
        put_parents(to, &self.parents);
        to.texts("names", &self.names);
    }

    fn decode(from: &Decoder<'_>) -> Result<Self, DecodeError> {
        let (names, parents) = (from.texts("names")?, parents(from)?);
        let matrix = csr(from)?;
        if parents.len() != names.len() || matrix.n_rows != names.len() {
            let (n_names, n_parents, n_rows) = (names.len(), parents.len(), matrix.n_rows);
            return Err(DecodeError(format!(
                "{n_names} names, {n_parents} parents and {n_rows} rows of joints"
            )));
        }
        Ok(Self { names, parents, matrix })
    }

    fn summary(&self) -> Vec<(String, String)> {
        let matrix = &self.matrix;
        let mut lines = vec![(
            "size".to_owned(),
            format!("{} joints x {} vertices", matrix.n_rows, matrix.n_cols),
        )];
        for (joint, name) in self.names.iter().enumerate() {
            let amplification: f64 = matrix.row(joint).map(|it| it.1.abs()).sum();
            let count = matrix.row(joint).count();
            let line = format!("{count} vertices, absolute weights add up to {amplification:.3}");
            lines.push((name.clone(), line));
        }
        lines
    }
}
