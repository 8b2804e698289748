//! Holds stored results against their digests, and against the same work done again.
//!
//! Work is done again by ordinary runs whose store is only read. One run is made for each depth of
//! the graph, so that a result that comes out differently never reaches the instances behind it:
//! each is computed from the inputs that its stored result was computed from.

use std::collections::{BTreeMap, BTreeSet};

use petgraph::{Direction, graph::NodeIndex};

use super::{
    artifact::{AnyArtifact, Decoder},
    digest::Digest,
    events::{Event, Observer, Outcome},
    graph::{Graph, PortRef},
    library::Library,
    plan::{self, Outputs, PipelineMemory, Plan, Status},
    run::{self, RunOptions},
    store::{Entry, ObjectError, Store},
    tensors::RawArray,
};

/// What was found at one instance.
#[derive(Debug, Clone, PartialEq)]
pub enum Verdict {
    /// All artifacts are as their digests say, or were made again with the same bytes.
    Good,
    /// Its result is not stored, or an artifact that is needed is not: the reason.
    Absent(String),
    /// A stored artifact is not what its digest says.
    Damaged { port: String },
    /// Made again, an artifact came out differently.
    Differs { port: String, how: String },
    /// Made again, it failed.
    Failed(String),
}

/// Holds the stored artifacts of a plan against their digests. Damaged ones are set aside unless the
/// store is only read, as whenever they are read.
pub fn check_objects(
    graph: &Graph,
    library: &Library,
    store: &Store,
    plan: &Plan,
    mut tell: impl FnMut(NodeIndex, &Verdict),
) {
    store.check_again();
    for &index in &plan.order {
        if plan.statuses[index.index()] == Status::NotWanted {
            continue;
        }
        tell(index, &check_instance(graph, library, store, plan, index));
    }
}

fn check_instance(
    graph: &Graph,
    library: &Library,
    store: &Store,
    plan: &Plan,
    index: NodeIndex,
) -> Verdict {
    let Some((_, entry)) = stored(graph, store, plan, index) else {
        return Verdict::Absent("its result is not stored".to_owned());
    };
    for output in &entry.outputs {
        let Some(kind) = library.artifact_kind(&output.ty) else { continue };
        match store.object(kind.ty, &output.digest) {
            Ok(_) => {}
            Err(ObjectError::Damaged { .. }) => {
                return Verdict::Damaged { port: output.port.clone() };
            }
            Err(error) => return Verdict::Absent(format!("`{}`: {error}", output.port)),
        }
    }
    Verdict::Good
}

/// The key and the stored result of an instance.
fn stored(
    graph: &Graph,
    store: &Store,
    plan: &Plan,
    index: NodeIndex,
) -> Option<(Digest, std::sync::Arc<Entry>)> {
    let key = match plan.statuses[index.index()] {
        Status::Cached { key } | Status::Run { key, .. } => key,
        _ => return None,
    };
    store.outputs(&key, |it| Outputs::of_entry(&graph.instances[index], it))?;
    let entry = store.entry(&key)?;
    Some((key, entry))
}

/// Computes stored results again and compares the bytes. The store should be open to be read only;
/// nothing is written. `chosen` says which of the instances that can be verified are.
///
/// Every wanted instance gets a verdict but those that are not chosen.
pub fn rerun(
    mut graph: Graph,
    library: &Library,
    store: &Store,
    options: &RunOptions,
    chosen: impl FnOnce(&Graph, Vec<NodeIndex>) -> Vec<NodeIndex>,
    mut tell: impl FnMut(&Graph, NodeIndex, &Verdict),
) {
    store.check_again();
    // Files of the user are none of our business.
    graph.outputs.clear();
    let plan = {
        let memory = PipelineMemory::new(store, &graph);
        plan::plan(&graph, &options.targets, &BTreeSet::new(), &memory)
    };
    let mut candidates = Vec::new();
    for &index in &plan.order {
        if plan.statuses[index.index()] == Status::NotWanted {
            continue;
        }
        match missing(&graph, store, &plan, index) {
            None => candidates.push(index),
            Some(why) => tell(&graph, index, &Verdict::Absent(why)),
        }
    }
    let depths = depths(&graph, &plan.order);
    let mut by_depth: BTreeMap<usize, Vec<NodeIndex>> = BTreeMap::new();
    for index in chosen(&graph, candidates) {
        by_depth.entry(depths[index.index()]).or_default().push(index);
    }
    for targets in by_depth.into_values() {
        let options = RunOptions {
            targets: targets.clone(),
            forced: targets.iter().copied().collect(),
            ..options.clone()
        };
        let mut verifier = Verifier::new(&graph, library, store, &plan, &targets);
        run::run(&graph, library, store, &options, &mut verifier);
        for index in targets {
            let verdict = verifier.verdicts.remove(&index);
            let stopped = || Verdict::Failed("the verification was stopped".to_owned());
            tell(&graph, index, &verdict.unwrap_or_else(stopped));
        }
    }
}

