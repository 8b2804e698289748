//! `sinew watch`: runs a pipeline again whenever a file that it reads is saved.
//!
//! Files are looked at, several times a second, instead of waiting for messages of the system:
//! editors save by renaming another file over the old one, so that a watch on the file follows the
//! wrong one; network disks send no messages; and a pipeline reads few enough files that looking at
//! all of them costs less than one message would save.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

use crossbeam_channel::Receiver;

use super::{
    Exit, Failure,
    run::{self, Args as RunArgs},
    ui::Ui,
    words::count,
};
use crate::engine::{digest::Digest, file_digests, graph::Graph};

/// Run a pipeline, and again whenever a file that it reads is saved
///
/// What did not change is not computed again. Mistakes are told, and end nothing: the outputs of the
/// last good run stay. Ctrl-C ends it.
#[derive(clap::Args)]
// The arguments of `run` are a group of the name that this one would have.
#[group(id = "WatchArgs")]
pub struct Args {
    #[command(flatten)]
    run: RunArgs,

    /// How often files are looked at
    #[arg(long, value_name = "MILLISECONDS", default_value_t = 150, value_parser = clap::value_parser!(u64).range(10..=60_000))]
    poll: u64,
}

/// While something is wrong, a file that is looked for in vain may appear anywhere: the pipeline is
/// read again this often.
const RETRY: Duration = Duration::from_secs(1);

/// Saving is over when nothing has changed between two looks, or after this time in any case.
const LONGEST_SAVE: Duration = Duration::from_secs(2);

pub fn run(args: &Args, ui: &Ui) -> Result<Exit, Failure> {
    let poll = Duration::from_millis(args.poll);
    let mut files = Files::default();
    files.watch(&args.run.pipeline.file);
    let stop = run::stop_requests()?;
    let mut told = String::new();
    loop {
        files.look();
        match args.run.pipeline.load() {
            Ok(graph) => {
                told.clear();
                files.watch_graph(&graph);
                match run::run_graph(&graph, &args.run, &stop, ui) {
                    Ok(Exit::Interrupted) => return Ok(Exit::Interrupted),
                    Ok(_) => {}
                    Err(failure) => ui.failure(&failure),
                }
                let n = count(files.states.len(), "file");
                ui.status("Watching", &format!("{n}; Ctrl-C ends"));
                if files.wait(poll, None, &stop) == Wait::Stopped {
                    return Ok(Exit::Interrupted);
                }
            }
            Err(failure) => {
                // The same mistakes are told once.
                let text = format!("{failure:?}");
                if text != told {
                    ui.failure(&failure);
                    ui.status("Watching", "until that is mended; Ctrl-C ends");
                    told = text;
                }
                if let Failure::Pipeline(diagnostics) = &failure {
                    let sources = diagnostics.sources.iter().filter(|it| !it.is_setting());
                    sources.for_each(|it| files.watch(&it.path));
                }
                if files.wait(poll, Some(RETRY), &stop) == Wait::Stopped {
                    return Ok(Exit::Interrupted);
                }
            }
        }
    }
}

/// Why waiting ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Wait {
    Over,
    Stopped,
}

/// What is watched, and how it looked before it was read last.
#[derive(Default)]
struct Files {
    /// `None` for a file that is not there.
    states: BTreeMap<PathBuf, Option<Digest>>,
}

impl Files {
    /// Takes down how all files look now.
    fn look(&mut self) {
        for (path, state) in &mut self.states {
            *state = state_of(path);
        }
    }

    /// Watches one more file.
    fn watch(&mut self, path: &Path) {
        if !self.states.contains_key(path) {
            self.states.insert(path.to_owned(), state_of(path));
        }
    }

    /// Watches the files of a graph and no others. What was watched before keeps the state that was
    /// taken down before it was read.
    fn watch_graph(&mut self, graph: &Graph) {
        let sources = graph.sources.iter().filter(|it| !it.is_setting());
        let inputs = graph.instances.node_weights().flat_map(|it| it.files.values());
        let paths: BTreeSet<&PathBuf> = sources.clone().map(|it| &it.path).chain(inputs).collect();
        self.states.retain(|path, _| paths.contains(path));
        for path in paths {
            self.watch(path);
        }
        for source in sources {
            // It was saved between being read and being looked at.
            if fs::read_to_string(&source.path).is_ok_and(|it| *it != *source.text) {
                self.states.insert(source.path.clone(), None);
            }
        }
    }

    /// Waits until a file has changed and is at rest again, or for this time, or until `stop` says
    /// so.
    fn wait(&mut self, poll: Duration, at_most: Option<Duration>, stop: &Receiver<()>) -> Wait {
        let start = Instant::now();
        while self.states.iter().all(|(path, state)| *state == state_of(path)) {
            if at_most.is_some_and(|it| start.elapsed() >= it) {
                return Wait::Over;
            }
            if stop.recv_timeout(poll).is_ok() {
                return Wait::Stopped;
            }
        }
        let change = Instant::now();
        let mut before = self.states.clone();
        loop {
            self.look();
            if self.states == before || change.elapsed() > LONGEST_SAVE {
                return Wait::Over;
            }
            before.clone_from(&self.states);
            if stop.recv_timeout(poll).is_ok() {
                return Wait::Stopped;
            }
        }
    }
}

/// What tells one state of a file from another: its place on the disk, its size, its times.
fn state_of(path: &Path) -> Option<Digest> {
    fs::metadata(path).ok().map(|it| file_digests::identity(path, &it))
}
