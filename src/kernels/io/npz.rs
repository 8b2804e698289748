//! Reading numpy's `.npz`: an archive of `.npy` arrays, as `numpy.savez` writes it.

use super::ReadError;

/// One array of an archive.
#[derive(Debug, Clone, PartialEq)]
pub struct NpzArray {
    pub name: String,
    /// Empty for a single value.
    pub shape: Vec<usize>,
    pub values: NpzValues,
}

#[derive(Debug, Clone, PartialEq)]
pub enum NpzValues {
    /// Little-endian numbers in row-major order, of numpy's type without its order of bytes: `f8`,
    /// `i4`, `u1`, `b1`.
    Numbers {
        dtype: &'static str,
        bytes: Vec<u8>,
    },
    Texts(Vec<String>),
}

/// Types of numbers, and their sizes.
const DTYPES: [(&str, usize); 11] = [
    ("f8", 8),
    ("f4", 4),
    ("i8", 8),
    ("i4", 4),
    ("i2", 2),
    ("i1", 1),
    ("u8", 8),
    ("u4", 4),
    ("u2", 2),
    ("u1", 1),
    ("b1", 1),
];

/// Reads all arrays of an archive, in its order.
///
/// # Errors
/// If it is no archive, compressed (`numpy.savez_compressed`), or holds what is no array of numbers or
/// texts.
pub fn read_npz(bytes: &[u8]) -> Result<Vec<NpzArray>, ReadError> {
    let files = read_zip(bytes)?;
    files
        .into_iter()
        .map(|(name, data)| {
            let name = name.strip_suffix(".npy").unwrap_or(&name).to_owned();
            let (shape, values) =
                read_npy(data).map_err(|what| fail(format!("`{name}` {what}")))?;
            Ok(NpzArray { name, shape, values })
        })
        .collect()
}

fn fail(what: impl Into<String>) -> ReadError {
    ReadError::content("NPZ", what)
}

/// The files of an archive without compression.
fn read_zip(bytes: &[u8]) -> Result<Vec<(String, &[u8])>, ReadError> {
    let damaged = || fail("it is no archive, or a damaged one");
    let earliest = bytes.len().saturating_sub(22 + 0xffff);
    let latest = bytes.len().checked_sub(22).ok_or_else(damaged)?;
    let end = (earliest..=latest).rev().find(|&it| bytes[it..].starts_with(b"PK\x05\x06"));
    let end = end.ok_or_else(damaged)?;
    let count = number(bytes, end + 10, 2).ok_or_else(damaged)?;
    let mut at = number(bytes, end + 16, 4).ok_or_else(damaged)? as usize;
    let mut files = Vec::new();
    for _ in 0..count {
        let (file, next) = read_entry(bytes, at).ok_or_else(damaged)?;
        let Entry { name, method, data } = file;
        if method != 0 {
            let message = format!("`{name}` is compressed: write it with `numpy.savez`");
            return Err(fail(message));
        }
        files.push((name, data));
        at = next;
    }
    Ok(files)
}

struct Entry<'a> {
    name: String,
    method: u64,
    data: &'a [u8],
}

/// An entry of the archive's directory, and where the next one starts.
fn read_entry(bytes: &[u8], at: usize) -> Option<(Entry<'_>, usize)> {
    if bytes.get(at..at.checked_add(4)?)? != b"PK\x01\x02" {
        return None;
    }
    let field = |offset: usize, size: usize| number(bytes, at.checked_add(offset)?, size);
    let (name_length, extra_length) = (field(28, 2)? as usize, field(30, 2)? as usize);
    let name = bytes.get(at + 46..at + 46 + name_length)?;
    let extra = bytes.get(at + 46 + name_length..at + 46 + name_length + extra_length)?;
    // Sizes and offsets of all ones are in the extra field, in this order.
    let mut wide = wide_numbers(extra).into_iter();
    let mut value = |offset: usize| match field(offset, 4)? {
        0xffff_ffff => wide.next(),
        it => Some(it),
    };
    let (size, packed, start) = (value(24)?, value(20)?, value(42)?);
    let start = usize::try_from(start).ok()?;
    let local = |offset: usize| number(bytes, start.checked_add(offset)?, 2);
    let data = start.checked_add(30 + local(26)? as usize + local(28)? as usize)?;
    let method = field(10, 2)?;
    let end = data.checked_add(usize::try_from(packed).ok()?)?;
    let data = bytes.get(data..end).filter(|_| method != 0 || size == packed)?;
    let name = String::from_utf8_lossy(name).into_owned();
    let next = at + 46 + name_length + extra_length + field(32, 2)? as usize;
    Some((Entry { name, method, data }, next))
}

