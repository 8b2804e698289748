use super::skeleton::{parents, put_parents};
use crate::engine::artifact::{Artifact, ArtifactType, DecodeError, Decoder, Encoder};
use crate::kernels::regressor::Regressor;
use crate::kernels::sparse::CsrMatrix;

impl Artifact for Regressor {
    const TYPE: ArtifactType = ArtifactType {
        name: "regressor",
        version: 1,
        doc: "Joints as sums of vertices, Q x V, sparse by rows: `offsets` (Q + 1), `columns`, \
              `values`; with `names` and `parents` (-1 for a root).",
    };

    fn encode<'a>(&'a self, to: &mut Encoder<'a>) {
        let matrix = &self.matrix;
        let offsets = matrix.offsets.iter().map(|&it| it as u64).collect();
        to.owned("offsets", &[matrix.offsets.len()], offsets);
        to.array("columns", &[matrix.columns.len()], &matrix.columns);
        to.array("values", &[matrix.values.len()], &matrix.values);
        to.text("n_vertices", matrix.n_cols.to_string());
        put_parents(to, &self.parents);
        to.texts("names", &self.names);
    }

    fn decode(from: &Decoder<'_>) -> Result<Self, DecodeError> {
        let (names, parents) = (from.texts("names")?, parents(from)?);
        let offsets: Vec<usize> =
            from.vector::<u64>("offsets")?.iter().map(|&it| it as usize).collect();
        let n_cols: usize =
            from.text("n_vertices")?.parse().map_err(|_| DecodeError::new("`n_vertices`"))?;
        let columns = from.vector::<u32>("columns")?.into_owned();
        let values = from.vector::<f64>("values")?.into_owned();
        let n_rows = names.len();
        if parents.len() != n_rows || offsets.len() != n_rows + 1 || columns.len() != values.len() {
            return Err(DecodeError::new(
                "the arrays differ in their numbers of joints or entries",
            ));
        }
        let ascending = offsets.windows(2).all(|it| it[0] <= it[1]);
        if !ascending || offsets[0] != 0 || offsets[n_rows] != columns.len() {
            return Err(DecodeError::new("`offsets` do not divide the entries into rows"));
        }
        let in_order = |row: &[u32]| row.windows(2).all(|it| it[0] < it[1]);
        let rows = offsets.windows(2).map(|it| &columns[it[0]..it[1]]);
        if !rows.clone().all(in_order) || columns.iter().any(|&it| it as usize >= n_cols) {
            return Err(DecodeError::new("`columns` do not ascend within the number of vertices"));
        }
        if let Some(value) = values.iter().find(|it| !it.is_finite()) {
            return Err(DecodeError(format!("array `values` holds {value}")));
        }
        Ok(Self { names, parents, matrix: CsrMatrix { n_rows, n_cols, offsets, columns, values } })
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
