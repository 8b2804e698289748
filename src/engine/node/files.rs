//! What a node's parameters name outside of the pipeline.

use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A file that a node reads, named by a parameter. Only its content and its extension count.
///
/// The path is relative to the folder of the pipeline file that names it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct InputFile(#[schemars(extend("format" = "input-file"))] pub PathBuf);

impl InputFile {
    /// In lower case, without the dot; empty if there is none.
    pub fn extension(&self) -> String {
        extension_of(&self.0)
    }
}

/// A program that a node starts: a name that is looked up in `PATH`, or a path relative to the folder of
/// the pipeline file that names it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct ProgramName(#[schemars(extend("format" = "program"))] pub String);

/// A path's extension in lower case, without the dot; empty if there is none.
pub fn extension_of(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_lowercase()
}
