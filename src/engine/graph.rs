//! The instance graph: a pipeline after expansion and checking, ready to be planned.

use std::{
    collections::BTreeMap,
    ops::Range,
    path::{Path, PathBuf},
    sync::Arc,
};

use petgraph::graph::{DiGraph, NodeIndex};

use super::node::{AnyNode, NodeKind};

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
}

/// A node at one point of its axes.
pub struct Instance {
    /// Unique among the nodes of the graph; `outer/inner` for a node of an inner pipeline.
    pub name: String,
    /// (axis, item) pairs, for people; empty for a node without axes.
    pub labels: Vec<(String, String)>,
    pub kind: &'static NodeKind,
    pub node: Box<dyn AnyNode>,
    /// By port: where its artifacts come from, in order.
    pub inputs: BTreeMap<&'static str, Vec<PortRef>>,
    /// From the paths of file parameters (and their side files) to real paths.
    pub files: BTreeMap<PathBuf, PathBuf>,
    /// Where the node is declared.
    pub place: Place,
    /// Where its parameters and wires are written.
    pub field_places: BTreeMap<String, Place>,
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
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// Index into [`Graph::sources`].
    pub source: usize,
    pub span: Range<usize>,
}

impl Graph {
    /// The instance of this name (and labels, written `name@item,item`).
    pub fn find(&self, id: &str) -> Option<NodeIndex> {
        self.instances.node_indices().find(|&it| self.instances[it].id() == id)
    }

    /// `file:line` of a place.
    pub fn show_place(&self, place: &Place) -> String {
        let source = &self.sources[place.source];
        let line = source.text[..place.span.start].matches('\n').count() + 1;
        format!("{}:{line}", source.path.display())
    }
}

impl Instance {
    /// The name with the labels of its axes: `score@wolf,40`.
    pub fn id(&self) -> String {
        if self.labels.is_empty() {
            return self.name.clone();
        }
        let items: Vec<&str> = self.labels.iter().map(|it| it.1.as_str()).collect();
        format!("{}@{}", self.name, items.join(","))
    }

    /// The real path of a declared file.
    pub fn real_path(&self, path: &Path) -> Option<&Path> {
        self.files.get(path).map(PathBuf::as_path)
    }
}
