//! The store's way to the disk: every system call goes through here, so that any of them can fail.
//!
//! A [`Disk`] is the real one unless it is given [`Faults`], which are asked before every operation.
//! So what a run does when a disk is full, torn or gone is tested operation by operation.

use std::{
    fs::{self, File, OpenOptions},
    hash::{BuildHasher, Hasher},
    io,
    os::unix::fs::{FileExt, MetadataExt, OpenOptionsExt},
    path::{Path, PathBuf},
    sync::Arc,
};

use memmap2::{Mmap, MmapOptions};

use super::StoreError;
use crate::engine::digest::Digest;

/// One thing that is asked of a disk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Operation {
    MakeFolder,
    List,
    Open,
    Create,
    Read,
    Write,
    Cut,
    Rename,
    Remove,
    Lock,
}

/// What becomes of an operation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    Go,
    /// The error with this number, such as `ENOSPC`.
    Fail(i32),
    /// Only so many bytes are written, then `EIO`; or so many are there to be read.
    Short(usize),
    /// It is reported as done, but is not.
    Ignore,
}

/// Decides what fails.
pub trait Faults: Send + Sync {
    fn verdict(&self, operation: Operation, path: &Path) -> Verdict;
}

/// The disk, or one that fails on demand.
#[derive(Clone, Default)]
pub struct Disk {
    faults: Option<Arc<dyn Faults>>,
}

impl Disk {
    pub fn with_faults(faults: Arc<dyn Faults>) -> Self {
        Self { faults: Some(faults) }
    }

    fn ask(&self, operation: Operation, path: &Path) -> io::Result<Verdict> {
        match &self.faults {
            None => Ok(Verdict::Go),
            Some(faults) => match faults.verdict(operation, path) {
                Verdict::Fail(code) => Err(io::Error::from_raw_os_error(code)),
                verdict => Ok(verdict),
            },
        }
    }

    /// Asks for an operation that happens or does not.
    fn goes(&self, operation: Operation, path: &Path) -> io::Result<bool> {
        Ok(self.ask(operation, path)? != Verdict::Ignore)
    }

    pub fn make_folder(&self, path: &Path) -> io::Result<()> {
        if self.goes(Operation::MakeFolder, path)? { fs::create_dir_all(path) } else { Ok(()) }
    }

    /// Makes a folder and does something in it; again if somebody has removed the folder in between.
    pub fn in_folder<T>(
        &self,
        folder: &Path,
        act: impl Fn() -> Result<T, StoreError>,
    ) -> Result<T, StoreError> {
        let mut attempt = 1;
        loop {
            self.make_folder(folder).map_err(StoreError::new("make the folder", folder))?;
            match act() {
                Err(it) if it.error.kind() == io::ErrorKind::NotFound && attempt < ATTEMPTS => {}
                result => return result,
            }
            attempt += 1;
        }
    }

    /// The paths in a folder, sorted.
    pub fn list(&self, path: &Path) -> io::Result<Vec<PathBuf>> {
        self.ask(Operation::List, path)?;
        let mut paths =
            fs::read_dir(path)?.map(|it| Ok(it?.path())).collect::<io::Result<Vec<_>>>()?;
        paths.sort();
        Ok(paths)
    }

    pub fn open(&self, path: &Path) -> io::Result<File> {
        self.ask(Operation::Open, path)?;
        File::open(path)
    }

    /// Opens a file to read and write that is there.
    pub fn open_to_write(&self, path: &Path) -> io::Result<File> {
        self.ask(Operation::Open, path)?;
        File::options().read(true).write(true).open(path)
    }

    /// Opens a file to read and write, and makes it if it is not there.
    pub fn open_or_create(&self, path: &Path) -> io::Result<File> {
        self.ask(Operation::Create, path)?;
        File::options().read(true).write(true).create(true).truncate(false).open(path)
    }

