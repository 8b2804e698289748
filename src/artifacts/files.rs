use crate::engine::artifact::{Artifact, ArtifactType, DecodeError, Decoder, Encoder};
use crate::kernels::files::{FileSet, check_relative};

impl Artifact for FileSet {
    const TYPE: ArtifactType = ArtifactType {
        name: "files",
        version: 1,
        doc: "Files by their relative path: a byte array `file:<path>` each.",
    };

    fn encode<'a>(&'a self, to: &mut Encoder<'a>) {
        for (path, bytes) in &self.files {
            to.array(&array_name(path), &[bytes.len()], bytes.as_slice());
        }
        let paths: Vec<String> = self.files.keys().cloned().collect();
        to.texts("paths", &paths);
    }

    fn decode(from: &Decoder<'_>) -> Result<Self, DecodeError> {
        let mut res = Self::default();
        for path in from.texts("paths")? {
            check_relative(&path).map_err(DecodeError)?;
            let bytes = from.vector::<u8>(&array_name(&path))?;
            if res.files.insert(path.clone(), bytes.to_vec()).is_some() {
                return Err(DecodeError(format!("the file `{path}` is listed twice")));
            }
        }
        Ok(res)
    }

    fn summary(&self) -> Vec<(String, String)> {
        let n_bytes: usize = self.files.values().map(Vec::len).sum();
        let mut lines = vec![
            ("files".to_owned(), self.files.len().to_string()),
            ("bytes".to_owned(), n_bytes.to_string()),
        ];
        let shown = self.files.iter().take(10);
        lines.extend(shown.map(|(path, bytes)| (path.clone(), format!("{} bytes", bytes.len()))));
        if self.files.len() > 10 {
            lines.push(("more".to_owned(), format!("{} files", self.files.len() - 10)));
        }
        lines
    }
}

fn array_name(path: &str) -> String {
    format!("file:{path}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::artifact::{AnyArtifact, ArtifactKind};

    #[test]
    fn files_survive_the_round_trip() {
        static KIND: ArtifactKind = ArtifactKind::of::<FileSet>();
        let mut files = FileSet::default();
        files.files.insert("a/b.txt".to_owned(), b"hello".to_vec());
        files.files.insert("empty".to_owned(), Vec::new());
        let (artifact, bytes) = AnyArtifact::encode(files.clone());
        let again = KIND.decode(&bytes, None).unwrap();
        assert_eq!(*again.downcast::<FileSet>().unwrap(), files);
        assert_eq!(again.digest(), artifact.digest());
        assert!(KIND.decode(&bytes[..bytes.len() - 1], None).is_err());
    }
}
