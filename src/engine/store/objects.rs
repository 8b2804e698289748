//! Large objects: one file each, named by its digest.

use std::{
    fs::{self, File},
    io,
    path::{Path, PathBuf},
};

use memmap2::Mmap;

use super::{Access, StoreError, disk::Disk};
use crate::engine::{
    artifact::{ArtifactType, Bytes, digest_of},
    digest::Digest,
};

/// Why an object cannot be had.
#[derive(Debug, thiserror::Error)]
pub enum ObjectError {
    #[error("object {} is not in the store", digest.short())]
    Missing { digest: Digest },
    #[error("object {} in `{}` is damaged", digest.short(), path.display())]
    Damaged { path: PathBuf, digest: Digest },
    #[error("cannot read `{}`: {error}", path.display())]
    Unreadable { path: PathBuf, error: io::Error },
}

/// `objects/ab/ab12….safetensors`
pub fn path(store: &Path, digest: &Digest) -> PathBuf {
    let name = digest.to_string();
    store.join("objects").join(&name[..2]).join(format!("{name}.safetensors"))
}

/// An object that is mapped and not checked yet.
pub struct Unchecked {
    pub path: PathBuf,
    pub file: File,
    pub map: Mmap,
    digest: Digest,
}

/// Maps the file of an object.
pub fn open(disk: &Disk, store: &Path, digest: &Digest) -> Result<Unchecked, ObjectError> {
    let path = path(store, digest);
    let file = match disk.open(&path) {
        Ok(file) => file,
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            return Err(ObjectError::Missing { digest: *digest });
        }
        Err(error) => return Err(ObjectError::Unreadable { path, error }),
    };
    // SAFETY: objects are never changed after the rename that brought them here.
    match unsafe { disk.map(&file, &path) } {
        Ok(map) => Ok(Unchecked { path, file, map, digest: *digest }),
        Err(error) => Err(ObjectError::Unreadable { path, error }),
    }
}

impl Unchecked {
    /// The bytes, if they are what the digest says; a damaged object is set aside unless the store is
    /// only read.
    pub fn check(
        self,
        disk: &Disk,
        access: Access,
        ty: ArtifactType,
    ) -> Result<Bytes, ObjectError> {
        let Self { path, map, digest, .. } = self;
        if digest_of(ty, &map) == digest {
            return Ok(Bytes::Mapped(map.into()));
        }
        // Out of the way, so that the next writer finds its place free; kept, so that it can be studied.
        if access == Access::ReadWrite {
            let _ = disk.rename(&path, &path.with_extension("damaged"));
        }
        Err(ObjectError::Damaged { path, digest })
    }
}

/// Writes an object, unless it is there already.
pub fn write(disk: &Disk, store: &Path, digest: &Digest, bytes: &[u8]) -> Result<(), StoreError> {
    let path = path(store, digest);
    if fs::metadata(&path).is_ok_and(|it| it.len() == bytes.len() as u64) {
        return Ok(());
    }
    let folder = path.parent().expect("an object lies in a folder");
    disk.in_folder(folder, || {
        disk.write_whole(&path, bytes).map_err(StoreError::new("write", &path))
    })
}
