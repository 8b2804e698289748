//! What flows along the wires: immutable typed values with one canonical encoding.

use std::{
    any::Any,
    borrow::Cow,
    ops::Deref,
    sync::{Arc, OnceLock},
};

use memmap2::Mmap;

use super::digest::Digest;
pub use super::tensors::{DecodeError, Decoder, Dtype, Encoder};

/// The stored form of an artifact.
pub enum Bytes {
    /// A file, or memory that another process has written.
    Mapped(Arc<Mmap>),
    Owned(Vec<u8>),
}

impl Deref for Bytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        match self {
            Self::Mapped(bytes) => bytes,
            Self::Owned(bytes) => bytes,
        }
    }
}

impl Bytes {
    pub fn into_vec(self) -> Vec<u8> {
        match self {
            Self::Mapped(bytes) => bytes.to_vec(),
            Self::Owned(bytes) => bytes,
        }
    }
}

impl From<Vec<u8>> for Bytes {
    fn from(bytes: Vec<u8>) -> Self {
        Self::Owned(bytes)
    }
}

/// The name of a type of artifact, as users see it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ArtifactType {
    pub name: &'static str,
    /// Raise it when the encoding changes.
    pub version: u32,
    /// One sentence: what it is, its shapes and units.
    pub doc: &'static str,
}

/// What an input of an open kind takes: an artifact of any type. No artifact has this one.
pub const ANY: ArtifactType =
    ArtifactType { name: "any", version: 0, doc: "An artifact of any type." };

/// A file format that a type of artifact can be exported to, beside the ones that all types share.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Format {
    /// Without the dot, in lower case.
    pub extension: &'static str,
    pub doc: &'static str,
}

/// A value that can be stored and wired.
pub trait Artifact: Any + Send + Sync + Sized {
    const TYPE: ArtifactType;

    /// What [`Artifact::export`] can write.
    const FORMATS: &'static [Format] = &[];

    /// Extensions of the files that [`Artifact::import`] can read.
    const IMPORTS: &'static [&'static str] = &[];

    /// Writes the value. The same value gives the same bytes.
    fn encode<'a>(&'a self, to: &mut Encoder<'a>);

    /// Reads and checks a value. Must refuse garbage, never panic.
    ///
    /// # Errors
    /// If an array is missing, has a wrong shape, or holds what the type does not allow.
    fn decode(from: &Decoder<'_>) -> Result<Self, DecodeError>;

    /// Checks a stored form as [`Artifact::decode`] does, but makes no value of it, and adds to `canonical`
    /// what [`Artifact::encode`] would write of that. False if this cannot be told without the value: what
    /// is large and turned around on its way into memory should be checked where it lies.
    ///
    /// # Errors
    /// As [`Artifact::decode`].
    fn check<'a>(_from: &Decoder<'a>, _canonical: &mut Encoder<'a>) -> Result<bool, DecodeError> {
        Ok(false)
    }

    /// What a person wants to know first: (name, value) lines, shapes and ranges before contents.
    fn summary(&self) -> Vec<(String, String)>;

    /// Writes the value in one of [`Artifact::FORMATS`].
    ///
    /// # Errors
    /// If this value cannot be written in this format, with the reason.
    fn export(&self, extension: &str) -> Result<Vec<u8>, String> {
        Err(format!("`{}` cannot be written as .{extension}", Self::TYPE.name))
    }

    /// Reads and checks a file that another program wrote, in one of [`Artifact::IMPORTS`].
    ///
    /// # Errors
    /// If the file does not hold such a value.
    fn import(extension: &str, _bytes: &[u8]) -> Result<Self, String> {
        Err(format!("`{}` cannot be read from .{extension}", Self::TYPE.name))
    }
}

/// An artifact whose type is known at run time only.
#[derive(Clone)]
pub struct AnyArtifact {
    kind: &'static ArtifactKind,
    digest: Digest,
    content: Arc<Content>,
}

/// A value, its stored form, or both.
struct Content {
    /// Made of the stored form when it is asked for first; `None` inside if that was in vain.
    value: OnceLock<Option<Value>>,
    stored: Option<Arc<Mmap>>,
}

type Value = Arc<dyn Any + Send + Sync>;

/// An artifact and its bytes.
pub type EncodedArtifact = (AnyArtifact, Bytes);

impl AnyArtifact {
    /// Encodes a value: the artifact and the bytes to store.
    pub fn encode<T: Artifact>(value: T) -> EncodedArtifact {
        let bytes = encoder(&value).finish().into();
        Self::with_bytes(value, bytes)
    }

