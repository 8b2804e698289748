//! A graph from the numbers and texts that [`super::encode`] wrote.

use std::{collections::BTreeMap, path::PathBuf, sync::Arc, time::Duration};

use petgraph::graph::NodeIndex;

use super::bytes::Reader;
use crate::engine::{
    graph::{self, Graph, Inputs, Instance, OutputRule, Place, PortRef},
    labels::{InputLabels, Labels, no_labels},
    library::Library,
    node::{CheckedNode, NodeKind},
    pipeline,
    settings::{Isolation, NodeSettings},
};

/// Reads a graph without its sources; `None` if it is none of this library.
pub fn read(from: &mut Reader<'_>, library: &Library) -> Option<Graph> {
    let has_title = from.flag()?;
    let title = from.text()?.to_owned();
    let cites =
        (0..from.count()?).map(|_| from.text().map(str::to_owned)).collect::<Option<_>>()?;
    let n_instances = from.count()?;
    let mut reading = Reading { from, library, nodes: Vec::with_capacity(n_instances) };
    for _ in 0..n_instances {
        let node = reading.node()?;
        reading.nodes.push(node);
    }
    let mut instances: Vec<Instance> = Vec::with_capacity(n_instances);
    for index in 0..n_instances {
        instances.push(reading.item(index)?);
    }
    let outputs = (0..reading.from.count()?).map(|_| reading.output()).collect::<Option<_>>()?;
    Some(Graph {
        title: has_title.then_some(title),
        cites,
        instances: graph::connect(instances),
        outputs,
        sources: Vec::new(),
        looks: None,
    })
}

/// What is the same for all items of a node.
struct Declaration {
    name: Arc<str>,
    /// Of an open kind, without the ports that its parameters declare.
    kind: &'static NodeKind,
    shows_missing: bool,
    settings: NodeSettings,
    place: Place,
    field_places: Arc<[(Arc<str>, Place)]>,
}

fn read_declaration(from: &mut Reader<'_>, library: &Library) -> Option<Declaration> {
    let name = from.text()?.into();
    let kind_name = from.name()?;
    let shows_missing = from.flag()?;
    let settings = read_settings(from)?;
    let place = read_place(from)?;
    let n_fields = from.count()?;
    let mut field_places = Vec::with_capacity(n_fields);
    for _ in 0..n_fields {
        field_places.push((from.name()?, read_place(from)?));
    }
    let (kind, field_places) = (library.kind(&kind_name)?, field_places.into());
    Some(Declaration { name, kind, shows_missing, settings, place, field_places })
}

fn read_settings(from: &mut Reader<'_>) -> Option<NodeSettings> {
    if !from.flag()? {
        return Some(NodeSettings::default());
    }
    let retries = u32::try_from(from.number()?).ok()?;
    let mut duration = || {
        let is_given = from.flag()?;
        let (secs, nanos) = (from.number()? as u64, u32::try_from(from.number()?).ok()?);
        Some(is_given.then(|| Duration::new(secs, nanos)))
    };
    let (backoff, timeout) = (duration()??, duration()?);
    let (is_isolated, is_limited) = (from.flag()?, from.flag()?);
    let memory = from.number()? as u64;
    let isolation = Isolation { memory: is_limited.then_some(memory) };
    Some(NodeSettings { retries, backoff, timeout, isolate: is_isolated.then_some(isolation) })
}

fn read_place(from: &mut Reader<'_>) -> Option<Place> {
    let (source, start, length) = (from.number()?, from.number()?, from.number()?);
    Some(Place::new(source, start..start.checked_add(length)?))
}

struct Reading<'a, 'b> {
    from: &'a mut Reader<'b>,
    library: &'a Library,
    /// By instance.
    nodes: Vec<(Arc<Declaration>, Arc<CheckedNode>)>,
}

impl Reading<'_, '_> {
    fn node(&mut self) -> Option<(Arc<Declaration>, Arc<CheckedNode>)> {
        let declaration = match self.from.flag()? {
            true => Arc::clone(&self.nodes.last()?.0),
            false => Arc::new(read_declaration(self.from, self.library)?),
        };
        let node = match self.from.flag()? {
            true => Arc::clone(&self.nodes.last()?.1),
            false => Arc::new(self.params(declaration.kind)?),
        };
        Some((declaration, node))
    }

    fn item(&mut self, index: usize) -> Option<Instance> {
        let labels = self.labels()?;
        let (declaration, node) = &self.nodes[index];
        let (declaration, node) = (Arc::clone(declaration), Arc::clone(node));
        let kind = node.kind();
        let mut inputs = Inputs::new();
        for _ in 0..self.from.count()? {
            let port = kind.spec.inputs.get(self.from.number()?)?.name;
            let n_sources = self.from.count()?;
            let mut sources = Vec::with_capacity(n_sources);
            for _ in 0..n_sources {
                sources.push(self.port_ref()?);
            }
            inputs.insert(port, sources);
        }
        let mut input_labels = InputLabels::new();
        for _ in 0..self.from.count()? {
            let port = kind.spec.inputs.get(self.from.number()?)?.name;
            let n_labels = self.from.count()?;
            let labels = (0..n_labels).map(|_| self.labels()).collect::<Option<_>>()?;
            input_labels.insert(port, labels);
        }
        let mut files = BTreeMap::new();
        for _ in 0..self.from.count()? {
            let path = PathBuf::from(self.from.text()?);
            files.insert(path, PathBuf::from(self.from.text()?));
        }
        Some(Instance {
            name: Arc::clone(&declaration.name),
            labels,
            kind,
            node,
            inputs,
            input_labels,
            shows_missing: declaration.shows_missing,
            files,
            settings: declaration.settings.clone(),
            place: declaration.place.clone(),
            field_places: Arc::clone(&declaration.field_places),
        })
    }

    fn params(&mut self, kind: &'static NodeKind) -> Option<CheckedNode> {
        let params = self.from.shared_text()?;
        let key_params =
            if self.from.flag()? { params.clone() } else { self.from.shared_text()? };
        let asks = self.from.flag()?;
        let kind = match kind.open {
            true => {
                let declared = serde_json::from_str(&params).ok()?;
                pipeline::with_ports(kind, &declared, self.library)
            }
            false => kind,
        };
        Some(CheckedNode::of_params(kind, params, key_params, asks))
    }

    fn labels(&mut self) -> Option<Labels> {
        let n_labels = self.from.count()?;
        let mut labels = Vec::with_capacity(n_labels);
        for _ in 0..n_labels {
            labels.push((self.from.name()?, self.from.name()?));
        }
        Some(if labels.is_empty() { no_labels() } else { labels.into() })
    }

    fn port_ref(&mut self) -> Option<PortRef> {
        let instance = self.from.number()?;
        let outputs = self.nodes.get(instance)?.1.kind().spec.outputs;
        let port = outputs.get(self.from.number()?)?.name;
        Some(PortRef { instance: NodeIndex::new(instance), port })
    }

    fn output(&mut self) -> Option<OutputRule> {
        let path = PathBuf::from(self.from.text()?);
        Some(OutputRule { path, from: self.port_ref()?, place: read_place(self.from)? })
    }
}
