//! What tells one run from another: parameters, what ran, results. From their records and the store.

use std::collections::{BTreeMap, BTreeSet};

use super::{
    digest::Digest,
    key::{Difference, Key},
    record::{NodeDone, Record},
    store::Store,
};

/// Two runs side by side.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Comparison {
    /// Parameters, files and versions that differ.
    pub changes: Vec<GroupedChange>,
    /// Instances whose keys differ, but what one of them was made from is not stored (any more).
    pub unknown: Vec<String>,
    /// Instances that only one of the runs has.
    pub only_before: Vec<String>,
    pub only_after: Vec<String>,
    /// By node, in the order of the run before: all instances that both or one of the runs has.
    pub nodes: Vec<NodeCompared>,
    pub outputs: Vec<OutputCompared>,
}

/// A difference, and the instances of a node that share it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GroupedChange {
    pub node: String,
    pub difference: Difference,
    pub instances: Vec<String>,
}

/// How a node fared in two runs.
#[derive(Debug, Clone, PartialEq)]
pub struct NodeCompared {
    pub node: String,
    pub before: Fared,
    pub after: Fared,
}

/// How the instances of a node fared in a run.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Fared {
    /// How many ended in which way: `ran`, `cached` …
    pub counts: BTreeMap<String, usize>,
    /// The time of those that ran or failed.
    pub wall_s: f64,
}

/// One output of one instance that both runs know and that differs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OutputCompared {
    pub instance: String,
    pub port: String,
    pub before: Digest,
    pub after: Digest,
    /// The type of the artifact, if either run's result is still stored.
    pub ty: Option<String>,
}

/// Compares two runs.
pub fn compare(before: &Record, after: &Record, store: &Store) -> Comparison {
    let (old, new) = (ends(before), ends(after));
    let mut res = Comparison {
        only_before: names_not_in(&old, &new),
        only_after: names_not_in(&new, &old),
        nodes: nodes(before, after, &old, &new),
        ..Comparison::default()
    };
    let mut places: BTreeMap<(String, String, String, String), usize> = BTreeMap::new();
    for (id, was) in &old {
        let Some(is) = new.get(id) else { continue };
        res.outputs.extend(outputs(was, is, store));
        let (Some(old_key), Some(new_key)) = (was.key, is.key) else { continue };
        if old_key == new_key {
            continue;
        }
        let (Some(old_key), Some(new_key)) = (key(store, &old_key), key(store, &new_key)) else {
            res.unknown.push((*id).to_owned());
            continue;
        };
        for difference in new_key.differences(&old_key) {
            // Inputs differ as a consequence; `outputs` says which.
            if difference.what.starts_with("inputs.") {
                continue;
            }
            let Difference { what, old, new } = difference.clone();
            let node = node_of(id);
            let place = *places.entry((node.to_owned(), what, old, new)).or_insert_with(|| {
                let node = node.to_owned();
                res.changes.push(GroupedChange { node, difference, instances: Vec::new() });
                res.changes.len() - 1
            });
            res.changes[place].instances.push((*id).to_owned());
        }
    }
    res
}

/// The node of an instance: its name without the items of its axes.
pub fn node_of(id: &str) -> &str {
    id.split_once('@').map_or(id, |it| it.0)
}

/// How every instance ended; the last time counts if it ran twice.
fn ends(record: &Record) -> BTreeMap<&str, &NodeDone> {
    record.nodes().map(|it| (it.node.as_str(), it)).collect()
}

fn names_not_in(of: &BTreeMap<&str, &NodeDone>, others: &BTreeMap<&str, &NodeDone>) -> Vec<String> {
    of.keys().filter(|it| !others.contains_key(*it)).map(|it| (*it).to_owned()).collect()
}

fn key(store: &Store, digest: &Digest) -> Option<Key> {
    serde_json::from_str(&store.entry(digest)?.key).ok()
}

fn nodes(
    before: &Record,
    after: &Record,
    old: &BTreeMap<&str, &NodeDone>,
    new: &BTreeMap<&str, &NodeDone>,
) -> Vec<NodeCompared> {
    let mut seen = BTreeSet::new();
    let names = before.nodes().chain(after.nodes()).map(|it| node_of(&it.node));
    let order: Vec<&str> = names.filter(|it| seen.insert(*it)).collect();
    let (old, new) = (fared(old), fared(new));
    let of = |all: &BTreeMap<&str, Fared>, it: &str| all.get(it).cloned().unwrap_or_default();
    let compared = |it: &&str| NodeCompared {
        node: (*it).to_owned(),
        before: of(&old, it),
        after: of(&new, it),
    };
    order.iter().map(compared).collect()
}

fn fared<'a>(ends: &BTreeMap<&'a str, &NodeDone>) -> BTreeMap<&'a str, Fared> {
    let mut res: BTreeMap<&str, Fared> = BTreeMap::new();
    for (id, node) in ends {
        let of_node = res.entry(node_of(id)).or_default();
        *of_node.counts.entry(node.status.clone()).or_default() += 1;
        of_node.wall_s += node.wall_s.unwrap_or(0.0);
    }
    res
}

/// The outputs of an instance that differ between two runs.
fn outputs(was: &NodeDone, is: &NodeDone, store: &Store) -> Vec<OutputCompared> {
    let differing = was.out.iter().filter_map(|(port, old)| {
        let new = is.out.get(port)?;
        (old != new).then_some((port, *old, *new))
    });
    let compared = |(port, before, after): (&String, Digest, Digest)| {
        let type_of = |node: &NodeDone| {
            let entry = store.entry(&node.key?)?;
            entry.outputs.iter().find(|it| it.port == *port).map(|it| it.ty.clone())
        };
        OutputCompared {
            instance: was.node.clone(),
            port: port.clone(),
            before,
            after,
            ty: type_of(was).or_else(|| type_of(is)),
        }
    };
    differing.map(compared).collect()
}
