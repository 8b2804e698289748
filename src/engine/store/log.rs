//! The append-only log: many small records in few files, and their index in memory.

use std::{
    collections::HashMap,
    fs::{self, File},
    hash::{BuildHasherDefault, Hasher},
    io::{self, Write},
    os::unix::fs::FileExt,
    path::{Path, PathBuf},
};

use memmap2::Mmap;

use super::StoreError;
use crate::engine::digest::Digest;

/// What a record is about. The numbers are the file format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum RecordKind {
    /// Key digest -> entry (JSON).
    Entry = 1,
    /// Object digest -> bytes.
    Object = 2,
    FileDigest = 3,
    LastKey = 4,
    Exported = 5,
    Facts = 6,
}

impl RecordKind {
    const ALL: [Self; 6] =
        [Self::Entry, Self::Object, Self::FileDigest, Self::LastKey, Self::Exported, Self::Facts];
}

const MAGIC: &[u8; 8] = b"SINEWLG1";

/// A record: payload length (4 bytes), kind (1), zeros (3), digest (32), check of the payload (8),
/// check of these 48 bytes (8), payload, zeros up to a multiple of 8.
const HEADER: usize = 56;

/// A segment that is larger is not appended to any more.
const FULL_SEGMENT: u64 = 256 << 20;

/// Where a payload lies.
#[derive(Debug, Clone, Copy)]
struct Place {
    segment: u32,
    offset: u64,
    length: u32,
    check: u64,
}

struct Segment {
    path: PathBuf,
    file: File,
    /// The end of the last whole record that was seen.
    end: u64,
    /// The segment up to where it was scanned last; what was appended since is read from the file.
    map: Option<Mmap>,
}

/// All segments of a store.
pub struct Log {
    dir: PathBuf,
    segments: Vec<Segment>,
    index: HashMap<(RecordKind, Digest), Place, BuildHasherDefault<DigestHasher>>,
    /// The segment that this process appends to, with its lock.
    own: Option<usize>,
}

impl Log {
    pub fn open(dir: &Path) -> Result<Self, StoreError> {
        let mut log = Self {
            dir: dir.to_owned(),
            segments: Vec::new(),
            index: HashMap::default(),
            own: None,
        };
        log.refresh()?;
        Ok(log)
    }

    /// Reads what was appended since, by whomever.
    ///
    /// Lists the folder every time: its time of change is too coarse to tell whether a segment has
    /// come in the same tick of the clock.
    pub fn refresh(&mut self) -> Result<(), StoreError> {
        let list = match fs::read_dir(&self.dir) {
            Ok(list) => list,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
            Err(error) => return Err(StoreError::new("read", &self.dir)(error)),
        };
        let mut paths: Vec<PathBuf> =
            list.filter_map(|it| Some(it.ok()?.path())).filter(|it| is_segment(it)).collect();
        // Later segments win where facts were replaced: names begin with the time of their making.
        paths.sort();
        for path in paths {
            if !self.segments.iter().any(|it| it.path == path) {
                let file = File::open(&path).map_err(StoreError::new("read", &path))?;
                self.segments.push(Segment { path, file, end: 0, map: None });
            }
        }
        for segment in 0..self.segments.len() {
            if self.own != Some(segment) {
                self.scan(segment)?;
            }
        }
        Ok(())
    }

    /// Indexes the whole records after the segment's known end.
    fn scan(&mut self, index: usize) -> Result<(), StoreError> {
        let segment = &mut self.segments[index];
        let fail = |path: &Path| StoreError::new("read", path);
        let length = segment.file.metadata().map_err(fail(&segment.path))?.len();
        if length <= segment.end.max(MAGIC.len() as u64) {
            return Ok(());
        }
        // SAFETY: segments only grow while a store is open (`gc` and the cutting of torn records
        // need locks that exclude this), so the mapped bytes stay.
        let map = unsafe { Mmap::map(&segment.file) }.map_err(fail(&segment.path))?;
        if segment.end == 0 {
            if !map.starts_with(MAGIC) {
                tracing::warn!(path = %segment.path.display(), "is no log segment; left alone");
                return Ok(());
            }
            segment.end = MAGIC.len() as u64;
        }
        while let Some((kind, digest, check, payload)) = read_header(&map, segment.end) {
            let offset = segment.end + HEADER as u64;
            let place = Place { segment: index as u32, offset, length: payload, check };
            segment.end = (offset + u64::from(payload)).next_multiple_of(8);
            if let Some(kind) = kind {
                self.index.insert((kind, digest), place);
            }
        }
        segment.map = Some(map);
        Ok(())
    }