    /// Makes a file that was not there.
    pub fn create_new(&self, path: &Path) -> io::Result<File> {
        self.ask(Operation::Create, path)?;
        File::options().read(true).write(true).create_new(true).open(path)
    }

    pub fn length(&self, file: &File, path: &Path) -> io::Result<u64> {
        self.ask(Operation::Read, path)?;
        Ok(file.metadata()?.len())
    }

    pub fn read_at(&self, file: &File, path: &Path, to: &mut [u8], offset: u64) -> io::Result<()> {
        match self.ask(Operation::Read, path)? {
            Verdict::Short(n) if n < to.len() => Err(io::ErrorKind::UnexpectedEof.into()),
            _ => file.read_exact_at(to, offset),
        }
    }

    /// All bytes of a file.
    pub fn read_whole(&self, path: &Path) -> io::Result<Vec<u8>> {
        let file = self.open(path)?;
        let mut bytes = vec![0; self.length(&file, path)? as usize];
        self.read_at(&file, path, &mut bytes, 0)?;
        Ok(bytes)
    }

    /// Maps a file.
    ///
    /// # Safety
    /// Nobody may make the file shorter or change its bytes while the map lives.
    pub unsafe fn map(&self, file: &File, path: &Path) -> io::Result<Mmap> {
        let mut options = MmapOptions::new();
        if let Verdict::Short(n) = self.ask(Operation::Read, path)? {
            options.len((file.metadata()?.len() as usize).min(n));
        }
        // SAFETY: the caller's promise.
        unsafe { options.map(file) }
    }

    pub fn write_at(&self, file: &File, path: &Path, bytes: &[u8], offset: u64) -> io::Result<()> {
        match self.ask(Operation::Write, path)? {
            Verdict::Go | Verdict::Fail(_) => file.write_all_at(bytes, offset),
            Verdict::Ignore => Ok(()),
            Verdict::Short(n) => {
                file.write_all_at(&bytes[..n.min(bytes.len())], offset)?;
                Err(io::Error::from_raw_os_error(libc::EIO))
            }
        }
    }

    pub fn cut(&self, file: &File, path: &Path, length: u64) -> io::Result<()> {
        if self.goes(Operation::Cut, path)? { file.set_len(length) } else { Ok(()) }
    }

    pub fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        if self.goes(Operation::Rename, to)? { fs::rename(from, to) } else { Ok(()) }
    }

    pub fn remove(&self, path: &Path) -> io::Result<()> {
        if self.goes(Operation::Remove, path)? { fs::remove_file(path) } else { Ok(()) }
    }

    /// Waits for a lock of a file beside others.
    pub fn lock_shared(&self, file: &File, path: &Path) -> io::Result<()> {
        self.ask(Operation::Lock, path)?;
        file.lock_shared()
    }

    /// Takes a file's lock alone; false if somebody has it.
    pub fn try_lock(&self, file: &File, path: &Path) -> io::Result<bool> {
        self.ask(Operation::Lock, path)?;
        match file.try_lock() {
            Ok(()) => Ok(true),
            Err(fs::TryLockError::WouldBlock) => Ok(false),
            Err(fs::TryLockError::Error(error)) => Err(error),
        }
    }

    /// Asks before a claim, which is a lock of its own kind.
    pub fn may_claim(&self, path: &Path) -> io::Result<()> {
        self.ask(Operation::Lock, path).map(drop)
    }

    /// Writes a whole file, which appears at its path when it is complete.
    ///
    /// The temporary file's name comes from the path's: one that a killed process has left is
    /// taken over by the next who writes the same file, so that they never pile up.
    pub fn write_whole(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        let (temporary, file) = self.temporary(path)?;
        let written = self.write_at(&file, &temporary, bytes, 0);
        // The lock on the file is held until it has its name.
        let result = written.and_then(|()| self.rename(&temporary, path));
        if result.is_err() {
            let _ = self.remove(&temporary);
        }
        self.sweep(path);
        result
    }

    /// Removes what killed writers of a file have left.
    pub fn sweep(&self, path: &Path) {
        for turn in 0..MAX_WRITERS {
            let temporary = temporary_path(path, turn);
            match self.open(&temporary) {
                Ok(file) => {
                    let is_left = self.try_lock(&file, &temporary).unwrap_or(false);
                    if is_left && is_at(&file, &temporary) {
                        let _ = self.remove(&temporary);
                    }
                }
                Err(_) if turn == 0 => {}
                Err(_) => return,
            }
        }
    }

    /// An empty file beside a path that nobody else writes to.
    fn temporary(&self, path: &Path) -> io::Result<(PathBuf, File)> {
        let mut options = OpenOptions::new();
        options.read(true).write(true).create(true).truncate(false).custom_flags(libc::O_NOFOLLOW);
        for turn in 0..MAX_WRITERS {
            let temporary = temporary_path(path, turn);
            self.ask(Operation::Create, &temporary)?;
            let file = options.open(&temporary)?;
            // Another may have renamed it between our opening and our locking: then what we hold is
            // a finished file.
            if self.try_lock(&file, &temporary)? && is_at(&file, &temporary) {
                self.cut(&file, &temporary, 0)?;
                return Ok((temporary, file));
            }
        }
        let message = format!("{MAX_WRITERS} others are writing `{}`", path.display());
        Err(io::Error::new(io::ErrorKind::ResourceBusy, message))
    }
}

