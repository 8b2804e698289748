//! The types of numbers that arrays are made of.

use bytemuck::{AnyBitPattern, NoUninit};

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
    pub(super) const ALL: [Self; 7] =
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_whole_numbers_are_not_rounded() {
        assert_eq!(f64::exactly(Wide::Integer((1 << 53) + 1)), None);
        assert_eq!(u64::exactly(Wide::Float(1e300)), None);
        assert_eq!(f32::exactly(Wide::Float(0.1)), None);
        assert_eq!(f32::exactly(Wide::Float(0.5)), Some(0.5));
        assert_eq!(i64::exactly(Wide::Float(-0.0)), Some(0));
    }
}
