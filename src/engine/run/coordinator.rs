//! The coordinator: every change of a run's state.

use std::{
    collections::{BTreeMap, HashMap, VecDeque},
    sync::Arc,
    thread::{self, Scope},
    time::{Duration, Instant},
};

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, unbounded};
use petgraph::graph::NodeIndex;
use rayon::ThreadPool;

use super::{
    RunOptions, export,
    ready::{ReadyQueue, remaining_paths},
    slots::{Slots, Work},
    worker::{self, Context, Job, JobResult, Loaded, Value},
    writer::{self, Write},
};
use crate::engine::{
    artifact::AnyArtifact,
    digest::Digest,
    events::{Event, ExportOutcome, Failure, Observer, Outcome, RunReport},
    graph::{Graph, PortRef},
    library::Library,
    node::NodeOutputs,
    plan::{
        self, KeyError, Memory, OutputInfo, Outputs, PipelineMemory, Reason, topological_order,
    },
    store::{Access, Claim, Entry, EntryOutput, NewEntry, Note, Store, StoreError, now_secs},
};

/// What workers and the writer report.
pub enum Message {
    Progress { instance: NodeIndex, fraction: Option<f64>, text: String },
    Ran { instance: NodeIndex, loaded: Loaded, result: JobResult },
    Exported { rule: usize, loaded: Loaded, result: JobResult },
    Stored { instances: Vec<NodeIndex> },
    StoreFailed { error: StoreError },
}

/// How often a key that another process computes is looked up again.
const CLAIM_POLL: Duration = Duration::from_millis(20);

