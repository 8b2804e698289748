//! The instance graph: a pipeline after expansion and checking, ready to be planned.

use std::{borrow::Cow, collections::BTreeMap, ops::Range, path::PathBuf, sync::Arc};

use petgraph::graph::{DiGraph, NodeIndex};

use super::{
    digest::Digest,
    labels::{InputLabels, Labels},
    node::{CheckedNode, NodeKind},
    port_map::PortMap,
    settings::NodeSettings,
};

/// A pipeline whose every instance is checked.
///
/// An edge leads from the instance that makes an artifact to the one that reads it.
pub struct Graph {
    pub title: Option<String>,
    /// BibTeX keys that the pipeline names.
    pub cites: Vec<String>,
    pub instances: DiGraph<Instance, ()>,
    pub outputs: Vec<OutputRule>,
    /// Every pipeline file that was read; the first is the one that was asked for.
    pub sources: Vec<Source>,
    /// What was looked at to read it; `None` if it was not read but kept.
    pub looks: Option<Looks>,
}

/// All of the disk that a pipeline was read from, beside the files of its nodes.
#[derive(Debug, Clone, Default)]
pub struct Looks {
    /// A path that was followed, where it led, and which source was read there.
    pub texts: Vec<(PathBuf, PathBuf, usize)>,
    /// A pattern of files, and a digest of what it found.
    pub listings: Vec<(String, Digest)>,
}

/// By port: where its artifacts come from, in order.
pub type Inputs = PortMap<Vec<PortRef>>;

/// A node at one point of its axes.
pub struct Instance {
    /// The same for all instances of a node; `outer/inner` for a node of an inner pipeline.
    pub name: Arc<str>,
    pub labels: Labels,
    pub kind: &'static NodeKind,
    pub node: Arc<CheckedNode>,
    pub inputs: Inputs,
    pub input_labels: InputLabels,
    /// Inputs at labelled ports that failed are told to the node instead of stopping it.
    pub shows_missing: bool,
    /// From the paths of file parameters (and their side files) to real paths.
    pub files: BTreeMap<PathBuf, PathBuf>,
    /// How it is run; no part of its key.
    pub settings: NodeSettings,
    /// Where the node is declared.
    pub place: Place,
    /// Where its parameters and wires are written: for a `${}`, where its value is.
    pub field_places: Arc<[(Arc<str>, Place)]>,
}

/// One output of one instance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PortRef {
    pub instance: NodeIndex,
    pub port: &'static str,
}

/// A file that the user wants: `"out/rigged.glb" = "@rig"`.
pub struct OutputRule {
    /// Relative to the folder where the user runs; its extension chooses the format.
    pub path: PathBuf,
    pub from: PortRef,
    pub place: Place,
}

/// A file of a pipeline and its text.
#[derive(Debug, Clone)]
pub struct Source {
    /// As the user would write it.
    pub path: PathBuf,
    pub text: Arc<str>,
}

/// A range of bytes in one of the graph's sources.
///
/// In small numbers, as every value of a pipeline has one; nothing behind the fourth gigabyte of a file
/// is told apart.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    source: u32,
    start: u32,
    end: u32,
}

impl Place {
    pub fn new(source: usize, span: Range<usize>) -> Self {
        let small = |it: usize| u32::try_from(it).unwrap_or(u32::MAX);
        Self { source: small(source), start: small(span.start), end: small(span.end) }
    }

    /// Index into [`Graph::sources`].
    pub fn source(&self) -> usize {
        self.source as usize
    }

    pub fn start(&self) -> usize {
        self.start as usize
    }

    pub fn span(&self) -> Range<usize> {
        self.start as usize..self.end as usize
    }
}

/// The graph of instances whose inputs are known; they keep their order.
pub fn connect(instances: Vec<Instance>) -> DiGraph<Instance, ()> {
    let n_edges = instances.iter().flat_map(|it| it.inputs.values()).map(Vec::len).sum();
    let mut graph = DiGraph::with_capacity(instances.len(), n_edges);
    let mut edges = Vec::with_capacity(n_edges);
    for (index, instance) in instances.into_iter().enumerate() {
        let start = edges.len();
        edges.extend(
            instance.inputs.values().flatten().map(|it| (it.instance, NodeIndex::new(index))),
        );
        edges[start..].sort_unstable();
        graph.add_node(instance);
    }
    edges.dedup();
    for (from, to) in edges {
        graph.add_edge(from, to, ());
    }
    graph
}

impl Graph {
    /// The instances that a user names: `score` (at all its items), `score@wolf,40`, or
    /// `score@target=wolf` (at this item, whatever the others are).
    pub fn select(&self, id: &str) -> Vec<NodeIndex> {
        let (name, items) = id.split_once('@').map_or((id, None), |it| (it.0, Some(it.1)));
        let is_meant = |it: &NodeIndex| {
            let instance = &self.instances[*it];
            *instance.name == *name && items.is_none_or(|items| instance.is_at(items))
        };
        self.instances.node_indices().filter(is_meant).collect()
    }

    /// `file:line` of a place.
    pub fn show_place(&self, place: &Place) -> String {
        let source = &self.sources[place.source()];
        if source.is_setting() {
            return format!("{} {}", source.path.display(), source.text);
        }
        let line = source.text[..place.start()].matches('\n').count() + 1;
        format!("{}:{line}", source.path.display())
    }
}

impl Source {
    /// Whether it is no file but a `--set` of the command line.
    pub fn is_setting(&self) -> bool {
        self.path.as_os_str() == "--set"
    }
}

impl Instance {
    /// The name with the labels of its axes: `score@wolf,40`.
    pub fn id(&self) -> String {
        self.shown_id().into_owned()
    }

    /// The same, without a copy for what has no axes.
    pub fn shown_id(&self) -> Cow<'_, str> {
        if self.labels.is_empty() {
            return Cow::Borrowed(&self.name);
        }
        let items: Vec<&str> = self.labels.iter().map(|it| &*it.1).collect();
        Cow::Owned(format!("{}@{}", self.name, items.join(",")))
    }

    /// Whether it is at these items: all labels in order, or some of them, also as `axis=label`.
    fn is_at(&self, items: &str) -> bool {
        let all: Vec<&str> = self.labels.iter().map(|it| &*it.1).collect();
        let is_one = |it: &str| {
            let is_at = |(axis, label): (&str, &str)| {
                self.labels.iter().any(|it| *it.0 == *axis && *it.1 == *label)
            };
            all.contains(&it) || it.split_once('=').is_some_and(is_at)
        };
        all.join(",") == items || items.split(',').all(is_one)
    }

    /// Whether it runs in a process of its own: it shall, or has a time limit that only killing keeps.
    pub fn needs_process(&self) -> bool {
        let is_limited = self.settings.timeout.is_some() && !self.kind.handles_limits;
        self.settings.isolate.is_some() || is_limited
    }

    /// Where a parameter or a wire is written.
    pub fn field_place(&self, name: &str) -> Option<&Place> {
        self.field_places.iter().find(|it| *it.0 == *name).map(|it| &it.1)
    }
}
