//! Housekeeping: what a store holds, what can go, what is damaged.
//!
//! Everything here that removes something holds the store's lock alone, so no run sees half of it.

use std::{
    collections::{BTreeMap, HashMap, HashSet},
    fs::{self, File},
    path::{Path, PathBuf},
};

use super::{
    Access, Entry, StoreError,
    log::{Log, RecordKind},
    objects, open_lock_file,
};
use crate::engine::{
    artifact::digest_of,
    digest::Digest,
    key::Key,
    library::Library,
    record::{self, Line, Record},
};

/// Why housekeeping did not happen.
#[derive(Debug, thiserror::Error)]
pub enum GcError {
    #[error("the cache `{}` is being used by a run; try again when it has ended", dir.display())]
    InUse { dir: PathBuf },
    #[error(transparent)]
    Store(#[from] StoreError),
}

/// What one kind of node takes.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct KindStat {
    pub entries: usize,
    pub bytes: u64,
    /// What it would cost to make it all again.
    pub wall_secs: f64,
}

/// What a store holds.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CacheStat {
    pub kinds: BTreeMap<String, KindStat>,
    pub entries: usize,
    pub objects: usize,
    pub object_bytes: u64,
    pub log_bytes: u64,
    pub runs: usize,
}

/// What may go. An entry stays if any of the reasons to keep it holds.
#[derive(Debug, Clone, Default)]
pub struct GcOptions {
    /// Keep what the last so many runs used.
    pub keep_runs: Option<usize>,
    /// Keep what was used within so many seconds.
    pub max_age_secs: Option<u64>,
    /// Then remove what was not used for longest until the rest is not larger.
    pub max_bytes: Option<u64>,
    /// Remove the entries of these kinds.
    pub kinds: Vec<String>,
    /// Remove the entries whose keys begin so.
    pub keys: Vec<String>,
    /// Remove everything.
    pub all: bool,
    pub dry_run: bool,
}

#[derive(Debug, Clone, Default, PartialEq)]
pub struct GcReport {
    pub kept_entries: usize,
    pub removed_entries: usize,
    pub removed_objects: usize,
    pub freed_bytes: u64,
}

#[derive(Debug, Clone, Default, PartialEq)]
pub struct VerifyReport {
    pub entries: usize,
    pub objects: usize,
    /// What is damaged, with its place. It is set aside, and made again when it is needed.
    pub damaged: Vec<String>,
}

struct StoredEntry {
    key: Digest,
    kind: String,
    entry: Entry,
}

/// Sums up what a store holds.
///
/// # Errors
/// If the log cannot be read.
pub fn stat(dir: &Path) -> Result<CacheStat, StoreError> {
    let log = Log::open(&dir.join("log"))?;
    let mut stat = CacheStat { runs: record::list(dir).len(), ..CacheStat::default() };
    for StoredEntry { kind, entry, .. } in entries(&log) {
        let of_kind = stat.kinds.entry(kind).or_default();
        of_kind.entries += 1;
        of_kind.bytes += entry.outputs.iter().map(|it| it.bytes).sum::<u64>();
        of_kind.wall_secs += entry.wall_secs;
        stat.entries += 1;
    }
    let small = log.list(RecordKind::Object);
    let large = large_objects(dir);
    stat.objects = small.len() + large.len();
    stat.object_bytes =
        small.iter().map(|it| it.1).sum::<u64>() + large.values().map(|it| it.bytes).sum::<u64>();
    stat.log_bytes = log.paths().filter_map(|it| Some(fs::metadata(it).ok()?.len())).sum();
    Ok(stat)
}

