//! Takes in what workers and the writer report.

use std::collections::BTreeMap;
use std::time::Duration;

use crossbeam_channel::at;
use crossbeam_channel::never;
use crossbeam_channel::select;
use petgraph::graph::NodeIndex;

use super::Coordinator;
use crate::engine::artifact::AnyArtifact;
use crate::engine::artifact::Bytes;
use crate::engine::digest::Digest;
use crate::engine::events::Event;
use crate::engine::events::Outcome;
use crate::engine::node::NodeOutputs;
use crate::engine::plan::OutputInfo;
use crate::engine::plan::Outputs;
use crate::engine::port_map::PortMap;
use crate::engine::run::message::Message;
use crate::engine::run::slots::Work;
use crate::engine::run::timers::Timer;
use crate::engine::run::worker::JobResult;
use crate::engine::run::worker::Loaded;
use crate::engine::run::writer::Write;
use crate::engine::store::Access;
use crate::engine::store::Claim;
use crate::engine::store::Entry;
use crate::engine::store::EntryOutput;
use crate::engine::store::NewEntry;
use crate::engine::store::now_secs;

impl<'a> Coordinator<'a> {
    /// Waits for the next thing to happen; false when nothing more will.
    pub(super) fn wait(&mut self) -> bool {
        if !self.resolvable.is_empty() {
            return true;
        }
        let waits_for_writer =
            self.pending_bytes > 0 && self.ready.peek().is_some() && !self.stopping;
        let busy = self.queues.as_ref().is_some_and(|it| it.n_jobs > 0) || waits_for_writer;
        let waits = !self.claimed.is_empty() || self.n_backoff > 0;
        if !busy && (self.stopping || !waits) {
            return false;
        }
        let messages = self.queues.as_ref().map_or_else(never, |it| it.message_queue.clone());
        let timer = self.timers.next().map_or_else(never, at);
        select! {
            recv(messages) -> message => {
                self.receive(message.expect("the run holds a sender"));
            }
            recv(self.stop) -> asked => match asked {
                Ok(()) => self.asked_to_stop(),
                // Nobody can ask any more.
                Err(_) => self.stop = never(),
            },
            recv(timer) -> _ => self.run_timers(),
        }
        true
    }

    fn run_timers(&mut self) {
        while let Some(timer) = self.timers.pop_due() {
            match timer {
                Timer::Retry(index) => self.try_again(index),
                Timer::PollClaims => self.poll_claims(),
                Timer::EndGrace => self.canceller.cancel(),
            }
        }
    }

    /// Puts instances that other processes compute back into the queue, to be claimed again.
    fn poll_claims(&mut self) {
        for index in std::mem::take(&mut self.claimed) {
            self.queue(index);
        }
    }

    pub(super) fn receive(&mut self, message: Message) {
        match message {
            Message::Progress { instance, fraction, text } => {
                self.emit(&Event::Progress { instance, fraction, text: &text });
            }
            Message::Ran { instance, loaded, result } => {
                self.job_ended(self.slots[instance].threads);
                self.running -= 1;
                self.reserved_bytes -= std::mem::take(&mut self.slots[instance].reserved);
                self.keep_loaded(loaded);
                self.node_ended(instance, result);
            }
            Message::Exported { rule, loaded, result } => {
                self.job_ended(1);
                self.keep_loaded(loaded);
                self.export_ended(rule, result);
            }
            Message::Stored { instances } => {
                for index in instances {
                    self.slots[index].stored = true;
                    let written = std::mem::take(&mut self.slots[index].pending);
                    self.pending_bytes -= written;
                    self.freed_bytes += written;
                }
                self.relieve_memory();
            }
            Message::StoreFailed { error } => {
                self.store_error = Some(error);
                self.stopping = true;
            }
        }
    }

    fn job_ended(&mut self, threads: usize) {
        self.free_threads += threads;
        if let Some(queues) = &mut self.queues {
            queues.n_jobs -= 1;
        }
    }

    /// Keeps what a job has read for others that will need it.
    fn keep_loaded(&mut self, loaded: Loaded) {
        for (from, artifact) in loaded {
            let slot = &mut self.slots[from.instance];
            let info = slot.outputs.as_ref().and_then(|it| it.artifacts.get(from.port));
            let is_current = info.is_some_and(|it| it.digest == artifact.digest());
            if slot.readers > 1 && is_current && !slot.live.contains_key(from.port) {
                self.live_bytes += info.map_or(0, |it| it.bytes);
                slot.live.insert(from.port, artifact);
            }
        }
        self.relieve_memory();
    }

    fn node_ended(&mut self, index: NodeIndex, result: JobResult) {
        self.slots[index].work = Work::Idle;
        match result {
            JobResult::Ran { outputs, wall } => self.ran(index, outputs, wall),
            JobResult::Failed { failure, wall } => self.try_failed(index, failure, wall),
            JobResult::Stopped => self.killed(index),
            JobResult::Lost { from, error } => {
                tracing::info!(%error, "an input is made again");
                self.tell_damage();
                self.slots[index].claim = None;
                self.slots[from.instance].stored = false;
                self.slots[from.instance].was_lost = true;
                self.prepare(index);
            }
            JobResult::Exported(_) => unreachable!("a node's job exports nothing"),
        }
    }