/// Where the writer of a file writes first, whose turn it is among those who write it now.
fn temporary_path(path: &Path, turn: usize) -> PathBuf {
    let name = Digest::of(path.file_name().unwrap_or_default().as_encoded_bytes()).to_string();
    path.with_file_name(format!("{TEMPORARY}{}-{turn}", &name[..16]))
}

/// How the names of unfinished files begin.
pub const TEMPORARY: &str = ".sinew-";

/// So many processes may write one file at the same moment.
const MAX_WRITERS: usize = 1000;

/// So often a folder is made again that vanishes while it is written to.
const ATTEMPTS: usize = 5;

/// A word for names that nobody else uses; nothing depends on it.
pub fn unique_word() -> String {
    format!("{:016x}", std::collections::hash_map::RandomState::new().build_hasher().finish())
}

/// Whether a path still leads to an open file.
pub fn is_at(file: &File, path: &Path) -> bool {
    let (Ok(open), Ok(there)) = (file.metadata(), fs::symlink_metadata(path)) else { return false };
    (open.dev(), open.ino()) == (there.dev(), there.ino())
}

/// Whether an open file has been removed.
pub fn is_removed(file: &File) -> bool {
    file.metadata().is_ok_and(|it| it.nlink() == 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_left_by_a_killed_writer_is_taken_over() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        let disk = Disk::default();
        // What a killed writer leaves: a longer text in the temporary file.
        let (left, file) = disk.temporary(&path).unwrap();
        disk.write_at(&file, &left, b"something longer", 0).unwrap();
        drop(file);
        disk.write_whole(&path, b"short").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"short");
        assert_eq!(disk.list(folder.path()).unwrap(), [path]);
    }

    #[test]
    fn two_writers_of_one_file_do_not_meet() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        let disk = Disk::default();
        let (_, _held) = disk.temporary(&path).unwrap();
        std::thread::scope(|scope| {
            for text in ["one", "two", "six"] {
                let (disk, path) = (&disk, &path);
                scope.spawn(move || {
                    for _ in 0..50 {
                        disk.write_whole(path, text.repeat(1000).as_bytes()).unwrap();
                        let found = fs::read_to_string(path).unwrap();
                        assert!(["one", "two", "six"].iter().any(|it| found == it.repeat(1000)));
                    }
                });
            }
        });
        assert_eq!(disk.list(folder.path()).unwrap().len(), 2);
    }
}
