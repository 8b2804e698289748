//! What is ready to start, longest remaining path first.

use std::{cmp::Reverse, collections::BinaryHeap};

use petgraph::{Direction, graph::NodeIndex};

use crate::engine::graph::Graph;

/// Instances that wait for a free thread.
#[derive(Default)]
pub struct ReadyQueue {
    heap: BinaryHeap<(u64, Reverse<NodeIndex>)>,
}

impl ReadyQueue {
    /// `priority` as [`remaining_paths`] gives it.
    pub fn push(&mut self, instance: NodeIndex, priority: u64) {
        self.heap.push((priority, Reverse(instance)));
    }

    pub fn peek(&self) -> Option<NodeIndex> {
        self.heap.peek().map(|it| it.1.0)
    }

    pub fn pop(&mut self) -> Option<NodeIndex> {
        self.heap.pop().map(|it| it.1.0)
    }

    pub fn len(&self) -> usize {
        self.heap.len()
    }
}

/// For every instance, the time from its start to the end of the longest path from it, given how
/// long each took when it ran last (`micros`).
pub fn remaining_paths(graph: &Graph, order: &[NodeIndex], micros: &[u64]) -> Vec<u64> {
    let mut res = vec![0; order.len()];
    for &index in order.iter().rev() {
        let after = graph
            .instances
            .neighbors_directed(index, Direction::Outgoing)
            .map(|it| res[it.index()])
            .max()
            .unwrap_or(0);
        res[index.index()] = micros[index.index()] + after;
    }
    res
}
