//! What is wrong with a file.

use crate::kernels::{
    geometry::mesh::MeshError,
    rigs::{skeleton::SkeletonError, weights::WeightsError},
};

/// Why a file cannot be read. Lines and records count from 1, bytes from 0.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ReadError {
    #[error("the {format} file is empty")]
    Empty { format: &'static str },
    #[error("{format} file, line {line}: {what}")]
    Line { format: &'static str, line: usize, what: String },
    #[error("{format} file, byte {offset}: {what}")]
    Byte { format: &'static str, offset: usize, what: String },
    #[error("the {format} file ends too early: {what} ends at byte {needed}, but there are {len}")]
    Truncated { format: &'static str, what: String, needed: u64, len: usize },
    #[error("{format} file: {what}")]
    Content { format: &'static str, what: String },
    #[error("{format} file: {error}")]
    Mesh { format: &'static str, error: MeshError },
    #[error("{format} file: {error}")]
    Skeleton { format: &'static str, error: SkeletonError },
    #[error("{format} file: {error}")]
    Weights { format: &'static str, error: WeightsError },
    #[error("no reader for `.{extension}` files (there are {known})")]
    Unknown { extension: String, known: String },
}

impl ReadError {
    pub(super) fn line(format: &'static str, line: usize, what: impl Into<String>) -> Self {
        Self::Line { format, line, what: what.into() }
    }

    pub(super) fn content(format: &'static str, what: impl Into<String>) -> Self {
        Self::Content { format, what: what.into() }
    }

    pub(super) fn mesh(format: &'static str) -> impl Fn(MeshError) -> Self {
        move |error| Self::Mesh { format, error }
    }
}

/// The text of a file without its byte order mark.
///
/// # Errors
/// [`ReadError::Empty`], or [`ReadError::Byte`] where the file is no UTF-8.
pub(super) fn text<'a>(format: &'static str, bytes: &'a [u8]) -> Result<&'a str, ReadError> {
    let text = std::str::from_utf8(bytes).map_err(|e| ReadError::Byte {
        format,
        offset: e.valid_up_to(),
        what: "the file is no text".to_owned(),
    })?;
    let text = text.trim_start_matches('\u{feff}');
    if text.trim().is_empty() { Err(ReadError::Empty { format }) } else { Ok(text) }
}

/// Parses one number of a text file.
pub(super) fn number<T: std::str::FromStr>(
    format: &'static str,
    line: usize,
    token: Option<&str>,
    what: &str,
) -> Result<T, ReadError> {
    let token = token
        .ok_or_else(|| ReadError::line(format, line, format!("the line ends before {what}")))?;
    token
        .parse()
        .map_err(|_| ReadError::line(format, line, format!("`{token}` is no number for {what}")))
}

/// Cuts a polygon into a fan around its first corner.
pub(super) fn fan<T: Copy>(corners: &[T]) -> impl Iterator<Item = [T; 3]> + '_ {
    (1..corners.len().saturating_sub(1)).map(|it| [corners[0], corners[it], corners[it + 1]])
}
