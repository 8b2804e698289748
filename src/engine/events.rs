//! What a run tells those who watch it: the terminal, the record, machines.

use std::{collections::BTreeMap, time::Duration};

use petgraph::graph::NodeIndex;

use super::{
    artifact::AnyArtifact,
    digest::Digest,
    graph::Graph,
    plan::{Outputs, Reason},
    store::StoreError,
};

/// One thing that happened.
#[derive(Debug)]
pub enum Event<'a> {
    /// Planning is done: how many instances are there, and how many of them are known to be stored.
    Planned {
        n_wanted: usize,
        n_cached: usize,
    },
    Started {
        instance: NodeIndex,
        threads: usize,
        reason: &'a Reason,
    },
    Progress {
        instance: NodeIndex,
        fraction: Option<f64>,
        text: &'a str,
    },
    /// Another process computes the same key; its result will be used.
    Waiting {
        instance: NodeIndex,
    },
    /// A try failed, and there will be another one.
    Retrying {
        instance: NodeIndex,
        /// The number of the retry, from 1.
        retry: u32,
        retries: u32,
        /// How long it waits before that.
        wait: Duration,
        failure: &'a Failure,
    },
    /// The run was asked to stop.
    Stopping {
        /// It was asked again, and ends at once.
        now: bool,
        n_running: usize,
        /// How many instances are done, out of those that are wanted.
        n_done: usize,
        n_wanted: usize,
    },
    Finished {
        instance: NodeIndex,
        outcome: &'a Outcome,
        key: Option<Digest>,
        outputs: Option<&'a Outputs>,
    },
    Exported {
        rule: usize,
        outcome: &'a ExportOutcome,
    },
    /// Something that the user should know, and that fails nothing: a damaged file that is made
    /// again.
    Warning {
        text: &'a str,
    },
}

/// How it ended for one instance.
#[derive(Debug, Clone, PartialEq)]
pub enum Outcome {
    /// Nothing that was wanted needs it.
    NotWanted,
    /// Its result was stored, and nothing before it ran.
    Cached,
    /// Something before it ran but gave what it gave before.
    CutOff,
    /// Another instance of this run, or another process, computed the same key.
    Shared,
    Ran {
        wall: Duration,
        reason: Reason,
        notes: Vec<String>,
    },
    Failed {
        failure: Failure,
        wall: Duration,
    },
    /// Something that it depends on failed.
    Skipped {
        because: NodeIndex,
    },
    /// The run was stopped before its turn came, or before it was done.
    NotReached,
}

/// Why an instance failed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Failure {
    /// The node says so.
    Node(String),
    /// The machine is to blame.
    Environment(String),
    /// A bug of the kind: the panic's message and place, or how its process crashed.
    Panic(String),
}

impl Outcome {
    /// Whether its result is there.
    pub fn is_done(&self) -> bool {
        matches!(self, Self::Cached | Self::CutOff | Self::Shared | Self::Ran { .. })
    }
}

impl Failure {
    /// The same failure with another message.
    pub fn map(self, change: impl FnOnce(String) -> String) -> Self {
        match self {
            Self::Node(message) => Self::Node(change(message)),
            Self::Environment(message) => Self::Environment(change(message)),
            Self::Panic(message) => Self::Panic(change(message)),
        }
    }

    pub fn message(&self) -> &str {
        match self {
            Self::Node(message) | Self::Environment(message) | Self::Panic(message) => message,
        }
    }
}

/// How it ended for one file of `[outputs]`.
#[derive(Debug, Clone, PartialEq)]
pub enum ExportOutcome {
    Written {
        bytes: u64,
    },
    UpToDate,
    Failed {
        failure: Failure,
    },
    /// What it shows was not made.
    Skipped,
}

/// Somebody who watches a run. Called by one thread at a time.
pub trait Observer {
    fn event(&mut self, graph: &Graph, event: &Event<'_>);

    /// An instance ran, and these are the artifacts that it made; told before it is finished.
    fn made(&mut self, _instance: NodeIndex, _artifacts: &BTreeMap<&'static str, AnyArtifact>) {}
}

/// Watches nothing.
pub struct Silent;

impl Observer for Silent {
    fn event(&mut self, _: &Graph, _: &Event<'_>) {}
}

/// The end of a run.
#[derive(Debug)]
pub struct RunReport {
    /// By instance.
    pub outcomes: Vec<Outcome>,
    /// By output rule.
    pub exports: Vec<ExportOutcome>,
    pub wall: Duration,
    /// It was asked to stop.
    pub stopped: bool,
    /// The store stopped taking results; what it had taken before is kept.
    pub store_error: Option<StoreError>,
}

/// How many instances ended in each way.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    pub ran: usize,
    /// Stored before, nothing before them ran.
    pub cached: usize,
    pub cut_off: usize,
    pub failed: usize,
    /// Together with those that were not reached.
    pub skipped: usize,
    /// The run was stopped before they were done.
    pub not_reached: usize,
}

impl RunReport {
    pub fn counts(&self) -> Counts {
        let mut counts = Counts::default();
        for outcome in &self.outcomes {
            match outcome {
                Outcome::NotWanted => {}
                Outcome::Cached | Outcome::Shared => counts.cached += 1,
                Outcome::CutOff => counts.cut_off += 1,
                Outcome::Ran { .. } => counts.ran += 1,
                Outcome::Failed { .. } => counts.failed += 1,
                Outcome::Skipped { .. } => counts.skipped += 1,
                Outcome::NotReached => {
                    counts.skipped += 1;
                    counts.not_reached += 1;
                }
            }
        }
        counts
    }

    /// Whether the machine, rather than the pipeline, is why something failed.
    pub fn environment_failed(&self) -> bool {
        let is_environment = |it: &Failure| matches!(it, Failure::Environment(_));
        self.store_error.is_some()
            || self
                .outcomes
                .iter()
                .any(|it| matches!(it, Outcome::Failed { failure, .. } if is_environment(failure)))
            || self.exports.iter().any(
                |it| matches!(it, ExportOutcome::Failed { failure } if is_environment(failure)),
            )
    }

    /// Whether a kind panicked.
    pub fn panicked(&self) -> bool {
        let panicked =
            |it: &Outcome| matches!(it, Outcome::Failed { failure: Failure::Panic(_), .. });
        self.outcomes.iter().any(panicked)
    }

    pub fn succeeded(&self) -> bool {
        // A skipped file shows what failed, and that counts already, or what nobody asked for.
        let failed = |it: &ExportOutcome| matches!(it, ExportOutcome::Failed { .. });
        let counts = self.counts();
        counts.failed == 0
            && counts.skipped == 0
            && self.store_error.is_none()
            && !self.exports.iter().any(failed)
    }
}