    pub fn has(&self, kind: RecordKind, digest: &Digest) -> bool {
        self.index.contains_key(&(kind, *digest))
    }

    pub fn forget(&mut self, kind: RecordKind, digest: &Digest) {
        self.index.remove(&(kind, *digest));
    }

    /// All digests of one kind, with the lengths of their payloads, sorted.
    pub fn list(&self, kind: RecordKind) -> Vec<(Digest, u64)> {
        let mut res: Vec<_> = self
            .index
            .iter()
            .filter(|it| it.0.0 == kind)
            .map(|(key, place)| (key.1, u64::from(place.length)))
            .collect();
        res.sort();
        res
    }

    /// The payload of the newest record, if it is whole.
    pub fn get(&self, kind: RecordKind, digest: &Digest) -> Option<Vec<u8>> {
        let place = self.index.get(&(kind, *digest))?;
        let segment = &self.segments[place.segment as usize];
        let range = place.offset as usize..place.offset as usize + place.length as usize;
        let payload = match segment.map.as_ref().and_then(|it| it.get(range)) {
            Some(mapped) => mapped.to_vec(),
            None => {
                let mut payload = vec![0; place.length as usize];
                segment.file.read_exact_at(&mut payload, place.offset).ok()?;
                payload
            }
        };
        (check_of(&payload) == place.check).then_some(payload)
    }

    /// Appends records with one write; either all of them or none.
    pub fn append(&mut self, records: &[(RecordKind, Digest, Vec<u8>)]) -> Result<(), StoreError> {
        if records.is_empty() {
            return Ok(());
        }
        let own = self.own_segment()?;
        let start = self.segments[own].end;
        let mut buffer = Vec::new();
        let mut places = Vec::new();
        for (kind, digest, payload) in records {
            let check = write_header(&mut buffer, *kind, digest, payload);
            let offset = start + buffer.len() as u64;
            let place = Place { segment: own as u32, offset, length: payload.len() as u32, check };
            places.push(((*kind, *digest), place));
            buffer.extend_from_slice(payload);
            buffer.resize(buffer.len().next_multiple_of(8), 0);
        }
        let segment = &mut self.segments[own];
        if let Err(error) = segment.file.write_all_at(&buffer, start) {
            // A full disk: cut off what fitted, so that the segment ends with a whole record.
            let _ = segment.file.set_len(start);
            return Err(StoreError::new("write", &segment.path)(error));
        }
        segment.end = start + buffer.len() as u64;
        self.index.extend(places);
        Ok(())
    }

    /// Takes over a segment that nobody appends to, or makes a new one.
    fn own_segment(&mut self) -> Result<usize, StoreError> {
        if let Some(own) = self.own {
            return Ok(own);
        }
        for index in 0..self.segments.len() {
            let path = self.segments[index].path.clone();
            if self.segments[index].end == 0 || self.segments[index].end > FULL_SEGMENT {
                continue;
            }
            let Ok(file) = File::options().read(true).write(true).open(&path) else { continue };
            if file.try_lock().is_err() {
                continue;
            }
            self.scan(index)?;
            let end = self.segments[index].end;
            if file.metadata().is_ok_and(|it| it.len() > end) {
                tracing::info!(path = %path.display(), end, "cut off a torn record");
                file.set_len(end).map_err(StoreError::new("write", &path))?;
            }
            self.segments[index].file = file;
            self.own = Some(index);
            return Ok(index);
        }
        self.new_segment()
    }

