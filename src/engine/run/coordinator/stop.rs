//! Stops when it is asked to: gently first, and then at once.

use std::time::Duration;

use petgraph::graph::NodeIndex;

use super::Coordinator;
use crate::engine::events::Event;
use crate::engine::events::Outcome;
use crate::engine::run::timers::Timer;

/// How long what could be killed may still run, so that what is nearly done is not lost.
const GRACE: Duration = Duration::from_secs(2);

impl<'a> Coordinator<'a> {
    /// Somebody asks to stop. Nothing more is started; nodes in threads of this process finish, for
    /// threads cannot be killed; all others have the grace, or end now if this is the second time.
    pub(super) fn asked_to_stop(&mut self) {
        let now = self.stop_asked;
        self.stop_asked = true;
        self.stopping = true;
        if now {
            self.canceller.cancel();
        } else {
            self.timers.start(GRACE, Timer::EndGrace);
        }
        let is_wanted = |it: &Option<Outcome>| *it != Some(Outcome::NotWanted);
        let n_wanted = self.slots.iter().filter(|it| is_wanted(&it.outcome)).count();
        let is_done = |it: &Option<Outcome>| it.as_ref().is_some_and(Outcome::is_done);
        let n_done = self.slots.iter().filter(|it| is_done(&it.outcome)).count();
        let n_running = self.running;
        self.emit(&Event::Stopping { now, n_running, n_done, n_wanted });
    }

    /// An instance was killed because the run stops.
    pub(super) fn killed(&mut self, index: NodeIndex) {
        let key = self.key_digest(index);
        self.in_flight.remove(&key);
        self.slots[index].claim = None;
        // One that was only to be made again has had its outcome.
        if self.slots[index].outcome.is_none() {
            self.end(index, Outcome::NotReached);
        }
    }
}
