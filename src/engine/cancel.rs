//! Tells a running node that its result is no longer wanted.

use std::{
    convert::Infallible,
    time::{Duration, Instant},
};

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, TryRecvError, bounded, never};

/// What a running node can ask: has the run been given up, is the time over?
#[derive(Debug, Clone)]
pub struct CancelToken {
    /// Closed when the run is given up.
    given_up: Receiver<Infallible>,
    /// When the node's time limit ends, if it has one.
    pub deadline: Option<Instant>,
}

impl CancelToken {
    /// A token of a run that nobody can give up.
    pub fn never() -> Self {
        Self { given_up: never(), deadline: None }
    }

    /// The same run, and a time limit from now on.
    pub fn with_limit(&self, limit: Option<Duration>) -> Self {
        let deadline = limit.and_then(|it| Instant::now().checked_add(it));
        Self { given_up: self.given_up.clone(), deadline }
    }

    /// Whether to stop: the run is given up, or the time is over.
    pub fn is_cancelled(&self) -> bool {
        self.is_given_up() || self.is_late()
    }

    /// Whether the run is given up.
    pub fn is_given_up(&self) -> bool {
        self.given_up.try_recv() == Err(TryRecvError::Disconnected)
    }

    /// Whether the time is over.
    pub fn is_late(&self) -> bool {
        self.deadline.is_some_and(|it| it <= Instant::now())
    }

    /// Sleeps for some time, but no longer than the result is wanted. Whether to stop.
    pub fn sleep(&self, duration: Duration) -> bool {
        let end = Instant::now().checked_add(duration);
        let end = [end, self.deadline].into_iter().flatten().min();
        let woken = match end {
            Some(end) => self.given_up.recv_deadline(end),
            None => self.given_up.recv().map_err(RecvTimeoutError::from),
        };
        woken == Err(RecvTimeoutError::Disconnected) || self.is_late()
    }
}

/// Gives up all nodes that have a token of it.
pub struct Canceller {
    sender: Option<Sender<Infallible>>,
    receiver: Receiver<Infallible>,
}

impl Canceller {
    pub fn new() -> Self {
        let (sender, receiver) = bounded(0);
        Self { sender: Some(sender), receiver }
    }

    pub fn token(&self) -> CancelToken {
        CancelToken { given_up: self.receiver.clone(), deadline: None }
    }

    pub fn cancel(&mut self) {
        self.sender = None;
    }
}

impl Default for Canceller {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use std::thread;

    use super::*;

    #[test]
    fn a_sleep_ends_when_the_run_is_given_up() {
        let mut canceller = Canceller::new();
        let token = canceller.token();
        assert!(!token.is_cancelled() && !token.sleep(Duration::ZERO));
        let sleeper = thread::spawn(move || token.sleep(Duration::MAX));
        canceller.cancel();
        assert!(sleeper.join().unwrap() && canceller.token().is_given_up());
    }

    #[test]
    fn a_sleep_ends_with_the_time_limit() {
        let token = CancelToken::never().with_limit(Some(Duration::from_millis(1)));
        assert!(token.sleep(Duration::MAX) && token.is_late() && !token.is_given_up());
        let unlimited = CancelToken::never().with_limit(Some(Duration::MAX));
        assert!(!unlimited.is_cancelled());
    }
}
