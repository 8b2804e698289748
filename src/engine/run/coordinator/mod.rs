//! The coordinator: every change of a run's state.

mod end;
mod memory;
mod outputs;
mod prepare;
mod receive;
mod resolve;
mod retry;
mod start;
mod stop;

use std::{
    collections::{HashMap, VecDeque},
    sync::Arc,
    thread::{self, Scope},
    time::{Duration, Instant},
};

use crossbeam_channel::{Receiver, Sender, unbounded};
use petgraph::graph::NodeIndex;
use rayon::ThreadPool;

use super::{
    RunOptions,
    message::Message,
    ready::ReadyQueue,
    slots::Slots,
    timers::Timers,
    worker::{Context, Job},
    writer::{self, Write},
};
use crate::engine::{
    cancel::Canceller,
    digest::Digest,
    events::{Event, ExportOutcome, Observer, Outcome, RunReport},
    graph::Graph,
    library::Library,
    plan::{self, PipelineMemory, topological_order},
    store::{Store, StoreError},
};

/// How often a key that another process computes is claimed again. A blocking lock would tell of its
/// end at once, but needs a thread for every key, which nothing but a signal can call back.
const CLAIM_POLL: Duration = Duration::from_millis(20);

pub struct Coordinator<'a> {
    context: Context<'a>,
    memory: PipelineMemory<'a>,
    observer: &'a mut dyn Observer,
    slots: Slots,
    order: Vec<NodeIndex>,
    priorities: Vec<u64>,
    exports: Vec<Option<ExportOutcome>>,
    /// Which exports an instance's outputs go to.
    rules: HashMap<NodeIndex, Vec<usize>>,
    /// Instances whose producers are all known, and whose key is to be made.
    resolvable: VecDeque<NodeIndex>,
    ready: ReadyQueue,
    ready_exports: VecDeque<usize>,
    claimed: Vec<NodeIndex>,
    /// Keys that this run computes.
    in_flight: HashMap<Digest, NodeIndex>,
    free_threads: usize,
    running: usize,
    /// Bytes of artifacts in memory.
    live_bytes: u64,
    /// Bytes that running jobs will need beside these.
    reserved_bytes: u64,
    /// Bytes that wait to be written to the store.
    pending_bytes: u64,
    /// Bytes that were freed since memory was given back to the system.
    freed_bytes: u64,
    /// The most bytes that an instance of a kind has given in this run.
    largest_outputs: HashMap<&'static str, u64>,
    pools: HashMap<usize, Vec<Arc<ThreadPool>>>,
    /// Planning is over: a stored result is found because something ran.
    planned: bool,
    /// Nothing more is started.
    stopping: bool,
    /// Somebody asked to stop.
    stop_asked: bool,
    /// Who may still ask.
    stop: Receiver<()>,
    canceller: Canceller,
    timers: Timers,
    /// Instances that wait for their next try.
    n_backoff: usize,
    store_error: Option<StoreError>,
    queues: Option<Queues>,
}

/// The threads' queues, made when there is something to do.
struct Queues {
    jobs: Sender<Job>,
    job_queue: Receiver<Job>,
    writes: Sender<Write>,
    messages: Sender<Message>,
    message_queue: Receiver<Message>,
    n_workers: usize,
    /// Jobs that are queued or running.
    n_jobs: usize,
}

impl<'a> Coordinator<'a> {
    pub fn new(
        graph: &'a Graph,
        library: &'a Library,
        store: &'a Store,
        options: &'a RunOptions,
        observer: &'a mut dyn Observer,
    ) -> Self {
        let wanted = plan::wanted(graph, &options.targets);
        Self {
            context: Context { graph, library, store, options },
            memory: PipelineMemory::new(store, graph),
            observer,
            slots: Slots::new(graph, &wanted),
            order: topological_order(graph),
            priorities: Vec::new(),
            exports: vec![None; graph.outputs.len()],
            rules: rules(graph),
            resolvable: VecDeque::new(),
            ready: ReadyQueue::default(),
            ready_exports: VecDeque::new(),
            claimed: Vec::new(),
            in_flight: HashMap::new(),
            free_threads: options.threads.max(1),
            running: 0,
            live_bytes: 0,
            reserved_bytes: 0,
            pending_bytes: 0,
            freed_bytes: 0,
            largest_outputs: HashMap::new(),
            pools: HashMap::new(),
            planned: false,
            stopping: false,
            stop_asked: false,
            stop: options.stop.clone(),
            canceller: Canceller::new(),
            timers: Timers::default(),
            n_backoff: 0,
            store_error: None,
            queues: None,
        }
    }

