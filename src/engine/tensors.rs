//! The file format of artifacts: named little-endian arrays behind a JSON header (safetensors).
//!
//! A file is the header's length (8 bytes), the header, and the arrays without gaps. Every number
//! here is aligned to its size, so that a mapped file can be used in place. Texts go into the
//! header's `__metadata__`. The same arrays and texts always give the same bytes: arrays are ordered
//! by the size of their numbers, then as they were written; texts by name.

use std::{borrow::Cow, collections::BTreeMap};

use bytemuck::{AnyBitPattern, NoUninit};
use serde_json::{Map, Value};

#[cfg(target_endian = "big")]
compile_error!("artifacts are little-endian, and so must be the machine");

/// The type of an array's numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dtype {
    F64,
    I64,
    U64,
    F32,
    U32,
    U16,
    U8,
}

impl Dtype {
    const ALL: [Self; 7] =
        [Self::F64, Self::I64, Self::U64, Self::F32, Self::U32, Self::U16, Self::U8];

    /// Bytes a number.
    pub fn size(self) -> usize {
        match self {
            Self::F64 | Self::I64 | Self::U64 => 8,
            Self::F32 | Self::U32 => 4,
            Self::U16 => 2,
            Self::U8 => 1,
        }
    }

    /// The name that safetensors uses.
    pub fn name(self) -> &'static str {
        match self {
            Self::F64 => "F64",
            Self::I64 => "I64",
            Self::U64 => "U64",
            Self::F32 => "F32",
            Self::U32 => "U32",
            Self::U16 => "U16",
            Self::U8 => "U8",
        }
    }
}

/// A number that arrays are made of.
pub trait Number: NoUninit + AnyBitPattern {
    const DTYPE: Dtype;

    /// The number of this type with the same value, if there is one.
    fn exactly(value: Wide) -> Option<Self>;
}

/// A number of any type.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Wide {
    Integer(i128),
    Float(f64),
}

impl std::fmt::Display for Wide {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Integer(value) => value.fmt(f),
            Self::Float(value) => value.fmt(f),
        }
    }
}

macro_rules! integers {
    ($($ty:ident $dtype:ident),*) => {
        $(
            impl Number for $ty {
                const DTYPE: Dtype = Dtype::$dtype;

                fn exactly(value: Wide) -> Option<Self> {
                    match value {
                        Wide::Integer(value) => Self::try_from(value).ok(),
                        Wide::Float(value) => {
                            // Beyond 2^53, integers and floats are no longer the same numbers.
                            let is_whole = value.fract() == 0.0 && value.abs() <= (1i64 << 53) as f64;
                            is_whole.then(|| Self::try_from(value as i128).ok()).flatten()
                        }
                    }
                }
            }
        )*
    };
}

integers!(i64 I64, u64 U64, u32 U32, u16 U16, u8 U8);

impl Number for f64 {
    const DTYPE: Dtype = Dtype::F64;

    fn exactly(value: Wide) -> Option<Self> {
        match value {
            Wide::Integer(value) => Some(value as f64).filter(|it| *it as i128 == value),
            Wide::Float(value) => Some(value),
        }
    }
}

impl Number for f32 {
    const DTYPE: Dtype = Dtype::F32;

    fn exactly(value: Wide) -> Option<Self> {
        let wide = f64::exactly(value)?;
        Some(wide as f32).filter(|it| f64::from(*it) == wide || wide.is_nan())
    }
}

/// Collects the arrays and texts of one artifact.
#[derive(Default)]
pub struct Encoder<'a> {
    /// Put before every name: `mesh.` inside of a part.
    prefix: String,
    arrays: Vec<(String, Dtype, Vec<usize>, Cow<'a, [u8]>)>,
    texts: BTreeMap<String, String>,
}

