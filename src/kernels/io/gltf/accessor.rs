//! Numbers out of buffers, every access checked: the readers of the `gltf` crate panic on damaged files.

use gltf::{
    Accessor,
    accessor::{DataType, sparse::IndexType},
    buffer::View,
};

use super::FORMAT;
use crate::kernels::io::error::ReadError;

/// Without a buffer view an accessor is all zeros; more rows than this, and than the file's data has
/// bytes, are a damaged file.
const MAX_ZEROS: usize = 1 << 16;

/// All numbers of an accessor, row by row; normalized integers become fractions.
pub fn floats(
    accessor: &Accessor<'_>,
    buffers: &[Vec<u8>],
    n_components: usize,
) -> Result<Vec<f64>, ReadError> {
    let fail =
        |what: String| ReadError::content(FORMAT, format!("accessor {}: {what}", accessor.index()));
    let found = accessor.dimensions().multiplicity();
    if found != n_components {
        return Err(fail(format!("{found} components instead of {n_components}")));
    }
    let (count, scalar) = (accessor.count(), accessor.data_type());
    let mut values = match accessor.view() {
        Some(view) => {
            let rows =
                Rows::new(&view, accessor.offset(), count, n_components * scalar.size(), buffers)
                    .map_err(fail)?;
            rows.flat_map(|row| row.chunks_exact(scalar.size()).map(|it| number(it, scalar)))
                .collect()
        }
        None if count <= buffers.iter().map(Vec::len).sum::<usize>().max(MAX_ZEROS) => {
            vec![0.0; count * n_components]
        }
        None => return Err(fail(format!("{count} rows without data"))),
    };
    if let Some(sparse) = accessor.sparse() {
        let (indices, new) = (sparse.indices(), sparse.values());
        let index_type = match indices.index_type() {
            IndexType::U8 => DataType::U8,
            IndexType::U16 => DataType::U16,
            IndexType::U32 => DataType::U32,
        };
        let n_new = sparse.count();
        let size = index_type.size();
        let at =
            Rows::new(&indices.view(), indices.offset(), n_new, size, buffers).map_err(fail)?;
        let row_bytes = n_components * scalar.size();
        let rows = Rows::new(&new.view(), new.offset(), n_new, row_bytes, buffers).map_err(fail)?;
        for (index, row) in at.map(|it| number(it, index_type) as usize).zip(rows) {
            if index >= count {
                return Err(fail(format!("a sparse value for row {index} of {count}")));
            }
            let into = &mut values[index * n_components..][..n_components];
            for (value, bytes) in into.iter_mut().zip(row.chunks_exact(scalar.size())) {
                *value = number(bytes, scalar);
            }
        }
    }
    if accessor.normalized() {
        let scale = match scalar {
            DataType::I8 => 127.0,
            DataType::U8 => 255.0,
            DataType::I16 => 32767.0,
            DataType::U16 => 65535.0,
            _ => 1.0,
        };
        values.iter_mut().for_each(|it| *it = (*it / scale).max(-1.0));
    }
    Ok(values)
}

/// The indices of a primitive.
pub fn indices(accessor: &Accessor<'_>, buffers: &[Vec<u8>]) -> Result<Vec<u32>, ReadError> {
    if accessor.data_type() == DataType::F32 {
        let what = format!("accessor {}: indices are no integers", accessor.index());
        return Err(ReadError::content(FORMAT, what));
    }
    let values = floats(accessor, buffers, 1)?;
    Ok(values.into_iter().map(|it| it as u32).collect())
}

fn number(bytes: &[u8], scalar: DataType) -> f64 {
    let mut it = [0; 4];
    it[..bytes.len()].copy_from_slice(bytes);
    let [a, b, ..] = it;
    match scalar {
        DataType::I8 => f64::from(a as i8),
        DataType::U8 => f64::from(a),
        DataType::I16 => f64::from(i16::from_le_bytes([a, b])),
        DataType::U16 => f64::from(u16::from_le_bytes([a, b])),
        DataType::U32 => f64::from(u32::from_le_bytes(it)),
        DataType::F32 => f64::from(f32::from_le_bytes(it)),
    }
}

/// Equal rows of bytes, checked to lie within their view and buffer.
struct Rows<'a> {
    bytes: &'a [u8],
    stride: usize,
    row_bytes: usize,
    left: usize,
}

impl<'a> Rows<'a> {
    fn new(
        view: &View<'_>,
        offset: usize,
        count: usize,
        row_bytes: usize,
        buffers: &'a [Vec<u8>],
    ) -> Result<Self, String> {
        let buffer = buffers.get(view.buffer().index()).map(Vec::as_slice).unwrap_or_default();
        let view_end = view.offset() as u128 + view.length() as u128;
        if view_end > buffer.len() as u128 {
            return Err(format!(
                "view {} ends at byte {view_end}, but the buffer has {}",
                view.index(),
                buffer.len()
            ));
        }
        let stride = view.stride().unwrap_or(row_bytes);
        let last = (count.max(1) - 1) as u128 * stride as u128;
        let needed = offset as u128 + if count == 0 { 0 } else { last + row_bytes as u128 };
        if needed > view.length() as u128 || stride < row_bytes {
            return Err(format!(
                "{count} rows end at byte {needed} of view {}, which has {}",
                view.index(),
                view.length()
            ));
        }
        let bytes = &buffer[view.offset() + offset..view_end as usize];
        Ok(Self { bytes, stride, row_bytes, left: count })
    }
}

impl<'a> Iterator for Rows<'a> {
    type Item = &'a [u8];

    fn next(&mut self) -> Option<&'a [u8]> {
        self.left = self.left.checked_sub(1)?;
        let row = &self.bytes[..self.row_bytes];
        self.bytes = &self.bytes[self.stride.min(self.bytes.len())..];
        Some(row)
    }
}
