use super::matrix::{matrix, put_matrix, show_range};
use crate::engine::artifact::{Artifact, ArtifactType, DecodeError, Decoder, Encoder};
use crate::kernels::{
    maps::functional_map::{FunctionalMap, MapSpaces},
    spectral::function_space::FunctionSpace,
};

impl Artifact for FunctionalMap {
    const TYPE: ArtifactType = ArtifactType {
        name: "functional_map",
        version: 1,
        doc: "A linear map of functions on the target to functions on the source: \
              `source_from_target` (k_source x k_target), in the bases at total area one. The texts \
              `source` and `target`, if there are any, tell which bases: vertices, and fingerprints \
              of masses and eigenfunctions.",
    };

    fn encode<'a>(&'a self, to: &mut Encoder<'a>) {
        put_matrix(to, "source_from_target", &self.source_from_target);
        if let Some(spaces) = &self.spaces {
            put_space(to, "source", &spaces.source);
            put_space(to, "target", &spaces.target);
        }
    }

    fn decode(from: &Decoder<'_>) -> Result<Self, DecodeError> {
        let spaces = match (space(from, "source")?, space(from, "target")?) {
            (Some(source), Some(target)) => Some(MapSpaces { source, target }),
            (None, None) => None,
            _ => return Err(DecodeError::new("only one of `source` and `target` is given")),
        };
        Ok(Self { source_from_target: matrix(from, "source_from_target")?, spaces })
    }

    fn summary(&self) -> Vec<(String, String)> {
        let map = &self.source_from_target;
        let diagonal = (0..map.nrows().min(map.ncols())).map(|it| map[(it, it)].abs());
        let first: Vec<String> = diagonal.take(6).map(|it| format!("{it:.3}")).collect();
        let mut lines = vec![
            ("size".to_owned(), format!("{} x {} (source x target)", map.nrows(), map.ncols())),
            ("range".to_owned(), show_range(map)),
            ("diagonal".to_owned(), format!("{} … (absolute)", first.join(" "))),
        ];
        if let Some(MapSpaces { source, target }) = &self.spaces {
            for (name, space) in [("from functions on", target), ("to functions on", source)] {
                let FunctionSpace { n_vertices, shape, .. } = space;
                lines.push((name.to_owned(), format!("{n_vertices} vertices, shape {shape:016x}")));
            }
        }
        lines
    }
}

/// Writes which functions a side's coefficients belong to.
pub fn put_space(to: &mut Encoder<'_>, name: &str, space: &FunctionSpace) {
    let FunctionSpace { n_vertices, shape, functions } = space;
    to.text(name, format!("{n_vertices} {shape:016x} {functions:016x}"));
}

/// Reads what [`put_space`] wrote, if it did.
pub fn space(from: &Decoder<'_>, name: &str) -> Result<Option<FunctionSpace>, DecodeError> {
    let Ok(text) = from.text(name) else { return Ok(None) };
    let fields: Vec<&str> = text.split(' ').collect();
    let number = |it: &str| u64::from_str_radix(it, 16).ok();
    let read = || match fields[..] {
        [n_vertices, shape, functions] => Some(FunctionSpace {
            n_vertices: n_vertices.parse().ok()?,
            shape: number(shape)?,
            functions: number(functions)?,
        }),
        _ => None,
    };
    match read() {
        Some(space) => Ok(Some(space)),
        None => Err(DecodeError(format!("`{name}` is `{text}`: no fingerprint of a basis"))),
    }
}
