//! Why a result is made, as data that can be kept: with places, and with who is to blame.
//!
//! A [`Why`] speaks of one instance and names the instances before it. Chains of causes are followed
//! from one to the next ([`root`], [`chain`]), in a plan or in a record alike.

use std::{
    cell::OnceCell,
    collections::{BTreeSet, HashMap},
};

use petgraph::graph::NodeIndex;
use serde::{Deserialize, Serialize};

use super::{
    graph::{Graph, Place},
    key::Difference,
    plan::{Memory, Plan, Reason, Status},
};

/// Why a result is made.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "reason", rename_all = "snake_case")]
pub enum Why {
    /// See [`Reason::New`]; so are the others.
    New,
    Changed {
        changes: Vec<Change>,
    },
    Replaced,
    Removed,
    Evicted {
        port: String,
    },
    Damaged {
        port: String,
    },
    Forced,
    /// What a later version of the program wrote.
    #[serde(other)]
    Unknown,
}

/// One thing that is not as it was.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Change {
    #[serde(flatten)]
    pub difference: Difference,
    /// Where its value is written: `pipeline.toml:21` or `--set k=60`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place: Option<String>,
    /// The instances that made a changed input, the first few of them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub from: Vec<String>,
}

/// A changed input names no more producers than this, and no longer list of digests.
const MAX_NAMED: usize = 8;

impl Why {
    pub fn of(graph: &Graph, index: NodeIndex, reason: &Reason, places: &Places) -> Self {
        match reason {
            Reason::New => Self::New,
            Reason::Changed(differences) => {
                let change = |it: &Difference| Change::of(graph, index, it, places);
                Self::Changed { changes: differences.iter().map(change).collect() }
            }
            Reason::Replaced => Self::Replaced,
            Reason::Removed => Self::Removed,
            Reason::Evicted { port } => Self::Evicted { port: (*port).to_owned() },
            Reason::Damaged { port } => Self::Damaged { port: (*port).to_owned() },
            Reason::Forced => Self::Forced,
        }
    }

    /// The changes that are no consequence of something before.
    fn own_changes(&self) -> impl Iterator<Item = &Change> {
        self.changes().iter().filter(|it| !it.is_input())
    }

    pub fn changes(&self) -> &[Change] {
        match self {
            Self::Changed { changes } => changes,
            _ => &[],
        }
    }
}

impl std::fmt::Display for Why {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::New => write!(f, "{}", Reason::New),
            Self::Changed { changes } => {
                let texts: Vec<String> = changes.iter().map(ToString::to_string).collect();
                f.write_str(&texts.join(", "))
            }
            Self::Replaced => write!(f, "{}", Reason::Replaced),
            Self::Removed => write!(f, "{}", Reason::Removed),
            Self::Evicted { port } => write!(f, "`{port}` is no longer in the store"),
            Self::Damaged { port } => write!(f, "`{port}` was damaged in the store"),
            Self::Forced => write!(f, "{}", Reason::Forced),
            Self::Unknown => f.write_str("a reason that this version does not know"),
        }
    }
}

impl Change {
    fn of(graph: &Graph, index: NodeIndex, difference: &Difference, places: &Places) -> Self {
        let instance = &graph.instances[index];
        let (group, field) = difference.what.split_once('.').unwrap_or(("", &difference.what));
        // Versions and the class of processors are written nowhere in the pipeline.
        let place = (!group.is_empty())
            .then(|| instance.field_place(field).unwrap_or(&instance.place))
            .map(|it| places.show(graph, it));
        let mut difference = difference.clone();
        let mut from = Vec::new();
        if let Some(port) = difference.what.strip_prefix("inputs.") {
            let old: Vec<&str> = difference.old.split(' ').collect();
            let is_new = |position: usize, it: &str| match old.get(position) {
                Some(old_at) => *old_at != it,
                None => true,
            };
            let new: Vec<&str> = difference.new.split(' ').collect();
            let sources = instance.inputs.get(port).map_or(&[][..], Vec::as_slice);
            for (position, (source, digest)) in sources.iter().zip(&new).enumerate() {
                let id = || graph.instances[source.instance].id();
                if is_new(position, digest) && from.len() < MAX_NAMED && !from.contains(&id()) {
                    from.push(id());
                }
            }
            (difference.old, difference.new) = (shortened(&old), shortened(&new));
        }
        Self { difference, place, from }
    }

    fn is_input(&self) -> bool {
        self.difference.what.starts_with("inputs.")
    }
}

