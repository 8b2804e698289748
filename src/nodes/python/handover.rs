//! Artifacts on their way to an interpreter and back: files that the other side maps.
//!
//! What is stored is handed over as it lies in the store; all else goes through memory that has no name
//! in any folder (`memfd`), so nothing is left behind whatever happens.

use std::{
    ffi::CStr,
    fs::File,
    io::{self, Read, Write},
    os::fd::{AsRawFd, FromRawFd},
};

use memmap2::MmapOptions;
use serde_json::{Map, Value as Json, json};

use crate::artifacts;
use crate::engine::artifact::{AnyArtifact, Bytes, EncodedArtifact};
use crate::engine::node::{Labels, NodeError, NodeIo, Port};

/// The inputs of a call. The files stay open as long as it lives.
pub struct Given {
    request: Map<String, Json>,
    _files: Vec<File>,
}

impl Given {
    pub fn new(io: &NodeIo<'_>) -> Result<Self, NodeError> {
        let (mut request, mut files) = (Map::new(), Vec::new());
        for (port, list) in io.inputs() {
            let mut items = Vec::new();
            for artifact in list {
                items.push(match artifact {
                    Ok(artifact) => {
                        let file = file_of(io, artifact).map_err(no_memory)?;
                        let item = json!({ "type": artifact.ty().name, "path": path(&file) });
                        files.push(file);
                        item
                    }
                    Err(why) => json!({ "missing": **why }),
                });
            }
            let value = match port.arity.takes_list() {
                true => json!({ "items": items, "labels": labels(io, port.name) }),
                false => items.remove(0),
            };
            request.insert(port.name.to_owned(), value);
        }
        Ok(Self { request, _files: files })
    }

    pub fn request(&self) -> &Map<String, Json> {
        &self.request
    }
}

/// What the items of a list are called, by their axes.
fn labels(io: &NodeIo<'_>, port: &str) -> Vec<Json> {
    let item = |labels: &Labels| {
        let pairs = labels.iter().map(|(axis, item)| (axis.to_string(), Json::from(&**item)));
        Json::Object(pairs.collect::<Map<String, Json>>())
    };
    io.labels(port).iter().map(item).collect()
}

/// An artifact as a file.
fn file_of(io: &NodeIo<'_>, artifact: &AnyArtifact) -> io::Result<File> {
    if let Some(Ok(file)) = io.stored_file(artifact).map(File::open) {
        return Ok(file);
    }
    let mut file = memory(c"sinew input")?;
    file.write_all(&artifact.bytes())?;
    Ok(file)
}

/// Where the outputs of a call come.
pub struct Taken {
    ports: Vec<(&'static Port, File)>,
}

impl Taken {
    pub fn new(ports: impl Iterator<Item = &'static Port>) -> Result<Self, NodeError> {
        let ports = ports.map(|it| Ok((it, memory(c"sinew output")?)));
        Ok(Self { ports: ports.collect::<io::Result<_>>().map_err(no_memory)? })
    }

    pub fn request(&self) -> Json {
        let port = |(port, file): &(&'static Port, File)| {
            let ty = port.ty;
            let output = json!({ "type": ty.name, "version": ty.version, "path": path(file) });
            (port.name.to_owned(), output)
        };
        Json::Object(self.ports.iter().map(port).collect::<Map<String, Json>>())
    }

    /// What was written, checked.
    ///
    /// # Errors
    /// If it is no artifact of the port's type.
    pub fn read(self) -> Result<Vec<(&'static str, EncodedArtifact)>, NodeError> {
        let read = |(port, file): (&Port, File)| {
            let bytes = content(file).map_err(no_memory)?;
            let kind = artifacts::kind(port.ty.name).expect("checked types are registered");
            let artifact = kind.import("safetensors", bytes).map_err(|message| {
                let (port, ty) = (port.name, port.ty.name);
                NodeError::failed(format!("output `{port}` is no `{ty}`: {message}"))
            })?;
            Ok((port.name, artifact))
        };
        self.ports.into_iter().map(read).collect()
    }
}

/// What lies in memory that the other side has written to; not copied if nobody can change it any more.
fn content(mut file: File) -> io::Result<Bytes> {
    if seal(&file) {
        // A private map: older kernels refuse a shared one of sealed memory.
        // SAFETY: sealed memory keeps its bytes and its length.
        let map = unsafe { MmapOptions::new().map_copy_read_only(&file) }?;
        return Ok(Bytes::Mapped(map.into()));
    }
    // A script that maps files by itself may hold this one, too.
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes)?;
    Ok(Bytes::Owned(bytes))
}

/// Makes memory so that nobody can change it; false if somebody has it mapped to write to it.
fn seal(file: &File) -> bool {
    let seals = libc::F_SEAL_WRITE | libc::F_SEAL_SHRINK | libc::F_SEAL_GROW;
    // SAFETY: a plain system call on a descriptor of ours.
    unsafe { libc::fcntl(file.as_raw_fd(), libc::F_ADD_SEALS, seals) == 0 }
}

/// Memory that can be opened as a file.
fn memory(name: &CStr) -> io::Result<File> {
    // SAFETY: the name ends with a zero; the descriptor is ours alone.
    unsafe {
        match libc::memfd_create(name.as_ptr(), libc::MFD_CLOEXEC | libc::MFD_ALLOW_SEALING) {
            -1 => Err(io::Error::last_os_error()),
            fd => Ok(File::from_raw_fd(fd)),
        }
    }
}

/// A path by which another process opens a file of ours.
fn path(file: &File) -> String {
    format!("/proc/{}/fd/{}", std::process::id(), file.as_raw_fd())
}

fn no_memory(error: io::Error) -> NodeError {
    NodeError::environment(format!("cannot hand artifacts over to Python: {error}"))
}
