//! What would run, and why. Pure: a graph, what is stored, and nothing else.

use std::{
    collections::{BTreeMap, BTreeSet, HashMap},
    io,
    path::{Path, PathBuf},
    sync::{Arc, Mutex},
};

use petgraph::{Direction, graph::NodeIndex};

use super::{
    digest::Digest,
    facts::{self, Facts, Question},
    file_digests,
    graph::{Graph, Instance, PortRef},
    key::{Difference, Key, KeyParts},
    labels::Labels,
    node::Arity,
    port_map::PortMap,
    store::{Entry, EntryOutputs, Note, Store},
};

/// What planning asks of the world.
pub trait Memory {
    fn entry(&self, key: &Digest) -> Option<Arc<Entry>>;
    /// What is stored under a key, for the ports that an instance declares; `None` if one is missing.
    fn outputs(&self, key: &Digest, instance: &Instance) -> Option<Outputs>;
    fn has_object(&self, digest: &Digest) -> bool;
    /// Whether an object that is no longer there was found damaged.
    fn was_damaged(&self, digest: &Digest) -> bool;
    /// The key that this instance had when its pipeline was run last.
    fn last_key(&self, instance: &str) -> Option<Digest>;
    /// # Errors
    /// If the file cannot be read.
    fn file_digest(&self, path: &Path) -> io::Result<Digest>;
    /// The answer to a node's question, remembered or asked now.
    ///
    /// # Errors
    /// With a message for the user, if the machine cannot answer.
    fn facts(&self, question: &Question) -> Result<Facts, String>;
}

/// A store, as one pipeline sees it.
pub struct PipelineMemory<'a> {
    pub store: &'a Store,
    /// Tells one pipeline's instances from another's: the absolute path of its file.
    pub pipeline: PathBuf,
    /// Answers to the questions of this run, so that it sees the machine in one state.
    facts: Mutex<HashMap<Digest, Result<Facts, String>>>,
}

impl<'a> PipelineMemory<'a> {
    pub fn new(store: &'a Store, graph: &Graph) -> Self {
        let path = graph.sources.first().map(|it| it.path.as_path()).unwrap_or(Path::new(""));
        let pipeline = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        Self { store, pipeline, facts: Mutex::default() }
    }

    /// What the last key of an instance is remembered by.
    pub fn subject(&self, instance: &str) -> Digest {
        let mut hasher = blake3::Hasher::new();
        hasher.update(self.pipeline.as_os_str().as_encoded_bytes());
        hasher.update(&[0]);
        hasher.update(instance.as_bytes());
        Digest(*hasher.finalize().as_bytes())
    }
}

impl Memory for PipelineMemory<'_> {
    fn entry(&self, key: &Digest) -> Option<Arc<Entry>> {
        self.store.entry(key)
    }

    fn outputs(&self, key: &Digest, instance: &Instance) -> Option<Outputs> {
        self.store.outputs(key, |it| Outputs::of_entry(instance, it))
    }

    fn has_object(&self, digest: &Digest) -> bool {
        self.store.has_object(digest)
    }

    fn was_damaged(&self, digest: &Digest) -> bool {
        self.store.was_damaged(digest)
    }

    fn last_key(&self, instance: &str) -> Option<Digest> {
        let bytes = self.store.recall(Note::LastKey, &self.subject(instance))?;
        Some(Digest(bytes.try_into().ok()?))
    }

    fn file_digest(&self, path: &Path) -> io::Result<Digest> {
        file_digests::digest(self.store, path)
    }

    fn facts(&self, question: &Question) -> Result<Facts, String> {
        let subject = question.digest();
        let mut known = self.facts.lock().expect("no question panics");
        known.entry(subject).or_insert_with(|| facts::answer(self.store, question)).clone()
    }
}

/// What is known of an instance's outputs before (or without) having their values.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Outputs {
    pub artifacts: PortMap<OutputInfo>,
    /// Optional outputs that were left out, and why.
    pub absent: BTreeMap<&'static str, String>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OutputInfo {
    pub digest: Digest,
    pub bytes: u64,
}

