//! The append-only log: many small records in few files, and their index in memory.

mod record;

pub use record::RecordKind;

use std::{
    borrow::Cow,
    collections::HashMap,
    fs::File,
    hash::{BuildHasherDefault, Hasher},
    io,
    path::{Path, PathBuf},
};

use memmap2::Mmap;

use self::record::{HEADER, MAX_GENERATION, check_of, next_record, read_header, write_header};
use super::{
    StoreError,
    disk::{Disk, is_at, is_removed, unique_word},
};
use crate::engine::digest::Digest;

const MAGIC: &[u8; 8] = b"SINEWLG1";

/// A record has about so many bytes: an index with room for as many need not grow while it is filled.
const USUAL_RECORD: usize = 300;

/// A segment that is larger is not appended to any more.
const FULL_SEGMENT: u64 = 256 << 20;

/// So many bytes of records are written at once when segments are rewritten.
const REWRITE_BATCH: usize = 16 << 20;

/// Where a payload lies.
#[derive(Debug, Clone, Copy)]
struct Place {
    offset: u64,
    check: u64,
    segment: u32,
    length: u32,
    generation: u32,
}

struct Segment {
    path: PathBuf,
    file: File,
    /// The end of the last whole record that was seen.
    end: u64,
    /// Whether it begins as a segment should; others are read, but not appended to.
    is_sound: bool,
    /// The segment up to where it was scanned last; what was appended since is read from the file.
    map: Option<Mmap>,
}

type Subject = (RecordKind, Digest);

/// All segments of a store.
pub struct Log {
    disk: Disk,
    dir: PathBuf,
    segments: Vec<Segment>,
    index: HashMap<Subject, Place, BuildHasherDefault<DigestHasher>>,
    /// Generations of records that turned out to be damaged, so that what replaces them wins.
    lost: HashMap<Subject, u32, BuildHasherDefault<DigestHasher>>,
    /// The segment that this process appends to, with its lock.
    own: Option<usize>,
    /// What was found damaged, for people.
    damage: Vec<String>,
}

impl Log {
    pub fn open(disk: &Disk, dir: &Path) -> Result<Self, StoreError> {
        let mut log = Self {
            disk: disk.clone(),
            dir: dir.to_owned(),
            segments: Vec::new(),
            index: HashMap::default(),
            lost: HashMap::default(),
            own: None,
            damage: Vec::new(),
        };
        log.refresh()?;
        Ok(log)
    }

    /// Reads what was appended since, by whomever.
    ///
    /// Lists the folder every time: its time of change is too coarse to tell whether a segment has
    /// come in the same tick of the clock.
    pub fn refresh(&mut self) -> Result<(), StoreError> {
        let paths = match self.disk.list(&self.dir) {
            Ok(paths) => paths,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
            Err(error) => return Err(StoreError::new("read", &self.dir)(error)),
        };
        for path in paths.into_iter().filter(|it| is_segment(it)) {
            if self.segments.iter().any(|it| it.path == path) {
                continue;
            }
            match self.disk.open(&path) {
                Ok(file) => self.push_segment(path, file, 0),
                // Housekeeping has removed it since the folder was listed.
                Err(error) if error.kind() == io::ErrorKind::NotFound => {}
                Err(error) => return Err(StoreError::new("read", &path)(error)),
            }
        }
        for segment in 0..self.segments.len() {
            if self.own != Some(segment) {
                self.scan(segment)?;
            }
        }
        Ok(())
    }

    fn push_segment(&mut self, path: PathBuf, file: File, end: u64) {
        self.segments.push(Segment { path, file, end, is_sound: true, map: None });
    }

    /// Indexes the whole records after the segment's known end.
    ///
    /// A damaged record costs only itself: the next one is looked for behind it.
    fn scan(&mut self, index: usize) -> Result<(), StoreError> {
        let segment = &mut self.segments[index];
        let fail = |path: &Path| StoreError::new("read", path);
        let length = self.disk.length(&segment.file, &segment.path).map_err(fail(&segment.path))?;
        if length <= segment.end.max(MAGIC.len() as u64) {
            return Ok(());
        }
        // SAFETY: segments only grow while a store is open (torn records are cut off by the holder
        // of the segment's lock, and never below what was indexed), so the mapped bytes stay.
        let map = unsafe { self.disk.map(&segment.file, &segment.path) };
        let map = map.map_err(fail(&segment.path))?;
        if (map.len() as u64) < length {
            return Err(fail(&segment.path)(io::ErrorKind::UnexpectedEof.into()));
        }
        if segment.end == 0 {
            segment.is_sound = map.starts_with(MAGIC);
            if !segment.is_sound {
                let path = segment.path.display();
                self.damage.push(format!("`{path}` does not begin as a segment of the log"));
            }
            segment.end = MAGIC.len() as u64;
        }
        self.index.reserve(map.len().saturating_sub(segment.end as usize) / USUAL_RECORD);
        loop {
            let Some(header) = read_header(&map, segment.end) else {
                let Some(next) = next_record(&map, segment.end) else { break };
                let (path, from) = (segment.path.display(), segment.end);
                self.damage.push(format!("`{path}`: bytes {from} to {next} are damaged"));
                segment.end = next;
                continue;
            };
            let offset = segment.end + HEADER as u64;
            segment.end = (offset + u64::from(header.length)).next_multiple_of(8);
            if let Some(kind) = header.kind {
                let place = Place {
                    offset,
                    check: header.check,
                    segment: index as u32,
                    length: header.length,
                    generation: header.generation,
                };
                let held = self.index.entry((kind, header.digest)).or_insert(place);
                if place.generation >= held.generation {
                    *held = place;
                }
            }
        }
        segment.map = Some(map);
        Ok(())
    }

