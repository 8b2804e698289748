use super::matrix::{matrix, put_matrix};
use crate::engine::artifact::{Artifact, ArtifactType, DecodeError, Decoder, Encoder};
use crate::kernels::basis::Basis;

impl Artifact for Basis {
    const TYPE: ArtifactType = ArtifactType {
        name: "basis",
        version: 1,
        doc: "Eigenbasis: `eigenvalues` (k), `eigenvectors` (V x k, orthonormal with respect to \
              `mass`), `mass` (V areas).",
    };

    fn encode<'a>(&'a self, to: &mut Encoder<'a>) {
        to.array("eigenvalues", &[self.k()], &self.eigenvalues);
        put_matrix(to, "eigenvectors", &self.eigenvectors);
        to.array("mass", &[self.mass.len()], &self.mass);
    }

    fn decode(from: &Decoder<'_>) -> Result<Self, DecodeError> {
        let eigenvalues = from.vector::<f64>("eigenvalues")?.into_owned();
        let mass = from.vector::<f64>("mass")?.into_owned();
        let eigenvectors = matrix(from, "eigenvectors")?;
        if eigenvectors.nrows() != mass.len() || eigenvectors.ncols() != eigenvalues.len() {
            let (n_rows, n_cols) = (eigenvectors.nrows(), eigenvectors.ncols());
            return Err(DecodeError(format!(
                "eigenvectors are {n_rows} x {n_cols} for {} masses and {} eigenvalues",
                mass.len(),
                eigenvalues.len()
            )));
        }
        if let Some(value) = eigenvalues.iter().chain(&mass).find(|it| !it.is_finite()) {
            return Err(DecodeError(format!("the value {value}")));
        }
        Ok(Self { eigenvalues, eigenvectors, mass })
    }

    fn summary(&self) -> Vec<(String, String)> {
        let first: Vec<String> =
            self.eigenvalues.iter().take(6).map(|it| format!("{it:.5}")).collect();
        vec![
            ("vertices".to_owned(), self.n_vertices().to_string()),
            ("eigenpairs".to_owned(), self.k().to_string()),
            ("eigenvalues".to_owned(), format!("{}, …", first.join(", "))),
            ("area".to_owned(), format!("{:.6}", self.area())),
        ]
    }
}
