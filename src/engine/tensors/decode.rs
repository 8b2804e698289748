//! Reads arrays and texts, and believes nothing.

use std::{borrow::Cow, collections::BTreeMap};

use serde_json::{Map, Value};

use super::{
    Dtype, Number,
    foreign::{Narrow, converted},
};

/// Reads the arrays and texts of one artifact. Checks every offset, so that garbage is refused.
pub struct Decoder<'a> {
    arrays: Vec<(String, RawArray<'a>)>,
    texts: BTreeMap<String, String>,
    /// Numbers of another type than is asked for are converted where that changes no value.
    converts: bool,
}

impl<'a> Decoder<'a> {
    /// # Errors
    /// If the header does not describe the bytes exactly.
    pub fn new(bytes: &'a [u8]) -> Result<Self, DecodeError> {
        Self::read(bytes, false)
    }

    /// Reads a file that another program wrote: its header may list the arrays in any order, and numbers
    /// may have any type that holds the same values (`numpy` counts in 64 bits).
    ///
    /// # Errors
    /// If the header does not describe the bytes exactly.
    pub fn foreign(bytes: &'a [u8]) -> Result<Self, DecodeError> {
        Self::read(bytes, true)
    }

    fn read(bytes: &'a [u8], foreign: bool) -> Result<Self, DecodeError> {
        let fail = |what: &str| DecodeError(format!("the file is damaged: {what}"));
        let (length, rest) = bytes
            .split_first_chunk::<8>()
            .ok_or_else(|| fail(&format!("{} bytes are too few for a header", bytes.len())))?;
        let length = usize::try_from(u64::from_le_bytes(*length))
            .ok()
            .filter(|&it| it <= rest.len())
            .ok_or_else(|| fail("the header is cut off"))?;
        let (header, data) = rest.split_at(length);
        let header: Map<String, Value> =
            serde_json::from_slice(header).map_err(|e| fail(&format!("header: {e}")))?;
        let mut res = Self { arrays: Vec::new(), texts: BTreeMap::new(), converts: foreign };
        let mut entries = Vec::new();
        for (name, entry) in header {
            if name == "__metadata__" {
                res.texts = serde_json::from_value(entry)
                    .map_err(|e| fail(&format!("`__metadata__`: {e}")))?;
                continue;
            }
            let (array, range) = read_entry(&entry, data, foreign)
                .ok_or_else(|| fail(&format!("the entry of array `{name}`")))?;
            entries.push((name, array, range));
        }
        if foreign {
            entries.sort_by_key(|it| it.2);
        }
        let mut expected = 0;
        for (name, array, range) in entries {
            if range.0 != expected {
                return Err(fail(&format!("array `{name}` starts at {}", range.0)));
            }
            expected = range.1;
            res.arrays.push((name, array));
        }
        if expected != data.len() {
            let message = format!("{} bytes of arrays instead of {expected}", data.len());
            return Err(fail(&message));
        }
        Ok(res)
    }

    /// A part that was written by [`Encoder::part`].
    pub fn part(&self, name: &str) -> Self {
        let inner = |full: &str| Some(full.strip_prefix(name)?.strip_prefix('.')?.to_owned());
        let arrays = self.arrays.iter().filter_map(|(k, v)| Some((inner(k)?, v.clone())));
        let texts = self.texts.iter().filter_map(|(k, v)| Some((inner(k)?, v.clone())));
        Self { arrays: arrays.collect(), texts: texts.collect(), converts: self.converts }
    }

    /// All arrays, in the order of the file.
    pub fn arrays(&self) -> impl Iterator<Item = (&str, &RawArray<'a>)> {
        self.arrays.iter().map(|(name, array)| (name.as_str(), array))
    }

    /// All texts, by name.
    pub fn all_texts(&self) -> &BTreeMap<String, String> {
        &self.texts
    }

