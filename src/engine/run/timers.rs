//! What the coordinator does later, without anybody waiting for it.

use std::{cmp::Reverse, collections::BinaryHeap, time::Duration, time::Instant};

use petgraph::graph::NodeIndex;

/// What is due.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Timer {
    /// Another try of an instance that failed.
    Retry(NodeIndex),
    /// Another look at the keys that others compute.
    PollClaims,
    /// The end of the grace for what can be killed.
    EndGrace,
}

/// Timers by time.
#[derive(Default)]
pub struct Timers {
    heap: BinaryHeap<Reverse<(Instant, Timer)>>,
}

impl Timers {
    pub fn start(&mut self, wait: Duration, timer: Timer) {
        self.heap.push(Reverse((Instant::now() + wait, timer)));
    }

    /// When the next one is due.
    pub fn next(&self) -> Option<Instant> {
        self.heap.peek().map(|it| it.0.0)
    }

    /// Takes the next one if it is due.
    pub fn pop_due(&mut self) -> Option<Timer> {
        let due = self.next().is_some_and(|it| it <= Instant::now());
        if due { self.heap.pop().map(|it| it.0.1) } else { None }
    }
}
