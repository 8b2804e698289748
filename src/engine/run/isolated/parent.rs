//! The parent of a worker process: describes the job, listens, takes over the outputs.

use std::{
    collections::BTreeMap,
    fs::File,
    io::{self, Read},
    process::{Command, Stdio},
    time::Instant,
};

use super::{ArtifactFile, Job, Line, WorkerProgram, memory_file};
use crate::engine::{
    artifact::Bytes,
    cancel::CancelToken,
    events::Failure,
    graph::Instance,
    labels::Labels,
    library::Library,
    node::{NodeOutputs, ProgressFn},
    program::{End, Input, Lines, Process, Stream, Tail},
    run::{
        RunOptions,
        worker::{Context, JobInputs, JobResult, Value},
    },
    settings::{show_limit, show_memory},
    store::{ObjectError, Store},
};

/// Runs an instance in a worker process.
pub fn run(
    context: &Context<'_>,
    instance: &Instance,
    inputs: &BTreeMap<&'static str, JobInputs>,
    threads: usize,
    cancel: &CancelToken,
    progress: ProgressFn<'_>,
) -> JobResult {
    let start = Instant::now();
    let mut memory_files = Vec::new();
    let inputs = match input_files(context.store, inputs, &mut memory_files) {
        Ok(inputs) => inputs,
        Err(NoInput::Lost(lost)) => return lost,
        Err(NoInput::Machine(error)) => {
            let message = format!("cannot hand an input to a worker: {error}");
            let failure = Failure::Environment(message);
            return JobResult::Failed { failure, wall: start.elapsed() };
        }
    };
    let job = job(context.options, instance, inputs, threads);
    let cancel = cancel.with_limit(instance.settings.timeout);
    let program = context.options.worker.as_ref();
    let result = Exchange { library: context.library, instance, last: None }
        .with_worker(program, &job, &cancel, progress);
    let wall = start.elapsed();
    match result {
        Ok(outputs) => JobResult::Ran { outputs, wall },
        Err(Some(failure)) => JobResult::Failed { failure, wall },
        Err(None) => JobResult::Stopped,
    }
}

fn job(
    options: &RunOptions,
    instance: &Instance,
    inputs: BTreeMap<String, InputFiles>,
    threads: usize,
) -> Job {
    let written =
        |it: &Labels| it.iter().map(|(axis, item)| (axis.to_string(), item.to_string())).collect();
    let labels = instance.input_labels.iter();
    Job {
        kind: instance.kind.spec.kind.to_owned(),
        params: instance.node.params(),
        inputs,
        labels: labels
            .map(|(port, list)| ((*port).to_owned(), list.iter().map(written).collect()))
            .collect(),
        files: instance.files.clone(),
        mirrors: options.surroundings.mirrors.clone(),
        offline: options.surroundings.offline,
        threads,
        memory: instance.settings.isolate.and_then(|it| it.memory),
    }
}

/// Why the inputs cannot be handed over.
enum NoInput {
    /// One of them has to be made again.
    Lost(JobResult),
    Machine(io::Error),
}

/// What is at a port: files, or why an input is missing.
type InputFiles = Vec<Result<ArtifactFile, String>>;

/// Inputs as files; `keep` holds those in memory.
fn input_files(
    store: &Store,
    inputs: &BTreeMap<&'static str, JobInputs>,
    keep: &mut Vec<File>,
) -> Result<BTreeMap<String, InputFiles>, NoInput> {
    let mut res = BTreeMap::new();
    for (port, values) in inputs {
        let mut list = InputFiles::new();
        for value in values {
            list.push(match value {
                Ok(value) => Ok(input_file(store, value, keep)?),
                Err(why_missing) => Err(why_missing.to_string()),
            });
        }
        res.insert((*port).to_owned(), list);
    }
    Ok(res)
}

