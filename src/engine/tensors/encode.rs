//! Writes arrays and texts as one file.

use std::{borrow::Cow, collections::BTreeMap};

use serde_json::{Map, Value};

use super::{Number, RawArray};

/// Collects the arrays and texts of one artifact.
#[derive(Default)]
pub struct Encoder<'a> {
    /// Put before every name: `mesh.` inside of a part.
    prefix: String,
    arrays: Vec<(String, RawArray<'a>)>,
    texts: BTreeMap<String, String>,
}

impl<'a> Encoder<'a> {
    /// Adds an array in row-major order, borrowed until the file is written.
    ///
    /// # Panics
    /// If the shape does not hold as many numbers as are given.
    pub fn array<T: Number>(&mut self, name: &str, shape: &[usize], values: &'a [T]) {
        assert_eq!(shape.iter().product::<usize>(), values.len(), "`{name}`: shape and numbers");
        self.add::<T>(name, shape, Cow::Borrowed(bytemuck::cast_slice(values)));
    }

    /// Adds an array that was made for the file.
    ///
    /// # Panics
    /// If the shape does not hold as many numbers as are given.
    pub fn owned<T: Number>(&mut self, name: &str, shape: &[usize], values: Vec<T>) {
        assert_eq!(shape.iter().product::<usize>(), values.len(), "`{name}`: shape and numbers");
        let bytes = match bytemuck::allocation::try_cast_vec(values) {
            Ok(bytes) => bytes,
            Err((_, values)) => bytemuck::cast_slice(&values).to_vec(),
        };
        self.add::<T>(name, shape, Cow::Owned(bytes));
    }

    fn add<T: Number>(&mut self, name: &str, shape: &[usize], bytes: Cow<'a, [u8]>) {
        let array = RawArray { dtype: T::DTYPE, shape: shape.to_vec(), bytes };
        self.arrays.push((self.full_name(name), array));
    }

    /// Adds a text.
    pub fn text(&mut self, name: &str, value: impl Into<String>) {
        self.texts.insert(self.full_name(name), value.into());
    }

    /// Adds a list of texts, stored as one JSON text.
    pub fn texts(&mut self, name: &str, values: &[String]) {
        self.text(name, serde_json::to_string(values).expect("texts are plain data"));
    }

    /// Adds what `write` adds as a part: `name.` comes before all its names.
    pub fn part(&mut self, name: &str, write: impl FnOnce(&mut Self)) {
        let outer = self.prefix.len();
        self.prefix = format!("{}{name}.", self.prefix);
        write(self);
        self.prefix.truncate(outer);
    }

    fn full_name(&self, name: &str) -> String {
        format!("{}{name}", self.prefix)
    }

    /// Writes the file.
    pub fn finish(mut self) -> Vec<u8> {
        let header = self.header();
        let n_bytes = self.arrays.iter().map(|it| it.1.bytes.len()).sum::<usize>();
        let mut res = Vec::with_capacity(header.len() + n_bytes);
        res.extend(header);
        for (_, array) in &self.arrays {
            res.extend_from_slice(&array.bytes);
        }
        res
    }

    /// Whether the file would have these bytes. It is not written for that.
    pub fn is(mut self, bytes: &[u8]) -> bool {
        let header = self.header();
        let arrays = self.arrays.iter().map(|it| &*it.1.bytes);
        let rest = std::iter::once(&header[..]).chain(arrays).try_fold(bytes, |rest, piece| {
            match rest.split_at_checked(piece.len()) {
                // A piece of the file itself need not be compared.
                Some((start, rest)) if std::ptr::eq(start, piece) || start == piece => Some(rest),
                _ => None,
            }
        });
        rest.is_some_and(<[u8]>::is_empty)
    }

    /// Puts the arrays into their order; what stands before them.
    fn header(&mut self) -> Vec<u8> {
        self.arrays.sort_by_key(|it| std::cmp::Reverse(it.1.dtype.size()));
        let mut header = Map::new();
        let texts = std::mem::take(&mut self.texts).into_iter();
        let texts = texts.map(|(k, v)| (k, Value::String(v)));
        header.insert("__metadata__".to_owned(), Value::Object(texts.collect()));
        let mut offset = 0;
        for (name, RawArray { dtype, shape, bytes }) in &self.arrays {
            let end = offset + bytes.len();
            let entry = serde_json::json!({
                "dtype": dtype.name(), "shape": shape, "data_offsets": [offset, end],
            });
            assert!(header.insert(name.clone(), entry).is_none(), "`{name}` is given twice");
            offset = end;
        }
        let mut header = serde_json::to_vec(&header).expect("the header is plain data");
        // Spaces, as the format allows, so that the arrays are aligned.
        header.resize(header.len().next_multiple_of(8), b' ');
        let mut res = (header.len() as u64).to_le_bytes().to_vec();
        res.extend(header);
        res
    }
}
