//! Tries instances again that failed.

use std::time::Duration;

use petgraph::graph::NodeIndex;

use super::Coordinator;
use crate::engine::events::Event;
use crate::engine::events::Failure;
use crate::engine::run::slots::Work;
use crate::engine::run::timers::Timer;

impl<'a> Coordinator<'a> {
    /// A try failed: there will be another one, or it was the last. In between the instance keeps its
    /// claim, so that no other process tries as well, but no thread.
    pub(super) fn try_failed(&mut self, index: NodeIndex, failure: Failure, wall: Duration) {
        let settings = &self.context.graph.instances[index].settings;
        let slot = &mut self.slots[index];
        slot.n_failed += 1;
        let (retry, retries) = (slot.n_failed, settings.retries);
        if retry > retries || self.stopping {
            return self.last_try_failed(index, failure, wall);
        }
        let wait = settings.wait_after(retry);
        slot.work = Work::Backoff;
        self.n_backoff += 1;
        self.timers.start(wait, Timer::Retry(index));
        self.emit(&Event::Retrying { instance: index, retry, retries, wait, failure: &failure });
        self.slots[index].last_failure = Some((failure, wall));
    }

    /// The wait before an instance's next try is over.
    pub(super) fn try_again(&mut self, index: NodeIndex) {
        if self.slots[index].work == Work::Backoff {
            self.n_backoff -= 1;
            self.prepare(index);
        }
    }

    /// There will be no more tries of instances that wait for one.
    pub(super) fn end_retries(&mut self) {
        for index in self.order.clone() {
            if self.slots[index].work != Work::Backoff {
                continue;
            }
            self.n_backoff -= 1;
            let failure = self.slots[index].last_failure.take();
            let (failure, wall) = failure.expect("what waits for its next try has failed");
            self.last_try_failed(index, failure, wall);
        }
    }

    /// Ends an instance, and those with the same key that wait for it.
    fn last_try_failed(&mut self, index: NodeIndex, failure: Failure, wall: Duration) {
        let n_failed = self.slots[index].n_failed;
        let failure = match n_failed {
            1 => failure,
            _ => failure.map(|it| format!("{it} (the last of {n_failed} tries)")),
        };
        let key = self.key_digest(index);
        self.in_flight.remove(&key);
        self.slots[index].claim = None;
        for follower in std::mem::take(&mut self.slots[index].followers) {
            self.fail(follower, failure.clone(), wall);
        }
        self.fail(index, failure, wall);
    }
}
