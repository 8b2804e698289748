use std::borrow::Cow;

use super::matrix::{check_matrix, matrix, put_matrix};
use crate::engine::artifact::{Artifact, ArtifactType, DecodeError, Decoder, Encoder};
use crate::kernels::spectral::basis::Basis;

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

#[cfg(test)]
mod tests {
    use faer::Mat;
    use memmap2::MmapMut;

    use super::*;
    use crate::engine::{
        artifact::{AnyArtifact, ArtifactKind, Bytes},
        digest::Digest,
    };

    fn basis() -> Basis {
        let eigenvectors = Mat::from_fn(50, 3, |row, column| (row * 3 + column) as f64 / 7.0);
        Basis { eigenvalues: vec![0.0, 1.5, 2.5], eigenvectors, mass: vec![0.02; 50] }
    }

    fn mapped(bytes: &[u8]) -> Bytes {
        let mut map = MmapMut::map_anon(bytes.len()).unwrap();
        map.copy_from_slice(bytes);
        Bytes::Mapped(map.make_read_only().unwrap().into())
    }

    /// What a file is taken for, and whether its bytes are stored as they lie there.
    fn import(file: Bytes) -> (Result<(Digest, Vec<u8>), String>, bool) {
        let (start, kind) = (file.as_ptr(), const { &ArtifactKind::of::<Basis>() });
        match kind.import("safetensors", file) {
            Ok((artifact, bytes)) => {
                let is_same = bytes.as_ptr() == start;
                assert_eq!(artifact.to_bytes(), bytes[..]);
                (Ok((artifact.digest(), bytes.into_vec())), is_same)
            }
            Err(message) => (Err(message), false),
        }
    }

    #[test]
    fn a_file_is_the_same_checked_where_it_lies_as_read_into_memory() {
        let (artifact, bytes) = AnyArtifact::encode(basis());
        let bytes = bytes.into_vec();
        assert_eq!(import(mapped(&bytes)), (Ok((artifact.digest(), bytes.clone())), true));
        let replaced = |old: &str, new: &str| {
            let at = bytes.windows(old.len()).position(|it| it == old.as_bytes()).unwrap();
            [&bytes[..at], new.as_bytes(), &bytes[at + old.len()..]].concat()
        };
        let with_number = |at: usize, number: f64| {
            let (start, end) = (bytes.len() - at * 8, bytes.len() - at * 8 + 8);
            [&bytes[..start], &number.to_le_bytes(), &bytes[end..]].concat()
        };
        let files = [
            // A mass, an eigenvector and an eigenvalue; the eigenvalues come first.
            with_number(1, f64::NAN),
            with_number(60, f64::INFINITY),
            with_number(50 + 150 + 3, f64::NAN),
            with_number(60, 1e300),
            replaced("[50,3]", "[3,50]"),
            replaced("[50,3]", "[50,2]"),
            replaced("\"basis\"", "\"mesh!\""),
            replaced("\"mass\"", "\"mast\""),
            replaced("\"F64\"", "\"I64\""),
            replaced("sinew.version", "sinew.Version"),
            bytes[..bytes.len() - 8].to_vec(),
        ];
        for (index, file) in files.into_iter().enumerate() {
            let (read, _) = import(file.clone().into());
            assert_eq!(import(mapped(&file)).0, read, "file {index}");
        }
    }

    #[test]
    fn the_value_of_a_file_is_made_when_it_is_asked_for() {
        let (_, bytes) = AnyArtifact::encode(basis());
        let kind = const { &ArtifactKind::of::<Basis>() };
        let (artifact, _) = kind.import("safetensors", mapped(&bytes)).unwrap();
        let value = artifact.clone().downcast::<Basis>().unwrap();
        assert_eq!(value.eigenvectors, basis().eigenvectors);
        assert_eq!(artifact.summary(), basis().summary());
        assert!(artifact.downcast::<crate::kernels::geometry::mesh::TriMesh>().is_none());
    }
}
