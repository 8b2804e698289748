//! Folders in which files are looked up by content.

use std::{
    collections::BTreeMap,
    fs,
    path::{Component, Path, PathBuf},
    sync::OnceLock,
};

use serde::Deserialize;

/// Folders with their indices, which are made when they are first needed.
pub struct Mirrors(Vec<(PathBuf, OnceLock<Index>)>);

type Index = BTreeMap<[u8; 32], PathBuf>;

pub enum Found {
    Bytes(Vec<u8>),
    /// The index knows the digest, but the file has other bytes or is gone.
    Stale(PathBuf),
    Nothing,
}

/// A line of a mirror's `manifest.json`; other keys are for people.
#[derive(Deserialize)]
struct Entry {
    path: PathBuf,
    blake3: Option<String>,
}

impl Mirrors {
    pub fn of(folders: &[PathBuf]) -> Self {
        Self(folders.iter().map(|it| (it.clone(), OnceLock::new())).collect())
    }

    /// The file with a digest, from the first folder that has it.
    pub fn find(&self, digest: blake3::Hash) -> Found {
        let mut stale = None;
        for (folder, index) in &self.0 {
            let Some(path) = index.get_or_init(|| index_of(folder)).get(digest.as_bytes()) else {
                continue;
            };
            match fs::read(path) {
                Ok(bytes) if blake3::hash(&bytes) == digest => return Found::Bytes(bytes),
                _ => stale = Some(path.clone()),
            }
        }
        stale.map_or(Found::Nothing, Found::Stale)
    }
}

/// From `manifest.json` if the folder has a readable one, else by hashing every file.
fn index_of(folder: &Path) -> Index {
    let manifest = fs::read(folder.join("manifest.json")).ok();
    let entries = manifest.and_then(|it| serde_json::from_slice::<Vec<Entry>>(&it).ok());
    let Some(entries) = entries else {
        let mut index = Index::new();
        hash_all(folder, &mut index);
        return index;
    };
    let digest = |it: &Entry| blake3::Hash::from_hex(it.blake3.as_ref()?).ok();
    // A mirror is a folder: its manifest names nothing outside of it.
    let is_inside = |it: &&Entry| it.path.components().all(|it| matches!(it, Component::Normal(_)));
    entries
        .iter()
        .filter(is_inside)
        .filter_map(|it| Some((*digest(it)?.as_bytes(), folder.join(&it.path))))
        .collect()
}

fn hash_all(folder: &Path, index: &mut Index) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    let mut paths: Vec<PathBuf> = entries.flatten().map(|it| it.path()).collect();
    paths.sort();
    for path in paths {
        if path.is_dir() {
            hash_all(&path, index);
        } else if let Ok(bytes) = fs::read(&path) {
            index.entry(*blake3::hash(&bytes).as_bytes()).or_insert(path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_found_by_content_with_and_without_a_manifest() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("sub")).unwrap();
        fs::write(folder.path().join("sub/a.txt"), "hello").unwrap();
        let digest = blake3::hash(b"hello");
        let find = || Mirrors::of(&[folder.path().to_owned()]).find(digest);
        assert!(matches!(find(), Found::Bytes(it) if it == b"hello"));

        let manifest = folder.path().join("manifest.json");
        let line = format!(r#"[{{ "path": "sub/a.txt", "blake3": "{digest}", "bytes": 5 }}]"#);
        fs::write(&manifest, line).unwrap();
        assert!(matches!(find(), Found::Bytes(it) if it == b"hello"));
        fs::write(folder.path().join("sub/a.txt"), "other").unwrap();
        assert!(matches!(find(), Found::Stale(_)));
        for outside in ["../a.txt", "/a.txt"] {
            let line = format!(r#"[{{ "path": "{outside}", "blake3": "{digest}" }}]"#);
            fs::write(&manifest, line).unwrap();
            assert!(matches!(find(), Found::Nothing));
        }
        fs::write(&manifest, "[]").unwrap();
        assert!(matches!(find(), Found::Nothing));
    }
}
