//! Gets instances ready to run: their inputs' values are there, or are made again first.

use petgraph::graph::NodeIndex;

use super::Coordinator;
use crate::engine::digest::Digest;
use crate::engine::graph::PortRef;
use crate::engine::plan::Memory;
use crate::engine::plan::Reason;
use crate::engine::run::ready::remaining_paths;
use crate::engine::run::slots::Work;

impl<'a> Coordinator<'a> {
    /// An instance has to run: it waits for its inputs' values, or for another with the same key.
    pub(super) fn start_work(&mut self, index: NodeIndex) {
        let key = self.key_digest(index);
        match self.in_flight.get(&key) {
            Some(&leader) if leader != index => {
                self.slots[index].work = Work::Waiting;
                self.slots[leader].followers.push(index);
            }
            _ => {
                self.in_flight.insert(key, index);
                self.prepare(index);
            }
        }
    }

    pub(super) fn key_digest(&self, index: NodeIndex) -> Digest {
        self.slots[index].key.as_ref().expect("what runs has a key").0
    }

    /// Queues an instance if all its inputs can be had, and otherwise has them made again.
    pub(super) fn prepare(&mut self, index: NodeIndex) {
        if !self.slots[index].reads {
            self.slots[index].reads = true;
            for producer in self.slots.producers(index) {
                self.slots[producer].readers += 1;
            }
        }
        self.slots[index].work = Work::Waiting;
        let mut missing: Vec<NodeIndex> = Vec::new();
        for from in self.input_refs(index) {
            if !missing.contains(&from.instance) && !self.can_have(from) {
                missing.push(from.instance);
                self.revive(from);
            }
        }
        for &producer in &missing {
            self.slots[producer].wakes.push(index);
        }
        self.slots[index].missing_inputs = missing.len();
        if missing.is_empty() {
            self.queue(index);
        }
    }

    pub(super) fn queue(&mut self, index: NodeIndex) {
        if self.priorities.is_empty() {
            let micros: Vec<u64> = self
                .context
                .graph
                .instances
                .node_indices()
                .map(|it| self.usual_micros(it))
                .collect();
            self.priorities = remaining_paths(self.context.graph, &self.order, &micros);
        }
        self.slots[index].work = Work::Ready;
        self.ready.push(index, self.priorities[index.index()]);
    }

    /// How long an instance took when it ran last; a millisecond if it never did.
    fn usual_micros(&self, index: NodeIndex) -> u64 {
        let id = self.context.graph.instances[index].id();
        let entry = self.memory.last_key(&id).and_then(|it| self.memory.entry(&it));
        entry.map_or(1000, |it| (it.wall_secs * 1e6) as u64)
    }

    pub(super) fn input_refs(&self, index: NodeIndex) -> Vec<PortRef> {
        self.context.graph.instances[index].inputs.values().flatten().copied().collect()
    }

    /// Whether a value is in memory or in the store, or was left out and never will be.
    pub(super) fn can_have(&self, from: PortRef) -> bool {
        let slot = &self.slots[from.instance];
        if slot.work != Work::Idle {
            return false;
        }
        let info = slot.outputs.as_ref().and_then(|it| it.artifacts.get(from.port));
        let Some(info) = info else { return true };
        slot.live.contains_key(from.port)
            || slot.stored && self.context.store.has_object(&info.digest)
    }

    /// A known result whose value was lost is made again.
    pub(super) fn revive(&mut self, from: PortRef) {
        if self.slots[from.instance].work == Work::Idle {
            let outputs = self.slots[from.instance].outputs.as_ref();
            let info = outputs.and_then(|it| it.artifacts.get(from.port));
            let digest = info.expect("what was lost was known").digest;
            let reason = Reason::of_loss(from.port, &digest, &self.memory);
            self.slots[from.instance].reason = reason;
            if let Some((key, text @ None)) = &mut self.slots[from.instance].key {
                // What was found in the store has its text there.
                *text = self.memory.entry(key).map(|it| it.key.clone());
            }
            self.start_work(from.instance);
        }
    }
}