/// Removes what may go, and writes what stays into one new segment.
///
/// # Errors
/// If a run uses the store, or the disk refuses. Nothing that was to stay is lost then.
pub fn collect(dir: &Path, options: &GcOptions) -> Result<GcReport, GcError> {
    let _alone = lock_alone(dir)?;
    let log = Log::open(&dir.join("log"))?;
    let (kept, removed) = choose(entries(&log), &last_uses(dir, None), dir, options);
    let kept_keys: HashSet<Digest> = kept.iter().map(|it| it.key).collect();
    let kept_objects: HashSet<Digest> =
        kept.iter().flat_map(|it| it.entry.outputs.iter().map(|it| it.digest)).collect();
    let mut report = GcReport {
        kept_entries: kept.len(),
        removed_entries: removed.len(),
        ..GcReport::default()
    };
    let large = large_objects(dir);
    for (digest, object) in &large {
        if !kept_objects.contains(digest) {
            report.removed_objects += 1;
            report.freed_bytes += object.bytes;
            if !options.dry_run {
                remove(&object.path)?;
            }
        }
    }
    for (digest, bytes) in log.list(RecordKind::Object) {
        if !kept_objects.contains(&digest) {
            report.removed_objects += 1;
            report.freed_bytes += bytes;
        }
    }
    if !options.dry_run {
        log.rewrite(|kind, digest| match kind {
            RecordKind::Entry => kept_keys.contains(digest),
            RecordKind::Object => kept_objects.contains(digest),
            RecordKind::FileDigest
            | RecordKind::LastKey
            | RecordKind::Exported
            | RecordKind::Facts => !options.all,
        })?;
        remove_leftovers(dir)?;
    }
    Ok(report)
}

/// Reads everything and compares it with its digests; what is damaged is set aside.
///
/// # Errors
/// If a run uses the store, or the log cannot be read.
pub fn verify(dir: &Path, library: &Library) -> Result<VerifyReport, GcError> {
    let _alone = lock_alone(dir)?;
    let log = Log::open(&dir.join("log"))?;
    let mut report = VerifyReport::default();
    let mut checked = HashSet::new();
    let mut damaged_small = HashSet::new();
    for (key, _) in log.list(RecordKind::Entry) {
        report.entries += 1;
        if log.get(RecordKind::Entry, &key).is_none() {
            report.damaged.push(format!("entry {}", key.short()));
        }
    }
    for StoredEntry { kind, entry, .. } in entries(&log) {
        for output in &entry.outputs {
            let Some(artifact) = library.artifact_kind(&output.ty) else { continue };
            if !checked.insert(output.digest) {
                continue;
            }
            let name = || format!("`{}` of a {kind} node ({})", output.port, output.digest.short());
            if log.has(RecordKind::Object, &output.digest) {
                report.objects += 1;
                let bytes = log.get(RecordKind::Object, &output.digest).unwrap_or_default();
                if digest_of(artifact.ty, &bytes) != output.digest {
                    damaged_small.insert(output.digest);
                    report.damaged.push(name());
                }
                continue;
            }
            match objects::read(dir, Access::ReadWrite, artifact.ty, &output.digest) {
                Ok(_) => report.objects += 1,
                Err(objects::ObjectError::Missing { .. }) => {}
                Err(error) => {
                    report.objects += 1;
                    report.damaged.push(format!("{}: {error}", name()));
                }
            }
        }
    }
    if !damaged_small.is_empty() {
        log.rewrite(|kind, digest| kind != RecordKind::Object || !damaged_small.contains(digest))?;
    }
    Ok(report)
}

fn lock_alone(dir: &Path) -> Result<File, GcError> {
    let lock = open_lock_file(&dir.join("lock"))?;
    match lock.try_lock() {
        Ok(()) => Ok(lock),
        Err(_) => Err(GcError::InUse { dir: dir.to_owned() }),
    }
}

fn entries(log: &Log) -> Vec<StoredEntry> {
    let read = |(key, _): (Digest, u64)| {
        let entry = Entry::from_payload(&log.get(RecordKind::Entry, &key)?)?;
        let kind = serde_json::from_str::<Key>(&entry.key).ok()?.kind;
        Some(StoredEntry { key, kind, entry })
    };
    log.list(RecordKind::Entry).into_iter().filter_map(read).collect()
}

