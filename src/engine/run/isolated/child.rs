//! The worker process: runs one node that its parent describes.

use std::{
    collections::BTreeMap,
    fs::File,
    io::{self, BufRead, BufReader, Read, Write},
    os::fd::{AsRawFd, FromRawFd},
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, Ordering},
    },
    thread::{self, JoinHandle},
};

use memmap2::Mmap;

use super::{ArtifactFile, Job, Line, memory_file};
use crate::engine::{
    artifact::AnyArtifact,
    labels::{InputLabels, Labels},
    library::Library,
    node::{NodeError, NodeIo, NodeOutputs, PortInputs, Spec, Surroundings},
    pipeline::with_ports,
    run::guard,
};

/// Does the one job that is described on standard input. Returns when the parent has the result.
///
/// # Errors
/// If standard input holds no job, or the parent cannot be told.
pub fn serve(library: &Library) -> io::Result<()> {
    let lines = Lines::take_standard_output()?;
    let mut stdin = BufReader::new(io::stdin());
    let mut text = String::new();
    stdin.read_line(&mut text)?;
    let job: Job = serde_json::from_str(&text)?;
    let is_done = Arc::new(AtomicBool::new(false));
    let parent = watch_parent(stdin, Arc::clone(&is_done));
    guard::catch_panic_places();
    // The files live as long as the parent may open them.
    let (line, _files) = last_line(library, job, &lines);
    is_done.store(true, Ordering::SeqCst);
    lines.write(&line)?;
    let _ = parent.join();
    Ok(())
}

fn last_line(library: &Library, job: Job, lines: &Lines) -> (Line, Vec<File>) {
    let result = guard::guarded(|| {
        let outputs = run(library, job, lines)?;
        keep_outputs(outputs).map_err(|e| NodeError::environment(format!("no memory: {e}")))
    });
    let line = match result {
        Ok(Ok(done)) => return done,
        Ok(Err(NodeError::Failed(message))) => Line::Failed { message },
        Ok(Err(NodeError::Environment(message))) => Line::Environment { message },
        Err(message) => Line::Panicked { message },
    };
    (line, Vec::new())
}

fn run(library: &Library, job: Job, lines: &Lines) -> Result<NodeOutputs, NodeError> {
    let kind = library.kind(&job.kind).expect("parent and worker have the same kinds");
    let spec = &with_ports(kind, &job.params, library).spec;
    let node = (kind.parse)(job.params).expect("the parent's parameters are checked");
    let inputs = read_inputs(library, spec, &job.inputs)?;
    let labels = read_labels(spec, &job.labels);
    let surroundings = Surroundings { mirrors: job.mirrors, offline: job.offline, isolated: true };
    let progress = |fraction, text: &str| {
        // A parent that does not listen is dead, and this process soon as well.
        let _ = lines.write(&Line::Progress { fraction, text: text.to_owned() });
    };
    let pool = if job.threads > 1 { guard::pool(job.threads) } else { guard::own_pool() };
    limit_memory(job.memory)?;
    pool.install(|| {
        let mut io = NodeIo::new(spec, inputs, labels, job.files, &surroundings, &progress);
        node.run(&mut io)?;
        Ok(io.finish())
    })
}

fn read_inputs(
    library: &Library,
    spec: &Spec,
    inputs: &BTreeMap<String, Vec<Result<ArtifactFile, String>>>,
) -> Result<BTreeMap<&'static str, PortInputs>, NodeError> {
    let mut res = BTreeMap::new();
    for port in spec.inputs {
        let mut list = PortInputs::new();
        for input in inputs.get(port.name).into_iter().flatten() {
            list.push(match input {
                Ok(file) => Ok(read_input(library, file)?),
                Err(why_missing) => Err(why_missing.as_str().into()),
            });
        }
        res.insert(port.name, list);
    }
    Ok(res)
}

