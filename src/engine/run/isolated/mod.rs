//! Instances that run in a process of their own: a worker process.
//!
//! [`parent`] starts this same program again, writes a [`Job`] as one line of JSON to its standard
//! input, and hears [`Line`]s of JSON from its standard output; [`child`] is the other side.
//! Artifacts go both ways as files in their stored form: an object of the store, or a file in memory
//! (`memfd`) that the other side opens as `/proc/PID/fd/N`. So nothing is left on a disk, however
//! either of them ends.
//!
//! The worker's standard input stays open as long as its result is wanted. When it is closed before
//! the end, the parent is dead, and the worker kills itself with its whole process group.

mod child;
mod parent;

use std::{
    collections::BTreeMap,
    ffi::CStr,
    fs::File,
    io::{self, Write},
    os::fd::{AsRawFd, FromRawFd},
    path::PathBuf,
};

use serde::{Deserialize, Serialize};

pub use child::serve;
pub use parent::{run, too_late};

use crate::engine::digest::Digest;

/// A program that calls [`serve`] for the same library as the run's.
#[derive(Debug, Clone)]
pub struct WorkerProgram {
    pub path: PathBuf,
    pub args: Vec<String>,
}

/// What a worker process is asked to do.
#[derive(Debug, Serialize, Deserialize)]
struct Job {
    kind: String,
    params: serde_json::Value,
    /// By port: artifacts in order, or why one is missing.
    inputs: BTreeMap<String, Vec<Result<ArtifactFile, String>>>,
    /// By port: the (axis, item) labels of its inputs.
    labels: BTreeMap<String, Vec<Vec<(String, String)>>>,
    /// From the paths of parameters to the real paths.
    files: BTreeMap<PathBuf, PathBuf>,
    mirrors: Vec<PathBuf>,
    offline: bool,
    threads: usize,
    /// Bytes that it may allocate.
    memory: Option<u64>,
}

/// An artifact in its stored form.
#[derive(Debug, Serialize, Deserialize)]
struct ArtifactFile {
    #[serde(rename = "type")]
    ty: String,
    path: PathBuf,
    /// Known to the parent, who has checked it; left out by the worker, who is not believed.
    digest: Option<Digest>,
}

/// What a worker process says. The last line is none of `Progress`.
#[derive(Debug, Serialize, Deserialize)]
#[serde(tag = "line", rename_all = "snake_case")]
enum Line {
    Progress {
        fraction: Option<f64>,
        text: String,
    },
    Done {
        outputs: BTreeMap<String, ArtifactFile>,
        absent: BTreeMap<String, String>,
        notes: Vec<String>,
    },
    Failed {
        message: String,
    },
    Environment {
        message: String,
    },
    Panicked {
        message: String,
    },
}

/// A file in memory, and the path by which other processes open it as long as this one keeps it.
fn memory_file(bytes: &[u8]) -> io::Result<(File, PathBuf)> {
    const NAME: &CStr = c"sinew artifact";
    // SAFETY: a plain system call with a name that lives.
    let fd = unsafe { libc::memfd_create(NAME.as_ptr(), libc::MFD_CLOEXEC) };
    if fd == -1 {
        return Err(io::Error::last_os_error());
    }
    // SAFETY: the descriptor is new and nobody else's.
    let mut file = unsafe { File::from_raw_fd(fd) };
    file.write_all(bytes)?;
    let path = format!("/proc/{}/fd/{}", std::process::id(), file.as_raw_fd());
    Ok((file, path.into()))
}
