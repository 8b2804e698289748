//! The store: results by key, artifacts by digest, on a disk that several processes may share.
//!
//! ```text
//! cache/
//!   CACHEDIR.TAG
//!   lock             shared by every user of the store; `gc` takes it alone
//!   claims           byte ranges of this file are locked while a key is being computed
//!   log/*.log        append-only segments: entries, small objects, digests of files …
//!   objects/ab/…     one file an object that is too large for the log
//!   runs/*.jsonl     run records
//! ```
//!
//! Nothing is ever changed in place. An object is there before the entry that names it. A writer
//! appends to a segment of its own (held by a lock that dies with it), so a torn record can only be
//! the last of a segment: readers stop before it and the next writer cuts it off.

mod claims;
pub mod gc;
mod log;
mod objects;

use std::{
    collections::HashSet,
    fs::{self, File},
    io,
    path::{Path, PathBuf},
    sync::{Arc, Mutex},
    time::{SystemTime, UNIX_EPOCH},
};

use serde::{Deserialize, Serialize};

pub use claims::Claim;
use claims::Claims;
use log::{Log, RecordKind};
pub use objects::{Bytes, ObjectError};

use super::{artifact::ArtifactType, digest::Digest};

/// What is stored under a key.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    /// The text of the key.
    #[serde(skip)]
    pub key: String,
    pub outputs: Vec<EntryOutput>,
    /// Optional outputs that were left out, and why.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub absent: Vec<(String, String)>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    pub wall_secs: f64,
    /// When it was made, in seconds since 1970.
    pub made: u64,
    /// The run that made it.
    pub run: String,
}

impl Entry {
    /// The stored form: one line of JSON, then the key's text as it is (quoting it would cost more
    /// than all the rest of a run that has nothing to do).
    fn to_payload(&self) -> Vec<u8> {
        let mut payload = serde_json::to_vec(self).expect("entries are plain data");
        payload.push(b'\n');
        payload.extend_from_slice(self.key.as_bytes());
        payload
    }

    fn from_payload(payload: &[u8]) -> Option<Self> {
        let line = payload.iter().position(|&it| it == b'\n')?;
        let mut entry: Self = serde_json::from_slice(&payload[..line]).ok()?;
        entry.key = std::str::from_utf8(&payload[line + 1..]).ok()?.to_owned();
        Some(entry)
    }
}

/// One artifact of an entry.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EntryOutput {
    pub port: String,
    #[serde(rename = "type")]
    pub ty: String,
    pub digest: Digest,
    pub bytes: u64,
}

/// Why the store cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("cannot {action} `{path}`: {error}")]
pub struct StoreError {
    pub action: &'static str,
    pub path: PathBuf,
    pub error: io::Error,
}

impl StoreError {
    fn new(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Self + use<> {
        let path = path.to_owned();
        move |error| Self { action, path, error }
    }
}

/// Whether a store may be changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    ReadWrite,
    ReadOnly,
}

/// An open store. Cheap to share between threads.
pub struct Store {
    dir: PathBuf,
    access: Access,
    log: Mutex<Log>,
    claims: Option<Arc<Claims>>,
    /// Objects that were found damaged while the store was open.
    damaged: Mutex<HashSet<Digest>>,
    /// Held, shared, as long as the store is open.
    _lock: Option<File>,
}

/// Objects up to this size live in the log: a file of their own would cost more than they do.
const SMALL_OBJECT: usize = 32 << 10;

const CACHEDIR_TAG: &str = "Signature: 8a477f597d28d172789f06886806bc55\n\
    # This folder is a cache of results. See https://bford.info/cachedir/\n";

impl Store {
    /// Opens a store, and makes it if it may be written.
    ///
    /// # Errors
    /// If the folder cannot be made, read, or (unless read-only) written.
    pub fn open(dir: &Path, access: Access) -> Result<Self, StoreError> {
        if access == Access::ReadWrite {
            for folder in ["log", "objects", "runs"] {
                let path = dir.join(folder);
                fs::create_dir_all(&path).map_err(StoreError::new("make the folder", &path))?;
            }
            let tag = dir.join("CACHEDIR.TAG");
            if !tag.exists() {
                fs::write(&tag, CACHEDIR_TAG).map_err(StoreError::new("write", &tag))?;
            }
        }
        let (lock, claims) = match access {
            Access::ReadOnly => (None, None),
            Access::ReadWrite => {
                let lock = open_lock_file(&dir.join("lock"))?;
                let path = dir.join("lock");
                lock.lock_shared().map_err(StoreError::new("lock", &path))?;
                let claims = Claims::new(open_lock_file(&dir.join("claims"))?);
                (Some(lock), Some(Arc::new(claims)))
            }
        };
        let log = Log::open(&dir.join("log"))?;
        Ok(Self {
            dir: dir.to_owned(),
            access,
            log: Mutex::new(log),
            claims,
            damaged: Mutex::default(),
            _lock: lock,
        })
    }

    pub fn dir(&self) -> &Path {
        &self.dir
    }

    pub fn access(&self) -> Access {
        self.access
    }