impl Outputs {
    /// What an entry says, for the ports that the kind declares; `None` if one is missing.
    pub fn of_entry(instance: &Instance, entry: &EntryOutputs<'_>) -> Option<Self> {
        let mut res = Self::default();
        for port in instance.kind.spec.outputs {
            let found = entry.outputs.iter().find(|it| it.port == port.name);
            let absent = entry.absent.iter().find(|it| it.0 == port.name);
            match (found, absent) {
                (Some(it), _) if it.ty == port.ty.name => {
                    let info = OutputInfo { digest: it.digest, bytes: it.bytes };
                    res.artifacts.insert(port.name, info);
                }
                (_, Some((_, why))) => {
                    res.absent.insert(port.name, why.to_string());
                }
                _ => return None,
            }
        }
        Some(res)
    }
}

/// Why a key cannot be made although all inputs are known.
#[derive(Debug, Clone, PartialEq)]
pub enum KeyError {
    /// An input needs an optional output that was left out.
    Absent {
        port: &'static str,
        from: PortRef,
        why: String,
    },
    File {
        path: PathBuf,
        error: String,
    },
    /// The node asks something that the machine cannot answer.
    Fact(String),
}

impl KeyError {
    pub fn message(&self, graph: &Graph) -> String {
        match self {
            Self::Absent { port, from, why } => {
                let producer = graph.instances[from.instance].id();
                format!("`{port}` needs `{}` of `{producer}`, which has none: {why}", from.port)
            }
            Self::File { path, error } => format!("cannot read `{}`: {error}", path.display()),
            Self::Fact(error) => error.clone(),
        }
    }
}

/// What an instance finds where a wire leads.
#[derive(Debug, Clone, Copy)]
pub enum Producer<'a> {
    Known(&'a Outputs),
    /// It failed, and the instance shows what is missing.
    Failed(&'a str),
}

/// The text of the key of an instance whose inputs' producers are all known.
///
/// # Errors
/// See [`KeyError`].
pub fn key_of<'a>(
    instance: &Instance,
    producer: impl Fn(NodeIndex) -> Producer<'a>,
    memory: &dyn Memory,
) -> Result<String, KeyError> {
    let mut key = KeyParts::new(&instance.kind.spec, instance.node.key_params());
    for port in instance.kind.spec.inputs {
        let Some(sources) = instance.inputs.get(port.name) else { continue };
        let mut digests = Vec::with_capacity(sources.len());
        let mut missing = Vec::new();
        for (at, &from) in sources.iter().enumerate() {
            let producer = match producer(from.instance) {
                Producer::Known(outputs) => outputs,
                Producer::Failed(why) => {
                    digests.push(None);
                    missing.push((at, why.to_owned()));
                    continue;
                }
            };
            match producer.artifacts.get(from.port) {
                Some(info) => digests.push(Some(info.digest)),
                None if port.arity == Arity::Optional => digests.push(None),
                None => {
                    let why = producer.absent.get(from.port).cloned().unwrap_or_default();
                    return Err(KeyError::Absent { port: port.name, from, why });
                }
            }
        }
        key.inputs.insert(port.name, digests);
        if !missing.is_empty() {
            key.missing.insert(port.name, missing);
        }
        if let Some(labels) = instance.input_labels.get(port.name)
            && labels.iter().any(|it| !it.is_empty())
        {
            key.items.insert(port.name, labels.iter().map(shown_labels).collect());
        }
    }
    let declared = instance.node.files();
    for (path, real) in &instance.files {
        let name = match declared.iter().find(|it| it.1.0 == *path) {
            Some((field, _)) => field.to_string(),
            // A side file counts by its place beside the file that refers to it, wherever both are.
            None => {
                let folders = declared.iter().filter_map(|it| it.1.0.parent());
                let beside = folders.filter_map(|it| path.strip_prefix(it).ok()).next();
                beside.unwrap_or(path).display().to_string()
            }
        };
        let digest = memory
            .file_digest(real)
            .map_err(|e| KeyError::File { path: real.clone(), error: e.to_string() })?;
        key.files.insert(name, digest);
    }
    if let Some(question) = instance.node.question() {
        key.facts = memory.facts(&question).map_err(KeyError::Fact)?;
    }
    Ok(key.text())
}

