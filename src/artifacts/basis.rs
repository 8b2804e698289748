use std::borrow::Cow;

use super::matrix::{check_matrix, matrix, put_matrix};
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
        check_parts(&eigenvalues, (eigenvectors.nrows(), eigenvectors.ncols()), &mass)?;
        Ok(Self { eigenvalues, eigenvectors, mass })
    }

    fn check<'a>(from: &Decoder<'a>, canonical: &mut Encoder<'a>) -> Result<bool, DecodeError> {
        let (eigenvalues, mass) = (from.vector::<f64>("eigenvalues")?, from.vector::<f64>("mass")?);
        let (Cow::Borrowed(eigenvalues), Cow::Borrowed(mass)) = (eigenvalues, mass) else {
            return Ok(false);
        };
        canonical.array("eigenvalues", &[eigenvalues.len()], eigenvalues);
        let shape = check_matrix(from, "eigenvectors", canonical)?;
        let Some(shape) = shape else { return Ok(false) };
        check_parts(eigenvalues, shape, mass)?;
        canonical.array("mass", &[mass.len()], mass);
        Ok(true)
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

/// What every basis must hold; `shape` is that of the eigenvectors.
fn check_parts(
    eigenvalues: &[f64],
    shape: (usize, usize),
    mass: &[f64],
) -> Result<(), DecodeError> {
    if shape != (mass.len(), eigenvalues.len()) {
        return Err(DecodeError(format!(
            "eigenvectors are {} x {} for {} masses and {} eigenvalues",
            shape.0,
            shape.1,
            mass.len(),
            eigenvalues.len()
        )));
    }
    match eigenvalues.iter().chain(mass).find(|it| !it.is_finite()) {
        Some(value) => Err(DecodeError(format!("the value {value}"))),
        None => Ok(()),
    }
}
