//! Digests of the user's files. They count by content; an unchanged file is not read again.

use std::{
    fs::{self, File},
    io,
    os::unix::fs::MetadataExt,
    path::Path,
    time::{SystemTime, UNIX_EPOCH},
};

use super::{
    digest::Digest,
    store::{Note, Store, StoreError},
};

/// The digest of a file's content, from memory if (path, size, time of change, inode) are those of
/// a digest taken before.
///
/// # Errors
/// If the file cannot be read.
pub fn digest(store: &Store, path: &Path) -> io::Result<Digest> {
    let meta = fs::metadata(path)?;
    let identity = identity(path, &meta);
    if let Some(bytes) = store.recall(Note::FileDigest, &identity)
        && let Ok(bytes) = bytes.try_into()
    {
        return Ok(Digest(bytes));
    }
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(File::open(path)?)?;
    let digest = Digest(*hasher.finalize().as_bytes());
    if is_at_rest(&meta) {
        let note = (Note::FileDigest, identity, digest.0.to_vec());
        if let Err(StoreError { error, .. }) = store.remember(vec![note]) {
            tracing::debug!(%error, "a file's digest is not remembered");
        }
    }
    Ok(digest)
}

/// A file that was changed a moment ago may be changed again within the clock's resolution, and
/// would then look the same. A time in the future is never settled.
pub fn is_settled(meta: &fs::Metadata) -> bool {
    is_long_ago(meta.mtime())
}

/// The same of a file that may be a copy, which keeps the original's time of change: when it was put here
/// counts as well.
pub fn is_at_rest(meta: &fs::Metadata) -> bool {
    is_settled(meta) && is_long_ago(meta.ctime())
}

fn is_long_ago(secs: i64) -> bool {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |it| it.as_secs() as i64);
    now.saturating_sub(secs) > 2
}

/// A digest of what tells one state of a file from another without reading it.
pub fn identity(path: &Path, meta: &fs::Metadata) -> Digest {
    let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let mut hasher = blake3::Hasher::new();
    hasher.update(path.as_os_str().as_encoded_bytes());
    for number in [meta.dev(), meta.ino(), meta.size()] {
        hasher.update(&number.to_le_bytes());
    }
    for number in [meta.mtime(), meta.mtime_nsec(), meta.ctime(), meta.ctime_nsec()] {
        hasher.update(&number.to_le_bytes());
    }
    Digest(*hasher.finalize().as_bytes())
}