fn shortened(digests: &[&str]) -> String {
    let text = digests[..digests.len().min(MAX_NAMED)].join(" ");
    match digests.len().saturating_sub(MAX_NAMED) {
        0 => text,
        n_more => format!("{text} and {n_more} more"),
    }
}

impl std::fmt::Display for Change {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &self.place {
            Some(place) if !self.is_input() => write!(f, "{} ({place})", self.difference),
            _ => write!(f, "{}", self.difference),
        }
    }
}

/// What became of an instance that others depend on, as far as their causes go.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Standing {
    /// It runs or ran.
    Runs(Why),
    /// It is stored, but not under the key that it had last.
    Switched(Why),
    /// It is as it was.
    Same,
}

impl Standing {
    fn why(&self) -> Option<&Why> {
        match self {
            Self::Runs(why) | Self::Switched(why) => Some(why),
            Self::Same => None,
        }
    }
}

/// The text of a reason with the first cause of a changed input behind it:
/// ``input `basis` changed because of `eigs`: `k`: 60 -> 120 (pipeline.toml:21)``.
pub fn headline(why: &Why, look_up: &dyn Fn(&str) -> Option<Standing>) -> String {
    let mut texts: Vec<String> = why.own_changes().map(ToString::to_string).collect();
    for change in why.changes().iter().filter(|it| it.is_input()) {
        let because = match root(change, look_up) {
            Some((id, why)) => format!(" because of `{id}`: {why}"),
            None => String::new(),
        };
        texts.push(format!("{change}{because}"));
    }
    if texts.is_empty() { why.to_string() } else { texts.join(", ") }
}

/// The instance at the beginning of a chain of changed inputs, and its own reason.
fn root(change: &Change, look_up: &dyn Fn(&str) -> Option<Standing>) -> Option<(String, String)> {
    let mut seen = BTreeSet::new();
    let mut open: Vec<String> = change.from.iter().rev().cloned().collect();
    while let Some(id) = open.pop() {
        if !seen.insert(id.clone()) {
            continue;
        }
        let Some(standing) = look_up(&id) else { continue };
        let Some(why) = standing.why() else { continue };
        let own: Vec<String> = why.own_changes().map(ToString::to_string).collect();
        if !own.is_empty() {
            return Some((id, own.join(", ")));
        }
        if why.changes().is_empty() {
            return Some((id, why.to_string()));
        }
        let before = why.changes().iter().flat_map(|it| &it.from);
        open.extend(before.cloned());
    }
    None
}

/// One line of a chain of causes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Step {
    pub depth: usize,
    pub text: String,
}

/// No chain is told in more lines.
const MAX_STEPS: usize = 40;

/// All causes of a reason, each consequence above what it comes from. What was told is not told
/// again, and producers that run for the same reason share a line.
pub fn chain(why: &Why, tense: Tense, look_up: &dyn Fn(&str) -> Option<Standing>) -> Vec<Step> {
    let mut teller = Teller { tense, look_up, told: BTreeSet::new(), steps: Vec::new() };
    teller.tell(why, 0);
    teller.steps
}

/// Whether something is still to happen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tense {
    Would,
    Did,
}

struct Teller<'a> {
    tense: Tense,
    look_up: &'a dyn Fn(&str) -> Option<Standing>,
    told: BTreeSet<String>,
    steps: Vec<Step>,
}

impl Teller<'_> {
    fn tell(&mut self, why: &Why, depth: usize) {
        if why.changes().is_empty() {
            return self.step(depth, why.to_string());
        }
        for change in why.changes() {
            if !change.is_input() {
                self.step(depth, change.to_string());
                continue;
            }
            let place = change.place.as_ref().map(|it| format!(" ({it})")).unwrap_or_default();
            self.step(depth, format!("{}{place}", change.difference));
            self.tell_producers(change, depth + 1);
        }
    }

    fn tell_producers(&mut self, change: &Change, depth: usize) {
        let mut groups: Vec<(Standing, Vec<&String>)> = Vec::new();
        for id in &change.from {
            let Some(standing) = (self.look_up)(id) else { continue };
            match groups.iter_mut().find(|it| it.0 == standing) {
                Some(group) => group.1.push(id),
                None => groups.push((standing, vec![id])),
            }
        }
        for (standing, ids) in groups {
            let names = name_some(&ids);
            let verb = match (&standing, self.tense) {
                (Standing::Runs(_), Tense::Would) => "would run",
                (Standing::Runs(_), Tense::Did) => "ran",
                (Standing::Switched(_), _) => "has another stored result than last time",
                (Standing::Same, _) => "is as it was: it is this wire that is new",
            };
            let is_new = ids.iter().any(|it| self.told.insert((*it).clone()));
            match standing.why() {
                Some(why) if is_new => {
                    self.step(depth, format!("{names} {verb}:"));
                    self.tell(why, depth + 1);
                }
                Some(_) => self.step(depth, format!("{names} {verb} (told above)")),
                None => self.step(depth, format!("{names} {verb}")),
            }
        }
    }

    fn step(&mut self, depth: usize, text: String) {
        match self.steps.len() {
            n if n < MAX_STEPS => self.steps.push(Step { depth, text }),
            MAX_STEPS => self.steps.push(Step { depth: 0, text: "… and so on".to_owned() }),
            _ => {}
        }
    }
}

