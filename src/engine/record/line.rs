//! The lines of a record.

use std::{collections::BTreeMap, path::PathBuf};

use serde::{Deserialize, Serialize};

use crate::engine::{digest::Digest, why::Why};

/// One line of a record.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Line {
    RunStart(RunStart),
    Planned {
        t: f64,
        nodes: usize,
        cached: usize,
    },
    NodeStart(NodeStart),
    NodeProgress {
        t: f64,
        node: String,
        fraction: Option<f64>,
        text: String,
    },
    NodeWaiting {
        t: f64,
        node: String,
    },
    NodeRetry {
        t: f64,
        node: String,
        retry: u32,
        retries: u32,
        wait_s: f64,
        message: String,
    },
    Stopping {
        t: f64,
        now: bool,
    },
    NodeDone(NodeDone),
    Output {
        t: f64,
        path: PathBuf,
        status: String,
        bytes: Option<u64>,
        message: Option<String>,
    },
    Warning {
        t: f64,
        text: String,
    },
    RunDone {
        t: f64,
        ran: usize,
        cached: usize,
        cut_off: usize,
        failed: usize,
        skipped: usize,
        /// It was asked to stop.
        #[serde(default)]
        stopped: bool,
    },
}

/// What was run, by whom, with what.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunStart {
    pub v: u32,
    pub run: String,
    /// UTC.
    pub time: String,
    /// The program's version.
    pub version: String,
    pub title: Option<String>,
    /// The command line.
    pub args: Vec<String>,
    /// The folder in which it was given.
    pub folder: PathBuf,
    pub host: String,
    pub threads: usize,
    /// Every pipeline file that was read, as it was; the first is the one that was asked for.
    pub sources: Vec<SourceText>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SourceText {
    pub path: PathBuf,
    pub text: String,
}

/// An instance begins to run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NodeStart {
    /// Seconds since the start of the run.
    pub t: f64,
    pub node: String,
    pub threads: usize,
    pub reason: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub why: Option<Why>,
}

/// How it ended for one instance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NodeDone {
    /// Seconds since the start of the run.
    pub t: f64,
    pub node: String,
    pub kind: String,
    /// `ran`, `cached`, `cut_off`, `shared`, `failed`, `skipped`, `not_reached`.
    pub status: String,
    pub key: Option<Digest>,
    pub wall_s: Option<f64>,
    /// Why it ran, why it failed, or because of which node it was skipped.
    pub message: Option<String>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// Outputs by port.
    pub out: BTreeMap<String, Digest>,
}