    /// The artifact of a value whose stored form is known.
    fn with_bytes<T: Artifact>(value: T, bytes: Bytes) -> EncodedArtifact {
        let kind = const { &ArtifactKind::of::<T>() };
        let digest = digest_of(T::TYPE, &bytes);
        (Self::of_value(kind, digest, Arc::new(value)), bytes)
    }

    fn of_value(kind: &'static ArtifactKind, digest: Digest, value: Value) -> Self {
        let content = Content { value: OnceLock::from(Some(value)), stored: None };
        Self { kind, digest, content: Arc::new(content) }
    }

    /// An artifact of a stored form that is known to be sound. Its value is made when somebody needs it:
    /// programs that read artifacts as files never do.
    pub fn of_stored(kind: &'static ArtifactKind, digest: Digest, stored: Arc<Mmap>) -> Self {
        let content = Content { value: OnceLock::new(), stored: Some(stored) };
        Self { kind, digest, content: Arc::new(content) }
    }

    fn value(&self) -> Option<&Value> {
        let make = || {
            let stored = self.content.stored.as_ref().expect("there is a value or a stored form");
            let value = (self.kind.decode)(stored);
            if let Err(error) = &value {
                tracing::warn!(digest = %self.digest, %error, "a stored artifact has no valid content");
            }
            value.ok()
        };
        self.content.value.get_or_init(make).as_ref()
    }

    fn known_value(&self) -> &(dyn Any + Send + Sync) {
        &**self.value().expect("what is stored under a digest was checked before")
    }

    pub fn ty(&self) -> ArtifactType {
        self.kind.ty
    }

    pub fn digest(&self) -> Digest {
        self.digest
    }

    /// The value, if it has this type.
    pub fn downcast<T: Artifact>(&self) -> Option<Arc<T>> {
        Arc::clone(self.value()?).downcast().ok()
    }

    /// See [`Artifact::summary`].
    pub fn summary(&self) -> Vec<(String, String)> {
        (self.kind.summary)(self.known_value())
    }

    /// See [`Artifact::export`].
    ///
    /// # Errors
    /// If the value cannot be written in this format.
    pub fn export(&self, extension: &str) -> Result<Vec<u8>, String> {
        (self.kind.export)(self.known_value(), extension)
    }

    /// The stored form, where it lies if it is there.
    pub fn bytes(&self) -> Cow<'_, [u8]> {
        match &self.content.stored {
            Some(stored) => Cow::Borrowed(&stored[..]),
            None => Cow::Owned((self.kind.encode)(self.known_value())),
        }
    }

    /// The stored form.
    pub fn to_bytes(&self) -> Vec<u8> {
        self.bytes().into_owned()
    }
}

/// The digest of an artifact: of its type's name and version and its canonical bytes.
pub fn digest_of(ty: ArtifactType, bytes: &[u8]) -> Digest {
    let mut hasher = blake3::Hasher::new();
    hasher.update(ty.name.as_bytes());
    hasher.update(&[0]);
    hasher.update(&ty.version.to_le_bytes());
    hasher.update(bytes);
    Digest(*hasher.finalize().as_bytes())
}

/// One line of the registry of types: a type's codec without its type.
pub struct ArtifactKind {
    pub ty: ArtifactType,
    pub formats: &'static [Format],
    /// Extensions of the files of other programs that can be read, beside `.safetensors`.
    pub imports: &'static [&'static str],
    encode: fn(&dyn Any) -> Vec<u8>,
    decode: fn(&[u8]) -> Result<Value, DecodeError>,
    summary: fn(&dyn Any) -> Vec<(String, String)>,
    export: fn(&dyn Any, &str) -> Result<Vec<u8>, String>,
    import: fn(&str, Bytes) -> Result<EncodedArtifact, String>,
}

