//! Numbers and texts in a row: what a snapshot is made of.

use std::{collections::HashMap, sync::Arc};

use crate::engine::{digest::Digest, shared_text::SharedText};

/// Writes numbers into one row and texts into another.
#[derive(Default)]
pub struct Writer {
    numbers: Vec<u8>,
    texts: String,
    /// Names that were written once are numbers afterwards.
    names: HashMap<Box<str>, usize>,
}

impl Writer {
    /// Seven bits a byte, the last one without the eighth.
    pub fn number(&mut self, number: impl TryInto<u64>) {
        let mut rest =
            number.try_into().ok().expect("lengths and positions are no more than 64 bits");
        while rest >= 0x80 {
            self.numbers.push(rest as u8 | 0x80);
            rest >>= 7;
        }
        self.numbers.push(rest as u8);
    }

    pub fn flag(&mut self, flag: bool) {
        self.numbers.push(u8::from(flag));
    }

    pub fn digest(&mut self, digest: &Digest) {
        self.numbers.extend_from_slice(&digest.0);
    }

    pub fn text(&mut self, text: &str) {
        self.number(text.len());
        self.texts.push_str(text);
    }

    /// A text that is written often.
    pub fn name(&mut self, name: &str) {
        match self.names.get(name) {
            Some(&known) => self.number(known + 1),
            None => {
                self.number(0_usize);
                self.text(name);
                self.names.insert(name.into(), self.names.len());
            }
        }
    }

    /// Both rows.
    pub fn finish(self) -> Vec<u8> {
        let mut res = (self.numbers.len() as u64).to_le_bytes().to_vec();
        res.extend(self.numbers);
        res.extend(self.texts.into_bytes());
        res
    }
}

/// Reads what a [`Writer`] wrote, in the same order; `None` where it cannot be that.
pub struct Reader<'a> {
    numbers: &'a [u8],
    texts: Arc<str>,
    /// Where the next text begins.
    at: usize,
    names: Vec<Arc<str>>,
}

impl<'a> Reader<'a> {
    pub fn new(bytes: &'a [u8]) -> Option<Self> {
        let (length, rest) = bytes.split_first_chunk::<8>()?;
        let length = usize::try_from(u64::from_le_bytes(*length)).ok()?;
        let (numbers, texts) = rest.split_at_checked(length)?;
        let texts = std::str::from_utf8(texts).ok().filter(|it| u32::try_from(it.len()).is_ok())?;
        Some(Self { numbers, texts: texts.into(), at: 0, names: Vec::new() })
    }

    pub fn number(&mut self) -> Option<usize> {
        let (mut res, mut shift) = (0_u64, 0);
        loop {
            let (&byte, rest) = self.numbers.split_first()?;
            self.numbers = rest;
            res |= u64::from(byte & 0x7f).checked_shl(shift)?;
            if byte < 0x80 {
                return usize::try_from(res).ok();
            }
            shift += 7;
        }
    }

    /// How many things follow. Each takes a byte at least, so that no number asks for too much memory.
    pub fn count(&mut self) -> Option<usize> {
        self.number().filter(|it| *it <= self.numbers.len())
    }

    pub fn flag(&mut self) -> Option<bool> {
        match self.number()? {
            0 => Some(false),
            1 => Some(true),
            _ => None,
        }
    }

    pub fn digest(&mut self) -> Option<Digest> {
        let (digest, rest) = self.numbers.split_first_chunk::<32>()?;
        self.numbers = rest;
        Some(Digest(*digest))
    }

    pub fn text(&mut self) -> Option<&str> {
        let start = self.skip_text()?;
        Some(&self.texts[start..self.at])
    }

    /// The same without a copy.
    pub fn shared_text(&mut self) -> Option<SharedText> {
        let start = self.skip_text()?;
        Some(SharedText::part(&self.texts, start..self.at))
    }

    fn skip_text(&mut self) -> Option<usize> {
        let (start, length) = (self.at, self.number()?);
        self.at = start.checked_add(length)?;
        self.texts.get(start..self.at)?;
        Some(start)
    }

    pub fn name(&mut self) -> Option<Arc<str>> {
        match self.number()? {
            0 => {
                let name: Arc<str> = self.text()?.into();
                self.names.push(Arc::clone(&name));
                Some(name)
            }
            known => self.names.get(known - 1).cloned(),
        }
    }

    /// Whether all was read.
    pub fn is_at_end(&self) -> bool {
        self.numbers.is_empty() && self.at == self.texts.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read() {
        let numbers = [0, 1, 127, 128, 300, u64::MAX];
        let digest = Digest::of(b"x");
        let mut writer = Writer::default();
        numbers.iter().for_each(|it| writer.number(*it));
        writer.flag(true);
        writer.digest(&digest);
        for name in ["mesh", "basis", "mesh"] {
            writer.name(name);
        }
        writer.text("Größe");
        let bytes = writer.finish();
        let mut reader = Reader::new(&bytes).unwrap();
        for number in numbers {
            assert_eq!(reader.number(), usize::try_from(number).ok());
        }
        assert_eq!((reader.flag(), reader.digest()), (Some(true), Some(digest)));
        let names: Vec<Arc<str>> = (0..3).map(|_| reader.name().unwrap()).collect();
        assert_eq!(names, ["mesh".into(), "basis".into(), "mesh".into()]);
        assert!(Arc::ptr_eq(&names[0], &names[2]) && !reader.is_at_end());
        assert_eq!(reader.text(), Some("Größe"));
        assert!(reader.is_at_end());
        assert_eq!(reader.text(), None);
        assert_eq!((reader.number(), reader.digest()), (None, None));
    }
}
