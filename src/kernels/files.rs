//! Named byte strings, as they come from a download.

use std::collections::BTreeMap;

/// Files by their relative path, with `/` between folders.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FileSet {
    pub files: BTreeMap<String, Vec<u8>>,
}
