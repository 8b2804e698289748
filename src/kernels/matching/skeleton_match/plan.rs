//! In which order the nodes of the smaller skeleton are matched.

use std::cmp::Reverse;
use std::collections::VecDeque;

use super::collapse::Collapsed;

/// A breadth-first order from the nodes of most branches: a new node hangs on one before it.
#[derive(Debug, Clone)]
pub struct Plan {
    pub order: Vec<u32>,
    /// The node before it that a node was reached from, and the branch; the first of a component has none.
    pub parent: Vec<Option<(u32, u32)>>,
    /// The nodes reached from a node, in order.
    pub children: Vec<Vec<u32>>,
    /// Branches to nodes before it in the order, without those to the parent: cycles. Loops are there once.
    pub back: Vec<Vec<(u32, u32)>>,
    /// All branches to the parent.
    pub to_parent: Vec<Vec<u32>>,
    /// Whether a node and all that was reached from it hang on the rest by one branch only.
    pub is_pendant: Vec<bool>,
}

/// Orders nodes: components by size, in each the first node is `start` if it lies there, or else the
/// one of most branches.
pub fn plan(collapsed: &Collapsed, start: Option<u32>) -> Plan {
    let n_nodes = collapsed.nodes.len();
    let mut plan = Plan {
        order: Vec::with_capacity(n_nodes),
        parent: vec![None; n_nodes],
        children: vec![Vec::new(); n_nodes],
        back: vec![Vec::new(); n_nodes],
        to_parent: vec![Vec::new(); n_nodes],
        is_pendant: vec![true; n_nodes],
    };
    let degree = |it: &u32| Reverse(collapsed.degree(*it as usize));
    for members in components(collapsed) {
        let start = start.filter(|it| members.contains(it));
        let first = start.or_else(|| members.iter().copied().min_by_key(|it| (degree(it), *it)));
        reach(collapsed, first.expect("a component has nodes"), &mut plan);
    }
    sort_branches(collapsed, &mut plan);
    plan
}

/// The nodes of every component, the one of most nodes first.
fn components(collapsed: &Collapsed) -> Vec<Vec<u32>> {
    let mut is_seen = vec![false; collapsed.nodes.len()];
    let mut components = Vec::new();
    for first in 0..collapsed.nodes.len() as u32 {
        if std::mem::replace(&mut is_seen[first as usize], true) {
            continue;
        }
        let mut members = vec![first];
        let mut index = 0;
        while let Some(&node) = members.get(index) {
            index += 1;
            for &(_, next) in &collapsed.incident[node as usize] {
                if !std::mem::replace(&mut is_seen[next as usize], true) {
                    members.push(next);
                }
            }
        }
        components.push(members);
    }
    components.sort_by_key(|it| Reverse(it.len()));
    components
}

fn reach(collapsed: &Collapsed, first: u32, plan: &mut Plan) {
    let mut queue = VecDeque::from([first]);
    let mut is_queued = vec![false; collapsed.nodes.len()];
    is_queued[first as usize] = true;
    while let Some(node) = queue.pop_front() {
        plan.order.push(node);
        let mut next: Vec<(u32, u32)> = collapsed.incident[node as usize].clone();
        next.sort_by_key(|it| (Reverse(collapsed.degree(it.1 as usize)), it.1, it.0));
        for (branch, child) in next {
            if !std::mem::replace(&mut is_queued[child as usize], true) {
                plan.parent[child as usize] = Some((node, branch));
                plan.children[node as usize].push(child);
                queue.push_back(child);
            }
        }
    }
}

/// Sorts branches into those to the parent and those that close cycles, and finds what is pendant.
fn sort_branches(collapsed: &Collapsed, plan: &mut Plan) {
    let mut place = vec![0; plan.order.len()];
    for (index, &node) in plan.order.iter().enumerate() {
        place[node as usize] = index;
    }
    for &node in &plan.order {
        let own = node as usize;
        let mut branches = collapsed.incident[own].clone();
        branches.sort_unstable();
        branches.dedup();
        let parent = plan.parent[own].map(|it| it.0);
        for (branch, other) in branches {
            if Some(other) == parent {
                plan.to_parent[own].push(branch);
            } else if place[other as usize] <= place[own] {
                plan.back[own].push((branch, other));
            }
        }
    }
    // A branch that closes a cycle ties all nodes on the ways up from its ends to where they meet.
    for &node in &plan.order {
        if plan.to_parent[node as usize].len() > 1 {
            plan.is_pendant[node as usize] = false;
        }
        for &(_, other) in &plan.back[node as usize].clone() {
            let (mut a, mut b) = (node, other);
            while a != b {
                let later = if place[a as usize] > place[b as usize] { &mut a } else { &mut b };
                plan.is_pendant[*later as usize] = false;
                *later = plan.parent[*later as usize].expect("one component has one start").0;
            }
        }
    }
}