impl<'a> Encoder<'a> {
    /// Adds an array in row-major order, borrowed until the file is written.
    ///
    /// # Panics
    /// If the shape does not hold as many numbers as are given.
    pub fn array<T: Number>(&mut self, name: &str, shape: &[usize], values: &'a [T]) {
        assert_eq!(shape.iter().product::<usize>(), values.len(), "`{name}`: shape and numbers");
        let bytes = Cow::Borrowed(bytemuck::cast_slice(values));
        self.arrays.push((self.full_name(name), T::DTYPE, shape.to_vec(), bytes));
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
        self.arrays.push((self.full_name(name), T::DTYPE, shape.to_vec(), Cow::Owned(bytes)));
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
        let n_bytes = self.arrays.iter().map(|it| it.3.len()).sum::<usize>();
        let mut res = Vec::with_capacity(header.len() + n_bytes);
        res.extend(header);
        for (_, _, _, bytes) in &self.arrays {
            res.extend_from_slice(bytes);
        }
        res
    }

    /// Whether the file would have these bytes. It is not written for that.
    pub fn is(mut self, bytes: &[u8]) -> bool {
        let header = self.header();
        let arrays = self.arrays.iter().map(|it| &*it.3);
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
        self.arrays.sort_by_key(|it| std::cmp::Reverse(it.1.size()));
        let mut header = Map::new();
        let texts = std::mem::take(&mut self.texts).into_iter();
        let texts = texts.map(|(k, v)| (k, Value::String(v)));
        header.insert("__metadata__".to_owned(), Value::Object(texts.collect()));
        let mut offset = 0;
        for (name, dtype, shape, bytes) in &self.arrays {
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

/// Why bytes are no artifact of the expected type.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{0}")]
pub struct DecodeError(pub String);

impl DecodeError {
    pub fn new(message: impl Into<String>) -> Self {
        Self(message.into())
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

/// A type of numbers that artifacts do not use, and the one that takes all its values.
struct Narrow {
    size: usize,
    wide: Dtype,
    widen: fn(&[u8]) -> Vec<u8>,
}

impl Narrow {
    fn of(name: &str) -> Option<Self> {
        fn to_i64<T: NoUninit + AnyBitPattern + Into<i64>>(bytes: &[u8]) -> Vec<u8> {
            let values = bytemuck::pod_collect_to_vec::<u8, T>(bytes);
            values.into_iter().flat_map(|it| it.into().to_le_bytes()).collect()
        }
        let i64_of = |size, widen| Self { size, wide: Dtype::I64, widen };
        match name {
            "I32" => Some(i64_of(4, to_i64::<i32>)),
            "I16" => Some(i64_of(2, to_i64::<i16>)),
            "I8" => Some(i64_of(1, to_i64::<i8>)),
            "BOOL" => Some(Self { size: 1, wide: Dtype::U8, widen: <[u8]>::to_vec }),
            _ => None,
        }
    }
}

/// The numbers of an array as another type.
fn converted<T: Number>(name: &str, raw: &RawArray<'_>) -> Result<Vec<T>, DecodeError> {
    fn cast<S: Number, T: Number>(bytes: &[u8], wide: impl Fn(S) -> Wide) -> Result<Vec<T>, Wide> {
        let values = bytemuck::pod_collect_to_vec::<u8, S>(bytes);
        values.into_iter().map(|it| T::exactly(wide(it)).ok_or(wide(it))).collect()
    }
    let bytes = &raw.bytes;
    let values = match raw.dtype {
        Dtype::F64 => cast(bytes, Wide::Float),
        Dtype::F32 => cast(bytes, |it: f32| Wide::Float(it.into())),
        Dtype::I64 => cast(bytes, |it: i64| Wide::Integer(it.into())),
        Dtype::U64 => cast(bytes, |it: u64| Wide::Integer(it.into())),
        Dtype::U32 => cast(bytes, |it: u32| Wide::Integer(it.into())),
        Dtype::U16 => cast(bytes, |it: u16| Wide::Integer(it.into())),
        Dtype::U8 => cast(bytes, |it: u8| Wide::Integer(it.into())),
    };
    values.map_err(|value| {
        let wanted = T::DTYPE.name();
        DecodeError(format!("array `{name}` holds {value}, which is no {wanted}"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> Vec<u8> {
        let mut encoder = Encoder::default();
        encoder.array("small", &[3], &[1u8, 2, 3]);
        encoder.array("matrix", &[2, 2], &[1.0, -2.5, 3.0, 1e-300]);
        encoder.owned("index", &[1], vec![7u32]);
        encoder.texts("names", &["a".to_owned(), "ü".to_owned()]);
        encoder.finish()
    }

    #[test]
    fn what_is_written_is_read() {
        let bytes = sample();
        let decoder = Decoder::new(&bytes).unwrap();
        let (n_rows, n_cols, values) = decoder.matrix::<f64>("matrix").unwrap();
        assert_eq!((n_rows, n_cols, &values[..]), (2, 2, &[1.0, -2.5, 3.0, 1e-300][..]));
        assert_eq!(&decoder.vector::<u8>("small").unwrap()[..], [1, 2, 3]);
        assert_eq!(&decoder.vector::<u32>("index").unwrap()[..], [7]);
        assert_eq!(decoder.texts("names").unwrap(), ["a", "ü"]);
        assert!(decoder.vector::<f32>("index").is_err());
        assert!(decoder.vector::<f64>("matrix").is_err());
    }

    /// A file as another program might write it.
    fn foreign(dtype: &str, shape: usize, bytes: &[u8]) -> Vec<u8> {
        let entry = serde_json::json!({
            "x": { "dtype": dtype, "shape": [shape], "data_offsets": [0, bytes.len()] },
        });
        let header = entry.to_string().into_bytes();
        [&(header.len() as u64).to_le_bytes(), &header[..], bytes].concat()
    }

    #[test]
    fn foreign_numbers_are_taken_where_no_value_changes() {
        let read = |dtype, bytes: &[u8]| {
            let file = foreign(dtype, 1, bytes);
            let decoder = Decoder::foreign(&file)?;
            Ok(decoder.vector::<u32>("x")?[0])
        };
        assert_eq!(read("I64", &7i64.to_le_bytes()), Ok(7));
        assert_eq!(read("I32", &7i32.to_le_bytes()), Ok(7));
        assert_eq!(read("BOOL", &[1]), Ok(1));
        assert_eq!(read("F32", &7f32.to_le_bytes()), Ok(7));
        let message = |it: Result<u32, DecodeError>| it.unwrap_err().0;
        let refused = message(read("I64", &(-1i64).to_le_bytes()));
        assert_eq!(refused, "array `x` holds -1, which is no U32");
        let refused = message(read("F64", &0.5f64.to_le_bytes()));
        assert_eq!(refused, "array `x` holds 0.5, which is no U32");
        assert!(message(read("C64", &[0; 8])).contains("the entry of array `x`"));
        let ours = foreign("I64", 1, &7i64.to_le_bytes());
        assert!(Decoder::new(&ours).unwrap().vector::<u32>("x").is_err(), "artifacts are exact");
    }

    #[test]
    fn the_largest_whole_numbers_are_not_rounded() {
        assert_eq!(f64::exactly(Wide::Integer((1 << 53) + 1)), None);
        assert_eq!(u64::exactly(Wide::Float(1e300)), None);
        assert_eq!(f32::exactly(Wide::Float(0.1)), None);
        assert_eq!(f32::exactly(Wide::Float(0.5)), Some(0.5));
        assert_eq!(i64::exactly(Wide::Float(-0.0)), Some(0));
    }

    #[test]
    fn a_foreign_header_may_list_the_arrays_in_any_order() {
        let header = br#"{"b":{"dtype":"U8","shape":[1],"data_offsets":[1,2]},"a":{"dtype":"U8","shape":[1],"data_offsets":[0,1]}}"#;
        let file = [&(header.len() as u64).to_le_bytes(), &header[..], &[5, 6]].concat();
        let decoder = Decoder::foreign(&file).unwrap();
        assert_eq!(decoder.vector::<u8>("a").unwrap()[0], 5);
        assert_eq!(decoder.vector::<u8>("b").unwrap()[0], 6);
        assert!(Decoder::new(&file).is_err());
    }

    #[test]
    fn every_truncation_and_every_flipped_length_is_refused() {
        let bytes = sample();
        for length in 0..bytes.len() {
            assert!(Decoder::new(&bytes[..length]).is_err(), "{length} bytes");
        }
        let mut longer = bytes.clone();
        longer.push(0);
        assert!(Decoder::new(&longer).is_err());
        let mut huge = bytes;
        huge[7] = 0xff;
        assert!(Decoder::new(&huge).is_err());
    }
}