    pub fn has(&self, kind: RecordKind, digest: &Digest) -> bool {
        self.index.contains_key(&(kind, *digest))
    }

    /// Drops a record that turned out to be damaged.
    pub fn forget(&mut self, kind: RecordKind, digest: &Digest) {
        let Some(place) = self.index.remove(&(kind, *digest)) else { return };
        self.lost.insert((kind, *digest), place.generation);
        let path = self.segments[place.segment as usize].path.display();
        self.damage.push(format!("`{path}`: the record at byte {} is damaged", place.offset));
    }

    /// What was found damaged since this was asked last.
    pub fn take_damage(&mut self) -> Vec<String> {
        std::mem::take(&mut self.damage)
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
    pub fn get(&mut self, kind: RecordKind, digest: &Digest) -> Option<Vec<u8>> {
        self.view(kind, digest, <[u8]>::to_vec)
    }

    /// Looks at the payload of the newest record where it lies, if it is whole.
    pub fn view<T>(
        &mut self,
        kind: RecordKind,
        digest: &Digest,
        look: impl FnOnce(&[u8]) -> T,
    ) -> Option<T> {
        let place = *self.index.get(&(kind, *digest))?;
        let payload = self.read(&place).ok().filter(|it| check_of(it) == place.check);
        let res = payload.map(|it| look(&it));
        if res.is_none() {
            self.forget(kind, digest);
        }
        res
    }

    fn read(&self, place: &Place) -> io::Result<Cow<'_, [u8]>> {
        let segment = &self.segments[place.segment as usize];
        let range = place.offset as usize..place.offset as usize + place.length as usize;
        if let Some(mapped) = segment.map.as_ref().and_then(|it| it.get(range)) {
            return Ok(mapped.into());
        }
        let mut payload = vec![0; place.length as usize];
        self.disk.read_at(&segment.file, &segment.path, &mut payload, place.offset)?;
        Ok(payload.into())
    }

    /// Appends records with one write; either all of them or none.
    pub fn append(&mut self, records: &[(RecordKind, Digest, Vec<u8>)]) -> Result<(), StoreError> {
        let generations: Vec<u32> = records
            .iter()
            .map(|(kind, digest, _)| {
                let subject = (*kind, *digest);
                let replaced = self.index.get(&subject).map(|it| it.generation);
                let replaced = replaced.max(self.lost.get(&subject).copied());
                replaced.map_or(0, |it| (it + 1).min(MAX_GENERATION))
            })
            .collect();
        self.append_as(records, &generations)
    }

    /// Appends records of given generations.
    fn append_as(
        &mut self,
        records: &[(RecordKind, Digest, Vec<u8>)],
        generations: &[u32],
    ) -> Result<(), StoreError> {
        if records.is_empty() {
            return Ok(());
        }
        let own = self.own_segment()?;
        let start = self.segments[own].end;
        let mut buffer = Vec::new();
        let mut places = Vec::new();
        for ((kind, digest, payload), &generation) in records.iter().zip(generations) {
            let check = write_header(&mut buffer, *kind, generation, digest, payload);
            let offset = start + buffer.len() as u64;
            let length = payload.len() as u32;
            let place = Place { offset, check, segment: own as u32, length, generation };
            places.push(((*kind, *digest), place));
            buffer.extend_from_slice(payload);
            buffer.resize(buffer.len().next_multiple_of(8), 0);
        }
        let segment = &mut self.segments[own];
        if let Err(error) = self.disk.write_at(&segment.file, &segment.path, &buffer, start) {
            // A full disk: cut off what fitted, so that the segment ends with a whole record.
            let _ = self.disk.cut(&segment.file, &segment.path, start);
            return Err(StoreError::new("write", &segment.path)(error));
        }
        segment.end = start + buffer.len() as u64;
        self.index.extend(places);
        Ok(())
    }

    /// The segment to append to: ours, one that nobody appends to, or a new one.
    fn own_segment(&mut self) -> Result<usize, StoreError> {
        if let Some(own) = self.own {
            if is_removed(&self.segments[own].file) {
                let path = self.dir.display();
                self.damage.push(format!("`{path}` was removed while it was in use"));
            } else if self.segments[own].end <= FULL_SEGMENT {
                return Ok(own);
            }
            self.own = None;
        }
        for index in 0..self.segments.len() {
            if self.take_over(index)? {
                self.own = Some(index);
                return Ok(index);
            }
        }
        self.new_segment()
    }

