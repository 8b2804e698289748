use super::functional_map::{put_space, space};
use super::matrix::{matrix, put_matrix, show_range};
use crate::engine::artifact::{Artifact, ArtifactType, DecodeError, Decoder, Encoder};
use crate::kernels::spectral::descriptors::Descriptors;

impl Artifact for Descriptors {
    const TYPE: ArtifactType = ArtifactType {
        name: "descriptors",
        version: 1,
        doc: "Functions that look alike at corresponding points: `values` (V x p, columns of unit \
              norm) and `names`. The text `space`, if there is one, tells the basis they come from.",
    };

    fn encode<'a>(&'a self, to: &mut Encoder<'a>) {
        put_matrix(to, "values", &self.values);
        to.texts("names", &self.names);
        if let Some(space) = &self.space {
            put_space(to, "space", space);
        }
    }

    fn decode(from: &Decoder<'_>) -> Result<Self, DecodeError> {
        let (values, names) = (matrix(from, "values")?, from.texts("names")?);
        if values.ncols() != names.len() {
            let (columns, names) = (values.ncols(), names.len());
            return Err(DecodeError(format!("{names} names for {columns} functions")));
        }
        Ok(Self { names, values, space: space(from, "space")? })
    }

    fn summary(&self) -> Vec<(String, String)> {
        let mut families: Vec<(String, usize)> = Vec::new();
        for name in &self.names {
            let family = name.rsplit_once(' ').map_or(name.as_str(), |it| it.0);
            match families.last_mut() {
                Some((last, count)) if last == family => *count += 1,
                _ => families.push((family.to_owned(), 1)),
            }
        }
        let mut lines = vec![
            ("functions".to_owned(), format!("{} at {} vertices", self.count(), self.n_vertices())),
            ("range".to_owned(), show_range(&self.values)),
        ];
        lines
            .extend(families.into_iter().map(|(name, count)| (name, format!("{count} functions"))));
        lines
    }
}