fn shown_labels(labels: &Labels) -> Vec<String> {
    labels.iter().map(|(axis, item)| format!("{axis}={item}")).collect()
}

/// Why an instance runs.
#[derive(Debug, Clone, PartialEq)]
pub enum Reason {
    /// Nothing like it was ever run by this pipeline.
    New,
    /// Its key is not the one that it had last.
    Changed(Vec<Difference>),
    /// Its key is not the one that it had last, and what that was made from is no longer stored.
    Replaced,
    /// Its key is the one that it had last, but the result was removed from the store.
    Removed,
    /// Its result is known, but the artifact at this port was removed from the store.
    Evicted { port: &'static str },
    /// Its result is known, but the artifact at this port was found damaged.
    Damaged { port: &'static str },
    /// The user asked for it.
    Forced,
}

impl Reason {
    /// Why a key (with its digest) that is not stored is not: compares it with the last one of the
    /// instance.
    pub fn of_miss(key: &str, digest: &Digest, instance: &str, memory: &dyn Memory) -> Self {
        let Some(last) = memory.last_key(instance) else { return Self::New };
        if last == *digest {
            return Self::Removed;
        }
        let old = memory.entry(&last);
        match (old.and_then(|it| Key::read(&it.key)), Key::read(key)) {
            (Some(old), Some(key)) => match key.differences(&old) {
                differences if differences.is_empty() => Self::Replaced,
                differences => Self::Changed(differences),
            },
            _ => Self::Replaced,
        }
    }

    /// Why a result has to be made again whose artifact at a port is not there.
    pub fn of_loss(port: &'static str, artifact: &Digest, memory: &dyn Memory) -> Self {
        if memory.was_damaged(artifact) { Self::Damaged { port } } else { Self::Evicted { port } }
    }
}

impl std::fmt::Display for Reason {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::New => f.write_str("new"),
            Self::Changed(differences) => {
                let texts: Vec<String> = differences.iter().map(ToString::to_string).collect();
                f.write_str(&texts.join(", "))
            }
            Self::Replaced => f.write_str(
                "its key is another one than last time; what that was made from is no longer stored",
            ),
            Self::Removed => f.write_str("its result is no longer in the store"),
            Self::Evicted { port } => write!(f, "`{port}` is no longer in the store"),
            Self::Damaged { port } => write!(f, "`{port}` was damaged in the store"),
            Self::Forced => f.write_str("forced"),
        }
    }
}

/// What would happen to one instance.
#[derive(Debug, Clone, PartialEq)]
pub enum Status {
    Cached {
        key: Digest,
    },
    Run {
        key: Digest,
        reason: Reason,
    },
    /// It depends on what `after` gives; if that is what it gave before, this need not run.
    Follows {
        after: NodeIndex,
    },
    /// It cannot run.
    Blocked(KeyError),
    /// Nothing that is wanted needs it.
    NotWanted,
}

/// What would happen, by instance.
pub struct Plan {
    pub statuses: Vec<Status>,
    /// The texts of keys that are known.
    pub keys: Vec<Option<String>>,
    /// Parents before children.
    pub order: Vec<NodeIndex>,
}

/// The instances that the wanted ones depend on, themselves included; all if none is named.
///
/// By instance.
pub fn wanted(graph: &Graph, targets: &[NodeIndex]) -> Vec<bool> {
    let mut res = vec![targets.is_empty(); graph.instances.node_count()];
    let mut open = targets.to_vec();
    while let Some(instance) = open.pop() {
        if !std::mem::replace(&mut res[instance.index()], true) {
            open.extend(graph.instances.neighbors_directed(instance, Direction::Incoming));
        }
    }
    res
}

