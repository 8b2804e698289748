//! Claims: one process computes a key, the others wait.
//!
//! A claim is a lock on one byte of one file, at an offset that comes from the key. It costs a
//! system call, leaves nothing behind, and the kernel takes it back when its holder dies. (Two keys
//! whose offsets collide, one chance in 2^62, only wait for each other.)

use std::{
    collections::HashSet,
    fs::File,
    io,
    os::fd::AsRawFd,
    sync::{Arc, Mutex, MutexGuard},
};

use crate::engine::digest::Digest;

/// The file of claims, and which of them this process has taken through it.
#[derive(Debug)]
pub struct Claims {
    file: File,
    /// Offsets: to the kernel, two runs that share an open file are one.
    held: Mutex<HashSet<i64>>,
}

impl Claims {
    pub fn new(file: File) -> Self {
        Self { file, held: Mutex::default() }
    }

    fn held(&self) -> MutexGuard<'_, HashSet<i64>> {
        self.held.lock().expect("no thread panics while it holds the list of claims")
    }
}

/// The right to compute a key, given back when dropped.
#[derive(Debug)]
pub struct Claim {
    held: Option<(Arc<Claims>, i64)>,
}

impl Claim {
    /// A claim that excludes nobody, for stores that are not written.
    pub fn none() -> Self {
        Self { held: None }
    }

    /// Takes the claim, or returns `None` if another run has it, in this or another process.
    pub fn take(claims: &Arc<Claims>, key: &Digest) -> io::Result<Option<Self>> {
        let first = key.0.first_chunk().expect("a digest has 32 bytes");
        let offset = (u64::from_le_bytes(*first) >> 2) as i64;
        let mut held = claims.held();
        if held.contains(&offset) {
            return Ok(None);
        }
        match lock(&claims.file, offset, libc::F_WRLCK) {
            Ok(()) => {
                held.insert(offset);
                Ok(Some(Self { held: Some((Arc::clone(claims), offset)) }))
            }
            Err(error) if is_busy(&error) => Ok(None),
            Err(error) => Err(error),
        }
    }
}

impl Drop for Claim {
    fn drop(&mut self) {
        if let Some((claims, offset)) = &self.held {
            let mut held = claims.held();
            // It can only fail for a file that is gone, and then nobody waits.
            let _ = lock(&claims.file, *offset, libc::F_UNLCK);
            held.remove(offset);
        }
    }
}

fn is_busy(error: &io::Error) -> bool {
    matches!(error.raw_os_error(), Some(libc::EAGAIN | libc::EACCES))
}

/// Locks belong to the open file, not to the process, so two stores opened by one process exclude
/// each other as two processes do.
fn lock(file: &File, offset: i64, kind: i32) -> io::Result<()> {
    let range = libc::flock {
        l_type: kind as i16,
        l_whence: libc::SEEK_SET as i16,
        l_start: offset,
        l_len: 1,
        l_pid: 0,
    };
    // SAFETY: a plain system call on a file that lives, with a struct that lives.
    let result = unsafe { libc::fcntl(file.as_raw_fd(), libc::F_OFD_SETLK, &raw const range) };
    if result == -1 { Err(io::Error::last_os_error()) } else { Ok(()) }
}
