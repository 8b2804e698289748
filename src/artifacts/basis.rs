use faer::{Mat, MatRef};

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
        put_matrix(to, "eigenvectors", self.eigenvectors.as_ref());
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

/// Rows are written together so that memory is read by whole cache lines.
const ROWS: usize = 32;

/// Writes a matrix row by row, as numpy reads it.
pub fn put_matrix(to: &mut Encoder<'_>, name: &str, matrix: MatRef<'_, f64>) {
    let (n_rows, n_cols) = (matrix.nrows(), matrix.ncols());
    let mut values = vec![0.0; n_rows * n_cols];
    for (block, rows) in values.chunks_mut(ROWS * n_cols.max(1)).enumerate() {
        let first = block * ROWS;
        for col in 0..n_cols {
            for row in 0..rows.len() / n_cols {
                rows[row * n_cols + col] = matrix[(first + row, col)];
            }
        }
    }
    to.owned(name, &[n_rows, n_cols], values);
}

/// Reads a matrix that is stored row by row.
///
/// # Errors
/// If it is missing, has not two dimensions, or holds a number that is not finite.
pub fn matrix(from: &Decoder<'_>, name: &str) -> Result<Mat<f64>, DecodeError> {
    let (n_rows, n_cols, values) = from.matrix::<f64>(name)?;
    if let Some(value) = values.iter().find(|it| !it.is_finite()) {
        return Err(DecodeError(format!("`{name}` holds the value {value}")));
    }
    Ok(Mat::from_fn(n_rows, n_cols, |row, col| values[row * n_cols + col]))
}
