use super::functional_map::{put_space, space};
use super::matrix::{matrix, put_matrix, show_range};
use super::skeleton::{parents, put_parents};
use crate::engine::artifact::{Artifact, ArtifactType, DecodeError, Decoder, Encoder};
use crate::kernels::transfer::regressor::SpectralRegressor;

impl Artifact for SpectralRegressor {
    const TYPE: ArtifactType = ArtifactType {
        name: "spectral_regressor",
        version: 1,
        doc: "Joints from spectral coefficients at total area one: `matrix` (Q x k), with `names` \
              and `parents` (-1 for a root). The text `space`, if there is one, tells the basis.",
    };

    fn encode<'a>(&'a self, to: &mut Encoder<'a>) {
        put_matrix(to, "matrix", &self.matrix);
        put_parents(to, &self.parents);
        to.texts("names", &self.names);
        if let Some(space) = &self.space {
            put_space(to, "space", space);
        }
    }

    fn decode(from: &Decoder<'_>) -> Result<Self, DecodeError> {
        let (matrix, names, parents) =
            (matrix(from, "matrix")?, from.texts("names")?, parents(from)?);
        if matrix.nrows() != names.len() || parents.len() != names.len() {
            let (rows, names, parents) = (matrix.nrows(), names.len(), parents.len());
            return Err(DecodeError(format!("{rows} rows, {names} names and {parents} parents")));
        }
        Ok(Self { names, parents, matrix, space: space(from, "space")? })
    }

    fn summary(&self) -> Vec<(String, String)> {
        let (joints, k) = (self.matrix.nrows(), self.matrix.ncols());
        vec![
            ("size".to_owned(), format!("{joints} joints x {k} eigenfunctions")),
            ("range".to_owned(), show_range(&self.matrix)),
        ]
    }
}