/// `` `a` ``, `` `a` and `b` ``, or `` `a` and 7 more ``.
pub fn name_some(ids: &[impl AsRef<str>]) -> String {
    match ids {
        [] => String::new(),
        [only] => format!("`{}`", only.as_ref()),
        [first, second] => format!("`{}` and `{}`", first.as_ref(), second.as_ref()),
        [first, others @ ..] => format!("`{}` and {} more", first.as_ref(), others.len()),
    }
}

/// Causes in a plan.
pub struct PlanCauses<'a> {
    pub graph: &'a Graph,
    pub plan: &'a Plan,
    pub memory: &'a dyn Memory,
    pub places: Places,
    /// Made when a name is looked up first.
    by_id: OnceCell<HashMap<String, NodeIndex>>,
}

impl<'a> PlanCauses<'a> {
    pub fn new(graph: &'a Graph, plan: &'a Plan, memory: &'a dyn Memory) -> Self {
        Self { graph, plan, memory, places: Places::default(), by_id: OnceCell::new() }
    }

    /// Why an instance runs, with places.
    pub fn why(&self, index: NodeIndex, reason: &Reason) -> Why {
        Why::of(self.graph, index, reason, &self.places)
    }

    /// How an instance stands, by its name.
    pub fn standing(&self, id: &str) -> Option<Standing> {
        let ids = self.by_id.get_or_init(|| {
            let indices = self.graph.instances.node_indices();
            indices.map(|it| (self.graph.instances[it].id(), it)).collect()
        });
        let index = *ids.get(id)?;
        match &self.plan.statuses[index.index()] {
            Status::Run { reason, .. } => Some(Standing::Runs(self.why(index, reason))),
            Status::Cached { key } => {
                let full = self.plan.keys[index.index()].as_ref()?;
                Some(match Reason::of_miss(full, key, id, self.memory) {
                    Reason::Removed => Standing::Same,
                    other => Standing::Switched(self.why(index, &other)),
                })
            }
            Status::Follows { .. } | Status::Blocked(_) | Status::NotWanted => None,
        }
    }
}

/// The instances that run for certain, and because of which one that follows may have to.
pub fn roots(graph: &Graph, index: NodeIndex, plan: &Plan) -> Vec<NodeIndex> {
    let (mut seen, mut open, mut res) = (BTreeSet::new(), vec![index], BTreeSet::new());
    while let Some(at) = open.pop() {
        match plan.statuses[at.index()] {
            Status::Run { .. } => {
                res.insert(at);
            }
            Status::Follows { .. } if seen.insert(at) => {
                let sources = graph.instances[at].inputs.values().flatten();
                open.extend(sources.map(|it| it.instance));
            }
            _ => {}
        }
    }
    res.into_iter().collect()
}

/// Finds lines fast: a graph of ten thousand nodes asks for as many.
#[derive(Debug, Default)]
pub struct Places {
    /// By source: where its lines start.
    starts: OnceCell<Vec<Vec<usize>>>,
}

impl Places {
    /// `file:line` of a place; `--set k=60` for what the command line says.
    pub fn show(&self, graph: &Graph, place: &Place) -> String {
        let source = &graph.sources[place.source()];
        if source.is_setting() {
            return graph.show_place(place);
        }
        let starts = self.starts.get_or_init(|| {
            let starts = |text: &str| text.match_indices('\n').map(|it| it.0 + 1).collect();
            graph.sources.iter().map(|it| starts(&it.text)).collect()
        });
        let line = starts[place.source()].partition_point(|it| *it <= place.start()) + 1;
        format!("{}:{line}", source.path.display())
    }
}
