//! Workers: run nodes and write exports, one job at a time each.

use std::{
    any::Any,
    cell::RefCell,
    collections::BTreeMap,
    panic::{AssertUnwindSafe, catch_unwind},
    path::PathBuf,
    sync::{Arc, Once},
    time::{Duration, Instant},
};

use crossbeam_channel::{Receiver, Sender};
use petgraph::graph::NodeIndex;
use rayon::ThreadPool;

use super::{RunOptions, export, message::Message};
use crate::engine::{
    artifact::{AnyArtifact, ArtifactType},
    digest::Digest,
    events::{ExportOutcome, Failure},
    graph::{Graph, PortRef},
    library::Library,
    node::{NodeError, NodeIo, NodeOutputs},
    store::{ObjectError, Store},
};

/// What a worker is asked to do.
pub enum Job {
    Run {
        instance: NodeIndex,
        inputs: BTreeMap<&'static str, JobInputs>,
        /// The pool to run in; `None` for the worker's own thread.
        pool: Option<Arc<ThreadPool>>,
    },
    Export {
        rule: usize,
        value: Value,
        path: PathBuf,
    },
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
    catch_panic_places();
    // Kernels that go parallel in a job of one thread must not find rayon's global pool.
    let own_pool = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build();
    let own_pool = own_pool.expect("a pool of the current thread needs nothing");
    for job in jobs {
        let message = match job {
            Job::Run { instance, inputs, pool } => {
                let pool = pool.as_deref().unwrap_or(&own_pool);
                let (loaded, result) = run_node(context, instance, inputs, pool, messages);
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
    index: NodeIndex,
    inputs: BTreeMap<&'static str, JobInputs>,
    pool: &ThreadPool,
    messages: &Sender<Message>,
) -> (Loaded, JobResult) {
    let instance = &context.graph.instances[index];
    let start = Instant::now();
    let mut loaded = Vec::new();
    let mut artifacts = BTreeMap::new();
    for (port, values) in inputs {
        let mut list = Vec::with_capacity(values.len());
        for value in values {
            match value.map(|it| load(context, it, &mut loaded)) {
                Ok(Ok(artifact)) => list.push(Ok(artifact)),
                Ok(Err(lost)) => return (loaded, lost),
                Err(missing) => list.push(Err(missing)),
            }
        }
        artifacts.insert(port, list);
    }
    let progress = |fraction: Option<f64>, text: &str| {
        let text = text.to_owned();
        let _ = messages.send(Message::Progress { instance: index, fraction, text });
    };
    let surroundings = &context.options.surroundings;
    let spec = &instance.kind.spec;
    let run = || {
        let labels = instance.input_labels.clone();
        let files = instance.files.clone();
        let mut io = NodeIo::new(spec, artifacts, labels, files, surroundings, &progress);
        instance.node.run(&mut io)?;
        Ok(io.finish())
    };
    let result = pool.install(|| guarded(run));
    let wall = start.elapsed();
    let result = match result {
        Ok(Ok(outputs)) => JobResult::Ran { outputs, wall },
        Ok(Err(NodeError::Failed(message))) => {
            JobResult::Failed { failure: Failure::Node(message), wall }
        }
        Ok(Err(NodeError::Environment(message))) => {
            JobResult::Failed { failure: Failure::Environment(message), wall }
        }
        Err(message) => JobResult::Failed { failure: Failure::Panic(message), wall },
    };
    (loaded, result)
}

fn run_export(context: &Context<'_>, value: Value, path: &std::path::Path) -> (Loaded, JobResult) {
    let mut loaded = Vec::new();
    let artifact = match load(context, value, &mut loaded) {
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

/// The artifact of a value, read from the store if need be.
fn load(
    context: &Context<'_>,
    value: Value,
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

thread_local! {
    /// Where this thread panicked last, while it was being watched.
    static PANIC: RefCell<Option<String>> = const { RefCell::new(None) };
    static WATCHED: std::cell::Cell<bool> = const { std::cell::Cell::new(false) };
}

/// Runs something that may panic; the error is the panic's message with its place.
fn guarded<T>(run: impl FnOnce() -> T) -> Result<T, String> {
    let before = WATCHED.replace(true);
    let result = catch_unwind(AssertUnwindSafe(run));
    WATCHED.set(before);
    result.map_err(|panic| PANIC.take().unwrap_or_else(|| panic_message(&*panic)))
}

fn panic_message(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().copied();
    text.or_else(|| panic.downcast_ref::<String>().map(String::as_str))
        .unwrap_or("a panic without a message")
        .to_owned()
}

/// A pool for jobs of several threads; panics of its threads are watched as well.
pub fn pool(threads: usize) -> ThreadPool {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .thread_name(|index| format!("kernel {index}"))
        .start_handler(|_| WATCHED.set(true))
        .build()
        .expect("the machine has threads left")
}

/// Keeps watched panics off the terminal: they become the failure of one instance.
fn catch_panic_places() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let before = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            if !WATCHED.get() {
                return before(info);
            }
            let place = info.location().map(|it| format!(" ({}:{})", it.file(), it.line()));
            let message = panic_message(info.payload());
            PANIC.set(Some(format!("{message}{}", place.unwrap_or_default())));
        }));
    });
}
