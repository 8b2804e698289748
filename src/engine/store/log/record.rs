//! A record as it lies in a segment.

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
    /// State of an object's file -> digest of the object that it was found to be.
    Checked = 7,
    LastKeys = 8,
}

impl RecordKind {
    const ALL: [Self; 8] = [
        Self::Entry,
        Self::Object,
        Self::FileDigest,
        Self::LastKey,
        Self::Exported,
        Self::Facts,
        Self::Checked,
        Self::LastKeys,
    ];
}

/// A record: payload length (4 bytes), kind (1), generation (3), digest (32), check of the payload
/// (8), check of these 48 bytes (8), payload, zeros up to a multiple of 8.
///
/// The generation orders records of one kind and digest, in whichever segments they are: a record
/// that replaces another has a larger one. No clock has a say in it.
pub const HEADER: usize = 56;

pub const MAX_GENERATION: u32 = (1 << 24) - 1;

/// Appends a record's header and returns the payload's check.
pub fn write_header(
    buffer: &mut Vec<u8>,
    kind: RecordKind,
    generation: u32,
    digest: &Digest,
    payload: &[u8],
) -> u64 {
    let start = buffer.len();
    let check = check_of(payload);
    buffer.extend_from_slice(&(payload.len() as u32).to_le_bytes());
    buffer.extend_from_slice(&(u32::from(kind as u8) | generation << 8).to_le_bytes());
    buffer.extend_from_slice(&digest.0);
    buffer.extend_from_slice(&check.to_le_bytes());
    let header_check = check_of(&buffer[start..]);
    buffer.extend_from_slice(&header_check.to_le_bytes());
    check
}

pub struct Header {
    /// `None` if this version does not know it.
    pub kind: Option<RecordKind>,
    pub generation: u32,
    pub digest: Digest,
    pub check: u64,
    pub length: u32,
}

/// The header of a whole record.
pub fn read_header(map: &[u8], at: u64) -> Option<Header> {
    let at = usize::try_from(at).ok()?;
    let header = map.get(at..at + HEADER)?;
    let number = |range: std::ops::Range<usize>| {
        u64::from_le_bytes(header[range].try_into().expect("eight bytes"))
    };
    let length = u32::from_le_bytes(header[..4].try_into().expect("four bytes"));
    map.get(at + HEADER..at + HEADER + length as usize)?;
    if number(48..56) != check_of(&header[..48]) {
        return None;
    }
    let word = u32::from_le_bytes(header[4..8].try_into().expect("four bytes"));
    Some(Header {
        kind: RecordKind::ALL.into_iter().find(|&it| it as u8 == word as u8),
        generation: word >> 8,
        digest: Digest(header[8..40].try_into().expect("a digest has 32 bytes")),
        check: number(40..48),
        length,
    })
}

/// Where the next whole record begins behind bytes that are none.
pub fn next_record(map: &[u8], at: u64) -> Option<u64> {
    let ends = (map.len() as u64).saturating_sub(HEADER as u64);
    (at + 8..=ends).step_by(8).find(|&it| {
        // Most bytes are ruled out by the kind, before their check is computed.
        let kind = map[it as usize + 4];
        RecordKind::ALL.iter().any(|it| *it as u8 == kind) && read_header(map, it).is_some()
    })
}

pub fn check_of(bytes: &[u8]) -> u64 {
    let digest = blake3::hash(bytes);
    u64::from_le_bytes(digest.as_bytes()[..8].try_into().expect("a digest has 32 bytes"))
}