    pub(super) fn ran(&mut self, index: NodeIndex, result: NodeOutputs, wall: Duration) {
        let NodeOutputs { artifacts, absent, notes } = result;
        let mut outputs = Outputs { artifacts: PortMap::new(), absent };
        let (mut live, mut objects) = (BTreeMap::new(), Vec::new());
        for (port, (artifact, bytes)) in artifacts {
            let info = OutputInfo { digest: artifact.digest(), bytes: bytes.len() as u64 };
            outputs.artifacts.insert(port, info);
            objects.push((artifact.digest(), bytes));
            live.insert(port, artifact);
        }
        let key = self.key_digest(index);
        self.in_flight.remove(&key);
        self.observer.made(index, &live);
        self.store_result(index, &outputs, &live, objects, wall, &notes);
        let followers = std::mem::take(&mut self.slots[index].followers);
        for &follower in &followers {
            self.observer.made(follower, &live);
        }
        for &instance in followers.iter().chain([&index]) {
            self.keep_live(instance, &outputs, &live);
        }
        let reason = self.slots[index].reason.clone();
        self.settle(index, outputs.clone(), Outcome::Ran { wall, reason, notes });
        for follower in followers {
            self.slots[follower].work = Work::Idle;
            self.settle(follower, outputs.clone(), Outcome::Shared);
        }
        self.relieve_memory();
    }

    fn keep_live(
        &mut self,
        index: NodeIndex,
        outputs: &Outputs,
        live: &BTreeMap<&'static str, AnyArtifact>,
    ) {
        if self.slots[index].readers > 0 {
            self.live_bytes += outputs.artifacts.values().map(|it| it.bytes).sum::<u64>();
            self.slots[index].live = live.clone();
        }
    }

    /// Hands a result to the writer; with a store that is only read, or without the text of its key, it
    /// stays in memory.
    fn store_result(
        &mut self,
        index: NodeIndex,
        outputs: &Outputs,
        live: &BTreeMap<&'static str, AnyArtifact>,
        objects: Vec<(Digest, Bytes)>,
        wall: Duration,
        notes: &[String],
    ) {
        let claim = self.slots[index].claim.take().unwrap_or_else(Claim::none);
        let (key, text) = self.slots[index].key.as_ref().expect("what ran has a key");
        let Some(text) = text.clone() else { return };
        if self.context.store.access() == Access::ReadOnly {
            return;
        }
        let key = *key;
        let n_bytes = objects.iter().map(|it| it.1.len() as u64).sum::<u64>();
        self.slots[index].pending += n_bytes;
        self.pending_bytes += n_bytes;
        let kind = self.context.graph.instances[index].kind.spec.kind;
        let largest = self.largest_outputs.entry(kind).or_default();
        *largest = n_bytes.max(*largest);
        let list = outputs.artifacts.iter().map(|(port, info)| EntryOutput {
            port: (*port).to_owned(),
            ty: live[port].ty().name.to_owned(),
            digest: info.digest,
            bytes: info.bytes,
        });
        let entry = Entry {
            key: text,
            outputs: list.collect(),
            absent: outputs.absent.iter().map(|(k, v)| ((*k).to_owned(), v.clone())).collect(),
            notes: notes.to_vec(),
            wall_secs: wall.as_secs_f64(),
            made: now_secs(),
            run: self.context.options.run_id.clone(),
        };
        let write = Write { instance: index, entry: NewEntry { key, entry, objects }, claim };
        let queues = self.queues.as_ref().expect("what ran had a queue");
        queues.writes.send(write).expect("the writer lives as long as the run");
    }

    /// An instance's outputs are known: by a run, or from the store.
    ///
    /// A lost result that was made again may have other bytes than before (its kind is not
    /// reproducible). Those who wait for it then get another key, so that nothing is ever stored under
    /// a key that names inputs it was not made from.
    pub(super) fn settle(&mut self, index: NodeIndex, outputs: Outputs, outcome: Outcome) {
        let before = self.slots[index].outputs.replace(outputs);
        let changed = before.is_some() && before != self.slots[index].outputs;
        if changed {
            let id = self.context.graph.instances[index].id();
            tracing::warn!(instance = id, "gave other bytes than before from the same key");
        }
        self.end(index, outcome);
        let wakes = std::mem::take(&mut self.slots[index].wakes);
        let exports = std::mem::take(&mut self.slots[index].waiting_exports);
        if before.is_none() {
            self.announce(index);
        }
        self.ready_exports.extend(exports);
        for consumer in wakes {
            self.wake(consumer, changed);
        }
    }

    /// One of the producers that an instance waits for is there again.
    pub(super) fn wake(&mut self, index: NodeIndex, producer_changed: bool) {
        let slot = &mut self.slots[index];
        // It may have been skipped meanwhile, because another of its inputs failed.
        if slot.work != Work::Waiting {
            return;
        }
        slot.missing_inputs -= 1;
        slot.stale_key |= producer_changed;
        match (slot.missing_inputs, slot.stale_key) {
            (0, false) => self.prepare(index),
            (0, true) => self.resolve_again(index),
            _ => {}
        }
    }

    /// An instance's key names an input that is no more: it and its followers get new ones.
    fn resolve_again(&mut self, index: NodeIndex) {
        let key = self.key_digest(index);
        self.in_flight.remove(&key);
        let followers = std::mem::take(&mut self.slots[index].followers);
        for instance in followers.into_iter().chain([index]) {
            let slot = &mut self.slots[instance];
            slot.stale_key = false;
            slot.work = Work::Idle;
            slot.outcome = None;
            self.resolvable.push_back(instance);
        }
    }
}