/// The numbers of the extra field for large archives.
fn wide_numbers(mut extra: &[u8]) -> Vec<u64> {
    while let (Some(kind), Some(length)) = (number(extra, 0, 2), number(extra, 2, 2)) {
        let Some(body) = extra.get(4..4 + length as usize) else { break };
        if kind == 1 {
            return body.chunks_exact(8).filter_map(|it| number(it, 0, 8)).collect();
        }
        extra = &extra[4 + length as usize..];
    }
    Vec::new()
}

/// A little-endian number of so many bytes.
fn number(bytes: &[u8], at: usize, size: usize) -> Option<u64> {
    let bytes = bytes.get(at..at.checked_add(size)?)?;
    Some(bytes.iter().rev().fold(0, |value, &byte| value << 8 | u64::from(byte)))
}

/// The shape and the values of a `.npy`; the error follows its name.
fn read_npy(bytes: &[u8]) -> Result<(Vec<usize>, NpzValues), String> {
    let damaged = || "is no array of numpy, or a damaged one".to_owned();
    let (head, data) = split_header(bytes).ok_or_else(damaged)?;
    let descr = quoted(head, "'descr': ").ok_or("is no array of plain values")?;
    let shape = read_shape(head).ok_or_else(damaged)?;
    let is_fortran = head.contains("'fortran_order': True");
    let (order, ty) = descr.split_at_checked(1).ok_or_else(damaged)?;
    let n_values = shape.iter().try_fold(1usize, |a, &b| a.checked_mul(b)).ok_or_else(damaged)?;
    let is_whole = |size: usize| n_values.checked_mul(size) == Some(data.len());
    if let Some(length) = ty.strip_prefix('U').and_then(|it| it.parse::<usize>().ok()) {
        let size = length.checked_mul(4).filter(|&it| is_whole(it)).ok_or_else(damaged)?;
        if shape.len() > 1 {
            return Err("is a table of texts".to_owned());
        }
        let texts = (0..n_values).map(|it| read_text(&data[it * size..(it + 1) * size], order));
        let texts = texts.collect::<Option<Vec<String>>>().ok_or_else(damaged)?;
        return Ok((shape, NpzValues::Texts(texts)));
    }
    let known = DTYPES.iter().find(|it| it.0 == ty);
    let &(dtype, size) = known.ok_or_else(|| format!("is an array of `{descr}`"))?;
    if !is_whole(size) {
        return Err(damaged());
    }
    let mut bytes = if is_fortran { row_major(data, &shape, size) } else { data.to_vec() };
    if order == ">" {
        bytes.chunks_exact_mut(size).for_each(<[u8]>::reverse);
    }
    Ok((shape, NpzValues::Numbers { dtype, bytes }))
}

fn split_header(bytes: &[u8]) -> Option<(&str, &[u8])> {
    let rest = bytes.strip_prefix(b"\x93NUMPY")?;
    let (start, length) = match rest.first()? {
        1 => (4, number(rest, 2, 2)?),
        2 | 3 => (6, number(rest, 2, 4)?),
        _ => return None,
    };
    let end = start + length as usize;
    Some((std::str::from_utf8(rest.get(start..end)?).ok()?, &rest[end..]))
}

/// The text in quotes behind a key.
fn quoted<'a>(head: &'a str, key: &str) -> Option<&'a str> {
    let rest = head.split_once(key)?.1.strip_prefix('\'')?;
    Some(rest.split_once('\'')?.0)
}

fn read_shape(head: &str) -> Option<Vec<usize>> {
    let inner = head.split_once("'shape': (")?.1.split_once(')')?.0;
    let lengths = inner.split(',').map(str::trim).filter(|it| !it.is_empty());
    lengths.map(|it| it.parse().ok()).collect()
}

