//! Write-behind: stores results while the run goes on.

use crossbeam_channel::{Receiver, Sender};
use petgraph::graph::NodeIndex;

use super::message::Message;
use crate::engine::store::{Claim, NewEntry, Store, StoreError};

/// One result to store.
pub struct Write {
    pub instance: NodeIndex,
    pub entry: NewEntry,
    /// Given back when the entry can be read by others.
    pub claim: Claim,
}

/// Stores what comes, in batches of what has come meanwhile, until the queue is closed. After the
/// first failure nothing more is written.
pub fn write_behind(store: &Store, queue: &Receiver<Write>, messages: &Sender<Message>) {
    let mut refused = false;
    while let Ok(first) = queue.recv() {
        let batch: Vec<Write> = std::iter::once(first).chain(queue.try_iter()).collect();
        let (mut instances, mut entries, mut claims) = (Vec::new(), Vec::new(), Vec::new());
        for Write { instance, entry, claim } in batch {
            instances.push(instance);
            entries.push(entry);
            claims.push(claim);
        }
        let result: Result<(), StoreError> = if refused { Ok(()) } else { store.write(entries) };
        let stored = result.is_ok() && !refused;
        refused |= result.is_err();
        drop(claims);
        let message = match result {
            Ok(()) if stored => Message::Stored { instances },
            Ok(()) => continue,
            Err(error) => Message::StoreFailed { error },
        };
        if messages.send(message).is_err() {
            return;
        }
    }
}
