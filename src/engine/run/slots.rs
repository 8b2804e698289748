//! What the coordinator knows of every instance.

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
    time::{Duration, Instant},
};

use petgraph::graph::NodeIndex;

use crate::engine::{
    artifact::AnyArtifact,
    digest::Digest,
    events::{Failure, Outcome},
    graph::Graph,
    key::Key,
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
    pub key: Option<(Digest, Key)>,
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
    producers: Vec<Vec<NodeIndex>>,
    consumers: Vec<Vec<NodeIndex>>,
}

impl Slots {
    pub fn new(graph: &Graph, wanted: &BTreeSet<NodeIndex>) -> Self {
        let n = graph.instances.node_count();
        let mut res = Self {
            slots: Vec::with_capacity(n),
            producers: vec![Vec::new(); n],
            consumers: vec![Vec::new(); n],
        };
        for &index in wanted {
            let sources = graph.instances[index].inputs.values().flatten();
            let mut producers: Vec<NodeIndex> = sources.map(|it| it.instance).collect();
            producers.sort();
            producers.dedup();
            for producer in &producers {
                res.consumers[producer.index()].push(index);
            }
            res.producers[index.index()] = producers;
        }
        let mut exports = vec![0; n];
        for rule in &graph.outputs {
            exports[rule.from.instance.index()] += 1;
        }
        for index in 0..n {
            let readers = res.consumers[index].len() + exports[index];
            let mut slot = Slot::new(res.producers[index].len(), readers);
            if !wanted.contains(&NodeIndex::new(index)) {
                slot.outcome = Some(Outcome::NotWanted);
            }
            res.slots.push(slot);
        }
        res
    }

    pub fn producers(&self, of: NodeIndex) -> Vec<NodeIndex> {
        self.producers[of.index()].clone()
    }

    pub fn consumers(&self, of: NodeIndex) -> Vec<NodeIndex> {
        self.consumers[of.index()].clone()
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
