//! Drawings of a pipeline.

mod layout;
mod svg;

use std::{collections::BTreeMap, fmt::Write};

use petgraph::graph::NodeIndex;

use crate::engine::graph::{Graph, Instance, PortRef};

pub use svg::svg;

/// One line a node, sources before their readers, then the output files.
pub fn text(graph: &Graph) -> String {
    let order = crate::engine::plan::topological_order(graph);
    let name_width = order.iter().map(|&it| graph.instances[it].id().chars().count()).max();
    let kind_width = order.iter().map(|&it| graph.instances[it].kind.spec.kind.len()).max();
    let (name_width, kind_width) = (name_width.unwrap_or(0), kind_width.unwrap_or(0));
    let mut res = String::new();
    for index in order {
        let instance = &graph.instances[index];
        let kind = instance.kind.spec.kind;
        let wires: Vec<String> = wires(instance)
            .map(|(port, from)| format!("{port} ← {}", wire_text(graph, from)))
            .collect();
        let line =
            format!("{:name_width$}  {kind:kind_width$}  {}", instance.id(), wires.join(", "));
        let _ = writeln!(res, "{}", line.trim_end());
    }
    for output in &graph.outputs {
        let _ = writeln!(res, "{} ← {}", output.path.display(), wire_text(graph, output.from));
    }
    res
}

/// For Graphviz, inner pipelines as clusters.
pub fn dot(graph: &Graph) -> String {
    let mut res = "digraph pipeline {\n  node [shape=box, style=rounded];\n".to_owned();
    dot_group(&mut res, graph, &Group::of(graph), "  ");
    for (index, output) in graph.outputs.iter().enumerate() {
        let path = quoted(&output.path.display().to_string());
        let _ = writeln!(res, "  out{index} [shape=note, label={path}];");
    }
    for index in graph.instances.node_indices() {
        for (port, from) in wires(&graph.instances[index]) {
            let (from, to) = (from.instance.index(), index.index());
            let _ = writeln!(res, "  n{from} -> n{to} [label={}];", quoted(port));
        }
    }
    for (index, output) in graph.outputs.iter().enumerate() {
        let _ = writeln!(res, "  n{} -> out{index};", output.from.instance.index());
    }
    res + "}\n"
}

fn dot_group(res: &mut String, graph: &Graph, group: &Group, indent: &str) {
    for &index in &group.nodes {
        let label = quoted(&label(&graph.instances[index], "\n"));
        let _ = writeln!(res, "{indent}n{} [label={label}];", index.index());
    }
    for (name, inner) in &group.groups {
        let path = quoted(&format!("cluster_{}", inner.path));
        let _ = writeln!(res, "{indent}subgraph {path} {{\n{indent}  label={};", quoted(name));
        dot_group(res, graph, inner, &format!("{indent}  "));
        let _ = writeln!(res, "{indent}}}");
    }
}

/// For Markdown files, inner pipelines as subgraphs.
pub fn mermaid(graph: &Graph) -> String {
    let mut res = "flowchart TD\n".to_owned();
    mermaid_group(&mut res, graph, &Group::of(graph), "  ");
    for (index, output) in graph.outputs.iter().enumerate() {
        let _ = writeln!(res, "  out{index}>\"{}\"]", output.path.display());
    }
    for index in graph.instances.node_indices() {
        for (port, from) in wires(&graph.instances[index]) {
            let _ = writeln!(res, "  n{} -->|{port}| n{}", from.instance.index(), index.index());
        }
    }
    for (index, output) in graph.outputs.iter().enumerate() {
        let _ = writeln!(res, "  n{} --> out{index}", output.from.instance.index());
    }
    res
}

fn mermaid_group(res: &mut String, graph: &Graph, group: &Group, indent: &str) {
    for &index in &group.nodes {
        let label = label(&graph.instances[index], "<br>");
        let _ = writeln!(res, "{indent}n{}[\"{label}\"]", index.index());
    }
    for (name, inner) in &group.groups {
        let id = inner.path.replace('/', "_");
        let _ = writeln!(res, "{indent}subgraph g_{id}[\"{name}\"]");
        mermaid_group(res, graph, inner, &format!("{indent}  "));
        let _ = writeln!(res, "{indent}end");
    }
}

/// Nodes by the inner pipelines that they belong to.
#[derive(Default)]
struct Group {
    /// `outer/inner`; empty for the whole.
    path: String,
    nodes: Vec<NodeIndex>,
    groups: BTreeMap<String, Group>,
}

impl Group {
    fn of(graph: &Graph) -> Self {
        let mut res = Self::default();
        for index in graph.instances.node_indices() {
            let name = &graph.instances[index].name;
            let mut group = &mut res;
            for (end, _) in name.match_indices('/') {
                let path = &name[..end];
                let own_name = path.rsplit('/').next().unwrap_or(path).to_owned();
                group = group.groups.entry(own_name).or_default();
                group.path = path.to_owned();
            }
            group.nodes.push(index);
        }
        res
    }
}

/// The name within its pipeline and, where it differs, the kind.
fn label(instance: &Instance, separator: &str) -> String {
    let (name, kind) = (own_name(instance), instance.kind.spec.kind);
    if name == kind { name } else { format!("{name}{separator}{kind}") }
}

fn own_name(instance: &Instance) -> String {
    let id = instance.id();
    id[instance.name.rfind('/').map_or(0, |it| it + 1)..].to_owned()
}

/// Ports and where they come from, in the order of the kind's declaration.
fn wires(instance: &Instance) -> impl Iterator<Item = (&'static str, PortRef)> + '_ {
    instance.kind.spec.inputs.iter().flat_map(|port| {
        let sources = instance.inputs.get(port.name).into_iter().flatten();
        sources.map(|&from| (port.name, from))
    })
}

fn wire_text(graph: &Graph, from: PortRef) -> String {
    let instance = &graph.instances[from.instance];
    match instance.kind.spec.outputs.len() {
        1 => instance.id(),
        _ => format!("{}.{}", instance.id(), from.port),
    }
}

/// The text in quotes, as Graphviz reads it.
fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n"))
}
