//! What the coordinator knows of every instance.

use std::{
    collections::BTreeMap,
    sync::Arc,
    time::{Duration, Instant},
};

use petgraph::graph::NodeIndex;

use crate::engine::{
    artifact::AnyArtifact,
    digest::Digest,
    events::{Failure, Outcome},
    graph::Graph,
    plan::{Outputs, Reason},
    store::Claim,
};

/// Where the work on an instance stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Work {
    /// None to do, as far as is known.
    Idle,
    /// For inputs that must be made (again) first, or for another instance with the same key.
    Waiting,
    Ready,
    /// Another process computes the same key.
    Claimed,
    Running,
    /// It failed, and waits for its next try.
    Backoff,
}

/// One instance's state.
pub struct Slot {
    /// Digests of its outputs, as soon as they are known.
    pub outputs: Option<Outputs>,
    /// Outputs in memory.
    pub live: BTreeMap<&'static str, AnyArtifact>,
    /// Whether its outputs can be read from the store.
    pub stored: bool,
    /// What was stored could not be read: it is not relied on again.
    pub was_lost: bool,
    /// Bytes that its running job will need beside what is in memory.
    pub reserved: u64,
    /// Bytes of its outputs that wait to be written.
    pub pending: u64,
    /// Its text is there if it runs, unless that was lost with the entry that it was stored with.
    pub key: Option<(Digest, Option<String>)>,
    pub reason: Reason,
    pub work: Work,
    pub claim: Option<Claim>,
    /// Somebody has been told that another process computes its key.
    pub told_claimed: bool,
    /// Tries that failed, and the last of their failures.
    pub n_failed: u32,
    pub last_failure: Option<(Failure, Duration)>,
    pub started: Option<Instant>,
    /// Threads granted to its job.
    pub threads: usize,
    /// Producers whose outputs are not known yet.
    pub unknown_inputs: usize,
    /// Producers that must run before this can.
    pub missing_inputs: usize,
    /// An input was made again with other bytes, so `key` no longer holds.
    pub stale_key: bool,
    /// Consumers that wait until this has run.
    pub wakes: Vec<NodeIndex>,
    /// Output rules that wait until this has run.
    pub waiting_exports: Vec<usize>,
    /// Instances with the same key that wait for this one.
    pub followers: Vec<NodeIndex>,
    /// Consumers and exports that may still read its outputs.
    pub readers: usize,
    /// Whether it counts among the readers of its producers.
    pub reads: bool,
    pub outcome: Option<Outcome>,
    /// Why its outputs will not come, for those who show what is missing.
    pub failed: Option<Arc<str>>,
}

impl Slot {
    fn new(unknown_inputs: usize, readers: usize) -> Self {
        Self {
            outputs: None,
            live: BTreeMap::new(),
            stored: false,
            was_lost: false,
            reserved: 0,
            pending: 0,
            key: None,
            reason: Reason::New,
            work: Work::Idle,
            claim: None,
            told_claimed: false,
            n_failed: 0,
            last_failure: None,
            started: None,
            threads: 0,
            unknown_inputs,
            missing_inputs: 0,
            stale_key: false,
            wakes: Vec::new(),
            waiting_exports: Vec::new(),
            followers: Vec::new(),
            readers,
            reads: true,
            outcome: None,
            failed: None,
        }
    }

    /// Bytes of the outputs in memory.
    pub fn live_bytes(&self) -> u64 {
        let Some(outputs) = &self.outputs else { return 0 };
        self.live.keys().filter_map(|port| Some(outputs.artifacts.get(port)?.bytes)).sum()
    }
}

/// All instances' states, and who reads whom.
pub struct Slots {
    slots: Vec<Slot>,
    producers: Neighbours,
    consumers: Neighbours,
}

/// A list of instances for every instance, all of them in one: most are short, and there are many.
#[derive(Default)]
struct Neighbours {
    ends: Vec<usize>,
    all: Vec<NodeIndex>,
}

impl Neighbours {
    /// Adds the list of the next instance.
    fn push(&mut self, list: impl IntoIterator<Item = NodeIndex>) {
        self.all.extend(list);
        self.ends.push(self.all.len());
    }

    fn of(&self, index: NodeIndex) -> &[NodeIndex] {
        let end = self.ends[index.index()];
        let start = index.index().checked_sub(1).map_or(0, |it| self.ends[it]);
        &self.all[start..end]
    }

    /// For every instance, in whose lists it is; ascending.
    fn reversed(&self) -> Self {
        let n = self.ends.len();
        let mut next = vec![0; n + 1];
        self.all.iter().for_each(|it| next[it.index() + 1] += 1);
        for index in 0..n {
            next[index + 1] += next[index];
        }
        let (ends, mut all) = (next[1..].to_vec(), vec![NodeIndex::default(); self.all.len()]);
        for index in (0..n).map(NodeIndex::new) {
            for neighbour in self.of(index) {
                let place = &mut next[neighbour.index()];
                all[*place] = index;
                *place += 1;
            }
        }
        Self { ends, all }
    }
}

impl Slots {
    pub fn new(graph: &Graph, wanted: &[bool]) -> Self {
        let n = graph.instances.node_count();
        let (mut producers, mut sources) = (Neighbours::default(), Vec::new());
        for index in graph.instances.node_indices() {
            sources.clear();
            if wanted[index.index()] {
                let inputs = graph.instances[index].inputs.values().flatten();
                sources.extend(inputs.map(|it| it.instance));
                sources.sort_unstable();
                sources.dedup();
            }
            producers.push(sources.iter().copied());
        }
        let consumers = producers.reversed();
        let mut res = Self { slots: Vec::with_capacity(n), producers, consumers };
        let mut exports = vec![0; n];
        for rule in &graph.outputs {
            exports[rule.from.instance.index()] += 1;
        }
        for index in graph.instances.node_indices() {
            let readers = res.consumers.of(index).len() + exports[index.index()];
            let mut slot = Slot::new(res.producers.of(index).len(), readers);
            if !wanted[index.index()] {
                slot.outcome = Some(Outcome::NotWanted);
            }
            res.slots.push(slot);
        }
        res
    }

    /// Those that an instance reads, for loops that change slots meanwhile.
    pub fn producers(&self, of: NodeIndex) -> Vec<NodeIndex> {
        self.producers.of(of).to_vec()
    }

    /// Those that read an instance.
    pub fn consumers(&self, of: NodeIndex) -> Vec<NodeIndex> {
        self.consumers.of(of).to_vec()
    }

    pub fn iter_mut(&mut self) -> impl Iterator<Item = &mut Slot> {
        self.slots.iter_mut()
    }

    pub fn iter(&self) -> impl Iterator<Item = &Slot> {
        self.slots.iter()
    }
}

impl std::ops::Index<NodeIndex> for Slots {
    type Output = Slot;

    fn index(&self, index: NodeIndex) -> &Slot {
        &self.slots[index.index()]
    }
}

impl std::ops::IndexMut<NodeIndex> for Slots {
    fn index_mut(&mut self, index: NodeIndex) -> &mut Slot {
        &mut self.slots[index.index()]
    }
}