fn read_labels(spec: &Spec, labels: &BTreeMap<String, Vec<Vec<(String, String)>>>) -> InputLabels {
    let read = |it: &Vec<(String, String)>| -> Labels {
        it.iter().map(|(axis, item)| (axis.as_str().into(), item.as_str().into())).collect()
    };
    let ports = spec.inputs.iter();
    ports
        .filter_map(|it| Some((it.name, labels.get(it.name)?.iter().map(read).collect())))
        .collect()
}

fn read_input(library: &Library, file: &ArtifactFile) -> Result<AnyArtifact, NodeError> {
    let ArtifactFile { ty, path, digest } = file;
    let fail = |error: &dyn std::fmt::Display| {
        NodeError::environment(format!("cannot read an input from `{}`: {error}", path.display()))
    };
    let opened = File::open(path).map_err(|e| fail(&e))?;
    // SAFETY: objects of the store are never changed, and the parent does not touch files in memory.
    let bytes = unsafe { Mmap::map(&opened) }.map_err(|e| fail(&e))?;
    let kind = library.artifact_kind(ty).expect("parent and worker have the same types");
    kind.decode(&bytes, *digest).map_err(|e| fail(&e))
}

/// Puts the outputs where the parent finds them.
fn keep_outputs(result: NodeOutputs) -> io::Result<(Line, Vec<File>)> {
    let mut files = Vec::new();
    let mut outputs = BTreeMap::new();
    for (port, (artifact, bytes)) in result.artifacts {
        let (file, path) = memory_file(&bytes)?;
        files.push(file);
        let ty = artifact.ty().name.to_owned();
        outputs.insert(port.to_owned(), ArtifactFile { ty, path, digest: None });
    }
    let absent = result.absent.into_iter().map(|(port, why)| (port.to_owned(), why)).collect();
    Ok((Line::Done { outputs, absent, notes: result.notes }, files))
}

/// Where the parent listens. Kernels and programs that print write to standard error instead.
struct Lines(Mutex<File>);

impl Lines {
    fn take_standard_output() -> io::Result<Self> {
        // SAFETY: plain system calls; the descriptor is new and nobody else's.
        let own = unsafe { libc::fcntl(libc::STDOUT_FILENO, libc::F_DUPFD_CLOEXEC, 3) };
        if own == -1 {
            return Err(io::Error::last_os_error());
        }
        // SAFETY: as above.
        let file = unsafe { File::from_raw_fd(own) };
        // SAFETY: as above.
        if unsafe { libc::dup2(io::stderr().as_raw_fd(), libc::STDOUT_FILENO) } == -1 {
            return Err(io::Error::last_os_error());
        }
        Ok(Self(Mutex::new(file)))
    }

    fn write(&self, line: &Line) -> io::Result<()> {
        let mut text = serde_json::to_vec(line)?;
        text.push(b'\n');
        self.0.lock().expect("no thread panics while it writes a line").write_all(&text)
    }
}

/// Waits until the parent closes standard input. If that is before the end, the parent is dead: then
/// this process ends with everything that it has started.
fn watch_parent(mut stdin: impl Read + Send + 'static, is_done: Arc<AtomicBool>) -> JoinHandle<()> {
    thread::spawn(move || {
        let _ = io::copy(&mut stdin, &mut io::sink());
        if !is_done.load(Ordering::SeqCst) {
            // SAFETY: plain system calls.
            unsafe {
                // Started by hand, it may share the group of the shell.
                if libc::getpgrp() == libc::getpid() {
                    libc::kill(0, libc::SIGKILL);
                }
            }
            std::process::exit(1);
        }
    })
}

/// Limits what this process may allocate (private memory that can be written: mapped files, such as
/// inputs, and the program itself do not count).
fn limit_memory(bytes: Option<u64>) -> Result<(), NodeError> {
    let Some(bytes) = bytes else { return Ok(()) };
    let limit = libc::rlimit { rlim_cur: bytes, rlim_max: bytes };
    // SAFETY: a plain system call with a struct that lives.
    if unsafe { libc::setrlimit(libc::RLIMIT_DATA, &raw const limit) } == -1 {
        let error = io::Error::last_os_error();
        return Err(NodeError::environment(format!("cannot limit its memory: {error}")));
    }
    Ok(())
}
