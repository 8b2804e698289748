use super::sparse::{csr, put_csr};
use crate::engine::artifact::{Artifact, ArtifactType, DecodeError, Decoder, Encoder};
use crate::kernels::spectral::operator::Operator;

impl Artifact for Operator {
    const TYPE: ArtifactType = ArtifactType {
        name: "operator",
        version: 1,
        doc: "Laplace-Beltrami operator: `mass` (V areas) and the stiffness (V x V, sparse by rows: \
              `offsets`, `columns`, `values`).",
    };

    fn encode<'a>(&'a self, to: &mut Encoder<'a>) {
        put_csr(to, &self.stiffness);
        to.array("mass", &[self.mass.len()], &self.mass);
    }

    fn decode(from: &Decoder<'_>) -> Result<Self, DecodeError> {
        let mass = from.vector::<f64>("mass")?.into_owned();
        let stiffness = csr(from)?;
        if stiffness.n_rows != mass.len() || stiffness.n_cols != mass.len() {
            let (n_rows, n_masses) = (stiffness.n_rows, mass.len());
            return Err(DecodeError(format!("{n_rows} rows of stiffness for {n_masses} masses")));
        }
        Ok(Self { stiffness, mass })
    }

    fn summary(&self) -> Vec<(String, String)> {
        let area: f64 = self.mass.iter().sum();
        vec![
            ("vertices".to_owned(), self.mass.len().to_string()),
            ("stored".to_owned(), format!("{} of the stiffness", self.stiffness.n_stored())),
            ("area".to_owned(), format!("{area:.6}")),
        ]
    }
}
