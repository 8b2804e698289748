//! The store: results by key, artifacts by digest, on a disk that several processes may share.
//!
//! ```text
//! cache/
//!   CACHEDIR.TAG
//!   lock             the gate: shared while somebody plans or writes; `gc` takes it alone
//!   claims           byte ranges of this file are locked while a key is being computed
//!   log/*.log        append-only segments: entries, small objects, digests of files …
//!   objects/ab/…     one file an object that is too large for the log
//!   runs/*.jsonl     run records
//!   graphs/*.graph   pipelines that were read before
//!   uses/*           what running runs rely on
//!   pins/*           what `gc` must keep
//! ```
//!
//! Nothing is ever changed in place. An object is there before the entry that names it. A writer
//! appends to a segment of its own (held by a lock that dies with it), so a torn record can only be
//! the last of a segment: readers stop before it and the next writer cuts it off.

mod claims;
pub mod disk;
mod entry_outputs;
mod gate;
pub mod gc;
mod log;
mod objects;
pub mod pins;
mod uses;
mod witness;

use std::{
    collections::HashSet,
    io,
    path::{Path, PathBuf},
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, Ordering},
    },
    time::{SystemTime, UNIX_EPOCH},
};

use serde::{Deserialize, Serialize};

pub use claims::Claim;
use claims::Claims;
use disk::Disk;
pub use entry_outputs::{EntryOutputs, OutputView};
use gate::{Gate, Pass};
use log::{Log, RecordKind};
pub use objects::ObjectError;
use uses::Uses;

