//! Housekeeping: what a store holds, what can go, what is damaged.
//!
//! It works beside runs. Whoever removes something holds the gate alone, so that nobody plans or
//! writes meanwhile, and keeps what is pinned, what a running run has planned with or has made, and
//! the segments that running processes append to. A run that learns of a result only later (because
//! what comes before it gave the same bytes as ever) may find its artifacts gone, and makes them
//! again.

use std::{
    collections::{BTreeMap, HashMap, HashSet},
    fs::{self, File},
    path::{Path, PathBuf},
    time::Duration,
};

use super::{
    Access, CACHEDIR_TAG, Entry, StoreError,
    disk::{self, Disk},
    gate,
    log::{Log, RecordKind},
    objects, pins, uses,
};
use crate::engine::{
    artifact::{ArtifactType, digest_of},
    digest::Digest,
    key::Key,
    library::Library,
    record::{self, Line, Record},
    snapshot,
};

/// Why housekeeping did not happen.
#[derive(Debug, thiserror::Error)]
pub enum GcError {
    #[error("the cache `{}` is busy: somebody plans or writes without a pause", dir.display())]
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
    /// Entries that could have gone, but a running run relies on them or appends beside them.
    pub in_use: usize,
    /// Entries that could have gone, but are pinned.
    pub pinned: usize,
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

/// How long housekeeping waits for a moment in which nobody plans or writes.
const PATIENCE: Duration = Duration::from_secs(60);

/// Sums up what a store holds.
///
/// # Errors
/// If the log cannot be read.
pub fn stat(dir: &Path) -> Result<CacheStat, StoreError> {
    let mut log = open_log(dir)?;
    let mut stat = CacheStat { runs: record::list(dir).len(), ..CacheStat::default() };
    for StoredEntry { kind, entry, .. } in entries(&mut log) {
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
/// If a pin cannot be read, if there is never a moment in which nobody plans or writes, or if the
/// disk refuses. Nothing that was to stay is lost then.
pub fn collect(dir: &Path, options: &GcOptions) -> Result<GcReport, GcError> {
    let _alone = close_gate(dir)?;
    let pinned: HashSet<Digest> = pins::all(dir)?.into_values().flatten().collect();
    let in_use = uses::living(&Disk::default(), dir);
    let mut log = open_log(dir)?;
    let all = entries(&mut log);
    let (mut kept, chosen) = choose(all, &last_uses(dir, None), dir, options);
    let mut report = GcReport::default();
    let mut removed = Vec::new();
    for it in chosen {
        if pinned.contains(&it.key) {
            report.pinned += 1;
            kept.push(it);
        } else if in_use.keys.contains(&it.key) || in_use.runs.contains(&it.entry.run) {
            report.in_use += 1;
            kept.push(it);
        } else {
            removed.push(it);
        }
    }
    let kept_keys: HashSet<Digest> = kept.iter().map(|it| it.key).collect();
    let kept_objects: HashSet<Digest> =
        kept.iter().flat_map(|it| it.entry.outputs.iter().map(|it| it.digest)).collect();
    let is_held = log.held();
    let n_held = removed.iter().filter(|it| is_held(RecordKind::Entry, &it.key)).count();
    report.kept_entries = kept.len() + n_held;
    report.in_use += n_held;
    report.removed_entries = removed.len() - n_held;
    for (digest, object) in &large_objects(dir) {
        if !kept_objects.contains(digest) {
            report.removed_objects += 1;
            report.freed_bytes += object.bytes;
            if !options.dry_run {
                remove(&object.path)?;
            }
        }
    }
    for (digest, bytes) in log.list(RecordKind::Object) {
        if !kept_objects.contains(&digest) && !is_held(RecordKind::Object, &digest) {
            report.removed_objects += 1;
            report.freed_bytes += bytes;
        }
    }
    drop(is_held);
    if !options.dry_run {
        log.rewrite(|kind, digest| match kind {
            RecordKind::Entry => kept_keys.contains(digest),
            RecordKind::Object => kept_objects.contains(digest),
            RecordKind::FileDigest
            | RecordKind::LastKey
            | RecordKind::Exported
            | RecordKind::Facts => !options.all,
            // One is left behind at every start of the machine; they are soon made again.
            RecordKind::Checked => false,
            // It tells of records some of which may be gone.
            RecordKind::LastKeys => false,
        })?;
        remove_leftovers(dir)?;
    }
    Ok(report)
}

/// Reads everything and compares it with its digests; what is damaged is set aside.
///
/// Runs go on meanwhile, but for the moment in which damaged records are removed.
///
/// # Errors
/// If the log cannot be read or written, or if there is never a moment in which nobody plans or
/// writes.
pub fn verify(dir: &Path, library: &Library) -> Result<VerifyReport, GcError> {
    let mut log = open_log(dir)?;
    let mut report = VerifyReport::default();
    let mut damaged = DamagedRecords::default();
    for (key, _) in log.list(RecordKind::Entry) {
        report.entries += 1;
        if !is_whole_entry(&mut log, &key) {
            damaged.entries.insert(key);
            report.damaged.push(format!("entry {}", key.short()));
        }
    }
    let mut checked = HashSet::new();
    for StoredEntry { kind, entry, .. } in entries(&mut log) {
        for output in &entry.outputs {
            let Some(artifact) = library.artifact_kind(&output.ty) else { continue };
            if !checked.insert(output.digest) {
                continue;
            }
            let name = || format!("`{}` of a {kind} node ({})", output.port, output.digest.short());
            if log.has(RecordKind::Object, &output.digest) {
                report.objects += 1;
                if !is_whole_object(&mut log, artifact.ty, &output.digest) {
                    damaged.objects.insert(output.digest, artifact.ty);
                    report.damaged.push(name());
                }
                continue;
            }
            let access = Access::ReadWrite;
            let disk = Disk::default();
            let object = objects::open(&disk, dir, &output.digest);
            match object.and_then(|it| it.check(&disk, access, artifact.ty)) {
                Ok(_) => report.objects += 1,
                Err(objects::ObjectError::Missing { .. }) => {}
                Err(error) => {
                    report.objects += 1;
                    report.damaged.push(format!("{}: {error}", name()));
                }
            }
        }
    }
    let in_log = log.take_damage();
    drop(log);
    if !in_log.is_empty() || !damaged.entries.is_empty() || !damaged.objects.is_empty() {
        remove_records(dir, damaged)?;
    }
    report.damaged.extend(in_log);
    mend_tag(dir, &mut report)?;
    Ok(report)
}

#[derive(Default)]
struct DamagedRecords {
    entries: HashSet<Digest>,
    objects: HashMap<Digest, ArtifactType>,
}

fn is_whole_entry(log: &mut Log, key: &Digest) -> bool {
    let entry = log.get(RecordKind::Entry, key).and_then(|it| Entry::from_payload(&it));
    entry.is_some_and(|it| Digest::of(it.key.as_bytes()) == *key)
}

fn is_whole_object(log: &mut Log, ty: ArtifactType, digest: &Digest) -> bool {
    log.get(RecordKind::Object, digest).is_some_and(|it| digest_of(ty, &it) == *digest)
}

/// Writes the log without damaged records.
fn remove_records(dir: &Path, mut damaged: DamagedRecords) -> Result<(), GcError> {
    let _alone = close_gate(dir)?;
    let mut log = open_log(dir)?;
    // Some may have been made again since.
    damaged.entries.retain(|key| !is_whole_entry(&mut log, key));
    damaged.objects.retain(|digest, ty| !is_whole_object(&mut log, *ty, digest));
    log.rewrite(|kind, digest| match kind {
        RecordKind::Entry => !damaged.entries.contains(digest),
        RecordKind::Object => !damaged.objects.contains_key(digest),
        RecordKind::FileDigest
        | RecordKind::LastKey
        | RecordKind::Exported
        | RecordKind::Facts
        | RecordKind::Checked => true,
        RecordKind::LastKeys => false,
    })?;
    Ok(())
}

/// The tag tells backup programs to leave the cache out.
fn mend_tag(dir: &Path, report: &mut VerifyReport) -> Result<(), StoreError> {
    let tag = dir.join("CACHEDIR.TAG");
    if fs::read(&tag).is_ok_and(|it| it == CACHEDIR_TAG.as_bytes()) {
        return Ok(());
    }
    report.damaged.push(format!("`{}`", tag.display()));
    let written = Disk::default().write_whole(&tag, CACHEDIR_TAG.as_bytes());
    written.map_err(StoreError::new("write", &tag))
}

fn close_gate(dir: &Path) -> Result<File, GcError> {
    let closed = gate::close(&Disk::default(), &dir.join("lock"), PATIENCE)?;
    closed.ok_or_else(|| GcError::InUse { dir: dir.to_owned() })
}

fn open_log(dir: &Path) -> Result<Log, StoreError> {
    Log::open(&Disk::default(), &dir.join("log"))
}

fn entries(log: &mut Log) -> Vec<StoredEntry> {
    let keys = log.list(RecordKind::Entry);
    let read = |(key, _): (Digest, u64)| {
        let entry = Entry::from_payload(&log.get(RecordKind::Entry, &key)?)?;
        let kind = serde_json::from_str::<Key>(&entry.key).ok()?.kind;
        Some(StoredEntry { key, kind, entry })
    };
    keys.into_iter().filter_map(read).collect()
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
        if name.starts_with(disk::TEMPORARY) || name.ends_with(".damaged") {
            remove(&path)?;
        }
    }
    // Of pipelines that may never be run again; of all others they are soon made again.
    for path in fs::read_dir(dir.join(snapshot::FOLDER)).into_iter().flatten().flatten() {
        remove(&path.path())?;
    }
    Ok(())
}

fn remove(path: &Path) -> Result<(), StoreError> {
    fs::remove_file(path).map_err(StoreError::new("remove", path))
}
