//! Archives without compression, and numpy's `.npz` made of them.

/// An array to write, in row-major order.
#[derive(Debug, Clone, Copy)]
pub struct NpyArray<'a> {
    pub name: &'a str,
    /// numpy's name of the type: `<f8`, `<u4`, `|u1`, ...
    pub dtype: &'a str,
    pub shape: &'a [usize],
    /// Little-endian numbers.
    pub bytes: &'a [u8],
}

/// Writes a `.npz`: every array as `name.npy`. `numpy.load` reads it.
///
/// # Panics
/// If the archive would pass 4 GiB, or an array's type is none of numpy's.
pub fn write_npz(arrays: &[NpyArray<'_>]) -> Vec<u8> {
    let files: Vec<(String, Vec<u8>)> =
        arrays.iter().map(|it| (format!("{}.npy", it.name), write_npy(it))).collect();
    write_zip(&files)
}

/// Writes a `.npy`, version 1.0.
fn write_npy(array: &NpyArray<'_>) -> Vec<u8> {
    let size: usize = array.dtype[2..].parse().expect("a type ends with its size");
    let count: usize = array.shape.iter().product();
    assert_eq!(array.bytes.len(), count * size, "`{}`: shape and numbers", array.name);
    let mut shape: String = array.shape.iter().map(|it| format!("{it}, ")).collect();
    if array.shape.len() > 1 {
        shape.truncate(shape.len() - 2);
    }
    let mut head = format!(
        "{{'descr': '{}', 'fortran_order': False, 'shape': ({}), }}",
        array.dtype,
        shape.trim_end()
    );
    // Numbers start at a multiple of 64 bytes, after ten bytes and a line feed.
    while (head.len() + 11) % 64 != 0 {
        head.push(' ');
    }
    head.push('\n');
    let mut out = b"\x93NUMPY\x01\x00".to_vec();
    out.extend_from_slice(&(head.len() as u16).to_le_bytes());
    out.extend_from_slice(head.as_bytes());
    out.extend_from_slice(array.bytes);
    out
}

/// Writes files one after the other, dated 1 January 1980, so that equal files give equal archives.
///
/// # Panics
/// If the archive would pass 4 GiB.
pub fn write_zip(files: &[(String, Vec<u8>)]) -> Vec<u8> {
    let mut out = Vec::new();
    let mut directory = Vec::new();
    for (name, data) in files {
        let (offset, crc) = (out.len(), crc32(data));
        // Version 2.0, no flags, stored, midnight, 1 January 1980.
        let mut common = Vec::new();
        for word in [20u16, 0, 0, 0, 0x21] {
            common.extend_from_slice(&word.to_le_bytes());
        }
        common.extend_from_slice(&crc.to_le_bytes());
        common.extend_from_slice(&four_bytes(data.len()));
        common.extend_from_slice(&four_bytes(data.len()));
        common.extend_from_slice(&(name.len() as u16).to_le_bytes());
        common.extend_from_slice(&[0; 2]);
        out.extend_from_slice(b"PK\x03\x04");
        out.extend_from_slice(&common);
        out.extend_from_slice(name.as_bytes());
        out.extend_from_slice(data);
        directory.extend_from_slice(b"PK\x01\x02\x14\x00");
        directory.extend_from_slice(&common);
        directory.extend_from_slice(&[0; 10]);
        directory.extend_from_slice(&four_bytes(offset));
        directory.extend_from_slice(name.as_bytes());
    }
    let start = out.len();
    out.extend_from_slice(&directory);
    out.extend_from_slice(b"PK\x05\x06\0\0\0\0");
    for _ in 0..2 {
        out.extend_from_slice(&(files.len() as u16).to_le_bytes());
    }
    out.extend_from_slice(&four_bytes(directory.len()));
    out.extend_from_slice(&four_bytes(start));
    out.extend_from_slice(&[0; 2]);
    out
}

fn four_bytes(it: usize) -> [u8; 4] {
    u32::try_from(it).expect("an archive below 4 GiB").to_le_bytes()
}

/// The checksum of ISO 3309.
fn crc32(bytes: &[u8]) -> u32 {
    let table: [u32; 256] = std::array::from_fn(|it| {
        (0..8).fold(it as u32, |crc, _| (crc >> 1) ^ (0xedb8_8320 * (crc & 1)))
    });
    !bytes.iter().fold(!0, |crc, &it| (crc >> 8) ^ table[(crc as u8 ^ it) as usize])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_of_the_standard() {
        assert_eq!(crc32(b"123456789"), 0xcbf4_3926);
    }

    #[test]
    fn headers_are_aligned_and_end_with_a_line_feed() {
        for shape in [&[][..], &[3], &[1, 3]] {
            let count: usize = shape.iter().product();
            let bytes = vec![7; count * 8];
            let npy = write_npy(&NpyArray { name: "a", dtype: "<f8", shape, bytes: &bytes });
            assert_eq!((npy.len() - bytes.len()) % 64, 0);
            assert_eq!(npy[npy.len() - bytes.len() - 1], b'\n');
        }
        let three =
            write_npy(&NpyArray { name: "a", dtype: "|u1", shape: &[3], bytes: &[1, 2, 3] });
        assert!(String::from_utf8_lossy(&three).contains("'shape': (3,), }"));
    }

    #[test]
    fn the_archive_lists_its_files_at_the_end() {
        let zip = write_zip(&[("a.txt".to_owned(), b"hello".to_vec())]);
        let end = &zip[zip.len() - 22..];
        assert_eq!(&end[..4], b"PK\x05\x06");
        assert_eq!(u32::from_le_bytes(end[16..20].try_into().unwrap()), 30 + 5 + 5);
    }
}
