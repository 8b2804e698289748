//! `sinew show`: what is in an artifact.

use std::{borrow::Cow, collections::BTreeSet, fs, path::PathBuf};

use anstream::println;
use petgraph::graph::NodeIndex;

use super::{
    Exit, Failure, LIBRARY, Ui,
    common::{self, StoreArgs},
    pipeline_args::PipelineArgs,
    style,
};
use crate::engine::{
    artifact::{ArtifactKind, Decoder},
    clock::show_bytes,
    graph::Graph,
    node::extension_of,
    plan::{self, Outputs, Status},
    run::encode_artifact,
    store::Store,
    tensors::RawArray,
};

/// Summarize the artifacts of a node: shapes, ranges, first rows
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    pipeline: PipelineArgs,

    /// The node, or one of its outputs: NODE or NODE.PORT
    node: String,

    #[command(flatten)]
    store: StoreArgs,

    /// Rows of each array
    #[arg(long, default_value_t = 3, value_name = "N")]
    rows: usize,

    /// Writes the artifact to a file; the extension chooses the format
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

pub fn run(args: &Args, ui: &Ui) -> Result<Exit, Failure> {
    let graph = args.pipeline.load()?;
    let store = args.store.open_read_only()?;
    let (index, port) = find_port(&graph, &args.node)?;
    let outputs = stored_outputs(&graph, &store, index)?;
    let shown: Vec<&str> =
        outputs.artifacts.keys().filter(|it| port.is_none_or(|port| port == *it)).collect();
    if let Some(path) = &args.output {
        let [only] = shown[..] else {
            let list = shown.join("`, `");
            return Err(Failure::usage(format_args!("name one of the outputs: `{list}`")));
        };
        return export(&graph, &store, index, only, &outputs, path);
    }
    for name in shown {
        show(&graph, &store, index, name, &outputs, args.rows, ui)?;
    }
    for (name, why) in outputs.absent.iter().filter(|it| port.is_none_or(|port| port == *it.0)) {
        println!("{name}: none, {why}");
    }
    Ok(Exit::Success)
}

/// `NODE` or `NODE.PORT`.
fn find_port<'a>(graph: &Graph, text: &'a str) -> Result<(NodeIndex, Option<&'a str>), Failure> {
    if let [index] = graph.select(text)[..] {
        return Ok((index, None));
    }
    let (id, port) = split_port(text);
    let index = common::find(graph, &id)?;
    let ports = graph.instances[index].kind.spec.outputs;
    match port {
        Some(port) if ports.iter().all(|it| it.name != port) => {
            let list: Vec<&str> = ports.iter().map(|it| it.name).collect();
            let list = list.join("`, `");
            Err(Failure::usage(format_args!("`{id}` has no output `{port}`: it has `{list}`")))
        }
        port => Ok((index, port)),
    }
}

/// The port stands behind the name of the node, `basis.mass@shape=cat`, or behind the items, which may have
/// points of their own.
fn split_port(text: &str) -> (Cow<'_, str>, Option<&str>) {
    if let Some((name, items)) = text.split_once('@')
        && let Some((name, port)) = name.rsplit_once('.')
    {
        return (format!("{name}@{items}").into(), Some(port));
    }
    match text.rsplit_once('.') {
        Some((id, port)) => (id.into(), Some(port)),
        None => (text.into(), None),
    }
}

fn stored_outputs(graph: &Graph, store: &Store, index: NodeIndex) -> Result<Outputs, Failure> {
    let memory = common::memory(store, graph);
    let plan = plan::plan(graph, &[index], &BTreeSet::new(), &memory);
    let id = graph.instances[index].id();
    let key = match &plan.statuses[index.index()] {
        Status::Cached { key } | Status::Run { key, .. } => Some(*key),
        _ => None,
    };
    let instance = &graph.instances[index];
    let outputs = key.and_then(|key| store.outputs(&key, |it| Outputs::of_entry(instance, it)));
    outputs.ok_or_else(|| {
        Failure::usage(format_args!(
            "there is no result of `{id}` for these parameters\nhint: `sinew run` computes it"
        ))
    })
}

fn artifact_kind(graph: &Graph, index: NodeIndex, port: &str) -> &'static ArtifactKind {
    let ports = graph.instances[index].kind.spec.outputs;
    let ty = ports.iter().find(|it| it.name == port).expect("the port was looked up").ty;
    LIBRARY.artifact_kind(ty.name).expect("a checked pipeline has known types")
}

