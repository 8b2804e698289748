//! What tells that an object was checked already: its file looks the same as it did then.
//!
//! A witness is believed until the machine is started again, because whoever lost power may have kept a
//! file's times and lost its bytes; so nothing has to be flushed to the disk for it.

use std::{fs, sync::LazyLock};

use super::objects::Unchecked;
use crate::engine::{artifact::ArtifactType, digest::Digest, file_digests};

/// What a check of this object is remembered by, if its file can tell one state from another.
///
/// `None` for a file that was changed a moment ago and could change again without looking different.
pub fn subject(object: &Unchecked, ty: ArtifactType) -> Option<Digest> {
    let boot = BOOT.as_ref()?;
    let meta = object.file.metadata().ok()?;
    let is_whole = meta.len() == object.map.len() as u64;
    if !is_whole || !file_digests::is_at_rest(&meta) {
        return None;
    }
    let mut hasher = blake3::Hasher::new();
    hasher.update(boot.as_bytes());
    hasher.update(ty.name.as_bytes());
    hasher.update(&[0]);
    hasher.update(&ty.version.to_le_bytes());
    hasher.update(&file_digests::identity(&object.path, &meta).0);
    Some(Digest(*hasher.finalize().as_bytes()))
}

/// Names the time since this machine was started.
static BOOT: LazyLock<Option<String>> =
    LazyLock::new(|| fs::read_to_string("/proc/sys/kernel/random/boot_id").ok());

#[cfg(test)]
mod tests {
    use std::{fs::File, path::Path, thread, time::Duration};

    use super::*;
    use crate::engine::{
        artifact::{Artifact, digest_of},
        store::{Access, Note, ObjectError, Store, disk::Disk, gc, objects},
        toy::{Number, TOY},
    };

    const TY: ArtifactType = Number::TYPE;

    fn open(folder: &Path) -> Store {
        Store::open(folder, Access::ReadWrite).unwrap()
    }

    /// Stores bytes under the digest of others.
    fn put(folder: &Path, digest_of_these: &[u8], bytes: &[u8]) -> Digest {
        let digest = digest_of(TY, digest_of_these);
        objects::write(&Disk::default(), folder, &digest, bytes).unwrap();
        digest
    }

    fn look(folder: &Path, digest: &Digest) -> Option<Digest> {
        subject(&objects::open(&Disk::default(), folder, digest).unwrap(), TY)
    }

    #[test]
    fn an_object_is_believed_as_long_as_its_file_looks_the_same() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let store = open(folder);
        let (good, bad) = (vec![1; 100_000], vec![2; 100_000]);
        let sound = put(folder, &good, &good);
        // Damaged, as a decaying disk does it, after it was checked.
        let decayed = put(folder, b"other bytes", &bad);
        assert!(store.object(TY, &sound).is_ok());
        assert_eq!(look(folder, &sound), None, "it was written a moment ago");
        thread::sleep(Duration::from_secs(4));

        let subject = look(folder, &sound).unwrap();
        assert_eq!(store.recall(Note::Checked, &subject), None);
        assert!(store.object(TY, &sound).is_ok());
        assert_eq!(store.recall(Note::Checked, &subject).unwrap(), sound.0);
        let note = (Note::Checked, look(folder, &decayed).unwrap(), decayed.0.to_vec());
        store.remember(vec![note]).unwrap();
        assert!(store.object(TY, &decayed).is_ok(), "its file looks as it did");
        assert!(store.object(TY, &sound).is_ok());

        // The same length and time of change, but other bytes.
        let path = store.object_path(&sound);
        let changed = path.metadata().unwrap().modified().unwrap();
        fs::write(&path, &bad).unwrap();
        File::options().write(true).open(&path).unwrap().set_modified(changed).unwrap();
        assert!(matches!(store.object(TY, &sound), Err(ObjectError::Damaged { .. })));

        // Whoever verifies believes nothing.
        let verifying = open(folder);
        verifying.check_again();
        assert!(matches!(verifying.object(TY, &decayed), Err(ObjectError::Damaged { .. })));
    }

    #[test]
    fn housekeeping_forgets_what_was_checked_and_verifies_all() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let bytes = vec![1; 100_000];
        let digest = put(folder, &bytes, &bytes);
        thread::sleep(Duration::from_secs(4));
        let subject = look(folder, &digest).unwrap();
        assert!(open(folder).object(TY, &digest).is_ok());
        assert!(open(folder).recall(Note::Checked, &subject).is_some());
        assert!(gc::verify(folder, &TOY).unwrap().damaged.is_empty());
        assert!(open(folder).recall(Note::Checked, &subject).is_some());
        gc::collect(folder, &gc::GcOptions { keep_runs: Some(1), ..Default::default() }).unwrap();
        assert!(open(folder).recall(Note::Checked, &subject).is_none());
    }
}