/// Why an instance cannot be verified: its result or one of its inputs is not stored.
fn missing(graph: &Graph, store: &Store, plan: &Plan, index: NodeIndex) -> Option<String> {
    if stored(graph, store, plan, index).is_none() {
        return Some("its result is not stored".to_owned());
    }
    for (port, sources) in &graph.instances[index].inputs {
        for PortRef { instance, port: of } in sources {
            let Some((_, entry)) = stored(graph, store, plan, *instance) else {
                return Some(format!("its input `{port}` is not stored"));
            };
            let output = entry.outputs.iter().find(|it| it.port == *of);
            if output.is_some_and(|it| !store.has_object(&it.digest)) {
                return Some(format!("its input `{port}` is no longer stored"));
            }
        }
    }
    None
}

/// How many instances stand before each one on the longest path to it.
fn depths(graph: &Graph, order: &[NodeIndex]) -> Vec<usize> {
    let mut res = vec![0; order.len()];
    for &index in order {
        let before = graph.instances.neighbors_directed(index, Direction::Incoming);
        res[index.index()] = before.map(|it| res[it.index()] + 1).max().unwrap_or(0);
    }
    res
}

/// Watches the instances of one run and compares what they make with what is stored.
struct Verifier<'a> {
    library: &'a Library,
    store: &'a Store,
    expected: BTreeMap<NodeIndex, (Digest, std::sync::Arc<Entry>)>,
    verdicts: BTreeMap<NodeIndex, Verdict>,
}

impl<'a> Verifier<'a> {
    fn new(
        graph: &Graph,
        library: &'a Library,
        store: &'a Store,
        plan: &Plan,
        targets: &[NodeIndex],
    ) -> Self {
        let expected = targets.iter().filter_map(|&it| Some((it, stored(graph, store, plan, it)?)));
        Self { library, store, expected: expected.collect(), verdicts: BTreeMap::new() }
    }

    /// The first output that differs, and how.
    fn compare(&self, entry: &Entry, made: &BTreeMap<&'static str, AnyArtifact>) -> Verdict {
        for output in &entry.outputs {
            let Some(artifact) = made.get(output.port.as_str()) else {
                let how = "it was left out this time".to_owned();
                return Verdict::Differs { port: output.port.clone(), how };
            };
            if artifact.digest() != output.digest {
                let how = self.describe(output.digest, artifact);
                return Verdict::Differs { port: output.port.clone(), how };
            }
        }
        match made.keys().find(|port| entry.outputs.iter().all(|it| it.port != **port)) {
            Some(port) => Verdict::Differs {
                port: (*port).to_owned(),
                how: "it was left out last time".to_owned(),
            },
            None => Verdict::Good,
        }
    }

    fn describe(&self, stored: Digest, made: &AnyArtifact) -> String {
        let kind = self.library.artifact_kind(made.ty().name).expect("its type is in the library");
        let old = match self.store.object(kind.ty, &stored) {
            Ok(bytes) => bytes,
            Err(error) => return format!("its digest differs, and {error}"),
        };
        let new = made.to_bytes();
        match (Decoder::new(&old), Decoder::new(&new)) {
            (Ok(old), Ok(new)) => first_difference(&old, &new),
            (Err(error), _) | (_, Err(error)) => format!("its digest differs, and {error}"),
        }
    }
}

impl Observer for Verifier<'_> {
    fn event(&mut self, graph: &Graph, event: &Event<'_>) {
        let Event::Finished { instance, outcome, key, .. } = event else { return };
        let Some((expected, _)) = self.expected.get(instance) else { return };
        let verdict = match outcome {
            _ if key.is_some() && *key != Some(*expected) => {
                Verdict::Absent("an input came out differently when it was made again".to_owned())
            }
            Outcome::Failed { failure, .. } => Verdict::Failed(failure.message().to_owned()),
            Outcome::Skipped { because } => {
                let id = graph.instances[*because].id();
                Verdict::Absent(format!("its input from `{id}` could not be made again"))
            }
            _ => return,
        };
        self.verdicts.insert(*instance, verdict);
    }

    fn made(&mut self, instance: NodeIndex, artifacts: &BTreeMap<&'static str, AnyArtifact>) {
        if let Some((_, entry)) = self.expected.get(&instance) {
            let verdict = self.compare(entry, artifacts);
            self.verdicts.insert(instance, verdict);
        }
    }
}