pub struct Coordinator<'a> {
    context: Context<'a>,
    memory: PipelineMemory<'a>,
    observer: &'a mut dyn Observer,
    slots: Slots,
    order: Vec<NodeIndex>,
    priorities: Vec<u64>,
    exports: Vec<Option<ExportOutcome>>,
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
    pools: HashMap<usize, Vec<Arc<ThreadPool>>>,
    /// Planning is over: a stored result is found because something ran.
    planned: bool,
    /// Nothing more is started.
    stopping: bool,
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
            resolvable: VecDeque::new(),
            ready: ReadyQueue::default(),
            ready_exports: VecDeque::new(),
            claimed: Vec::new(),
            in_flight: HashMap::new(),
            free_threads: options.threads.max(1),
            running: 0,
            live_bytes: 0,
            pools: HashMap::new(),
            planned: false,
            stopping: false,
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
            self.finish();
        });
        self.remember();
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
    }

    fn emit(&mut self, event: &Event<'_>) {
        self.observer.event(self.context.graph, event);
    }

    // ---- what is known -------------------------------------------------------------------------

    /// Looks up everything whose inputs are known, and what becomes known by that.
    fn resolve(&mut self) {
        while let Some(index) = self.resolvable.pop_front() {
            if self.slots[index].outcome.is_some() {
                continue;
            }
            let instance = &self.context.graph.instances[index];
            let known =
                |it: NodeIndex| self.slots[it].outputs.as_ref().expect("its producers are known");
            let key = match plan::key_of(instance, known, &self.memory) {
                Ok(key) => key,
                Err(error) => {
                    self.cannot_start(index, &error);
                    continue;
                }
            };
            let digest = Digest::of(key.text().as_bytes());
            let forced = self.context.options.forced.contains(&index);
            let stored = if forced { None } else { self.stored_outputs(index, &digest) };
            if let Some(outputs) = stored {
                self.slots[index].key = Some((digest, key));
                let outcome = if self.planned { Outcome::CutOff } else { Outcome::Cached };
                self.found(index, outputs, outcome);
            } else {
                self.slots[index].reason = if forced {
                    Reason::Forced
                } else {
                    Reason::of_miss(&key, &instance.id(), &self.memory)
                };
                self.slots[index].key = Some((digest, key));
                self.start_work(index);
            }
        }
    }

    fn stored_outputs(&self, index: NodeIndex, key: &Digest) -> Option<Outputs> {
        let entry = self.memory.entry(key)?;
        Outputs::of_entry(&self.context.graph.instances[index], &entry)
    }

    fn cannot_start(&mut self, index: NodeIndex, error: &KeyError) {
        let message = error.message(self.context.graph);
        let failure = match error {
            KeyError::Absent { .. } => Failure::Node(message),
            KeyError::File { .. } => Failure::Environment(message),
        };
        self.fail(index, failure, Duration::ZERO);
    }

    /// An instance's outputs are in the store.
    fn found(&mut self, index: NodeIndex, outputs: Outputs, outcome: Outcome) {
        self.slots[index].stored = true;
        self.slots[index].work = Work::Idle;
        self.slots[index].outputs = Some(outputs);
        self.end(index, outcome);
        self.announce(index);
    }

    /// Tells consumers and exports that an instance's outputs are known now.
    fn announce(&mut self, index: NodeIndex) {
        for consumer in self.slots.consumers(index) {
            let slot = &mut self.slots[consumer];
            slot.unknown_inputs -= 1;
            if slot.unknown_inputs == 0 {
                self.resolvable.push_back(consumer);
            }
        }
        for rule in self.rules_of(index) {
            self.plan_export(rule);
        }
    }

    fn rules_of(&self, index: NodeIndex) -> Vec<usize> {
        let rules = self.context.graph.outputs.iter().enumerate();
        rules.filter(|it| it.1.from.instance == index).map(|it| it.0).collect()
    }

    // ---- what has to run -----------------------------------------------------------------------

    /// An instance has to run: it waits for its inputs' values, or for another with the same key.
    fn start_work(&mut self, index: NodeIndex) {
        let key = self.key_digest(index);
        match self.in_flight.get(&key) {
            Some(&leader) if leader != index => {
                self.slots[index].work = Work::Waiting;
                self.slots[leader].followers.push(index);
            }
            _ => {
                self.in_flight.insert(key, index);
                self.prepare(index);
            }
        }
    }

    fn key_digest(&self, index: NodeIndex) -> Digest {
        self.slots[index].key.as_ref().expect("what runs has a key").0
    }

    /// Queues an instance if all its inputs can be had, and otherwise has them made again.
    fn prepare(&mut self, index: NodeIndex) {
        if !self.slots[index].reads {
            self.slots[index].reads = true;
            for producer in self.slots.producers(index) {
                self.slots[producer].readers += 1;
            }
        }
        self.slots[index].work = Work::Waiting;
        let mut missing: Vec<NodeIndex> = Vec::new();
        for from in self.input_refs(index) {
            if !missing.contains(&from.instance) && !self.can_have(from) {
                missing.push(from.instance);
                self.revive(from);
            }
        }
        for &producer in &missing {
            self.slots[producer].wakes.push(index);
        }
        self.slots[index].missing_inputs = missing.len();
        if missing.is_empty() {
            self.queue(index);
        }
    }

    fn queue(&mut self, index: NodeIndex) {
        if self.priorities.is_empty() {
            let micros: Vec<u64> = self
                .context
                .graph
                .instances
                .node_indices()
                .map(|it| self.usual_micros(it))
                .collect();
            self.priorities = remaining_paths(self.context.graph, &self.order, &micros);
        }
        self.slots[index].work = Work::Ready;
        self.ready.push(index, self.priorities[index.index()]);
    }

    /// How long an instance took when it ran last; a millisecond if it never did.
    fn usual_micros(&self, index: NodeIndex) -> u64 {
        let id = self.context.graph.instances[index].id();
        let entry = self.memory.last_key(&id).and_then(|it| self.memory.entry(&it));
        entry.map_or(1000, |it| (it.wall_secs * 1e6) as u64)
    }

    fn input_refs(&self, index: NodeIndex) -> Vec<PortRef> {
        self.context.graph.instances[index].inputs.values().flatten().copied().collect()
    }

    /// Whether a value is in memory or in the store, or was left out and never will be.
    fn can_have(&self, from: PortRef) -> bool {
        let slot = &self.slots[from.instance];
        if slot.work != Work::Idle {
            return false;
        }
        let info = slot.outputs.as_ref().and_then(|it| it.artifacts.get(from.port));
        let Some(info) = info else { return true };
        slot.live.contains_key(from.port)
            || slot.stored && self.context.store.has_object(&info.digest)
    }

    /// A known result whose value was lost is made again.
    fn revive(&mut self, from: PortRef) {
        if self.slots[from.instance].work == Work::Idle {
            self.slots[from.instance].reason = Reason::Evicted { port: from.port };
            self.start_work(from.instance);
        }
    }

    // ---- starting ------------------------------------------------------------------------------

    /// Starts what is ready, as far as threads and memory allow.
    fn dispatch<'scope>(&mut self, scope: &'scope Scope<'scope, '_>, context: Context<'a>)
    where
        'a: 'scope,
    {
        self.resolve();
        while !self.stopping && self.free_threads > 0 {
            let job = match self.ready_exports.pop_front() {
                Some(rule) => self.export_job(rule),
                None => self.next_run(),
            };
            let Some(job) = job else { break };
            self.send(job, scope, context);
        }
    }

    fn send<'scope>(&mut self, job: Job, scope: &'scope Scope<'scope, '_>, context: Context<'a>)
    where
        'a: 'scope,
    {
        let store = self.context.store;
        let queues = self.queues.get_or_insert_with(|| Queues::start(scope, store));
        queues.n_jobs += 1;
        if queues.n_workers < queues.n_jobs.min(context.options.threads.max(1)) {
            queues.n_workers += 1;
            let (jobs, messages) = (queues.job_queue.clone(), queues.messages.clone());
            scope.spawn(move || worker::work(&context, &jobs, &messages));
        }
        queues.jobs.send(job).expect("workers live as long as the run");
    }

    /// The next job to run a node, if one is ready, fits into memory, and can be claimed.
    fn next_run(&mut self) -> Option<Job> {
        while let Some(index) = self.ready.peek() {
            if self.running > 0 && !self.fits(index) {
                return None;
            }
            self.ready.pop();
            if let Some(claim) = self.claim(index) {
                self.slots[index].claim = Some(claim);
                return Some(self.run_job(index));
            }
        }
        None
    }

    /// Whether an instance's inputs and (as far as is known) outputs fit into the memory budget.
    fn fits(&self, index: NodeIndex) -> bool {
        let to_load = self.input_refs(index).into_iter().filter_map(|from| {
            let slot = &self.slots[from.instance];
            let in_memory = slot.live.contains_key(from.port);
            let info = slot.outputs.as_ref()?.artifacts.get(from.port)?;
            (!in_memory).then_some(info.bytes)
        });
        self.live_bytes + to_load.sum::<u64>() <= self.context.options.memory
    }

    /// Claims a key, unless another process has it or has just stored its result.
    fn claim(&mut self, index: NodeIndex) -> Option<Claim> {
        let key = self.key_digest(index);
        let claim = match self.context.store.claim(&key) {
            Ok(claim) => claim,
            Err(error) => {
                tracing::warn!(%error, "works without claims");
                Some(Claim::none())
            }
        };
        let Some(claim) = claim else {
            self.slots[index].work = Work::Claimed;
            self.claimed.push(index);
            self.emit(&Event::Waiting { instance: index });
            return None;
        };
        if self.made_by_others(index, &key) { None } else { Some(claim) }
    }

    /// Takes over a result that another process has stored meanwhile.
    fn made_by_others(&mut self, index: NodeIndex, key: &Digest) -> bool {
        if let Err(error) = self.context.store.refresh() {
            tracing::warn!(%error, "cannot see what other processes store");
            return false;
        }
        let wanted_again =
            matches!(self.slots[index].reason, Reason::Evicted { .. } | Reason::Forced);
        let Some(outputs) = self.stored_outputs(index, key).filter(|_| !wanted_again) else {
            return false;
        };
        self.in_flight.remove(key);
        let followers = std::mem::take(&mut self.slots[index].followers);
        for instance in followers.into_iter().chain([index]) {
            self.found(instance, outputs.clone(), Outcome::Shared);
        }
        self.resolve();
        true
    }

    fn run_job(&mut self, index: NodeIndex) -> Job {
        let instance = &self.context.graph.instances[index];
        let inputs = instance
            .inputs
            .iter()
            .map(|(&port, sources)| {
                (port, sources.iter().filter_map(|&from| self.value(from)).collect::<Vec<_>>())
            })
            .collect();
        let others = self.ready.len() + self.ready_exports.len();
        let threads = (self.free_threads / (1 + others)).max(1);
        let pool = (threads > 1).then(|| self.take_pool(threads));
        self.free_threads -= threads;
        self.running += 1;
        let slot = &mut self.slots[index];
        slot.work = Work::Running;
        slot.threads = threads;
        slot.started = Some(Instant::now());
        let reason = slot.reason.clone();
        self.emit(&Event::Started { instance: index, threads, reason: &reason });
        Job::Run { instance: index, inputs, pool }
    }

    fn take_pool(&mut self, threads: usize) -> Arc<ThreadPool> {
        let free = self.pools.entry(threads).or_default();
        match free.iter().position(|it| Arc::strong_count(it) == 1) {
            Some(index) => Arc::clone(&free[index]),
            None => {
                let pool = Arc::new(worker::pool(threads));
                free.push(Arc::clone(&pool));
                pool
            }
        }
    }

    /// Where a job finds a value; `None` for an optional output that was left out.
    fn value(&self, from: PortRef) -> Option<Value> {
        let slot = &self.slots[from.instance];
        let info = slot.outputs.as_ref()?.artifacts.get(from.port)?;
        if let Some(artifact) = slot.live.get(from.port) {
            return Some(Value::Live(artifact.clone()));
        }
        let outputs = self.context.graph.instances[from.instance].kind.spec.outputs;
        let ty = outputs.iter().find(|it| it.name == from.port)?.ty;
        Some(Value::Stored { from, ty, digest: info.digest })
    }

    // ---- what comes back -----------------------------------------------------------------------

    /// Waits for the next thing to happen; false when nothing more will.
    fn wait(&mut self) -> bool {
        if !self.resolvable.is_empty() {
            return true;
        }
        let busy = self.queues.as_ref().is_some_and(|it| it.n_jobs > 0);
        if !busy && self.claimed.is_empty() {
            return false;
        }
        if self.stopping && !busy {
            return false;
        }
        let message = match &self.queues {
            Some(queues) if self.claimed.is_empty() => {
                Some(queues.message_queue.recv().expect("the run holds a sender"))
            }
            Some(queues) => match queues.message_queue.recv_timeout(CLAIM_POLL) {
                Ok(message) => Some(message),
                Err(RecvTimeoutError::Timeout) => None,
                Err(RecvTimeoutError::Disconnected) => unreachable!("the run holds a sender"),
            },
            None => {
                thread::sleep(CLAIM_POLL);
                None
            }
        };
        match message {
            Some(message) => self.receive(message),
            None => self.poll_claims(),
        }
        true
    }

    /// Puts instances that other processes compute back into the queue, to be claimed again.
    fn poll_claims(&mut self) {
        for index in std::mem::take(&mut self.claimed) {
            self.queue(index);
        }
    }

    fn receive(&mut self, message: Message) {
        match message {
            Message::Progress { instance, fraction, text } => {
                self.emit(&Event::Progress { instance, fraction, text: &text });
            }
            Message::Ran { instance, loaded, result } => {
                self.job_ended(self.slots[instance].threads);
                self.running -= 1;
                self.keep_loaded(loaded);
                self.node_ended(instance, result);
            }
            Message::Exported { rule, loaded, result } => {
                self.job_ended(1);
                self.keep_loaded(loaded);
                self.export_ended(rule, result);
            }
            Message::Stored { instances } => {
                for index in instances {
                    self.slots[index].stored = true;
                }
                self.relieve_memory();
            }
            Message::StoreFailed { error } => {
                self.store_error = Some(error);
                self.stopping = true;
            }
        }
    }

    fn job_ended(&mut self, threads: usize) {
        self.free_threads += threads;
        if let Some(queues) = &mut self.queues {
            queues.n_jobs -= 1;
        }
    }

    /// Keeps what a job has read for others that will need it.
    fn keep_loaded(&mut self, loaded: Loaded) {
        for (from, artifact) in loaded {
            let slot = &mut self.slots[from.instance];
            let info = slot.outputs.as_ref().and_then(|it| it.artifacts.get(from.port));
            let is_current = info.is_some_and(|it| it.digest == artifact.digest());
            if slot.readers > 1 && is_current && !slot.live.contains_key(from.port) {
                self.live_bytes += info.map_or(0, |it| it.bytes);
                slot.live.insert(from.port, artifact);
            }
        }
        self.relieve_memory();
    }

    fn node_ended(&mut self, index: NodeIndex, result: JobResult) {
        self.slots[index].work = Work::Idle;
        match result {
            JobResult::Ran { outputs, wall } => self.ran(index, outputs, wall),
            JobResult::Failed { failure, wall } => {
                let key = self.key_digest(index);
                self.in_flight.remove(&key);
                self.slots[index].claim = None;
                for follower in std::mem::take(&mut self.slots[index].followers) {
                    self.fail(follower, failure.clone(), wall);
                }
                self.fail(index, failure, wall);
            }
            JobResult::Lost { from, error } => {
                tracing::warn!(%error, "an input is made again");
                self.slots[index].claim = None;
                self.slots[from.instance].stored = false;
                self.prepare(index);
            }
            JobResult::Exported(_) => unreachable!("a node's job exports nothing"),
        }
    }

    fn ran(&mut self, index: NodeIndex, result: NodeOutputs, wall: Duration) {
        let NodeOutputs { artifacts, absent, notes } = result;
        let mut outputs = Outputs { artifacts: BTreeMap::new(), absent };
        let (mut live, mut objects) = (BTreeMap::new(), Vec::new());
        for (port, (artifact, bytes)) in artifacts {
            let info = OutputInfo { digest: artifact.digest(), bytes: bytes.len() as u64 };
            outputs.artifacts.insert(port, info);
            objects.push((artifact.digest(), bytes));
            live.insert(port, artifact);
        }
        let key = self.key_digest(index);
        self.in_flight.remove(&key);
        self.store_result(index, &outputs, &live, objects, wall, &notes);
        let followers = std::mem::take(&mut self.slots[index].followers);
        for &instance in followers.iter().chain([&index]) {
            self.keep_live(instance, &outputs, &live);
        }
        let reason = self.slots[index].reason.clone();
        self.made(index, &outputs, Outcome::Ran { wall, reason, notes });
        for follower in followers {
            self.slots[follower].work = Work::Idle;
            self.made(follower, &outputs, Outcome::Shared);
        }
        self.relieve_memory();
    }

    fn keep_live(
        &mut self,
        index: NodeIndex,
        outputs: &Outputs,
        live: &BTreeMap<&'static str, AnyArtifact>,
    ) {
        if self.slots[index].readers > 0 {
            self.live_bytes += outputs.artifacts.values().map(|it| it.bytes).sum::<u64>();
            self.slots[index].live = live.clone();
        }
    }

    /// Hands a result to the writer; with a store that is only read, it stays in memory.
    fn store_result(
        &mut self,
        index: NodeIndex,
        outputs: &Outputs,
        live: &BTreeMap<&'static str, AnyArtifact>,
        objects: Vec<(Digest, Vec<u8>)>,
        wall: Duration,
        notes: &[String],
    ) {
        let claim = self.slots[index].claim.take().unwrap_or_else(Claim::none);
        if self.context.store.access() == Access::ReadOnly {
            return;
        }
        let (key, text) = self.slots[index].key.as_ref().expect("what ran has a key");
        let list = outputs.artifacts.iter().map(|(port, info)| EntryOutput {
            port: (*port).to_owned(),
            ty: live[port].ty().name.to_owned(),
            digest: info.digest,
            bytes: info.bytes,
        });
        let entry = Entry {
            key: text.text(),
            outputs: list.collect(),
            absent: outputs.absent.iter().map(|(k, v)| ((*k).to_owned(), v.clone())).collect(),
            notes: notes.to_vec(),
            wall_secs: wall.as_secs_f64(),
            made: now_secs(),
            run: self.context.options.run_id.clone(),
        };
        let write = Write { instance: index, entry: NewEntry { key: *key, entry, objects }, claim };
        let queues = self.queues.as_ref().expect("what ran had a queue");
        queues.writes.send(write).expect("the writer lives as long as the run");
    }

    /// An instance's outputs were made in this run.
    fn made(&mut self, index: NodeIndex, outputs: &Outputs, outcome: Outcome) {
        let before = self.slots[index].outputs.replace(outputs.clone());
        self.end(index, outcome);
        let wakes = std::mem::take(&mut self.slots[index].wakes);
        let exports = std::mem::take(&mut self.slots[index].waiting_exports);
        match before {
            None => self.announce(index),
            Some(before) if before != *outputs => {
                let id = self.context.graph.instances[index].id();
                tracing::warn!(instance = id, "gave other bytes than before from the same key");
            }
            Some(_) => {}
        }
        self.ready_exports.extend(exports);
        for consumer in wakes {
            // It may have been skipped meanwhile, because another of its inputs failed.
            if self.slots[consumer].work != Work::Waiting {
                continue;
            }
            self.slots[consumer].missing_inputs -= 1;
            if self.slots[consumer].missing_inputs == 0 {
                self.prepare(consumer);
            }
        }
    }

    // ---- ends ----------------------------------------------------------------------------------

    fn end(&mut self, index: NodeIndex, outcome: Outcome) {
        let slot = &self.slots[index];
        let (key, outputs) = (slot.key.as_ref().map(|it| it.0), slot.outputs.as_ref());
        let event = Event::Finished { instance: index, outcome: &outcome, key, outputs };
        self.observer.event(self.context.graph, &event);
        self.slots[index].outcome = Some(outcome);
        self.release_inputs(index);
    }

    /// An instance will not read its inputs (again): the last reader's leaving drops them.
    fn release_inputs(&mut self, index: NodeIndex) {
        if std::mem::replace(&mut self.slots[index].reads, false) {
            for producer in self.slots.producers(index) {
                self.leave(producer);
            }
        }
    }

    fn leave(&mut self, producer: NodeIndex) {
        let slot = &mut self.slots[producer];
        slot.readers = slot.readers.saturating_sub(1);
        if slot.readers == 0 {
            self.live_bytes -= slot.live_bytes();
            slot.live.clear();
        }
    }

    /// Drops artifacts that are stored as long as memory is above the budget.
    fn relieve_memory(&mut self) {
        let budget = self.context.options.memory;
        if self.live_bytes <= budget {
            return;
        }
        for slot in self.slots.iter_mut().filter(|it| it.stored) {
            self.live_bytes -= slot.live_bytes();
            slot.live.clear();
            if self.live_bytes <= budget {
                return;
            }
        }
    }

    fn fail(&mut self, index: NodeIndex, failure: Failure, wall: Duration) {
        if self.context.options.fail_fast {
            self.stopping = true;
        }
        self.slots[index].work = Work::Idle;
        self.end(index, Outcome::Failed { failure, wall });
        let mut open = self.dependents(index);
        while let Some(consumer) = open.pop() {
            let is_open = match &self.slots[consumer].outcome {
                None => true,
                // Its value was to be made again for somebody.
                Some(_) => self.slots[consumer].work == Work::Waiting,
            };
            if is_open {
                self.slots[consumer].work = Work::Idle;
                self.end(consumer, Outcome::Skipped { because: index });
                open.extend(self.dependents(consumer));
            }
        }
    }

    /// Who cannot go on when an instance fails.
    fn dependents(&mut self, index: NodeIndex) -> Vec<NodeIndex> {
        for rule in std::mem::take(&mut self.slots[index].waiting_exports) {
            self.end_export(rule, ExportOutcome::Skipped);
        }
        let mut res = std::mem::take(&mut self.slots[index].wakes);
        res.extend(std::mem::take(&mut self.slots[index].followers));
        if self.slots[index].outputs.is_none() {
            res.extend(self.slots.consumers(index));
        }
        res
    }

    /// Waits for what still runs, closes the queues, and hears the writer out.
    fn finish(&mut self) {
        let Some(queues) = self.queues.take() else { return };
        let Queues { jobs, job_queue, writes, messages, message_queue, .. } = queues;
        drop((jobs, job_queue, writes, messages));
        for message in message_queue {
            if let Message::StoreFailed { error } = message {
                self.store_error = Some(error);
            }
        }
    }

    /// Keeps what the next run wants to know: the keys of now.
    fn remember(&mut self) {
        let mut notes = Vec::new();
        for index in self.context.graph.instances.node_indices() {
            let Some((key, _)) = &self.slots[index].key else { continue };
            let done = matches!(
                self.slots[index].outcome,
                Some(Outcome::Cached | Outcome::CutOff | Outcome::Shared | Outcome::Ran { .. })
            );
            let id = self.context.graph.instances[index].id();
            if done && self.memory.last_key(&id) != Some(*key) {
                notes.push((Note::LastKey, self.memory.subject(&id), key.0.to_vec()));
            }
        }
        for (rule, outcome) in self.exports.iter().enumerate() {
            if !matches!(outcome, Some(ExportOutcome::Written { .. })) {
                continue;
            }
            let path = self.output_path(rule);
            if let Some(info) = self.export_info(rule)
                && let Some(receipt) = export::receipt(info.digest, &path)
            {
                notes.push((Note::Exported, export::subject(&path), receipt));
            }
        }
        if self.store_error.is_none()
            && let Err(error) = self.context.store.remember(notes)
        {
            self.store_error = Some(error);
        }
    }

    // ---- exports -------------------------------------------------------------------------------

    fn output_path(&self, rule: usize) -> std::path::PathBuf {
        self.context.options.output_dir.join(&self.context.graph.outputs[rule].path)
    }

    fn export_info(&self, rule: usize) -> Option<OutputInfo> {
        let from = self.context.graph.outputs[rule].from;
        self.slots[from.instance].outputs.as_ref()?.artifacts.get(from.port).copied()
    }

    /// An output's artifact is known: is the file up to date, or what has to be done?
    fn plan_export(&mut self, rule: usize) {
        if self.exports[rule].is_some() {
            return;
        }
        let from = self.context.graph.outputs[rule].from;
        let Some(info) = self.export_info(rule) else {
            let why = self.slots[from.instance].outputs.as_ref();
            let why = why.and_then(|it| it.absent.get(from.port)).cloned().unwrap_or_default();
            let id = self.context.graph.instances[from.instance].id();
            let failure = Failure::Node(format!("`{id}` has no `{}`: {why}", from.port));
            return self.end_export(rule, ExportOutcome::Failed { failure });
        };
        let path = self.output_path(rule);
        let receipt = self.context.store.recall(Note::Exported, &export::subject(&path));
        if receipt.is_some() && receipt == export::receipt(info.digest, &path) {
            self.end_export(rule, ExportOutcome::UpToDate);
        } else if self.can_have(from) {
            self.ready_exports.push_back(rule);
        } else {
            self.revive(from);
            self.slots[from.instance].waiting_exports.push(rule);
        }
    }

    fn export_job(&mut self, rule: usize) -> Option<Job> {
        let from = self.context.graph.outputs[rule].from;
        let value = self.value(from).expect("an export is queued when its value can be had");
        self.free_threads -= 1;
        Some(Job::Export { rule, value, path: self.output_path(rule) })
    }

    fn export_ended(&mut self, rule: usize, result: JobResult) {
        match result {
            JobResult::Exported(outcome) => self.end_export(rule, outcome),
            JobResult::Lost { from, error } => {
                tracing::warn!(%error, "an output's artifact is made again");
                self.slots[from.instance].stored = false;
                self.plan_export(rule);
            }
            JobResult::Ran { .. } | JobResult::Failed { .. } => {
                unreachable!("an export's job runs no node")
            }
        }
    }

    fn end_export(&mut self, rule: usize, outcome: ExportOutcome) {
        self.emit(&Event::Exported { rule, outcome: &outcome });
        self.exports[rule] = Some(outcome);
        self.leave(self.context.graph.outputs[rule].from.instance);
    }
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
