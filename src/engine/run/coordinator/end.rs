//! Ends instances: outcomes, failures and whom they stop, memory that is free again.

use std::{borrow::Cow, sync::Arc, time::Duration};

use petgraph::graph::NodeIndex;

use super::Coordinator;
use super::Queues;
use crate::engine::digest::Digest;
use crate::engine::events::Event;
use crate::engine::events::ExportOutcome;
use crate::engine::events::Failure;
use crate::engine::events::Outcome;
use crate::engine::node::Port;
use crate::engine::plan::Memory;
use crate::engine::run::export;
use crate::engine::run::message::Message;
use crate::engine::run::slots::Work;
use crate::engine::store::Note;

impl<'a> Coordinator<'a> {
    pub(super) fn end(&mut self, index: NodeIndex, outcome: Outcome) {
        let slot = &self.slots[index];
        let (key, outputs) = (slot.key.as_ref().map(|it| it.0), slot.outputs.as_ref());
        let event = Event::Finished { instance: index, outcome: &outcome, key, outputs };
        self.observer.event(self.context.graph, &event);
        self.slots[index].outcome = Some(outcome);
        self.release_inputs(index);
    }

    /// An instance will not read its inputs (again): the last reader's leaving drops them.
    fn release_inputs(&mut self, index: NodeIndex) {
        if std::mem::replace(&mut self.slots[index].reads, false) {
            for producer in self.slots.producers(index) {
                self.leave(producer);
            }
        }
    }

    pub(super) fn leave(&mut self, producer: NodeIndex) {
        let slot = &mut self.slots[producer];
        slot.readers = slot.readers.saturating_sub(1);
        if slot.readers == 0 {
            let dropped = slot.live_bytes();
            slot.live.clear();
            self.live_bytes -= dropped;
            self.freed_bytes += dropped;
        }
    }

    pub(super) fn fail(&mut self, index: NodeIndex, failure: Failure, wall: Duration) {
        if self.context.options.fail_fast {
            self.stopping = true;
        }
        self.slots[index].work = Work::Idle;
        let message = failure.message().to_owned();
        self.slots[index].failed = Some(message.as_str().into());
        self.end(index, Outcome::Failed { failure, wall });
        let because = format!("`{}` failed: {message}", self.context.graph.instances[index].id());
        let because: Arc<str> = because.into();
        let mut open = self.dependents(index);
        while let Some(consumer) = open.pop() {
            let is_open = match &self.slots[consumer].outcome {
                None => true,
                // Its value was to be made again for somebody.
                Some(_) => self.slots[consumer].work == Work::Waiting,
            };
            if is_open {
                self.slots[consumer].work = Work::Idle;
                self.slots[consumer].claim = None;
                self.slots[consumer].failed = Some(Arc::clone(&because));
                self.end(consumer, Outcome::Skipped { because: index });
                open.extend(self.dependents(consumer));
            }
        }
    }

    /// Who cannot go on when an instance fails.
    fn dependents(&mut self, index: NodeIndex) -> Vec<NodeIndex> {
        for rule in std::mem::take(&mut self.slots[index].waiting_exports) {
            self.end_export(rule, ExportOutcome::Skipped);
        }
        let mut res = std::mem::take(&mut self.slots[index].followers);
        for consumer in std::mem::take(&mut self.slots[index].wakes) {
            match self.shows_missing(consumer, index) {
                true => self.wake(consumer, true),
                false => res.push(consumer),
            }
        }
        if self.slots[index].outputs.is_none() {
            for consumer in self.slots.consumers(index) {
                match self.shows_missing(consumer, index) {
                    true => self.one_more_known(consumer),
                    false => res.push(consumer),
                }
            }
        }
        res
    }

    /// Whether a consumer goes on without a producer that failed: it reads it only where it shows what
    /// is missing.
    fn shows_missing(&self, consumer: NodeIndex, producer: NodeIndex) -> bool {
        let instance = &self.context.graph.instances[consumer];
        let reads = |it: &&Port| {
            let refs = instance.inputs.get(it.name).into_iter().flatten();
            refs.into_iter().any(|it| it.instance == producer)
        };
        instance.shows_missing
            && instance.kind.spec.inputs.iter().filter(reads).all(|it| it.labelled)
    }

    /// Waits for what still runs, closes the queues, and hears the writer out.
    pub(super) fn finish(&mut self) {
        let Some(queues) = self.queues.take() else { return };
        let Queues { jobs, job_queue, writes, messages, message_queue, .. } = queues;
        drop((jobs, job_queue, writes, messages));
        for message in message_queue {
            if let Message::StoreFailed { error } = message {
                self.store_error = Some(error);
            }
        }
    }

    /// Keeps what the next run wants to know: the keys of now.
    pub(super) fn remember(&mut self) {
        let mut notes = self.changed_keys();
        for (rule, outcome) in self.exports.iter().enumerate() {
            if !matches!(outcome, Some(ExportOutcome::Written { .. })) {
                continue;
            }
            let path = self.output_path(rule);
            if let Some(info) = self.export_info(rule)
                && let Some(receipt) = export::receipt(info.digest, &path)
            {
                notes.push((Note::Exported, export::subject(&path), receipt));
            }
        }
        if self.store_error.is_none()
            && let Err(error) = self.context.store.remember(notes)
        {
            self.store_error = Some(error);
        }
    }

    /// The keys that are not those of the last run. That nothing has changed is told by one note: ten
    /// thousand need not be looked at for it.
    fn changed_keys(&self) -> Vec<(Note, Digest, Vec<u8>)> {
        let mut done = Vec::with_capacity(self.order.len());
        let mut all = blake3::Hasher::new();
        for index in self.context.graph.instances.node_indices() {
            let slot = &self.slots[index];
            if let Some((key, _)) = &slot.key
                && slot.outcome.as_ref().is_some_and(Outcome::is_done)
            {
                let id = self.context.graph.instances[index].shown_id();
                all.update(id.as_bytes()).update(&[0]).update(&key.0);
                done.push((id, *key));
            }
        }
        let all = all.finalize().as_bytes().to_vec();
        let subject = self.memory.subject("");
        if done.is_empty()
            || self.context.store.recall(Note::LastKeys, &subject).as_ref() == Some(&all)
        {
            return Vec::new();
        }
        let is_new = |it: &(Cow<'_, str>, Digest)| self.memory.last_key(&it.0) != Some(it.1);
        let new = done.into_iter().filter(is_new);
        let note = |(id, key): (Cow<'_, str>, Digest)| {
            (Note::LastKey, self.memory.subject(&id), key.0.to_vec())
        };
        new.map(note).chain([(Note::LastKeys, subject, all)]).collect()
    }
}
