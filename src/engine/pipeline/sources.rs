//! The files that a pipeline is read from.

use std::{
    collections::HashMap,
    path::{Path, PathBuf},
    sync::Arc,
};

use crate::engine::graph::{Looks, Source};

/// Texts of pipelines and of `--set`, and the folders in which their relative paths start.
#[derive(Default)]
pub struct Sources {
    pub list: Vec<Source>,
    folders: Vec<PathBuf>,
    by_real_path: HashMap<PathBuf, usize>,
    pub looks: Looks,
}

impl Sources {
    /// Reads a file, once.
    ///
    /// # Errors
    /// With a message that names the file.
    pub fn read(&mut self, path: &Path) -> Result<usize, String> {
        let fail = |e: std::io::Error| match e.kind() {
            std::io::ErrorKind::NotFound => format!("there is no file `{}`", path.display()),
            _ => format!("cannot read `{}`: {e}", path.display()),
        };
        let real_path = path.canonicalize().map_err(fail)?;
        if let Some(&source) = self.by_real_path.get(&real_path) {
            if !self.looks.texts.iter().any(|it| it.0 == *path) {
                self.looks.texts.push((path.to_owned(), real_path, source));
            }
            return Ok(source);
        }
        let text = std::fs::read_to_string(path).map_err(fail)?;
        let folder = path.parent().unwrap_or(Path::new("")).to_owned();
        self.by_real_path.insert(real_path.clone(), self.list.len());
        self.looks.texts.push((path.to_owned(), real_path, self.list.len()));
        Ok(self.add(path.to_owned(), &text, folder))
    }

    /// Adds a text that is no file, or whose file need not exist.
    pub fn add(&mut self, path: PathBuf, text: &str, folder: PathBuf) -> usize {
        self.list.push(Source { path, text: Arc::from(text) });
        self.folders.push(folder);
        self.list.len() - 1
    }

    /// A path of this source as the current folder sees it.
    pub fn resolve(&self, source: usize, path: &str) -> PathBuf {
        self.folders[source].join(path)
    }
}
