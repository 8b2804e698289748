//! Numbers of the types that other programs write.

use bytemuck::{AnyBitPattern, NoUninit};

use super::{DecodeError, Dtype, Number, RawArray, numbers::Wide};

/// A type of numbers that artifacts do not use, and the one that takes all its values.
pub struct Narrow {
    pub size: usize,
    pub wide: Dtype,
    pub widen: fn(&[u8]) -> Vec<u8>,
}

impl Narrow {
    pub fn of(name: &str) -> Option<Self> {
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
pub fn converted<T: Number>(name: &str, raw: &RawArray<'_>) -> Result<Vec<T>, DecodeError> {
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