    fn log(&self) -> std::sync::MutexGuard<'_, Log> {
        self.log.lock().expect("no thread panics while it holds the log")
    }

    /// What is stored under a key.
    pub fn entry(&self, key: &Digest) -> Option<Arc<Entry>> {
        let payload = self.log().get(RecordKind::Entry, key)?;
        Entry::from_payload(&payload).map(Arc::new)
    }

    /// Sees what other processes have written since; costs little if nobody has.
    ///
    /// # Errors
    /// If the log cannot be read.
    pub fn refresh(&self) -> Result<(), StoreError> {
        self.log().refresh()
    }

    /// Whether an object is there. Its bytes are checked when they are read.
    pub fn has_object(&self, digest: &Digest) -> bool {
        self.log().has(RecordKind::Object, digest) || objects::path(&self.dir, digest).is_file()
    }

    /// The file of an object, if it has one of its own.
    pub fn object_file(&self, digest: &Digest) -> Option<PathBuf> {
        Some(objects::path(&self.dir, digest)).filter(|it| it.is_file())
    }

    /// The bytes of an object, checked against its digest.
    ///
    /// # Errors
    /// If it is missing or damaged. A damaged object is set aside, so that it is made again.
    pub fn object(&self, ty: ArtifactType, digest: &Digest) -> Result<Bytes, ObjectError> {
        let res = self.read_object(ty, digest);
        if matches!(res, Err(ObjectError::Damaged { .. })) {
            self.damaged.lock().expect("nobody panics while holding it").insert(*digest);
        }
        res
    }

    fn read_object(&self, ty: ArtifactType, digest: &Digest) -> Result<Bytes, ObjectError> {
        let mut log = self.log();
        if !log.has(RecordKind::Object, digest) {
            drop(log);
            return objects::read(&self.dir, self.access, ty, digest);
        }
        let bytes = log.get(RecordKind::Object, digest);
        match bytes.filter(|it| super::artifact::digest_of(ty, it) == *digest) {
            Some(bytes) => Ok(Bytes::Owned(bytes)),
            None => {
                log.forget(RecordKind::Object, digest);
                Err(ObjectError::Damaged { path: self.dir.join("log"), digest: *digest })
            }
        }
    }

    /// Whether an object was found damaged and set aside, by this process or an earlier one.
    pub fn was_damaged(&self, digest: &Digest) -> bool {
        self.damaged.lock().expect("nobody panics while holding it").contains(digest)
            || objects::path(&self.dir, digest).with_extension("damaged").exists()
    }

    /// The file of an object that [`Store::object`] has mapped.
    pub fn object_path(&self, digest: &Digest) -> PathBuf {
        objects::path(&self.dir, digest)
    }

    /// Writes objects and the entries that name them, in this order.
    ///
    /// # Errors
    /// If the disk refuses. What was written before stays; nothing half-written is ever read.
    pub fn write(&self, batch: Vec<NewEntry>) -> Result<(), StoreError> {
        if self.access == Access::ReadOnly {
            return Ok(());
        }
        let mut records = Vec::new();
        for NewEntry { key, entry, objects } in batch {
            for (digest, bytes) in objects {
                if bytes.len() > SMALL_OBJECT {
                    objects::write(&self.dir, &digest, &bytes)?;
                } else if !self.log().has(RecordKind::Object, &digest) {
                    records.push((RecordKind::Object, digest, bytes));
                }
            }
            records.push((RecordKind::Entry, key, entry.to_payload()));
        }
        self.log().append(&records)
    }

    /// Remembers small facts that may be forgotten at any time.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn remember(&self, notes: Vec<(Note, Digest, Vec<u8>)>) -> Result<(), StoreError> {
        if self.access == Access::ReadOnly || notes.is_empty() {
            return Ok(());
        }
        let records: Vec<_> =
            notes.into_iter().map(|(note, digest, bytes)| (note.record(), digest, bytes)).collect();
        self.log().append(&records)
    }

    /// A remembered fact.
    pub fn recall(&self, note: Note, about: &Digest) -> Option<Vec<u8>> {
        self.log().get(note.record(), about)
    }

    /// Claims a key for one run, if nobody else computes it now.
    ///
    /// # Errors
    /// If the file of claims cannot be locked for another reason.
    pub fn claim(&self, key: &Digest) -> Result<Option<Claim>, StoreError> {
        match &self.claims {
            None => Ok(Some(Claim::none())),
            Some(claims) => {
                let path = self.dir.join("claims");
                Claim::take(claims, key).map_err(StoreError::new("lock", &path))
            }
        }
    }
}

/// An entry with its key and the objects that it names.
pub struct NewEntry {
    pub key: Digest,
    pub entry: Entry,
    pub objects: Vec<(Digest, Vec<u8>)>,
}

/// A kind of small fact.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Note {
    /// About (path, size, time of change …): the digest of a file's content.
    FileDigest,
    /// About (pipeline, instance): the key that it had last.
    LastKey,
    /// About a path in the user's folder: what was written there.
    Exported,
    /// About a question to the machine: the answer, and what it was read from.
    Facts,
}

impl Note {
    fn record(self) -> RecordKind {
        match self {
            Self::FileDigest => RecordKind::FileDigest,
            Self::LastKey => RecordKind::LastKey,
            Self::Exported => RecordKind::Exported,
            Self::Facts => RecordKind::Facts,
        }
    }
}

fn open_lock_file(path: &Path) -> Result<File, StoreError> {
    File::options()
        .read(true)
        .write(true)
        .create(true)
        .truncate(false)
        .open(path)
        .map_err(StoreError::new("write", path))
}

/// Seconds since 1970.
pub fn now_secs() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |it| it.as_secs())
}