/// Plans a run for `targets` (all instances if none is named), with `forced` ones run in any case.
pub fn plan(
    graph: &Graph,
    targets: &[NodeIndex],
    forced: &BTreeSet<NodeIndex>,
    memory: &dyn Memory,
) -> Plan {
    let n = graph.instances.node_count();
    let order = topological_order(graph);
    let wanted = wanted(graph, targets);
    let mut statuses = vec![Status::NotWanted; n];
    let mut keys: Vec<Option<String>> = vec![None; n];
    let mut outputs: Vec<Option<Outputs>> = vec![None; n];
    for &index in order.iter().filter(|it| wanted[it.index()]) {
        let instance = &graph.instances[index];
        let mut producers = instance.inputs.values().flatten().map(|it| it.instance);
        if let Some(after) = producers.find(|it| outputs[it.index()].is_none()) {
            statuses[index.index()] = Status::Follows { after };
            continue;
        }
        let known = |it: NodeIndex| {
            Producer::Known(outputs[it.index()].as_ref().expect("producers are known"))
        };
        let key = match key_of(instance, known, memory) {
            Ok(key) => key,
            Err(error) => {
                statuses[index.index()] = Status::Blocked(error);
                continue;
            }
        };
        let digest = Digest::of(key.as_bytes());
        let is_forced = forced.contains(&index);
        outputs[index.index()] = if is_forced { None } else { memory.outputs(&digest, instance) };
        statuses[index.index()] = if outputs[index.index()].is_some() {
            Status::Cached { key: digest }
        } else if is_forced {
            Status::Run { key: digest, reason: Reason::Forced }
        } else {
            let reason = Reason::of_miss(&key, &digest, &instance.id(), memory);
            Status::Run { key: digest, reason }
        };
        keys[index.index()] = Some(key);
    }
    plan_evicted(graph, &order, &outputs, &mut statuses, memory);
    Plan { statuses, keys, order }
}

/// Marks cached instances to be run again whose values are needed but no longer stored.
fn plan_evicted(
    graph: &Graph,
    order: &[NodeIndex],
    outputs: &[Option<Outputs>],
    statuses: &mut [Status],
    memory: &dyn Memory,
) {
    let mut needed: BTreeSet<PortRef> = graph.outputs.iter().map(|it| it.from).collect();
    for &index in order.iter().rev() {
        if let Status::Cached { key } = statuses[index.index()] {
            let known = outputs[index.index()].as_ref().expect("cached outputs are known");
            let lost = known.artifacts.iter().find(|(port, info)| {
                needed.contains(&PortRef { instance: index, port })
                    && !memory.has_object(&info.digest)
            });
            let Some((port, info)) = lost else { continue };
            let reason = Reason::of_loss(port, &info.digest, memory);
            statuses[index.index()] = Status::Run { key, reason };
        }
        if matches!(statuses[index.index()], Status::Run { .. } | Status::Follows { .. }) {
            needed.extend(graph.instances[index].inputs.values().flatten());
        }
    }
}

/// Parents before children, otherwise in the order of the file.
pub fn topological_order(graph: &Graph) -> Vec<NodeIndex> {
    let instances = &graph.instances;
    let mut open: Vec<usize> = instances
        .node_indices()
        .map(|it| instances.neighbors_directed(it, Direction::Incoming).count())
        .collect();
    let mut ready: std::collections::BinaryHeap<std::cmp::Reverse<NodeIndex>> = instances
        .node_indices()
        .filter(|it| open[it.index()] == 0)
        .map(std::cmp::Reverse)
        .collect();
    let mut order = Vec::with_capacity(open.len());
    while let Some(std::cmp::Reverse(index)) = ready.pop() {
        order.push(index);
        for child in instances.neighbors_directed(index, Direction::Outgoing) {
            open[child.index()] -= 1;
            if open[child.index()] == 0 {
                ready.push(std::cmp::Reverse(child));
            }
        }
    }
    assert_eq!(order.len(), open.len(), "a checked pipeline has no cycles");
    order
}
