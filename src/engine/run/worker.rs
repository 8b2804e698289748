//! Workers: run nodes and write exports, one job at a time each.

use std::{
    collections::BTreeMap,
    path::PathBuf,
    sync::Arc,
    time::{Duration, Instant},
};

use crossbeam_channel::{Receiver, Sender};
use petgraph::graph::NodeIndex;
use rayon::ThreadPool;

use super::{
    RunOptions, export,
    guard::{self, guarded},
    isolated,
    message::Message,
};
use crate::engine::{
    artifact::{AnyArtifact, ArtifactType, Bytes},
    cancel::CancelToken,
    digest::Digest,
    events::{ExportOutcome, Failure},
    graph::{Graph, Instance, PortRef},
    library::Library,
    node::{NodeError, NodeIo, NodeOutputs, PortInputs, ProgressFn},
    store::{ObjectError, Store},
};

/// What a worker is asked to do.
pub enum Job {
    Run(RunJob),
    Export { rule: usize, value: Value, path: PathBuf },
}

/// A node to run.
pub struct RunJob {
    pub instance: NodeIndex,
    pub inputs: BTreeMap<&'static str, JobInputs>,
    /// Threads granted to it.
    pub threads: usize,
    /// The pool to run in; `None` for the worker's own thread, or for a process of its own.
    pub pool: Option<Arc<ThreadPool>>,
    pub cancel: CancelToken,
}

/// What a job finds at a port: values in order, or why one is missing.
pub type JobInputs = Vec<Result<Value, Arc<str>>>;

/// An artifact in memory or in the store.
#[derive(Clone)]
pub enum Value {
    Live(AnyArtifact),
    Stored { from: PortRef, ty: ArtifactType, digest: Digest },
}

/// How a job ended.
pub enum JobResult {
    Ran {
        outputs: NodeOutputs,
        wall: Duration,
    },
    Failed {
        failure: Failure,
        wall: Duration,
    },
    Exported(ExportOutcome),
    /// The run was given up before it was done.
    Stopped,
    /// A stored artifact is gone or damaged; it has to be made again first.
    Lost {
        from: PortRef,
        error: ObjectError,
    },
}

/// What all workers share.
#[derive(Clone, Copy)]
pub struct Context<'a> {
    pub graph: &'a Graph,
    pub library: &'a Library,
    pub store: &'a Store,
    pub options: &'a RunOptions,
}

/// Works until the queue is closed.
pub fn work(context: &Context<'_>, jobs: &Receiver<Job>, messages: &Sender<Message>) {
    guard::catch_panic_places();
    let own_pool = guard::own_pool();
    for job in jobs {
        let message = match job {
            Job::Run(job) => {
                let instance = job.instance;
                let (loaded, result) = run_node(context, job, &own_pool, messages);
                Message::Ran { instance, loaded, result }
            }
            Job::Export { rule, value, path } => {
                let (loaded, result) = run_export(context, value, &path);
                Message::Exported { rule, loaded, result }
            }
        };
        if messages.send(message).is_err() {
            return;
        }
    }
}

/// Artifacts that a job read from the store, for others that need them.
pub type Loaded = Vec<(PortRef, AnyArtifact)>;