    /// An array by its name.
    ///
    /// # Errors
    /// If it is missing or has numbers of another type.
    pub fn array<T: Number>(&self, name: &str) -> Result<Array<'a, T>, DecodeError> {
        let (_, raw) = self
            .arrays
            .iter()
            .find(|it| it.0 == name)
            .ok_or_else(|| DecodeError(format!("array `{name}` is missing")))?;
        let values = match &raw.bytes {
            _ if raw.dtype != T::DTYPE && self.converts => Cow::Owned(converted(name, raw)?),
            _ if raw.dtype != T::DTYPE => {
                let (found, wanted) = (raw.dtype.name(), T::DTYPE.name());
                return Err(DecodeError(format!("array `{name}` is {found} instead of {wanted}")));
            }
            Cow::Borrowed(bytes) => match bytemuck::try_cast_slice(bytes) {
                Ok(values) => Cow::Borrowed(values),
                Err(_) => Cow::Owned(bytemuck::pod_collect_to_vec(bytes)),
            },
            Cow::Owned(bytes) => Cow::Owned(bytemuck::pod_collect_to_vec(bytes)),
        };
        Ok(Array { shape: raw.shape.clone(), values })
    }

    /// A one-dimensional array.
    ///
    /// # Errors
    /// As [`Decoder::array`], or if it has another number of dimensions.
    pub fn vector<T: Number>(&self, name: &str) -> Result<Cow<'a, [T]>, DecodeError> {
        let array = self.array::<T>(name)?;
        match array.shape[..] {
            [_] => Ok(array.values),
            _ => Err(DecodeError(format!("array `{name}` has the shape {:?}", array.shape))),
        }
    }

    /// A two-dimensional array: its rows, its columns, and its numbers row by row.
    ///
    /// # Errors
    /// As [`Decoder::array`], or if it has another number of dimensions.
    pub fn matrix<T: Number>(
        &self,
        name: &str,
    ) -> Result<(usize, usize, Cow<'a, [T]>), DecodeError> {
        let array = self.array::<T>(name)?;
        match array.shape[..] {
            [n_rows, n_cols] => Ok((n_rows, n_cols, array.values)),
            _ => Err(DecodeError(format!("array `{name}` has the shape {:?}", array.shape))),
        }
    }

    /// A text by its name.
    ///
    /// # Errors
    /// If it is missing.
    pub fn text(&self, name: &str) -> Result<&str, DecodeError> {
        self.texts
            .get(name)
            .map(String::as_str)
            .ok_or_else(|| DecodeError(format!("text `{name}` is missing")))
    }

    /// A list of texts by its name.
    ///
    /// # Errors
    /// If it is missing or no list.
    pub fn texts(&self, name: &str) -> Result<Vec<String>, DecodeError> {
        serde_json::from_str(self.text(name)?)
            .map_err(|e| DecodeError(format!("text `{name}` is no list of texts: {e}")))
    }
}

/// One array of a file.
#[derive(Debug, Clone)]
pub struct Array<'a, T: Number> {
    pub shape: Vec<usize>,
    /// Row-major; borrowed from the file where its bytes are aligned.
    pub values: Cow<'a, [T]>,
}

/// An array as it lies in the file.
#[derive(Debug, Clone)]
pub struct RawArray<'a> {
    pub dtype: Dtype,
    pub shape: Vec<usize>,
    pub bytes: Cow<'a, [u8]>,
}

impl RawArray<'_> {
    /// How many numbers there are.
    pub fn len(&self) -> usize {
        self.bytes.len() / self.dtype.size()
    }

    pub fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// One number, whatever its type.
    ///
    /// # Panics
    /// If there are not as many numbers.
    pub fn number(&self, index: usize) -> f64 {
        let size = self.dtype.size();
        let bytes = &self.bytes[index * size..(index + 1) * size];
        macro_rules! read {
            ($ty:ty) => {
                <$ty>::from_le_bytes(bytes.try_into().expect("as long as the type")) as f64
            };
        }
        match self.dtype {
            Dtype::F64 => read!(f64),
            Dtype::I64 => read!(i64),
            Dtype::U64 => read!(u64),
            Dtype::F32 => read!(f32),
            Dtype::U32 => read!(u32),
            Dtype::U16 => read!(u16),
            Dtype::U8 => read!(u8),
        }
    }
}

/// Why bytes are no artifact of the expected type.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{0}")]
pub struct DecodeError(pub String);

impl DecodeError {
    pub fn new(message: impl Into<String>) -> Self {
        Self(message.into())
    }
}

const MAX_DIMENSION: usize = 1 << 40;

type Range = (usize, usize);

fn read_entry<'a>(entry: &Value, data: &'a [u8], foreign: bool) -> Option<(RawArray<'a>, Range)> {
    let name = entry.get("dtype")?.as_str()?;
    let known = Dtype::ALL.into_iter().find(|it| it.name() == name);
    let narrow = if foreign && known.is_none() { Narrow::of(name) } else { None };
    let numbers = |name: &str| -> Option<Vec<usize>> {
        let list = entry.get(name)?.as_array()?;
        list.iter().map(|it| usize::try_from(it.as_u64()?).ok()).collect()
    };
    // Where another dimension is zero, no number of bytes bounds the rest.
    let shape = numbers("shape").filter(|it| it.iter().all(|&n| n <= MAX_DIMENSION))?;
    let [start, end] = numbers("data_offsets")?.try_into().ok()?;
    let size = known.map(Dtype::size).or(narrow.as_ref().map(|it| it.size))?;
    let n_bytes = shape.iter().try_fold(size, |a, &b| a.checked_mul(b))?;
    let bytes = data.get(start..end).filter(|it| it.len() == n_bytes)?;
    let (dtype, bytes) = match narrow {
        Some(narrow) => (narrow.wide, Cow::Owned((narrow.widen)(bytes))),
        None => (known?, Cow::Borrowed(bytes)),
    };
    Some((RawArray { dtype, shape, bytes }, (start, end)))
}
