//! Named byte strings, as they come from a download.

use std::collections::BTreeMap;

/// Files by their relative path, with `/` between folders.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FileSet {
    pub files: BTreeMap<String, Vec<u8>>,
}

/// Refuses paths that may lead out of the folder which they are relative to.
///
/// # Errors
/// If the path is empty or absolute, or has a part that is empty, `.`, `..`, or means something else
/// on another system (`\\` and control characters).
pub fn check_relative(path: &str) -> Result<(), String> {
    let is_plain = |part: &str| {
        !part.is_empty()
            && !matches!(part, "." | "..")
            && !part.chars().any(|it| it == '\\' || it.is_control())
    };
    if path.split('/').all(is_plain) {
        return Ok(());
    }
    Err(format!("`{path}` is no path below its folder"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_stay_below_their_folder() {
        for path in ["a", "a/b.txt", "a b", "...", "a..b", "ü/é"] {
            assert_eq!(check_relative(path), Ok(()));
        }
        let bad = [
            "",
            "/",
            "/etc/passwd",
            "..",
            "../a",
            "a/../../b",
            "a//b",
            "a/",
            "./a",
            "a/.",
            "a\\..\\b",
            "file:///etc/passwd",
            "a\0b",
            "a\nb",
        ];
        for path in bad {
            assert_eq!(check_relative(path), Err(format!("`{path}` is no path below its folder")));
        }
    }
}
