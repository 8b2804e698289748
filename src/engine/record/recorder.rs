//! Writes the record of a run as it goes.

use std::{
    fs::File,
    io::{BufWriter, Write},
    path::Path,
    time::Instant,
};

use super::{Line, Liner, RunStart};
use crate::engine::{
    events::{Event, Observer, Outcome, RunReport},
    graph::Graph,
};

/// Writes the record of a run as it goes.
pub struct Recorder {
    liner: Liner,
    file: Option<BufWriter<File>>,
    /// The line that is being written.
    line: Vec<u8>,
}

impl Recorder {
    /// Starts a record `runs/<id>.jsonl` in a store's folder.
    pub fn start(store: &Path, start: &RunStart) -> Self {
        let path = store.join("runs").join(format!("{}.jsonl", start.run));
        let file = File::options().write(true).create_new(true).open(&path);
        if let Err(error) = &file {
            tracing::warn!(path = %path.display(), %error, "the run is not recorded");
        }
        // Tells readers that the run is going on; it dies with the process.
        let file = file.ok().inspect(|it| drop(it.try_lock()));
        let file = file.map(|it| BufWriter::with_capacity(1 << 16, it));
        let mut res = Self { liner: Liner::new(Instant::now()), file, line: Vec::new() };
        res.write(&Line::RunStart(start.clone()), true);
        res
    }

    /// Ends the record.
    pub fn done(mut self, report: &RunReport) {
        let line = self.liner.done(report);
        self.write(&line, true);
    }

    fn write(&mut self, line: &Line, flush: bool) {
        serde_json::to_writer(&mut self.line, line).expect("lines are plain data");
        self.line.push(b'\n');
        self.write_line(flush);
    }

    fn write_line(&mut self, flush: bool) {
        let Some(file) = &mut self.file else { return self.line.clear() };
        let written = file.write_all(&self.line);
        self.line.clear();
        let result = written.and_then(|()| if flush { file.flush() } else { Ok(()) });
        if let Err(error) = result {
            tracing::warn!(%error, "the rest of the run is not recorded");
            self.file = None;
        }
    }
}

impl Observer for Recorder {
    fn event(&mut self, graph: &Graph, event: &Event<'_>) {
        match *event {
            Event::Progress { .. } => return,
            Event::Finished { instance, outcome: Outcome::Cached, key, outputs } => {
                let line = &mut self.line;
                self.liner.write_stored(line, graph, instance, "cached", key, outputs);
                return self.write_line(false);
            }
            _ => {}
        }
        // What is cached would be cached again; what ran must not be lost with the process.
        let flush = matches!(
            event,
            Event::Finished { outcome: Outcome::Ran { .. } | Outcome::Failed { .. }, .. }
                | Event::Stopping { .. }
        );
        if let Some(line) = self.liner.line(graph, event) {
            self.write(&line, flush);
        }
    }
}