/// A text of numpy: four bytes a letter, zeros behind it.
fn read_text(bytes: &[u8], order: &str) -> Option<String> {
    let letters = bytes.chunks_exact(4).map(|it| {
        let it = [it[0], it[1], it[2], it[3]];
        char::from_u32(if order == ">" { u32::from_be_bytes(it) } else { u32::from_le_bytes(it) })
    });
    let text = letters.collect::<Option<String>>()?;
    Some(text.trim_end_matches('\0').to_owned())
}

/// Values whose first index runs fastest, in the order in which the last one does.
fn row_major(data: &[u8], shape: &[usize], size: usize) -> Vec<u8> {
    let n_values = data.len() / size;
    let mut res = Vec::with_capacity(data.len());
    let mut index = vec![0; shape.len()];
    for _ in 0..n_values {
        let from = index.iter().zip(shape).rev().fold(0, |it, (index, length)| it * length + index);
        res.extend_from_slice(&data[from * size..(from + 1) * size]);
        for axis in (0..shape.len()).rev() {
            index[axis] += 1;
            if index[axis] < shape[axis] {
                break;
            }
            index[axis] = 0;
        }
    }
    res
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::io::zip::{NpyArray, write_npz, write_zip};

    fn npy(head: &str, data: &[u8]) -> Vec<u8> {
        let length = (head.len() as u16).to_le_bytes();
        [&b"\x93NUMPY\x01\x00"[..], &length, head.as_bytes(), data].concat()
    }

    fn one(head: &str, data: &[u8]) -> Result<NpzArray, String> {
        let zip = write_zip(&[("x.npy".to_owned(), npy(head, data))]);
        read_npz(&zip).map(|mut it| it.remove(0)).map_err(|e| e.to_string())
    }

    #[test]
    fn what_we_write_is_read() {
        let bytes: Vec<u8> = (0..24).collect();
        let array = |name, dtype, shape| NpyArray { name, dtype, shape, bytes: &bytes };
        let zip = write_npz(&[array("a", "<f4", &[2, 3]), array("b", "|u1", &[24])]);
        let read = read_npz(&zip).unwrap();
        assert_eq!((read[0].name.as_str(), &read[0].shape[..]), ("a", &[2, 3][..]));
        let (dtype, bytes) = ("u1", bytes.clone());
        assert_eq!(read[1].values, NpzValues::Numbers { dtype, bytes });
        for length in 0..zip.len() {
            assert!(read_npz(&zip[..length]).is_err(), "{length} bytes");
        }
        let mut damaged = zip.clone();
        for at in 0..zip.len() {
            damaged[at] ^= 0x15;
            let _ = read_npz(&damaged);
            damaged[at] ^= 0x15;
        }
    }

    #[test]
    fn orders_of_bytes_and_of_axes_are_ours_afterwards() {
        let head = "{'descr': '>i2', 'fortran_order': True, 'shape': (2, 3), }";
        let columns: Vec<u8> =
            [0i16, 3, 1, 4, 2, 5].iter().flat_map(|it| it.to_be_bytes()).collect();
        let bytes = [0i16, 1, 2, 3, 4, 5].iter().flat_map(|it| it.to_le_bytes()).collect();
        let values = NpzValues::Numbers { dtype: "i2", bytes };
        assert_eq!(one(head, &columns).unwrap().values, values);
    }

    #[test]
    fn texts_are_read_and_what_is_no_array_is_refused() {
        let texts: Vec<u8> = "ab\0ü\0\0".chars().flat_map(|it| (it as u32).to_le_bytes()).collect();
        let read =
            one("{'descr': '<U3', 'fortran_order': False, 'shape': (2,), }", &texts).unwrap();
        assert_eq!(read.values, NpzValues::Texts(vec!["ab".to_owned(), "ü".to_owned()]));
        let check = |head: &str, message: &str| {
            assert_eq!(one(head, &[0; 16]).unwrap_err(), format!("NPZ file: {message}"));
        };
        let rest = "'fortran_order': False, 'shape': (2,), }";
        check(&format!("{{'descr': '|O', {rest}"), "`x` is an array of `|O`");
        check(&format!("{{'descr': '<c8', {rest}"), "`x` is an array of `<c8`");
        check(&format!("{{'descr': [('a', '<f8')], {rest}"), "`x` is no array of plain values");
        check(&format!("{{'descr': '<f4', {rest}"), "`x` is no array of numpy, or a damaged one");
    }
}