impl ArtifactKind {
    pub const fn of<T: Artifact>() -> Self {
        Self {
            ty: T::TYPE,
            formats: T::FORMATS,
            imports: T::IMPORTS,
            encode: |value| encoder(cast::<T>(value)).finish(),
            decode: |bytes| {
                let decoder = Decoder::new(bytes)?;
                let found = decoder.text("sinew.type")?;
                if found != T::TYPE.name {
                    let wanted = T::TYPE.name;
                    return Err(DecodeError(format!("it is `{found}` instead of `{wanted}`")));
                }
                Ok(Arc::new(T::decode(&decoder)?))
            },
            summary: |value| cast::<T>(value).summary(),
            export: |value, extension| cast::<T>(value).export(extension),
            import: |extension, bytes| {
                if extension != "safetensors" {
                    return Ok(AnyArtifact::encode::<T>(T::import(extension, &bytes)?));
                }
                if let Bytes::Mapped(stored) = &bytes
                    && is_canonical::<T>(stored).map_err(|e| e.to_string())?
                {
                    let kind = const { &ArtifactKind::of::<T>() };
                    let digest = digest_of(T::TYPE, stored);
                    return Ok((AnyArtifact::of_stored(kind, digest, Arc::clone(stored)), bytes));
                }
                let value = decode_foreign::<T>(&bytes).map_err(|e| e.to_string())?;
                // Whoever wrote it as we do has saved us a copy.
                Ok(match encoder(&value).is(&bytes) {
                    true => AnyArtifact::with_bytes(value, bytes),
                    false => AnyArtifact::encode(value),
                })
            },
        }
    }

    /// Reads stored bytes whose digest has been checked, or is computed here if it is not given.
    ///
    /// # Errors
    /// See [`Artifact::decode`].
    pub fn decode(
        &'static self,
        bytes: &[u8],
        digest: Option<Digest>,
    ) -> Result<AnyArtifact, DecodeError> {
        let digest = digest.unwrap_or_else(|| digest_of(self.ty, bytes));
        Ok(AnyArtifact::of_value(self, digest, (self.decode)(bytes)?))
    }

    /// Reads a file that another program wrote, by its extension: `.safetensors` for any type (its
    /// numbers may have another type that holds the same values), or one of [`Self::imports`]. Returns
    /// the artifact and the bytes to store, as [`AnyArtifact::encode`] does.
    ///
    /// # Errors
    /// If the file does not hold an artifact of this type.
    pub fn import(&self, extension: &str, bytes: Bytes) -> Result<EncodedArtifact, String> {
        (self.import)(extension, bytes)
    }
}

/// All that the stored form of a value is made of.
fn encoder<T: Artifact>(value: &T) -> Encoder<'_> {
    let mut encoder = Encoder::default();
    value.encode(&mut encoder);
    add_type::<T>(&mut encoder);
    encoder
}

fn add_type<T: Artifact>(to: &mut Encoder<'_>) {
    to.text("sinew.type", T::TYPE.name);
    to.text("sinew.version", T::TYPE.version.to_string());
}

fn decode_foreign<T: Artifact>(bytes: &[u8]) -> Result<T, DecodeError> {
    T::decode(&foreign::<T>(bytes)?)
}

fn foreign<T: Artifact>(bytes: &[u8]) -> Result<Decoder<'_>, DecodeError> {
    let decoder = Decoder::foreign(bytes)?;
    match decoder.text("sinew.type") {
        Ok(found) if found != T::TYPE.name => {
            Err(DecodeError(format!("it is `{found}` instead of `{}`", T::TYPE.name)))
        }
        _ => Ok(decoder),
    }
}

/// Whether a file is known to have the bytes that its value would be stored with. It is sound then.
fn is_canonical<T: Artifact>(bytes: &[u8]) -> Result<bool, DecodeError> {
    let mut canonical = Encoder::default();
    if !T::check(&foreign::<T>(bytes)?, &mut canonical)? {
        return Ok(false);
    }
    add_type::<T>(&mut canonical);
    Ok(canonical.is(bytes))
}

fn cast<T: Artifact>(value: &dyn Any) -> &T {
    value.downcast_ref().expect("an artifact's kind is that of its value")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::toy::Number;

    /// Imports a file; the artifact's digest, its bytes, and whether they are those of the file.
    fn import(file: Vec<u8>) -> (Digest, Vec<u8>, bool) {
        let (start, kind) = (file.as_ptr(), const { &ArtifactKind::of::<Number>() });
        let (artifact, bytes) = kind.import("safetensors", file.into()).unwrap();
        let is_same = bytes.as_ptr() == start;
        (artifact.digest(), bytes.into_vec(), is_same)
    }

    #[test]
    fn a_file_that_is_written_as_we_do_is_stored_as_it_is() {
        let (artifact, bytes) = AnyArtifact::encode(Number(7));
        let bytes = bytes.into_vec();
        assert_eq!(import(bytes.clone()), (artifact.digest(), bytes.clone(), true));
        // The header padded by eight more spaces: the same value, other bytes.
        let length = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        let header = &bytes[8..8 + length];
        let longer =
            [&(length as u64 + 8).to_le_bytes()[..], header, b"        ", &bytes[8 + length..]];
        assert_eq!(import(longer.concat()), (artifact.digest(), bytes, false));
    }
}