fn run_node(
    context: &Context<'_>,
    job: RunJob,
    own_pool: &ThreadPool,
    messages: &Sender<Message>,
) -> (Loaded, JobResult) {
    let RunJob { instance: index, inputs, threads, pool, cancel } = job;
    let instance = &context.graph.instances[index];
    let progress = |fraction: Option<f64>, text: &str| {
        let text = text.to_owned();
        let _ = messages.send(Message::Progress { instance: index, fraction, text });
    };
    if instance.needs_process() {
        let start = Instant::now();
        let run = || isolated::run(context, instance, &inputs, threads, &cancel, &progress);
        let result = guarded(run).unwrap_or_else(|message| {
            let failure = Failure::Panic(message);
            JobResult::Failed { failure, wall: start.elapsed() }
        });
        return (Vec::new(), result);
    }
    let start = Instant::now();
    let mut loaded = Vec::new();
    let mut artifacts = BTreeMap::new();
    for (port, values) in inputs {
        let mut list = Vec::with_capacity(values.len());
        for value in values {
            match value.map(|it| load(context, it, instance.kind.declared, &mut loaded)) {
                Ok(Ok(artifact)) => list.push(Ok(artifact)),
                Ok(Err(lost)) => return (loaded, lost),
                Err(missing) => list.push(Err(missing)),
            }
        }
        artifacts.insert(port, list);
    }
    let cancel = cancel.with_limit(instance.settings.timeout);
    let pool = pool.as_deref().unwrap_or(own_pool);
    let run = || run_here(context, instance, artifacts, &cancel, &progress);
    let result = pool.install(|| guarded(run));
    let wall = start.elapsed();
    let failure = match result {
        Ok(Ok(outputs)) => return (loaded, JobResult::Ran { outputs, wall }),
        // It has ended because it was told to, whatever it says.
        Ok(Err(_)) if instance.kind.handles_limits && cancel.is_given_up() => {
            return (loaded, JobResult::Stopped);
        }
        Ok(Err(_)) if cancel.is_late() => isolated::too_late(instance),
        Ok(Err(NodeError::Failed(message))) => Failure::Node(message),
        Ok(Err(NodeError::Environment(message))) => Failure::Environment(message),
        Err(message) => Failure::Panic(message),
    };
    (loaded, JobResult::Failed { failure, wall })
}

/// Runs a node in this process.
fn run_here(
    context: &Context<'_>,
    instance: &Instance,
    inputs: BTreeMap<&'static str, PortInputs>,
    cancel: &CancelToken,
    progress: ProgressFn<'_>,
) -> Result<NodeOutputs, NodeError> {
    let (spec, surroundings) = (&instance.kind.spec, &context.options.surroundings);
    let (labels, files) = (instance.input_labels.clone(), instance.files.clone());
    let stored_file = |digest: &Digest| context.store.object_file(digest);
    let mut io = NodeIo::new(spec, inputs, labels, files, surroundings, progress)
        .with_cancel(cancel.clone())
        .with_stored_files(&stored_file);
    instance.node.run(&mut io)?;
    Ok(io.finish())
}

fn run_export(context: &Context<'_>, value: Value, path: &std::path::Path) -> (Loaded, JobResult) {
    let mut loaded = Vec::new();
    let artifact = match load(context, value, false, &mut loaded) {
        Ok(artifact) => artifact,
        Err(lost) => return (loaded, lost),
    };
    let outcome =
        match guarded(|| export::write(context.store.disk(), context.library, &artifact, path)) {
            Ok(Ok(bytes)) => ExportOutcome::Written { bytes },
            Ok(Err(failure)) => ExportOutcome::Failed { failure },
            Err(message) => ExportOutcome::Failed { failure: Failure::Panic(message) },
        };
    (loaded, JobResult::Exported(outcome))
}

/// The artifact of a value, read from the store if need be. One that has a file is left there if it is
/// only taken `as_file`.
fn load(
    context: &Context<'_>,
    value: Value,
    as_file: bool,
    loaded: &mut Loaded,
) -> Result<AnyArtifact, JobResult> {
    let (from, ty, digest) = match value {
        Value::Live(artifact) => return Ok(artifact),
        Value::Stored { from, ty, digest } => (from, ty, digest),
    };
    if let Some((_, artifact)) = loaded.iter().find(|it| it.1.digest() == digest) {
        return Ok(artifact.clone());
    }
    let bytes =
        context.store.object(ty, &digest).map_err(|error| JobResult::Lost { from, error })?;
    let kind = context.library.artifact_kind(ty.name).expect("a checked pipeline has known types");
    if let Bytes::Mapped(stored) = &bytes
        && as_file
    {
        let artifact = AnyArtifact::of_stored(kind, digest, Arc::clone(stored));
        loaded.push((from, artifact.clone()));
        return Ok(artifact);
    }
    match kind.decode(&bytes, Some(digest)) {
        Ok(artifact) => {
            loaded.push((from, artifact.clone()));
            Ok(artifact)
        }
        Err(error) => {
            tracing::warn!(%digest, %error, "a stored artifact has its digest but no valid content");
            Err(JobResult::Lost { from, error: ObjectError::Missing { digest } })
        }
    }
}
