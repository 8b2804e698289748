//! Starts jobs, as far as threads, memory and claims allow.

use std::sync::Arc;
use std::thread::Scope;
use std::time::Instant;

use petgraph::graph::NodeIndex;
use rayon::ThreadPool;

use super::CLAIM_POLL;
use super::Coordinator;
use super::Queues;
use crate::engine::digest::Digest;
use crate::engine::events::Event;
use crate::engine::events::Outcome;
use crate::engine::graph::PortRef;
use crate::engine::plan::Reason;
use crate::engine::run::guard;
use crate::engine::run::slots::Work;
use crate::engine::run::timers::Timer;
use crate::engine::run::worker;
use crate::engine::run::worker::Context;
use crate::engine::run::worker::Job;
use crate::engine::run::worker::RunJob;
use crate::engine::run::worker::Value;
use crate::engine::store::Claim;

impl<'a> Coordinator<'a> {
    /// Starts what is ready, as far as threads and memory allow.
    pub(super) fn dispatch<'scope>(
        &mut self,
        scope: &'scope Scope<'scope, '_>,
        context: Context<'a>,
    ) where
        'a: 'scope,
    {
        self.resolve();
        while self.free_threads > 0 {
            // When the store refuses, what is there is still written for the user.
            let may_export = !self.stopping || self.store_error.is_some();
            let job = match self.ready_exports.front().copied().filter(|_| may_export) {
                Some(rule) => {
                    self.ready_exports.pop_front();
                    self.export_job(rule)
                }
                None if self.stopping => None,
                None => self.next_run(),
            };
            let Some(job) = job else {
                // A result that another process has stored may have brought exports.
                if may_export && !self.ready_exports.is_empty() {
                    continue;
                }
                break;
            };
            self.send(job, scope, context);
        }
    }

    pub(super) fn send<'scope>(
        &mut self,
        job: Job,
        scope: &'scope Scope<'scope, '_>,
        context: Context<'a>,
    ) where
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
            // One job at least goes on, whatever it needs, when there is nothing to wait for.
            if (self.running > 0 || self.pending_bytes > 0) && !self.fits(index) {
                return None;
            }
            self.ready.pop();
            // A further try still has its claim.
            if self.slots[index].claim.is_none() {
                let Some(claim) = self.claim(index) else { continue };
                self.slots[index].claim = Some(claim);
            }
            self.give_back_memory(index);
            return Some(self.run_job(index));
        }
        None
    }

    /// Claims a key, unless another process has it or has just stored its result.
    pub(super) fn claim(&mut self, index: NodeIndex) -> Option<Claim> {
        let key = self.key_digest(index);
        let claim = match self.context.store.claim(&key) {
            Ok(claim) => claim,
            Err(error) => {
                tracing::warn!(%error, "works without claims");
                Some(Claim::none())
            }
        };
        let Some(claim) = claim else {
            self.wait_for_claim(index);
            return None;
        };
        if self.made_by_others(index, &key) { None } else { Some(claim) }
    }

    /// Another process computes an instance's key.
    fn wait_for_claim(&mut self, index: NodeIndex) {
        if self.claimed.is_empty() {
            self.timers.start(CLAIM_POLL, Timer::PollClaims);
        }
        self.claimed.push(index);
        self.slots[index].work = Work::Claimed;
        if !std::mem::replace(&mut self.slots[index].told_claimed, true) {
            self.emit(&Event::Waiting { instance: index });
        }
    }

    /// Takes over a result that another process has stored meanwhile.
    fn made_by_others(&mut self, index: NodeIndex, key: &Digest) -> bool {
        if let Err(error) = self.context.store.refresh() {
            tracing::warn!(%error, "cannot see what other processes store");
            return false;
        }
        let wanted_again = matches!(
            self.slots[index].reason,
            Reason::Evicted { .. } | Reason::Damaged { .. } | Reason::Forced
        );
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
            .map(|(port, sources)| {
                let values =
                    sources.iter().filter_map(|&from| match &self.slots[from.instance].failed {
                        Some(why) if instance.shows_missing => Some(Err(Arc::clone(why))),
                        _ => self.value(from).map(Ok),
                    });
                (port, values.collect())
            })
            .collect();
        let others = self.ready.len() + self.ready_exports.len();
        let threads = (self.free_threads / (1 + others)).max(1);
        let needs_pool = threads > 1 && !instance.needs_process();
        let pool = needs_pool.then(|| self.take_pool(threads));
        let cancel = self.canceller.token();
        self.free_threads -= threads;
        self.running += 1;
        let needed = self.bytes_needed(index);
        self.reserved_bytes += needed;
        self.slots[index].reserved = needed;
        let slot = &mut self.slots[index];
        slot.work = Work::Running;
        slot.threads = threads;
        slot.started = Some(Instant::now());
        let reason = slot.reason.clone();
        self.emit(&Event::Started { instance: index, threads, reason: &reason });
        Job::Run(RunJob { instance: index, inputs, threads, pool, cancel })
    }

    fn take_pool(&mut self, threads: usize) -> Arc<ThreadPool> {
        let free = self.pools.entry(threads).or_default();
        match free.iter().position(|it| Arc::strong_count(it) == 1) {
            Some(index) => Arc::clone(&free[index]),
            None => {
                let pool = Arc::new(guard::pool(threads));
                free.push(Arc::clone(&pool));
                pool
            }
        }
    }

    /// Where a job finds a value; `None` for an optional output that was left out.
    pub(super) fn value(&self, from: PortRef) -> Option<Value> {
        let slot = &self.slots[from.instance];
        let info = slot.outputs.as_ref()?.artifacts.get(from.port)?;
        if let Some(artifact) = slot.live.get(from.port) {
            return Some(Value::Live(artifact.clone()));
        }
        let outputs = self.context.graph.instances[from.instance].kind.spec.outputs;
        let ty = outputs.iter().find(|it| it.name == from.port)?.ty;
        Some(Value::Stored { from, ty, digest: info.digest })
    }
}
