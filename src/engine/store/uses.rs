//! What running runs rely on: one file a run, locked as long as it lives.
//!
//! Housekeeping keeps what such a file names: the results that the run has planned with, and those
//! that the run makes. A file whose lock is free belongs to a process that has died.

use std::{
    collections::HashSet,
    fs::{self, File},
    path::{Path, PathBuf},
};

use super::{
    StoreError,
    disk::{Disk, unique_word},
};
use crate::engine::digest::Digest;

/// A run's note of what it relies on, taken back when dropped.
pub struct Uses {
    disk: Disk,
    path: PathBuf,
    /// Its lock tells that the run lives.
    _file: File,
}

impl Uses {
    /// Notes down which keys a run relies on, and its name.
    pub fn note(disk: &Disk, store: &Path, run: &str, keys: &[Digest]) -> Result<Self, StoreError> {
        let folder = folder(store);
        disk.make_folder(&folder).map_err(StoreError::new("make the folder", &folder))?;
        let path = folder.join(unique_word());
        let fail = |error| StoreError::new("write", &path)(error);
        let file = disk.create_new(&path).map_err(fail)?;
        disk.try_lock(&file, &path).map_err(fail)?;
        let mut text = format!("{run}\n");
        for key in keys {
            text.push_str(&format!("{key}\n"));
        }
        disk.write_at(&file, &path, text.as_bytes(), 0).map_err(fail)?;
        Ok(Self { disk: disk.clone(), path, _file: file })
    }
}

impl Drop for Uses {
    fn drop(&mut self) {
        // What stays is removed by the next housekeeping.
        let _ = self.disk.remove(&self.path);
    }
}

/// What all living runs rely on.
#[derive(Default)]
pub struct InUse {
    pub runs: HashSet<String>,
    pub keys: HashSet<Digest>,
}

/// Reads the notes of living runs and removes those of dead ones. Call it with the gate closed.
pub fn living(disk: &Disk, store: &Path) -> InUse {
    let mut res = InUse::default();
    for path in disk.list(&folder(store)).unwrap_or_default() {
        let Ok(file) = disk.open(&path) else { continue };
        if disk.try_lock(&file, &path).is_ok_and(|it| it) {
            let _ = disk.remove(&path);
            continue;
        }
        let text = fs::read_to_string(&path).unwrap_or_default();
        let mut lines = text.lines();
        res.runs.extend(lines.next().map(str::to_owned));
        res.keys.extend(lines.filter_map(|it| it.parse::<Digest>().ok()));
    }
    res
}

fn folder(store: &Path) -> PathBuf {
    store.join("uses")
}