    /// Takes over a segment that nobody appends to; a torn record at its end is cut off.
    fn take_over(&mut self, index: usize) -> Result<bool, StoreError> {
        let segment = &self.segments[index];
        let path = segment.path.clone();
        if !segment.is_sound || segment.end > FULL_SEGMENT {
            return Ok(false);
        }
        let Ok(file) = self.disk.open_to_write(&path) else { return Ok(false) };
        if !self.disk.try_lock(&file, &path).unwrap_or(false) || !is_at(&file, &path) {
            return Ok(false);
        }
        self.scan(index)?;
        let fail = || StoreError::new("write", &path);
        let length = self.disk.length(&file, &path).map_err(fail())?;
        let segment = &mut self.segments[index];
        if !segment.is_sound {
            return Ok(false);
        }
        if segment.end == 0 {
            // Its maker was killed before its first word.
            self.disk.write_at(&file, &path, MAGIC, 0).map_err(fail())?;
            segment.end = MAGIC.len() as u64;
        } else if length > segment.end {
            let (n, end) = (length - segment.end, segment.end);
            self.damage.push(format!("`{}`: cut off {n} torn bytes at byte {end}", path.display()));
            self.disk.cut(&file, &path, end).map_err(fail())?;
        }
        segment.file = file;
        Ok(true)
    }

    fn new_segment(&mut self) -> Result<usize, StoreError> {
        let (path, file) = self.disk.in_folder(&self.dir, || self.new_file())?;
        let fail = |what| StoreError::new(what, &path);
        if !self.disk.try_lock(&file, &path).map_err(fail("lock"))? {
            // Another was quicker to take over the empty file.
            return self.new_segment();
        }
        self.disk.write_at(&file, &path, MAGIC, 0).map_err(fail("write"))?;
        self.push_segment(path, file, MAGIC.len() as u64);
        self.own = Some(self.segments.len() - 1);
        Ok(self.segments.len() - 1)
    }

    /// An empty file for a segment, with a name that nobody has.
    fn new_file(&self) -> Result<(PathBuf, File), StoreError> {
        loop {
            // Numbered, so that whoever looks can tell old from new; the order does not matter.
            let name = format!("{:04}-{}.log", self.segments.len(), unique_word());
            let path = self.dir.join(name);
            match self.disk.create_new(&path) {
                Ok(file) => return Ok((path, file)),
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
                Err(error) => return Err(StoreError::new("make", &path)(error)),
            }
        }
    }

    /// Writes the records that `keeps` chooses into a new segment and removes those they were in.
    ///
    /// Segments that running processes append to stay as they are. A crash on the way leaves
    /// records twice, not less.
    pub fn rewrite(
        &mut self,
        keeps: impl Fn(RecordKind, &Digest) -> bool,
    ) -> Result<(), StoreError> {
        let free = self.free_segments();
        let mut subjects: Vec<(Subject, Place)> = self
            .index
            .iter()
            .filter(|it| free.iter().any(|(index, _)| *index == it.1.segment as usize))
            .filter(|it| keeps(it.0.0, &it.0.1))
            .map(|it| (*it.0, *it.1))
            .collect();
        subjects.sort_by_key(|((kind, digest), _)| (*kind as u8, *digest));
        self.own = None;
        if !subjects.is_empty() {
            self.new_segment()?;
        }
        let (mut records, mut generations, mut n_bytes) = (Vec::new(), Vec::new(), 0);
        for ((kind, digest), place) in subjects {
            let Some(payload) = self.get(kind, &digest) else { continue };
            n_bytes += payload.len();
            records.push((kind, digest, payload));
            generations.push(place.generation);
            if n_bytes > REWRITE_BATCH {
                self.append_as(&records, &generations)?;
                (records, generations, n_bytes) = (Vec::new(), Vec::new(), 0);
            }
        }
        self.append_as(&records, &generations)?;
        for (index, _lock) in free {
            let path = &self.segments[index].path;
            self.disk.remove(path).map_err(StoreError::new("remove", path))?;
        }
        Ok(())
    }

    /// The segments that no running process appends to, with their locks.
    fn free_segments(&self) -> Vec<(usize, File)> {
        let lock = |(index, segment): (usize, &Segment)| {
            let file = self.disk.open_to_write(&segment.path).ok()?;
            let is_free = self.disk.try_lock(&file, &segment.path).ok()?;
            (is_free && is_at(&file, &segment.path)).then_some((index, file))
        };
        self.segments.iter().enumerate().filter_map(lock).collect()
    }

    /// Tells which records lie in segments that running processes append to.
    pub fn held(&self) -> impl Fn(RecordKind, &Digest) -> bool + '_ {
        let free: Vec<u32> = self.free_segments().iter().map(|it| it.0 as u32).collect();
        move |kind, digest| {
            self.index.get(&(kind, *digest)).is_some_and(|it| !free.contains(&it.segment))
        }
    }

    /// The paths of all segments.
    pub fn paths(&self) -> impl Iterator<Item = &Path> {
        self.segments.iter().map(|it| it.path.as_path())
    }
}

fn is_segment(path: &Path) -> bool {
    path.extension().is_some_and(|it| it == "log")
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
