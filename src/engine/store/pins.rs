//! Pins: results that housekeeping must keep, whatever else it is told.
//!
//! `pins/<run>` holds the keys of one run's results, one a line, and can be read without this
//! program.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs, io,
    path::{Path, PathBuf},
};

use super::{StoreError, disk::Disk};
use crate::engine::digest::Digest;

/// All pins, by the run that was pinned.
///
/// # Errors
/// If a pin cannot be read: nothing must be removed then.
pub fn all(dir: &Path) -> Result<BTreeMap<String, BTreeSet<Digest>>, StoreError> {
    let disk = Disk::default();
    let paths = match disk.list(&dir.join("pins")) {
        Ok(paths) => paths,
        Err(error) if error.kind() == io::ErrorKind::NotFound => Vec::new(),
        Err(error) => return Err(StoreError::new("read", &dir.join("pins"))(error)),
    };
    let mut res = BTreeMap::new();
    for path in paths {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if name.starts_with(super::disk::TEMPORARY) {
            continue;
        }
        let text = fs::read_to_string(&path).map_err(StoreError::new("read", &path))?;
        let parse = |line: &str| line.parse::<Digest>().map_err(|_| line.to_owned());
        let keys: Result<BTreeSet<Digest>, String> = text.lines().map(parse).collect();
        let keys = keys.map_err(|line| {
            let message = format!("`{line}` is no key");
            StoreError::new("read", &path)(io::Error::new(io::ErrorKind::InvalidData, message))
        })?;
        res.insert(name, keys);
    }
    Ok(res)
}

/// Pins keys under the name of a run, beside those that are pinned under it already.
///
/// # Errors
/// If a pin cannot be read or written.
pub fn add(dir: &Path, run: &str, keys: &BTreeSet<Digest>) -> Result<(), StoreError> {
    let before = all(dir)?.remove(run).unwrap_or_default();
    let text: String = before.union(keys).map(|it| format!("{it}\n")).collect();
    let (disk, path) = (Disk::default(), path(dir, run));
    let folder = dir.join("pins");
    disk.make_folder(&folder).map_err(StoreError::new("make the folder", &folder))?;
    disk.write_whole(&path, text.as_bytes()).map_err(StoreError::new("write", &path))
}

/// Takes a pin back.
///
/// # Errors
/// If it cannot be removed.
pub fn remove(dir: &Path, run: &str) -> Result<(), StoreError> {
    let path = path(dir, run);
    fs::remove_file(&path).map_err(StoreError::new("remove", &path))
}

fn path(dir: &Path, run: &str) -> PathBuf {
    dir.join("pins").join(run)
}
