//! The file format of artifacts: named little-endian arrays behind a JSON header (safetensors).
//!
//! A file is the header's length (8 bytes), the header, and the arrays without gaps. Every number
//! here is aligned to its size, so that a mapped file can be used in place. Texts go into the
//! header's `__metadata__`. The same arrays and texts always give the same bytes: arrays are ordered
//! by the size of their numbers, then as they were written; texts by name.

mod decode;
mod encode;
mod foreign;
mod numbers;
#[cfg(test)]
mod tests;

pub use decode::{Array, DecodeError, Decoder, RawArray};
pub use encode::Encoder;
pub use numbers::{Dtype, Number};

#[cfg(target_endian = "big")]
compile_error!("artifacts are little-endian, and so must be the machine");
