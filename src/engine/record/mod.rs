//! Run records: one file of JSON lines a run, from which it can be told again.
//!
//! The same lines are the machine-readable output of `sinew run --json`. Trouble with a record never
//! fails a run.

mod line;
mod liner;
mod names;
mod recorder;

pub use line::{Line, NodeDone, NodeStart, RunStart, SourceText};
pub use liner::Liner;
pub use names::{FindError, find, list, name, new_run_id};
pub use recorder::Recorder;

use std::{
    collections::BTreeMap,
    fs::{self, File},
    io::{self, BufRead, BufReader},
    path::Path,
};

use super::why::Why;

/// Raise it when a line changes its meaning. Fields are only added, so that old records stay
/// readable; what a reader does not know it passes over.
///
/// 2: `node_start` has `why`, the reason as data.
pub const RECORD_VERSION: u32 = 2;

/// A record as it was read.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    pub start: RunStart,
    /// All further lines; a run that was killed has no `RunDone`.
    pub lines: Vec<Line>,
}

impl Record {
    /// Reads a record. Lines that are torn, or that a later version has added, are left out.
    ///
    /// # Errors
    /// If the file cannot be read or does not begin as a record.
    pub fn read(path: &Path) -> io::Result<Self> {
        let mut lines = BufReader::new(File::open(path)?).lines();
        let damaged =
            |e: serde_json::Error| io::Error::new(io::ErrorKind::InvalidData, e.to_string());
        let first = lines.next().transpose()?.unwrap_or_default();
        let Line::RunStart(start) = serde_json::from_str(&first).map_err(damaged)? else {
            return Err(io::Error::new(
                io::ErrorKind::InvalidData,
                "it starts with no `run_start`",
            ));
        };
        let mut res = Self { start, lines: Vec::new() };
        for line in lines {
            // What is no text any more is no line either: the rest of the record may be sound.
            let line = match line {
                Ok(line) => line,
                Err(error) if error.kind() == io::ErrorKind::InvalidData => continue,
                Err(error) => return Err(error),
            };
            res.lines.extend(serde_json::from_str::<Line>(&line));
        }
        Ok(res)
    }

    /// What happened to an instance; the last time counts if it ran twice.
    pub fn node(&self, id: &str) -> Option<&NodeDone> {
        self.lines.iter().rev().find_map(|it| match it {
            Line::NodeDone(node) if node.node == id => Some(node),
            _ => None,
        })
    }

    /// Why instances ran, by their names.
    pub fn whys(&self) -> BTreeMap<&str, &Why> {
        let starts = self.lines.iter().filter_map(|it| match it {
            Line::NodeStart(start) => Some((start.node.as_str(), start.why.as_ref()?)),
            _ => None,
        });
        starts.collect()
    }

    /// How the run ended; `None` if it did not.
    pub fn done(&self) -> Option<&Line> {
        self.lines.iter().rev().find(|it| matches!(it, Line::RunDone { .. }))
    }

    /// The instances that ended, in this order.
    pub fn nodes(&self) -> impl Iterator<Item = &NodeDone> {
        self.lines.iter().filter_map(|it| match it {
            Line::NodeDone(node) => Some(node),
            _ => None,
        })
    }
}

/// Whether the run of a record is going on: its process holds a lock on the file.
pub fn is_going_on(path: &Path) -> bool {
    let locked = |it: File| matches!(it.try_lock_shared(), Err(fs::TryLockError::WouldBlock));
    File::open(path).is_ok_and(locked)
}
