//! Finds out what is stored: keys, look-ups, and what becomes known by them.

use std::time::Duration;

use petgraph::graph::NodeIndex;

use super::Coordinator;
use crate::engine::digest::Digest;
use crate::engine::events::Failure;
use crate::engine::events::Outcome;
use crate::engine::plan;
use crate::engine::plan::KeyError;
use crate::engine::plan::Memory;
use crate::engine::plan::Outputs;
use crate::engine::plan::Producer;
use crate::engine::plan::Reason;
use crate::engine::run::slots::Work;

impl<'a> Coordinator<'a> {
    /// Looks up everything whose inputs are known, and what becomes known by that.
    pub(super) fn resolve(&mut self) {
        while let Some(index) = self.resolvable.pop_front() {
            if self.slots[index].outcome.is_some() {
                continue;
            }
            let key = match self.key_text(index) {
                Ok(key) => key,
                Err(error) => {
                    self.cannot_start(index, &error);
                    continue;
                }
            };
            let digest = Digest::of(key.as_bytes());
            let forced = self.context.options.forced.contains(&index);
            let stored = if forced { None } else { self.stored_outputs(index, &digest) };
            if let Some(outputs) = stored {
                self.slots[index].key = Some((digest, None));
                let outcome = if self.planned { Outcome::CutOff } else { Outcome::Cached };
                self.found(index, outputs, outcome);
            } else {
                self.slots[index].reason = if forced {
                    Reason::Forced
                } else {
                    let id = self.context.graph.instances[index].id();
                    Reason::of_miss(&key, &digest, &id, &self.memory)
                };
                self.slots[index].key = Some((digest, Some(key)));
                self.start_work(index);
            }
        }
    }

    /// The text of the key of an instance whose producers are known.
    fn key_text(&self, index: NodeIndex) -> Result<String, KeyError> {
        let instance = &self.context.graph.instances[index];
        let producer = |it: NodeIndex| match &self.slots[it].failed {
            Some(why) if instance.shows_missing => Producer::Failed(why),
            _ => Producer::Known(self.slots[it].outputs.as_ref().expect("its producers are known")),
        };
        plan::key_of(instance, producer, &self.memory)
    }

    pub(super) fn stored_outputs(&self, index: NodeIndex, key: &Digest) -> Option<Outputs> {
        self.memory.outputs(key, &self.context.graph.instances[index])
    }

    fn cannot_start(&mut self, index: NodeIndex, error: &KeyError) {
        let message = error.message(self.context.graph);
        let failure = match error {
            KeyError::Absent { .. } => Failure::Node(message),
            KeyError::File { .. } | KeyError::Fact(_) => Failure::Environment(message),
        };
        self.fail(index, failure, Duration::ZERO);
    }

    /// An instance's outputs are in the store.
    pub(super) fn found(&mut self, index: NodeIndex, outputs: Outputs, outcome: Outcome) {
        self.slots[index].stored = true;
        self.slots[index].work = Work::Idle;
        self.settle(index, outputs, outcome);
    }

    /// Tells consumers and exports that an instance's outputs are known now.
    pub(super) fn announce(&mut self, index: NodeIndex) {
        for consumer in self.slots.consumers(index) {
            self.one_more_known(consumer);
        }
        for rule in self.rules.get(&index).cloned().unwrap_or_default() {
            self.plan_export(rule);
        }
    }

    /// One more of an instance's producers has ended: all of them, and its key can be made.
    pub(super) fn one_more_known(&mut self, consumer: NodeIndex) {
        let slot = &mut self.slots[consumer];
        slot.unknown_inputs -= 1;
        if slot.unknown_inputs == 0 {
            self.resolvable.push_back(consumer);
        }
    }
}
