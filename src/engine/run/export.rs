//! Writes artifacts into the user's folder.

use std::{fs, path::Path};

use crate::engine::{
    artifact::AnyArtifact,
    digest::Digest,
    events::Failure,
    file_digests,
    library::{self, Library},
    node::extension_of,
    store::disk::Disk,
};

/// Writes an artifact through a temporary file in the format that the path's extension names.
///
/// Returns the number of bytes.
///
/// # Errors
/// If the artifact cannot be written in this format, or the disk refuses.
pub fn write(
    disk: &Disk,
    library: &Library,
    artifact: &AnyArtifact,
    path: &Path,
) -> Result<u64, Failure> {
    let bytes = encode(library, artifact, &extension_of(path)).map_err(Failure::Node)?;
    let fail = |error| Failure::Environment(format!("cannot write `{}`: {error}", path.display()));
    let folder = path.parent().filter(|it| !it.as_os_str().is_empty()).unwrap_or(Path::new("."));
    disk.make_folder(folder).map_err(fail)?;
    disk.write_whole(path, &bytes).map_err(fail)?;
    Ok(bytes.len() as u64)
}

/// The bytes of an artifact in a format.
///
/// # Errors
/// If the artifact cannot be written in this format, with the ones that it can.
pub fn encode(
    library: &Library,
    artifact: &AnyArtifact,
    extension: &str,
) -> Result<Vec<u8>, String> {
    library::export(library.common_formats, artifact, extension)
}

/// What is remembered about an exported file: its artifact, and the file's own identity.
pub fn receipt(artifact: Digest, path: &Path) -> Option<Vec<u8>> {
    let meta = fs::metadata(path).ok()?;
    let identity = file_digests::identity(path, &meta);
    Some([artifact.0, identity.0].concat())
}

/// What a receipt is remembered by.
pub fn subject(path: &Path) -> Digest {
    let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    Digest::of(path.as_os_str().as_encoded_bytes())
}