    pub fn run(mut self) -> RunReport {
        let start = Instant::now();
        let context = self.context;
        thread::scope(|scope| {
            self.plan();
            loop {
                self.dispatch(scope, context);
                if !self.wait() {
                    break;
                }
            }
            self.end_retries();
            self.finish();
        });
        self.remember();
        self.tell_damage();
        self.context.store.ended();
        let outcome = |it: &mut super::slots::Slot| it.outcome.take();
        RunReport {
            outcomes: self
                .slots
                .iter_mut()
                .map(|it| outcome(it).unwrap_or(Outcome::NotReached))
                .collect(),
            exports: self
                .exports
                .into_iter()
                .map(|it| it.unwrap_or(ExportOutcome::Skipped))
                .collect(),
            wall: start.elapsed(),
            stopped: self.stop_asked,
            store_error: self.store_error,
        }
    }

    /// Finds out what is stored, as far as that can be known before anything runs.
    fn plan(&mut self) {
        for index in self.order.clone() {
            if self.slots[index].outcome.is_none() && self.slots[index].unknown_inputs == 0 {
                self.resolvable.push_back(index);
            }
        }
        self.resolve();
        self.planned = true;
        let count = |what: fn(&Outcome) -> bool| {
            self.slots.iter().filter(|it| it.outcome.as_ref().is_some_and(what)).count()
        };
        let n_wanted = self.order.len() - count(|it| *it == Outcome::NotWanted);
        let n_cached = count(|it| *it == Outcome::Cached);
        self.emit(&Event::Planned { n_wanted, n_cached });
        self.open_gate();
        self.tell_damage();
    }

    /// Housekeeping may go on now; if there is something to do, it must keep what is relied on.
    fn open_gate(&mut self) {
        let is_idle = self.ready.len() == 0 && self.ready_exports.is_empty();
        let cached = |it: &&super::slots::Slot| it.outcome == Some(Outcome::Cached);
        let key = |it: &super::slots::Slot| it.key.as_ref().map(|it| it.0);
        let keys = || self.slots.iter().filter(cached).filter_map(key).collect();
        let relies_on: Option<Vec<Digest>> = (!is_idle).then(keys);
        self.context.store.planned(&self.context.options.run_id, relies_on.as_deref());
    }

    /// Tells the user what was found damaged in the store since this was asked last.
    fn tell_damage(&mut self) {
        for text in self.context.store.take_damage() {
            self.emit(&Event::Warning { text: &text });
        }
    }

    fn emit(&mut self, event: &Event<'_>) {
        self.observer.event(self.context.graph, event);
    }
}

fn rules(graph: &Graph) -> HashMap<NodeIndex, Vec<usize>> {
    let mut res: HashMap<NodeIndex, Vec<usize>> = HashMap::new();
    for (rule, output) in graph.outputs.iter().enumerate() {
        res.entry(output.from.instance).or_default().push(rule);
    }
    res
}

impl Queues {
    /// Makes the queues and starts the writer.
    fn start<'scope, 'a: 'scope>(scope: &'scope Scope<'scope, '_>, store: &'a Store) -> Self {
        let (jobs, job_queue) = unbounded();
        let (writes, write_queue) = unbounded();
        let (messages, message_queue) = unbounded();
        let to_run = messages.clone();
        scope.spawn(move || writer::write_behind(store, &write_queue, &to_run));
        Self { jobs, job_queue, writes, messages, message_queue, n_workers: 0, n_jobs: 0 }
    }
}