fn input_file(store: &Store, value: &Value, keep: &mut Vec<File>) -> Result<ArtifactFile, NoInput> {
    let mut in_memory = |bytes: &[u8]| {
        let (file, path) = memory_file(bytes).map_err(NoInput::Machine)?;
        keep.push(file);
        Ok(path)
    };
    let (ty, path, digest) = match value {
        Value::Live(artifact) => (artifact.ty(), in_memory(&artifact.bytes())?, artifact.digest()),
        Value::Stored { from, ty, digest } => {
            let lost = |error: ObjectError| NoInput::Lost(JobResult::Lost { from: *from, error });
            let path = match store.object(*ty, digest).map_err(lost)? {
                Bytes::Mapped(_) => store.object_path(digest),
                Bytes::Owned(bytes) => in_memory(&bytes)?,
            };
            (*ty, path, *digest)
        }
    };
    Ok(ArtifactFile { ty: ty.name.to_owned(), path, digest: Some(digest) })
}

/// What is said between the two processes.
struct Exchange<'a> {
    library: &'a Library,
    instance: &'a Instance,
    /// What the worker's last line came to.
    last: Option<Result<NodeOutputs, Failure>>,
}

impl Exchange<'_> {
    /// The outputs, or why there are none; `Err(None)` if the run was given up.
    fn with_worker(
        mut self,
        program: Option<&WorkerProgram>,
        job: &Job,
        cancel: &CancelToken,
        progress: ProgressFn<'_>,
    ) -> Result<NodeOutputs, Option<Failure>> {
        let machine = |message: String| Some(Failure::Environment(message));
        let program = program
            .ok_or_else(|| machine("this run has no program for worker processes".to_owned()))?;
        let mut text = serde_json::to_vec(job)
            .map_err(|e| machine(format!("cannot describe the job to a worker: {e}")))?;
        text.push(b'\n');
        let mut command = Command::new(&program.path);
        command.args(&program.args).stdin(Stdio::piped()).stdout(Stdio::piped());
        let (end, stderr) = self
            .talk(command, text, cancel, progress)
            .map_err(|e| machine(format!("cannot start a worker: {e}")))?;
        match (self.last.take(), end) {
            (Some(result), _) => result.map_err(Some),
            (None, End::GivenUp) => Err(None),
            (None, End::Late) => Err(Some(too_late(self.instance))),
            (None, _) => Err(Some(self.crash(end, &stderr))),
        }
    }

    /// How the worker ended, and the end of its standard error.
    fn talk(
        &mut self,
        command: Command,
        job: Vec<u8>,
        cancel: &CancelToken,
        progress: ProgressFn<'_>,
    ) -> io::Result<(End, Tail)> {
        let id = self.instance.id();
        let log = |line: &str| tracing::info!(instance = id, line, "a worker says");
        let (mut lines, mut error_lines) = (Lines::default(), Lines::default());
        let mut stderr = Tail::default();
        let mut worker = Process::start(command, true)?;
        let mut input = Some(worker.feed(job));
        let end = worker.watch(cancel, &mut |stream, bytes| match stream {
            Stream::Stdout => lines.push(bytes, |it| self.hear(it, progress, &mut input)),
            Stream::Stderr => {
                stderr.push(bytes);
                error_lines.push(bytes, log);
            }
        })?;
        lines.end(|it| self.hear(it, progress, &mut input));
        error_lines.end(log);
        Ok((end, stderr))
    }

    /// Takes in a line; after the last one, the worker's input is closed.
    fn hear(&mut self, line: &str, progress: ProgressFn<'_>, input: &mut Option<Input>) {
        let result = match serde_json::from_str(line) {
            Ok(Line::Progress { fraction, text }) => {
                progress(fraction, &text);
                return;
            }
            Ok(Line::Done { outputs, absent, notes }) => self.outputs(&outputs, absent, notes),
            Ok(Line::Failed { message }) => Err(self.blame_limit(message, Failure::Node)),
            Ok(Line::Environment { message }) => {
                Err(self.blame_limit(message, Failure::Environment))
            }
            Ok(Line::Panicked { message }) => Err(self.blame_limit(message, Failure::Panic)),
            Err(error) => Err(Failure::Panic(format!("the worker says `{line}`: {error}"))),
        };
        self.last = Some(result);
        *input = None;
    }

    /// A failure that may come from the memory limit: not every allocation that fails ends the worker.
    fn blame_limit(&self, message: String, failure: fn(String) -> Failure) -> Failure {
        match self.instance.settings.isolate.and_then(|it| it.memory) {
            Some(limit) if lacks_memory(&message) => {
                let limit = show_memory(limit);
                Failure::Node(format!("needs more memory than its limit of {limit}: {message}"))
            }
            _ => failure(message),
        }
    }

    /// Reads and checks every output.
    fn outputs(
        &self,
        files: &BTreeMap<String, ArtifactFile>,
        mut absent: BTreeMap<String, String>,
        notes: Vec<String>,
    ) -> Result<NodeOutputs, Failure> {
        let mut res = NodeOutputs { notes, ..NodeOutputs::default() };
        for port in self.instance.kind.spec.outputs {
            if let Some(why) = absent.remove(port.name) {
                res.absent.insert(port.name, why);
                continue;
            }
            let fail = |what: &dyn std::fmt::Display| {
                Failure::Panic(format!("the worker's output `{}`: {what}", port.name))
            };
            let file = files.get(port.name).ok_or_else(|| fail(&"it is missing"))?;
            let bytes = read(file).map_err(|e| fail(&e))?;
            let kind = self.library.artifact_kind(port.ty.name);
            let kind = kind.expect("a checked pipeline has known types");
            let artifact = kind.decode(&bytes, None).map_err(|e| fail(&e))?;
            res.artifacts.insert(port.name, (artifact, bytes.into()));
        }
        Ok(res)
    }

    /// A worker that ended without a last line.
    fn crash(&self, end: End, stderr: &Tail) -> Failure {
        let how = format!("the worker {end}");
        let text = stderr.text();
        let no_memory = text.lines().find(|it| lacks_memory(it));
        match (no_memory, self.instance.settings.isolate.and_then(|it| it.memory)) {
            (Some(what), Some(limit)) => {
                let limit = show_memory(limit);
                return Failure::Node(format!(
                    "needs more memory than its limit of {limit}: {what}"
                ));
            }
            // Only what the allocator says is sure to be the end of it.
            (Some(what), None) if what.starts_with(ALLOCATOR_SAYS) => {
                return Failure::Environment(format!("the machine has no memory left: {what}"));
            }
            _ => {}
        }
        if end == End::Signalled(libc::SIGKILL) {
            // Nobody else kills so: either a person, or the system that is out of memory.
            let hint = "the machine may have run out of memory";
            return Failure::Environment(format!("{how}; {hint}{}", last_words(stderr)));
        }
        Failure::Panic(format!("{how}{}", last_words(stderr)))
    }
}

/// The start of the last line of a program whose allocator has given up.
const ALLOCATOR_SAYS: &str = "memory allocation of ";

/// Whether a message tells of memory that was not given: to the allocator, or to a thread that starts.
fn lacks_memory(message: &str) -> bool {
    ["out of memory", "Cannot allocate memory", ALLOCATOR_SAYS]
        .iter()
        .any(|it| message.contains(it))
}

fn read(file: &ArtifactFile) -> io::Result<Vec<u8>> {
    let mut file = File::open(&file.path)?;
    let size = file.metadata()?.len();
    let mut bytes = Vec::with_capacity(usize::try_from(size).unwrap_or(0));
    file.read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// The end of its standard error, on lines of their own.
fn last_words(stderr: &Tail) -> String {
    stderr.last_lines(8).lines().map(|it| format!("\n    {it}")).collect()
}

/// The failure of an instance whose time is over.
pub fn too_late(instance: &Instance) -> Failure {
    let limit = instance.settings.timeout.map(show_limit).unwrap_or_default();
    Failure::Node(format!("took longer than its time limit of {limit}"))
}