fn show(
    graph: &Graph,
    store: &Store,
    index: NodeIndex,
    port: &str,
    outputs: &Outputs,
    n_rows: usize,
    ui: &Ui,
) -> Result<(), Failure> {
    let kind = artifact_kind(graph, index, port);
    let info = outputs.artifacts[port];
    let bytes = store.object(kind.ty, &info.digest).map_err(Failure::environment)?;
    let artifact = kind.decode(&bytes, Some(info.digest)).map_err(Failure::environment)?;
    let decoder = Decoder::new(&bytes).map_err(Failure::environment)?;
    if ui.json {
        let arrays: serde_json::Map<_, _> = decoder
            .arrays()
            .map(|(name, it)| {
                (
                    name.to_owned(),
                    serde_json::json!({ "dtype": it.dtype.name(), "shape": it.shape }),
                )
            })
            .collect();
        let summary: serde_json::Map<_, _> =
            artifact.summary().into_iter().map(|(k, v)| (k, v.into())).collect();
        println!(
            "{}",
            serde_json::json!({
                "port": port, "type": kind.ty.name, "digest": info.digest, "bytes": info.bytes,
                "summary": summary, "arrays": arrays,
            })
        );
        return Ok(());
    }
    let (head, note) = (style::HEAD, style::NOTE);
    let (size, digest) = (show_bytes(info.bytes), info.digest.short());
    println!("{head}{port}{head:#}: {}  {size}  {note}{digest}{note:#}", kind.ty.name);
    let summary = artifact.summary();
    let width = summary.iter().map(|it| it.0.chars().count()).max().unwrap_or(0);
    for (name, value) in summary {
        println!("  {name:width$}  {value}");
    }
    for (name, array) in decoder.arrays() {
        show_array(name, array, n_rows);
    }
    println!();
    Ok(())
}

/// An array's shape and range, and its first rows.
fn show_array(name: &str, array: &RawArray<'_>, n_rows: usize) {
    let shape: Vec<String> = array.shape.iter().map(ToString::to_string).collect();
    let (mut low, mut high, mut n_bad) = (f64::INFINITY, f64::NEG_INFINITY, 0);
    for index in 0..array.len() {
        let value = array.number(index);
        if value.is_finite() {
            (low, high) = (low.min(value), high.max(value));
        } else {
            n_bad += 1;
        }
    }
    let range =
        if low <= high { format!("{} … {}", short(low), short(high)) } else { String::new() };
    let bad = if n_bad > 0 { format!("  {n_bad} not finite") } else { String::new() };
    let note = style::NOTE;
    println!(
        "  {note}{name}  {} [{}]  {range}{bad}{note:#}",
        array.dtype.name(),
        shape.join(" x ")
    );
    let n_columns = array.shape.get(1..).map_or(1, |it| it.iter().product::<usize>()).max(1);
    for row in 0..n_rows.min(array.shape.first().copied().unwrap_or(0)) {
        let shown = n_columns.min(8);
        let cells: Vec<String> = (0..shown)
            .map(|it| format!("{:>12}", short(array.number(row * n_columns + it))))
            .collect();
        println!("    {}{}", cells.join(" "), if n_columns > shown { "  …" } else { "" });
    }
}

/// Six significant digits at most.
fn short(value: f64) -> String {
    if value == value.trunc() && value.abs() < 1e9 {
        return format!("{value:.0}");
    }
    let magnitude = value.abs().log10().floor();
    if (-4.0..6.0).contains(&magnitude) {
        format!("{value:.*}", (5.0 - magnitude).max(0.0) as usize)
    } else {
        format!("{value:.5e}")
    }
}

fn export(
    graph: &Graph,
    store: &Store,
    index: NodeIndex,
    port: &str,
    outputs: &Outputs,
    path: &std::path::Path,
) -> Result<Exit, Failure> {
    let kind = artifact_kind(graph, index, port);
    let info = outputs.artifacts[port];
    let bytes = store.object(kind.ty, &info.digest).map_err(Failure::environment)?;
    let artifact = kind.decode(&bytes, Some(info.digest)).map_err(Failure::environment)?;
    let extension = extension_of(path);
    let formats = LIBRARY.formats(kind.ty);
    if formats.iter().all(|it| it.extension != extension) {
        let list: Vec<&str> = formats.iter().map(|it| it.extension).collect();
        let list = list.join(", .");
        let name = kind.ty.name;
        return Err(Failure::usage(format_args!(
            "`{name}` cannot be written as .{extension}: .{list} are possible"
        )));
    }
    let bytes = encode_artifact(&LIBRARY, &artifact, &extension).map_err(Failure::usage)?;
    fs::write(path, &bytes).map_err(|e| {
        Failure::environment(format_args!("cannot write `{}`: {e}", path.display()))
    })?;
    anstream::eprintln!("{}  {}", path.display(), show_bytes(bytes.len() as u64));
    Ok(Exit::Success)
}

#[cfg(test)]
mod tests {
    use super::split_port;

    #[test]
    fn a_port_stands_behind_the_name_or_the_items() {
        for (text, id, port) in [
            ("basis", "basis", None),
            ("basis.mass", "basis", Some("mass")),
            ("basis.mass@cat", "basis@cat", Some("mass")),
            ("basis.mass@cat,20.0", "basis@cat,20.0", Some("mass")),
            ("basis@cat,20.0.mass", "basis@cat,20.0", Some("mass")),
        ] {
            let (found, named) = split_port(text);
            assert_eq!((&*found, named), (id, port), "{text}");
        }
    }
}