struct LargeObject {
    path: PathBuf,
    bytes: u64,
}

fn large_objects(dir: &Path) -> BTreeMap<Digest, LargeObject> {
    let mut res = BTreeMap::new();
    for path in object_files(dir) {
        let is_object = path.extension().is_some_and(|it| it == "safetensors");
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        if let (true, Ok(digest), Ok(meta)) = (is_object, stem.parse(), fs::metadata(&path)) {
            res.insert(digest, LargeObject { path, bytes: meta.len() });
        }
    }
    res
}

fn object_files(dir: &Path) -> Vec<PathBuf> {
    let list = |path: &Path| -> Vec<PathBuf> {
        fs::read_dir(path).into_iter().flatten().flatten().map(|it| it.path()).collect()
    };
    list(&dir.join("objects")).iter().flat_map(|it| list(it)).collect()
}

/// When each key was used last (seconds since 1970), by the records of the newest `n_runs` runs.
fn last_uses(dir: &Path, n_runs: Option<usize>) -> HashMap<Digest, u64> {
    let mut uses = HashMap::new();
    for path in record::list(dir).into_iter().take(n_runs.unwrap_or(usize::MAX)) {
        let changed = fs::metadata(&path).and_then(|it| it.modified()).ok();
        let since = changed.and_then(|it| it.duration_since(std::time::UNIX_EPOCH).ok());
        let (Ok(record), Some(since)) = (Record::read(&path), since) else { continue };
        for line in record.lines {
            if let Line::NodeDone(node) = line
                && let Some(key) = node.key
            {
                uses.entry(key).or_insert(since.as_secs());
            }
        }
    }
    uses
}

/// Splits entries into those that stay and those that go.
fn choose(
    entries: Vec<StoredEntry>,
    uses: &HashMap<Digest, u64>,
    dir: &Path,
    options: &GcOptions,
) -> (Vec<StoredEntry>, Vec<StoredEntry>) {
    let recent = options.keep_runs.map(|it| last_uses(dir, Some(it)));
    let now = super::now_secs();
    let used = |it: &StoredEntry| uses.get(&it.key).copied().unwrap_or(it.entry.made);
    let named = !options.kinds.is_empty() || !options.keys.is_empty();
    let aged = recent.is_some() || options.max_age_secs.is_some();
    let stays = |it: &StoredEntry| {
        if options.all {
            return false;
        }
        let text = it.key.to_string();
        let is_named = options.kinds.contains(&it.kind)
            || options.keys.iter().any(|key| text.starts_with(key.as_str()));
        let is_recent = recent.as_ref().is_some_and(|recent| recent.contains_key(&it.key))
            || options.max_age_secs.is_some_and(|age| now.saturating_sub(used(it)) <= age);
        !(named && is_named) && (!aged || is_recent)
    };
    let (mut kept, mut removed): (Vec<_>, Vec<_>) = entries.into_iter().partition(stays);
    if let Some(max_bytes) = options.max_bytes {
        kept.sort_by_key(|it| (std::cmp::Reverse(used(it)), it.key));
        let mut total = 0;
        let mut fits = |it: &StoredEntry| {
            total += it.entry.outputs.iter().map(|it| it.bytes).sum::<u64>();
            total <= max_bytes
        };
        let n_kept = kept.iter().position(|it| !fits(it)).unwrap_or(kept.len());
        removed.extend(kept.split_off(n_kept));
    }
    (kept, removed)
}

/// Files that were being written when a process died, and objects that were set aside.
fn remove_leftovers(dir: &Path) -> Result<(), StoreError> {
    for path in object_files(dir) {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if name.starts_with(".tmp-") || name.ends_with(".damaged") {
            remove(&path)?;
        }
    }
    Ok(())
}

fn remove(path: &Path) -> Result<(), StoreError> {
    fs::remove_file(path).map_err(StoreError::new("remove", path))
}
