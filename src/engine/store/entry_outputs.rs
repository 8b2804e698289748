//! What an entry says of its artifacts, read where it lies.

use std::borrow::Cow;

use serde::Deserialize;

use crate::engine::digest::Digest;

/// The artifacts of an entry, and what was left out.
#[derive(Debug, PartialEq, Deserialize)]
pub struct EntryOutputs<'a> {
    #[serde(borrow)]
    pub outputs: Vec<OutputView<'a>>,
    #[serde(default)]
    pub absent: Vec<(String, String)>,
}

/// An [`EntryOutput`](super::EntryOutput) where it lies.
#[derive(Debug, PartialEq, Deserialize)]
pub struct OutputView<'a> {
    #[serde(borrow)]
    pub port: Cow<'a, str>,
    #[serde(borrow, rename = "type")]
    pub ty: Cow<'a, str>,
    pub digest: Digest,
    pub bytes: u64,
}

impl<'a> EntryOutputs<'a> {
    /// Reads the stored form of an entry: its first line.
    pub fn read(payload: &'a [u8]) -> Option<Self> {
        let line = payload.split(|&it| it == b'\n').next()?;
        let plain = std::str::from_utf8(line).ok().and_then(Self::read_plain);
        plain.or_else(|| serde_json::from_slice(line).ok())
    }

    /// Reads a line that is written as nearly all are; `None` for any other. A run that has nothing to
    /// do reads one for every instance, and a general parser takes six times as long.
    fn read_plain(line: &'a str) -> Option<Self> {
        let mut rest = line.strip_prefix("{\"outputs\":[")?;
        let mut outputs = Vec::with_capacity(1);
        if !rest.starts_with(']') {
            loop {
                let (output, behind) = OutputView::read_plain(rest)?;
                outputs.push(output);
                match behind.strip_prefix(',') {
                    Some(next) => rest = next,
                    None => {
                        rest = behind;
                        break;
                    }
                }
            }
        }
        // What was left out would come first.
        let has_no_more = rest.starts_with("],\"notes\":[") || rest.starts_with("],\"wall_secs\":");
        has_no_more.then_some(Self { outputs, absent: Vec::new() })
    }
}

impl<'a> OutputView<'a> {
    /// The output at the beginning of a text, and what stands behind it.
    fn read_plain(text: &'a str) -> Option<(Self, &'a str)> {
        let (port, rest) = plain_text(text.strip_prefix("{\"port\":\"")?)?;
        let (ty, rest) = plain_text(rest.strip_prefix(",\"type\":\"")?)?;
        let (digest, rest) = plain_text(rest.strip_prefix(",\"digest\":\"")?)?;
        let (bytes, rest) = rest.strip_prefix(",\"bytes\":")?.split_once('}')?;
        let output = Self {
            port: port.into(),
            ty: ty.into(),
            digest: digest.parse().ok()?,
            bytes: bytes.parse().ok()?,
        };
        Some((output, rest))
    }
}

/// A text without escapes up to its closing quote, and what stands behind that.
fn plain_text(text: &str) -> Option<(&str, &str)> {
    let end = text.bytes().position(|it| it == b'"' || it == b'\\')?;
    let rest = text[end..].strip_prefix('"')?;
    Some((&text[..end], rest))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::store::{Entry, EntryOutput};

    fn entry(ports: &[&str], absent: &[&str], notes: &[&str]) -> Entry {
        let output = |port: &&str| EntryOutput {
            port: (*port).to_owned(),
            ty: "number".to_owned(),
            digest: Digest::of(port.as_bytes()),
            bytes: port.len() as u64,
        };
        Entry {
            key: "{}".to_owned(),
            outputs: ports.iter().map(output).collect(),
            absent: absent.iter().map(|it| ((*it).to_owned(), "why".to_owned())).collect(),
            notes: notes.iter().map(|it| (*it).to_owned()).collect(),
            wall_secs: 1.5,
            made: 7,
            run: "run".to_owned(),
        }
    }

    /// Whether an entry is plain; what is read must be what a general parser reads.
    fn check(entry: &Entry, is_plain: bool) {
        let payload = entry.to_payload();
        let line = payload.split(|&it| it == b'\n').next().unwrap();
        let plain = EntryOutputs::read_plain(std::str::from_utf8(line).unwrap());
        let expected: EntryOutputs<'_> = serde_json::from_slice(line).unwrap();
        assert_eq!(plain.is_some(), is_plain, "{entry:?}");
        assert_eq!(plain.unwrap_or(EntryOutputs::read(&payload).unwrap()), expected);
        assert_eq!(EntryOutputs::read(&payload).unwrap(), expected);
    }

    #[test]
    fn entries_are_read_as_a_general_parser_reads_them() {
        check(&entry(&["mesh"], &[], &[]), true);
        check(&entry(&["mesh", "skin_weights"], &[], &["a \"note\" of\n two lines"]), true);
        check(&entry(&[], &[], &[]), true);
        check(&entry(&["mesh"], &["basis"], &[]), false);
        check(&entry(&["quoted\"\\"], &[], &[]), false);
    }

    #[test]
    fn what_is_no_entry_is_not_read() {
        let payload = entry(&["mesh", "basis"], &[], &[]).to_payload();
        let end = payload.iter().position(|&it| it == b'\n').unwrap();
        for length in 0..end {
            let torn = std::str::from_utf8(&payload[..length]).unwrap();
            // The rest of the line is not looked at: the record's check tells whether it is whole.
            let is_read = EntryOutputs::read_plain(torn).is_some();
            assert_eq!(is_read, torn.contains("],\"wall_secs\":"), "{torn}");
        }
    }
}
