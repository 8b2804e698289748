//! `files = "data/*.off"`: one item a file, sorted by path.

use std::path::{Path, PathBuf};

use super::list::{List, Reading};
use crate::engine::digest::Digest;
use crate::engine::pipeline::{
    diagnostic::Diagnostic,
    value::{Data, Value},
};

/// Files that match one pattern, or any of a list of patterns. Fields: `path`, `name`, `stem`.
pub fn read(value: &Value, reading: &mut Reading<'_>) -> Option<List> {
    let patterns = match &value.data {
        Data::List(items) => &items[..],
        _ => std::slice::from_ref(value),
    };
    let mut files: Vec<(PathBuf, Value)> = Vec::new();
    for pattern in patterns {
        for (path, written) in matching(pattern, reading)? {
            if !files.iter().any(|it| it.0 == path) {
                files.push((path, written));
            }
        }
    }
    let paths: Vec<PathBuf> = files.iter().map(|it| it.0.clone()).collect();
    let labels = labels(&paths);
    let mut res = List::with_fields(["", "path", "name", "stem"]);
    for ((path, written), label) in files.iter().zip(labels) {
        let text = |text: String| Value { data: Data::Text(text.into()), ..written.clone() };
        let part = |part: Option<&std::ffi::OsStr>| {
            text(part.unwrap_or_default().to_string_lossy().into_owned())
        };
        let values = vec![
            text(label.clone()),
            written.clone(),
            part(path.file_name()),
            part(path.file_stem()),
        ];
        res.push(label, values);
    }
    Some(res)
}

/// The files of a pattern, each with its path as the pipeline file would write it.
fn matching(pattern: &Value, reading: &mut Reading<'_>) -> Option<Vec<(PathBuf, Value)>> {
    let text = crate::engine::pipeline::parse::text(pattern, "`files`", reading.problems)?;
    let fail = |message: String, reading: &mut Reading<'_>| {
        reading.problems.push(
            Diagnostic::error(&pattern.place, message)
                .related(pattern.origin.as_ref(), "the pattern is written here"),
        );
    };
    let folder = reading.sources.resolve(pattern.base, "");
    // Only what the user wrote is a pattern: the folder may well be called `[old]`.
    let whole = match Path::new(text).is_absolute() {
        true => PathBuf::from(text),
        false => Path::new(&glob::Pattern::escape(&folder.to_string_lossy())).join(text),
    };
    let whole = whole.to_string_lossy().into_owned();
    let files = match list_files(&whole) {
        Ok(files) => files,
        Err(ListError::Pattern(message)) => {
            fail(format!("`{text}` is not a pattern of files: {message}"), reading);
            return None;
        }
        Err(error @ ListError::Unreadable { .. }) => {
            fail(error.to_string(), reading);
            return None;
        }
    };
    let digest = digest_of_list(&files);
    reading.sources.looks.listings.push((whole, digest));
    if files.is_empty() {
        fail(format!("no file matches `{}`", folder.join(text).display()), reading);
        return None;
    }
    let written = |path: &Path| {
        let relative = path.strip_prefix(&folder).unwrap_or(path);
        let data = Data::Text(relative.to_string_lossy().into());
        Value { data, ..pattern.clone() }
    };
    Some(files.iter().map(|it| (it.clone(), written(it))).collect())
}

/// Why files cannot be listed.
#[derive(Debug, thiserror::Error)]
pub enum ListError {
    #[error("not a pattern of files: {0}")]
    Pattern(&'static str),
    #[error("cannot read `{}`: {error}", path.display())]
    Unreadable { path: PathBuf, error: String },
}

/// The files that match a pattern, sorted.
fn list_files(pattern: &str) -> Result<Vec<PathBuf>, ListError> {
    let options = glob::MatchOptions { require_literal_leading_dot: true, ..Default::default() };
    let found = glob::glob_with(pattern, options).map_err(|e| ListError::Pattern(e.msg))?;
    let mut files = Vec::new();
    for path in found {
        match path {
            Ok(path) if path.is_file() => files.push(path),
            Ok(_) => {}
            Err(error) => {
                let path = error.path().to_owned();
                return Err(ListError::Unreadable { path, error: error.error().to_string() });
            }
        }
    }
    files.sort();
    Ok(files)
}

/// Tells one list of files from another.
fn digest_of_list(files: &[PathBuf]) -> Digest {
    let mut hasher = blake3::Hasher::new();
    for path in files {
        hasher.update(path.as_os_str().as_encoded_bytes()).update(&[0]);
    }
    Digest(*hasher.finalize().as_bytes())
}

/// A digest of the files that match a pattern now; `None` if they cannot be listed.
pub fn listing(pattern: &str) -> Option<Digest> {
    list_files(pattern).ok().map(|it| digest_of_list(&it))
}

/// Stems where they tell the files apart; otherwise paths below the folder that all share, without
/// extensions where these are not needed.
fn labels(paths: &[PathBuf]) -> Vec<String> {
    let stem = |path: &PathBuf| path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let shared = shared_folder(paths);
    let below = |path: &PathBuf| path.strip_prefix(&shared).unwrap_or(path).to_path_buf();
    let without_extension =
        |path: &PathBuf| below(path).with_extension("").to_string_lossy().into_owned();
    let whole = |path: &PathBuf| below(path).to_string_lossy().into_owned();
    let candidates: [&dyn Fn(&PathBuf) -> String; 2] = [&stem, &without_extension];
    for label in candidates {
        let labels: Vec<String> = paths.iter().map(label).collect();
        let mut unique: Vec<&String> = labels.iter().collect();
        unique.sort_unstable();
        unique.dedup();
        if unique.len() == labels.len() {
            return labels;
        }
    }
    paths.iter().map(whole).collect()
}

fn shared_folder(paths: &[PathBuf]) -> PathBuf {
    let mut folders = paths.iter().map(|it| it.parent().unwrap_or(Path::new("")));
    let Some(first) = folders.next() else { return PathBuf::new() };
    folders.fold(first.to_owned(), |shared, folder| {
        let same = shared.components().zip(folder.components()).take_while(|it| it.0 == it.1);
        same.map(|it| it.0).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_as_short_as_tells_files_apart() {
        let check = |paths: &[&str], expected: &[&str]| {
            let paths: Vec<PathBuf> = paths.iter().map(PathBuf::from).collect();
            assert_eq!(labels(&paths), expected);
        };
        check(&["d/a.off", "d/b.ply"], &["a", "b"]);
        check(&["d/x/a.off", "d/y/a.off"], &["x/a", "y/a"]);
        check(&["d/a.off", "d/a.ply"], &["a.off", "a.ply"]);
        check(&["d/a.off"], &["a"]);
        check(&[], &[]);
    }
}
