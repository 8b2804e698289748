//! The kinds and types that an engine works with.

use super::{
    artifact::{AnyArtifact, ArtifactKind, ArtifactType, DecodeError, Decoder, Format},
    node::NodeKind,
};

/// A registry: what pipelines can name. The engine itself knows none of it.
pub struct Library {
    /// Sorted by name.
    pub kinds: &'static [NodeKind],
    /// Sorted by name.
    pub types: &'static [ArtifactKind],
    /// Formats that every artifact can be exported to, made from its stored arrays.
    pub common_formats: &'static [CommonFormat],
}

/// A file format that holds the arrays of any artifact.
pub struct CommonFormat {
    pub format: Format,
    pub write: fn(&[u8], &Decoder<'_>) -> Result<Vec<u8>, DecodeError>,
}

/// The bytes of an artifact in a format: one of its own, or one that all share.
///
/// # Errors
/// If the artifact cannot be written in this format, with the reason.
pub fn export(
    common_formats: &[CommonFormat],
    artifact: &AnyArtifact,
    extension: &str,
) -> Result<Vec<u8>, String> {
    match common_formats.iter().find(|it| it.format.extension == extension) {
        Some(common) => {
            let bytes = artifact.bytes();
            let decoder = Decoder::new(&bytes).map_err(|e| e.to_string())?;
            (common.write)(&bytes, &decoder).map_err(|e| e.to_string())
        }
        None => artifact.export(extension),
    }
}

impl Library {
    pub fn kind(&self, name: &str) -> Option<&'static NodeKind> {
        let index = self.kinds.binary_search_by(|it| it.spec.kind.cmp(name)).ok()?;
        Some(&self.kinds[index])
    }

    pub fn artifact_kind(&self, name: &str) -> Option<&'static ArtifactKind> {
        let index = self.types.binary_search_by(|it| it.ty.name.cmp(name)).ok()?;
        Some(&self.types[index])
    }

    /// All formats that a type can be exported to.
    pub fn formats(&self, ty: ArtifactType) -> Vec<Format> {
        let own = self.artifact_kind(ty.name).map_or(&[][..], |it| it.formats);
        own.iter().copied().chain(self.common_formats.iter().map(|it| it.format)).collect()
    }
}
