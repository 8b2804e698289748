//! Files of other programs, to and from bytes.

pub mod png;
