//! File formats in and out, on byte strings: one file a format.
//!
//! Readers take the bytes of a file and return checked data or a [`ReadError`] with the facts; no
//! input makes them panic. Writers return bytes, the same for the same value. Nothing here opens
//! a file; where a format refers to others (`.gltf`), the caller hands in a function that finds
//! them.

pub mod anime;
pub mod bvh;
pub mod character;
pub mod csv;
pub mod error;
pub mod glb;
pub mod gltf;
pub mod npz;
pub mod obj;
pub mod off;
pub mod ply;
pub mod png;
pub mod read;
pub mod skeleton_file;
pub mod stl;
pub mod table_file;
pub mod table_text;
pub mod uri;
pub mod xyz;
pub mod zip;

#[cfg(test)]
pub(super) mod corpus_tests;
#[cfg(test)]
mod garbage;

pub use error::ReadError;