    fn new_segment(&mut self) -> Result<usize, StoreError> {
        let file = tempfile::Builder::new()
            .prefix(&format!("{:010}-", super::now_secs()))
            .suffix(".log")
            .tempfile_in(&self.dir)
            .map_err(StoreError::new("make a file in", &self.dir))?;
        let (mut file, path) =
            file.keep().map_err(|e| StoreError::new("keep", &self.dir)(e.error))?;
        file.try_lock().map_err(|e| StoreError::new("lock", &path)(e.into()))?;
        file.write_all(MAGIC).map_err(StoreError::new("write", &path))?;
        self.segments.push(Segment { path, file, end: MAGIC.len() as u64, map: None });
        self.own = Some(self.segments.len() - 1);
        Ok(self.segments.len() - 1)
    }

    /// Writes the records that `keeps` chooses into a new segment and removes all others.
    ///
    /// Nobody else may have the store open. A crash on the way leaves records twice, not less.
    pub fn rewrite(
        mut self,
        keeps: impl Fn(RecordKind, &Digest) -> bool,
    ) -> Result<(), StoreError> {
        let old: Vec<PathBuf> = self.segments.iter().map(|it| it.path.clone()).collect();
        let mut records = Vec::new();
        for kind in RecordKind::ALL {
            for (digest, _) in self.list(kind) {
                if keeps(kind, &digest)
                    && let Some(payload) = self.get(kind, &digest)
                {
                    records.push((kind, digest, payload));
                }
            }
        }
        self.new_segment()?;
        self.append(&records)?;
        for path in old {
            fs::remove_file(&path).map_err(StoreError::new("remove", &path))?;
        }
        Ok(())
    }

    /// The paths of all segments.
    pub fn paths(&self) -> impl Iterator<Item = &Path> {
        self.segments.iter().map(|it| it.path.as_path())
    }
}

fn is_segment(path: &Path) -> bool {
    path.extension().is_some_and(|it| it == "log")
}

fn check_of(bytes: &[u8]) -> u64 {
    let digest = blake3::hash(bytes);
    u64::from_le_bytes(digest.as_bytes()[..8].try_into().expect("a digest has 32 bytes"))
}

/// Appends a record's header and returns the payload's check.
fn write_header(buffer: &mut Vec<u8>, kind: RecordKind, digest: &Digest, payload: &[u8]) -> u64 {
    let start = buffer.len();
    let check = check_of(payload);
    buffer.extend_from_slice(&(payload.len() as u32).to_le_bytes());
    buffer.extend_from_slice(&[kind as u8, 0, 0, 0]);
    buffer.extend_from_slice(&digest.0);
    buffer.extend_from_slice(&check.to_le_bytes());
    let header_check = check_of(&buffer[start..]);
    buffer.extend_from_slice(&header_check.to_le_bytes());
    check
}

/// The header of a whole record: its kind (if this version knows it), digest, payload check, length.
fn read_header(map: &[u8], at: u64) -> Option<(Option<RecordKind>, Digest, u64, u32)> {
    let at = usize::try_from(at).ok()?;
    let header = map.get(at..at + HEADER)?;
    let number = |range: std::ops::Range<usize>| {
        u64::from_le_bytes(header[range].try_into().expect("eight bytes"))
    };
    if number(48..56) != check_of(&header[..48]) {
        return None;
    }
    let length = u32::from_le_bytes(header[..4].try_into().expect("four bytes"));
    map.get(at + HEADER..at + HEADER + length as usize)?;
    let kind = RecordKind::ALL.into_iter().find(|&it| it as u8 == header[4]);
    let digest = Digest(header[8..40].try_into().expect("a digest has 32 bytes"));
    Some((kind, digest, number(40..48), length))
}

/// Digests are already spread evenly: their first bytes are their hash.
#[derive(Default)]
struct DigestHasher(u64);

impl Hasher for DigestHasher {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        if let Some(first) = bytes.first_chunk::<8>() {
            self.0 ^= u64::from_le_bytes(*first);
        }
    }
}