/// The first array that two artifacts do not share, where it differs first, and by how much at most.
fn first_difference(old: &Decoder<'_>, new: &Decoder<'_>) -> String {
    let old_arrays: Vec<(&str, &RawArray<'_>)> = old.arrays().collect();
    let new_arrays: Vec<(&str, &RawArray<'_>)> = new.arrays().collect();
    let names = |arrays: &[(&str, &RawArray<'_>)]| {
        arrays.iter().map(|it| it.0.to_owned()).collect::<Vec<_>>()
    };
    let (old_names, new_names) = (names(&old_arrays), names(&new_arrays));
    if old_names != new_names {
        return format!("it has the arrays {new_names:?} instead of {old_names:?}");
    }
    for ((name, old), (_, new)) in old_arrays.iter().zip(&new_arrays) {
        if let Some(how) = array_difference(name, old, new) {
            return how;
        }
    }
    for (name, text) in old.all_texts() {
        if new.all_texts().get(name) != Some(text) {
            return format!("its text `{name}` differs");
        }
    }
    "its texts differ".to_owned()
}

fn array_difference(name: &str, old: &RawArray<'_>, new: &RawArray<'_>) -> Option<String> {
    if (old.dtype, &old.shape) != (new.dtype, &new.shape) {
        let show = |it: &RawArray<'_>| format!("{} {:?}", it.dtype.name(), it.shape);
        return Some(format!("array `{name}` is {} instead of {}", show(new), show(old)));
    }
    let size = old.dtype.size();
    let (old_numbers, new_numbers) = (old.bytes.chunks_exact(size), new.bytes.chunks_exact(size));
    let differing = old_numbers.zip(new_numbers).enumerate().filter(|it| it.1.0 != it.1.1);
    let (mut first, mut n_differing, mut largest) = (None, 0, 0.0f64);
    for (index, _) in differing {
        let (was, is) = (old.number(index), new.number(index));
        first.get_or_insert((index, was, is));
        n_differing += 1;
        largest = largest.max((is - was).abs());
    }
    let (index, was, is) = first?;
    let total = old.bytes.len() / size;
    Some(format!(
        "array `{name}` differs in {n_differing} of {total} numbers, first at {}: {is:?} instead of \
         {was:?}; by {largest:e} at most",
        position(index, &old.shape)
    ))
}

/// A flat index as one for each dimension: `[3, 0]`.
fn position(mut index: usize, shape: &[usize]) -> String {
    let mut places = Vec::with_capacity(shape.len());
    for &length in shape.iter().rev() {
        places.push((index % length.max(1)).to_string());
        index /= length.max(1);
    }
    places.reverse();
    format!("[{}]", places.join(", "))
}

/// The first `n` of a shuffle that is the same for the same seed: what is chosen depends on names
/// alone, not on what else there is to choose from.
pub fn sample(graph: &Graph, mut from: Vec<NodeIndex>, n: usize, seed: u64) -> Vec<NodeIndex> {
    let rank = |it: &NodeIndex| {
        let id = graph.instances[*it].id();
        Digest::of(format!("{seed} {id}").as_bytes())
    };
    from.sort_by_cached_key(rank);
    from.truncate(n);
    from
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::artifact::Encoder;

    fn bytes(values: &[f64], text: &str) -> Vec<u8> {
        let mut encoder = Encoder::default();
        encoder.array("values", &[values.len() / 2, 2], values);
        encoder.text("note", text);
        encoder.finish()
    }

    fn difference(old: &[u8], new: &[u8]) -> String {
        first_difference(&Decoder::new(old).unwrap(), &Decoder::new(new).unwrap())
    }

    #[test]
    fn differences_are_told_with_their_places() {
        let old = bytes(&[1.0, 2.0, 3.0, 4.0], "a");
        assert_eq!(
            difference(&old, &bytes(&[1.0, 2.0, 3.5, 3.0], "a")),
            "array `values` differs in 2 of 4 numbers, first at [1, 0]: 3.5 instead of 3.0; by 1e0 \
             at most"
        );
        assert_eq!(difference(&old, &bytes(&[1.0, 2.0, 3.0, 4.0], "b")), "its text `note` differs");
        assert_eq!(
            difference(&old, &bytes(&[1.0, 2.0], "a")),
            "array `values` is F64 [1, 2] instead of F64 [2, 2]"
        );
    }
}
