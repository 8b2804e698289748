//! The memory budget: what may start, what is dropped, what is given back to the system.

use petgraph::graph::NodeIndex;

use super::Coordinator;

/// Freed memory is given back to the system when it adds up to this part of the budget.
const GIVEN_BACK_PART: u64 = 16;

impl<'a> Coordinator<'a> {
    /// Whether an instance's inputs and outputs fit into the memory budget.
    pub(super) fn fits(&self, index: NodeIndex) -> bool {
        self.bytes_in_use() + self.bytes_needed(index) <= self.context.options.memory
    }

    fn bytes_in_use(&self) -> u64 {
        self.live_bytes + self.reserved_bytes + self.pending_bytes
    }

    /// What a job needs beside what is in memory: inputs that it reads, the largest of them twice
    /// (stored and decoded), and its outputs as values and as stored. How large these will be is
    /// guessed from others of its kind.
    pub(super) fn bytes_needed(&self, index: NodeIndex) -> u64 {
        let to_load = self.input_refs(index).into_iter().filter_map(|from| {
            let slot = &self.slots[from.instance];
            let in_memory = slot.live.contains_key(from.port);
            let info = slot.outputs.as_ref()?.artifacts.get(from.port)?;
            (!in_memory).then_some(info.bytes)
        });
        let (sum, largest) = to_load.fold((0, 0), |(sum, max), it| (sum + it, it.max(max)));
        let kind = self.context.graph.instances[index].kind.spec.kind;
        let outputs = self.largest_outputs.get(kind).copied().unwrap_or(0);
        sum + largest + 2 * outputs
    }

    /// Drops artifacts that are stored as long as memory is above the budget.
    pub(super) fn relieve_memory(&mut self) {
        let budget = self.context.options.memory;
        let others = self.bytes_in_use() - self.live_bytes;
        if self.live_bytes + others <= budget {
            return;
        }
        // What could not be read once stays in memory: it would be lost and made again for ever.
        for slot in self.slots.iter_mut().filter(|it| it.stored && !it.was_lost) {
            let dropped = slot.live_bytes();
            slot.live.clear();
            self.live_bytes -= dropped;
            self.freed_bytes += dropped;
            if self.live_bytes + others <= budget {
                return;
            }
        }
    }

    /// Gives memory that was freed back to the system before an instance starts that would bring the run
    /// near its budget. The allocator keeps freed blocks by thread, and one thread frees what another
    /// has allocated: without this, the process had up to 1.8 times the budget.
    pub(super) fn give_back_memory(&mut self, next: NodeIndex) {
        let budget = self.context.options.memory;
        let is_near = self.bytes_in_use() + self.bytes_needed(next) > budget / 2;
        if is_near && self.freed_bytes > budget / GIVEN_BACK_PART {
            self.freed_bytes = 0;
            trim();
        }
    }
}

#[cfg(target_env = "gnu")]
fn trim() {
    // SAFETY: a call into the allocator without arguments that could be wrong.
    unsafe {
        libc::malloc_trim(0);
    }
}

/// Other allocators of C libraries know no such call.
#[cfg(not(target_env = "gnu"))]
fn trim() {}
