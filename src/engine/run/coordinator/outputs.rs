//! Writes the files that the pipeline's outputs name.

use super::Coordinator;
use crate::engine::events::Event;
use crate::engine::events::ExportOutcome;
use crate::engine::events::Failure;
use crate::engine::plan::OutputInfo;
use crate::engine::run::export;
use crate::engine::run::worker::Job;
use crate::engine::run::worker::JobResult;
use crate::engine::store::Note;

impl<'a> Coordinator<'a> {
    pub(super) fn output_path(&self, rule: usize) -> std::path::PathBuf {
        self.context.options.output_dir.join(&self.context.graph.outputs[rule].path)
    }

    pub(super) fn export_info(&self, rule: usize) -> Option<OutputInfo> {
        let from = self.context.graph.outputs[rule].from;
        self.slots[from.instance].outputs.as_ref()?.artifacts.get(from.port).copied()
    }

    /// An output's artifact is known: is the file up to date, or what has to be done?
    pub(super) fn plan_export(&mut self, rule: usize) {
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
            // Another run may have finished the file that a killed one was writing.
            self.context.store.disk().sweep(&path);
            self.end_export(rule, ExportOutcome::UpToDate);
        } else if self.can_have(from) {
            self.ready_exports.push_back(rule);
        } else {
            self.revive(from);
            self.slots[from.instance].waiting_exports.push(rule);
        }
    }

    pub(super) fn export_job(&mut self, rule: usize) -> Option<Job> {
        let from = self.context.graph.outputs[rule].from;
        let value = self.value(from).expect("an export is queued when its value can be had");
        self.free_threads -= 1;
        Some(Job::Export { rule, value, path: self.output_path(rule) })
    }

    pub(super) fn export_ended(&mut self, rule: usize, result: JobResult) {
        match result {
            JobResult::Exported(outcome) => self.end_export(rule, outcome),
            JobResult::Lost { from, error } => {
                tracing::info!(%error, "an output's artifact is made again");
                self.tell_damage();
                self.slots[from.instance].stored = false;
                self.slots[from.instance].was_lost = true;
                self.plan_export(rule);
            }
            JobResult::Ran { .. } | JobResult::Failed { .. } | JobResult::Stopped => {
                unreachable!("an export's job runs no node")
            }
        }
    }

    pub(super) fn end_export(&mut self, rule: usize, outcome: ExportOutcome) {
        self.emit(&Event::Exported { rule, outcome: &outcome });
        self.exports[rule] = Some(outcome);
        self.leave(self.context.graph.outputs[rule].from.instance);
    }
}
