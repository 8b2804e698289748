//! A temporary folder with files in it.

use std::{fs, path::PathBuf};

pub struct Folder(tempfile::TempDir);

impl Folder {
    /// `files`: paths and texts.
    pub fn new(files: &[(&str, &str)]) -> Self {
        let res = Self(tempfile::tempdir().unwrap());
        for (name, text) in files {
            res.write(name, text);
        }
        res
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn write(&self, name: &str, text: &str) {
        let path = self.path(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }
}