use super::{
    artifact::{ArtifactType, Bytes, digest_of},
    digest::Digest,
};

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
    disk: Disk,
    log: Mutex<Log>,
    claims: Option<Arc<Claims>>,
    /// None for a store that is only read.
    gate: Option<Arc<Gate>>,
    /// Held from the opening until a run has planned, so that nothing it has seen is removed.
    planning: Mutex<Option<Pass>>,
    /// What the run relies on that is going on, noted down for housekeeping.
    uses: Mutex<Option<Uses>>,
    /// Objects that were found damaged while the store was open.
    damaged: Mutex<HashSet<Digest>>,
    /// The same of large objects, for people.
    damage: Mutex<Vec<String>>,
    /// Objects are checked although they were before.
    checks_again: AtomicBool,
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
        Self::open_on(&Disk::default(), dir, access)
    }

    /// Opens a store on a disk that may fail.
    ///
    /// # Errors
    /// As [`Store::open`].
    pub fn open_on(disk: &Disk, dir: &Path, access: Access) -> Result<Self, StoreError> {
        let (mut gate, mut claims, mut planning) = (None, None, None);
        if access == Access::ReadWrite {
            make_folders(disk, dir)?;
            let open = Gate::open(disk, &dir.join("lock"))?;
            planning = Some(open.enter()?);
            gate = Some(open);
            let path = dir.join("claims");
            let file = disk.open_or_create(&path).map_err(StoreError::new("write", &path))?;
            claims = Some(Arc::new(Claims::new(file)));
        }
        let log = Log::open(disk, &dir.join("log"))?;
        Ok(Self {
            dir: dir.to_owned(),
            access,
            disk: disk.clone(),
            log: Mutex::new(log),
            claims,
            gate,
            planning: Mutex::new(planning),
            uses: Mutex::default(),
            damaged: Mutex::default(),
            damage: Mutex::default(),
            checks_again: AtomicBool::new(false),
        })
    }

    /// Lets housekeeping work beside a run that has planned. It keeps what the run relies on, if
    /// there is something left to do: these keys, and what it will store under its name.
    pub fn planned(&self, run: &str, relies_on: Option<&[Digest]>) {
        if self.access == Access::ReadWrite
            && let Some(keys) = relies_on
        {
            match Uses::note(&self.disk, &self.dir, run, keys) {
                Ok(uses) => *self.uses.lock().expect("nobody panics while it is held") = Some(uses),
                Err(error) => tracing::debug!(%error, "housekeeping does not know of this run"),
            }
        }
        *self.planning.lock().expect("nobody panics while it is held") = None;
    }

    /// A run has ended: housekeeping may remove what it relied on.
    pub fn ended(&self) {
        *self.uses.lock().expect("nobody panics while it is held") = None;
    }

    /// What was found damaged since this was asked last, with its place; it is made again when it
    /// is needed.
    pub fn take_damage(&self) -> Vec<String> {
        let mut res = self.log().take_damage();
        res.append(&mut self.damage.lock().expect("nobody panics while it is held"));
        res
    }

    pub fn dir(&self) -> &Path {
        &self.dir
    }

    pub fn disk(&self) -> &Disk {
        &self.disk
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

    /// Looks at the artifacts of an entry. That is all that a run asks of most of them, so neither the key
    /// nor the rest is read.
    pub fn outputs<T>(
        &self,
        key: &Digest,
        look: impl FnOnce(&EntryOutputs<'_>) -> Option<T>,
    ) -> Option<T> {
        self.log().view(RecordKind::Entry, key, |payload| look(&EntryOutputs::read(payload)?))?
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

    /// From now on, objects are held against their digests at every reading, whatever was found before.
    pub fn check_again(&self) {
        self.checks_again.store(true, Ordering::Relaxed);
    }

    /// The bytes of an object, checked against its digest: now, or before if its file looks the same as
    /// it did then.
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
        if log.has(RecordKind::Object, digest) {
            let bytes = log.get(RecordKind::Object, digest);
            if let Some(bytes) = bytes.filter(|it| digest_of(ty, it) == *digest) {
                return Ok(Bytes::Owned(bytes));
            }
            log.forget(RecordKind::Object, digest);
            return Err(ObjectError::Damaged { path: self.dir.join("log"), digest: *digest });
        }
        drop(log);
        let res = self.read_file(ty, digest);
        if let Err(error @ (ObjectError::Damaged { .. } | ObjectError::Unreadable { .. })) = &res {
            let mut damage = self.damage.lock().expect("nobody panics while it is held");
            damage.push(error.to_string());
        }
        res
    }

    fn read_file(&self, ty: ArtifactType, digest: &Digest) -> Result<Bytes, ObjectError> {
        let object = objects::open(&self.disk, &self.dir, digest)?;
        let witness = witness::subject(&object, ty);
        let is_known = |it: &Digest| self.recall(Note::Checked, it).as_deref() == Some(&digest.0);
        if !self.checks_again.load(Ordering::Relaxed) && witness.as_ref().is_some_and(is_known) {
            return Ok(Bytes::Mapped(object.map.into()));
        }
        let bytes = object.check(&self.disk, self.access, ty)?;
        if let Some(subject) = witness
            && let Err(error) = self.remember(vec![(Note::Checked, subject, digest.0.to_vec())])
        {
            tracing::debug!(%error, "a check of an object is not remembered");
        }
        Ok(bytes)
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
        // Between the writing of an object and that of its entry, nobody may think it is garbage.
        let _pass = self.enter()?;
        let mut records = Vec::new();
        for NewEntry { key, entry, objects } in batch {
            for (digest, bytes) in objects {
                if bytes.len() > SMALL_OBJECT {
                    objects::write(&self.disk, &self.dir, &digest, &bytes)?;
                } else if !self.log().has(RecordKind::Object, &digest) {
                    records.push((RecordKind::Object, digest, bytes.into_vec()));
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
        let _pass = self.enter()?;
        self.log().append(&records)
    }

    /// Writes a whole file below the folder of the store, beside what it keeps itself.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn write_beside(&self, place: &Path, bytes: &[u8]) -> Result<(), StoreError> {
        let path = self.dir.join(place);
        let folder = path.parent().expect("a file lies in a folder");
        let _pass = self.enter()?;
        self.disk.in_folder(folder, || {
            self.disk.write_whole(&path, bytes).map_err(StoreError::new("write", &path))
        })
    }

    fn enter(&self) -> Result<Option<Pass>, StoreError> {
        self.gate.as_ref().map(Gate::enter).transpose()
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
                self.disk.may_claim(&path).map_err(StoreError::new("lock", &path))?;
                Claim::take(claims, key).map_err(StoreError::new("lock", &path))
            }
        }
    }
}

/// An entry with its key and the objects that it names.
pub struct NewEntry {
    pub key: Digest,
    pub entry: Entry,
    pub objects: Vec<(Digest, Bytes)>,
}

/// A kind of small fact.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Note {
    /// About (path, size, time of change …): the digest of a file's content.
    FileDigest,
    /// About (pipeline, instance): the key that it had last.
    LastKey,
    /// About a pipeline: a digest of all keys that its instances had last.
    LastKeys,
    /// About a path in the user's folder: what was written there.
    Exported,
    /// About a question to the machine: the answer, and what it was read from.
    Facts,
    /// About the state of an object's file: the object that it was found to be.
    Checked,
}

impl Note {
    fn record(self) -> RecordKind {
        match self {
            Self::FileDigest => RecordKind::FileDigest,
            Self::LastKey => RecordKind::LastKey,
            Self::LastKeys => RecordKind::LastKeys,
            Self::Exported => RecordKind::Exported,
            Self::Facts => RecordKind::Facts,
            Self::Checked => RecordKind::Checked,
        }
    }
}

fn make_folders(disk: &Disk, dir: &Path) -> Result<(), StoreError> {
    for folder in ["log", "objects", "runs"] {
        let path = dir.join(folder);
        disk.make_folder(&path).map_err(StoreError::new("make the folder", &path))?;
    }
    let tag = dir.join("CACHEDIR.TAG");
    if !tag.exists() {
        disk.write_whole(&tag, CACHEDIR_TAG.as_bytes()).map_err(StoreError::new("write", &tag))?;
    }
    Ok(())
}

/// Seconds since 1970.
pub fn now_secs() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |it| it.as_secs())
}
