//! Runs a graph: starts what is ready, keeps what is done, stops only what cannot go on.
//!
//! One thread, the coordinator ([`coordinator`]), owns all state and makes every decision; workers
//! ([`worker`]) compute and read, the writer ([`writer`]) stores behind them. They talk by messages,
//! so every change of state happens in one place and in one order. A worker runs a node in its own
//! thread or lets a process of its own do it ([`isolated`]).

mod coordinator;
mod export;
mod guard;
mod isolated;
mod message;
mod ready;
mod slots;
mod timers;
mod worker;
mod writer;

pub use export::encode as encode_artifact;
pub use isolated::{WorkerProgram, serve as serve_parent};

use std::{collections::BTreeSet, path::PathBuf};

use crossbeam_channel::{Receiver, never};
use petgraph::graph::NodeIndex;

use super::{
    events::{Observer, RunReport},
    graph::Graph,
    library::Library,
    node::Surroundings,
    store::Store,
};

/// How to run. None of it changes a result.
#[derive(Debug, Clone)]
pub struct RunOptions {
    /// Threads for all nodes together.
    pub threads: usize,
    /// Bytes that live artifacts may take before they are dropped and read again.
    pub memory: u64,
    /// Instances to bring up to date with all they depend on; every one if none is named.
    pub targets: Vec<NodeIndex>,
    /// Instances to compute although they are stored.
    pub forced: BTreeSet<NodeIndex>,
    /// Start nothing more after the first failure.
    pub fail_fast: bool,
    pub surroundings: Surroundings,
    /// The folder that output paths are relative to.
    pub output_dir: PathBuf,
    /// The name of the run, kept with every result that it makes.
    pub run_id: String,
    /// What runs nodes in processes of their own.
    pub worker: Option<WorkerProgram>,
    /// Asks to stop. First: nothing more is started, and what can be killed is killed after a grace.
    /// Again: it is killed at once.
    pub stop: Receiver<()>,
}

impl Default for RunOptions {
    /// Everything, with one thread, a gigabyte, and nobody who asks to stop.
    fn default() -> Self {
        Self {
            threads: 1,
            memory: 1 << 30,
            targets: Vec::new(),
            forced: BTreeSet::new(),
            fail_fast: false,
            surroundings: Surroundings::default(),
            output_dir: PathBuf::new(),
            run_id: String::new(),
            worker: None,
            stop: never(),
        }
    }
}

/// Brings the targets of a graph up to date and writes the files that its outputs name.
///
/// Never fails as a whole: the report says how it ended for every instance.
pub fn run(
    graph: &Graph,
    library: &Library,
    store: &Store,
    options: &RunOptions,
    observer: &mut dyn Observer,
) -> RunReport {
    coordinator::Coordinator::new(graph, library, store, options, observer).run()
}
