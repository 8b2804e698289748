//! A graph as numbers and texts, in the order in which [`super::decode`] reads them.

use std::{path::Path, sync::Arc};

use super::bytes::Writer;
use crate::engine::{
    graph::{Graph, Instance, Place, PortRef},
    labels::Labels,
    node::{CheckedNode, Port},
    settings::NodeSettings,
};

/// Writes everything of a graph but its sources; `None` if a path is no text.
pub fn write(graph: &Graph, to: &mut Writer) -> Option<()> {
    to.flag(graph.title.is_some());
    to.text(graph.title.as_deref().unwrap_or_default());
    to.number(graph.cites.len());
    graph.cites.iter().for_each(|it| to.text(it));
    to.number(graph.instances.node_count());
    // First all nodes, since wires lead to instances further down as well.
    let mut before = None;
    for instance in graph.instances.node_weights() {
        write_node(instance, before, to);
        before = Some(instance);
    }
    for instance in graph.instances.node_weights() {
        write_item(graph, instance, to)?;
    }
    to.number(graph.outputs.len());
    for rule in &graph.outputs {
        write_path(&rule.path, to)?;
        write_ref(graph, rule.from, to)?;
        write_place(&rule.place, to);
    }
    Some(())
}

/// Whether two instances are one node at two items.
fn is_same_node(a: &Instance, b: &Instance) -> bool {
    Arc::ptr_eq(&a.name, &b.name)
        && Arc::ptr_eq(&a.field_places, &b.field_places)
        && std::ptr::eq(a.kind, b.kind)
}

/// Writes what an instance does not share with the one before.
fn write_node(instance: &Instance, before: Option<&Instance>, to: &mut Writer) {
    let is_same = before.is_some_and(|it| is_same_node(it, instance));
    to.flag(is_same);
    if !is_same {
        write_declaration(instance, to);
    }
    let has_same_params = before.is_some_and(|it| Arc::ptr_eq(&it.node, &instance.node));
    to.flag(has_same_params);
    if !has_same_params {
        write_params(&instance.node, to);
    }
}

fn write_declaration(instance: &Instance, to: &mut Writer) {
    to.text(&instance.name);
    to.name(instance.kind.spec.kind);
    to.flag(instance.shows_missing);
    write_settings(&instance.settings, to);
    write_place(&instance.place, to);
    to.number(instance.field_places.len());
    for (name, place) in instance.field_places.iter() {
        to.name(name);
        write_place(place, to);
    }
}

fn write_settings(settings: &NodeSettings, to: &mut Writer) {
    to.flag(*settings != NodeSettings::default());
    if *settings == NodeSettings::default() {
        return;
    }
    let NodeSettings { retries, backoff, timeout, isolate } = settings;
    to.number(*retries);
    for duration in [Some(*backoff), *timeout] {
        to.flag(duration.is_some());
        to.number(duration.map_or(0, |it| it.as_secs()));
        to.number(duration.map_or(0, |it| it.subsec_nanos()));
    }
    let memory = isolate.and_then(|it| it.memory);
    to.flag(isolate.is_some());
    to.flag(memory.is_some());
    to.number(memory.unwrap_or(0));
}

fn write_place(place: &Place, to: &mut Writer) {
    let span = place.span();
    to.number(place.source());
    to.number(span.start);
    to.number(span.end.saturating_sub(span.start));
}

fn write_item(graph: &Graph, instance: &Instance, to: &mut Writer) -> Option<()> {
    write_labels(&instance.labels, to);
    let ports = instance.kind.spec.inputs;
    to.number(instance.inputs.len());
    for (port, sources) in &instance.inputs {
        to.number(position(ports, port)?);
        to.number(sources.len());
        for from in sources {
            write_ref(graph, *from, to)?;
        }
    }
    to.number(instance.input_labels.len());
    for (port, labels) in &instance.input_labels {
        to.number(position(ports, port)?);
        to.number(labels.len());
        labels.iter().for_each(|it| write_labels(it, to));
    }
    to.number(instance.files.len());
    for (path, real_path) in &instance.files {
        write_path(path, to)?;
        write_path(real_path, to)?;
    }
    Some(())
}

fn write_params(node: &CheckedNode, to: &mut Writer) {
    let params = serde_json::to_string(&node.params()).expect("parameters are plain data");
    let is_same = params == node.key_params();
    to.text(&params);
    to.flag(is_same);
    if !is_same {
        to.text(node.key_params());
    }
    to.flag(node.question().is_some());
}

fn write_labels(labels: &Labels, to: &mut Writer) {
    to.number(labels.len());
    for (axis, item) in labels.iter() {
        to.name(axis);
        to.name(item);
    }
}

fn write_ref(graph: &Graph, from: PortRef, to: &mut Writer) -> Option<()> {
    to.number(from.instance.index());
    to.number(position(graph.instances[from.instance].kind.spec.outputs, from.port)?);
    Some(())
}

fn position(ports: &[Port], name: &str) -> Option<usize> {
    ports.iter().position(|it| it.name == name)
}

pub fn write_path(path: &Path, to: &mut Writer) -> Option<()> {
    to.text(path.to_str()?);
    Some(())
}
