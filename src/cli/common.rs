//! Arguments and steps that several commands share.

use std::{
    io::ErrorKind,
    path::{Path, PathBuf},
};

use petgraph::graph::NodeIndex;

use super::Failure;
use crate::engine::{
    graph::Graph,
    pipeline,
    plan::PipelineMemory,
    store::{Access, Store, StoreError},
};

/// Where results are kept.
#[derive(clap::Args)]
pub struct StoreArgs {
    /// The folder of the cache
    #[arg(long, value_name = "DIR", env = "SINEW_CACHE", default_value = "cache")]
    pub cache: PathBuf,
}

impl StoreArgs {
    /// Opens the cache to write.
    pub fn open(&self) -> Result<Store, Failure> {
        Store::open(&self.cache, Access::ReadWrite).map_err(|it| match it.error.kind() {
            ErrorKind::ReadOnlyFilesystem | ErrorKind::PermissionDenied => {
                Failure::environment(format_args!(
                    "{it}\nhint: `--cache DIR` names another folder; with `--read-only-cache` \
                     nothing is kept"
                ))
            }
            _ => cache_stop(&it),
        })
    }

    /// Opens the cache to read; a folder that is not there is an empty cache.
    pub fn open_read_only(&self) -> Result<Store, Failure> {
        Store::open(&self.cache, Access::ReadOnly).map_err(|it| cache_stop(&it))
    }

    /// Complains about a folder that is no cache, before anything is removed there.
    pub fn existing(&self) -> Result<&Path, Failure> {
        if self.cache.join("CACHEDIR.TAG").is_file() {
            return Ok(&self.cache);
        }
        Err(Failure::usage(format_args!("`{}` is no cache of Sinew", self.cache.display())))
    }
}

pub fn cache_stop(error: &StoreError) -> Failure {
    Failure::environment(format_args!("{error}\nhint: `--cache DIR` names another folder"))
}

/// What the store remembers of this pipeline.
pub fn memory<'a>(store: &'a Store, graph: &Graph) -> PipelineMemory<'a> {
    PipelineMemory::new(store, graph)
}

/// The one instance that a user names.
pub fn find(graph: &Graph, id: &str) -> Result<NodeIndex, Failure> {
    match select(graph, id)?[..] {
        [one] => Ok(one),
        ref several => {
            let ids = several.iter().map(|&it| graph.instances[it].id());
            let ids: Vec<String> = ids.take(4).map(|it| format!("`{it}`")).collect();
            let more = if several.len() > ids.len() { ", …" } else { "" };
            let (count, ids) = (several.len(), ids.join(", "));
            Err(Failure::usage(format_args!(
                "`{id}` is there {count} times\nhint: name one of {ids}{more}"
            )))
        }
    }
}

/// The instances that a user names: a node, or a node at some of its items.
pub fn select(graph: &Graph, id: &str) -> Result<Vec<NodeIndex>, Failure> {
    let found = graph.select(id);
    if !found.is_empty() {
        return Ok(found);
    }
    let name = id.split('@').next().unwrap_or_default();
    let has_name = graph.instances.node_weights().any(|it| *it.name == *name);
    let hint = if has_name {
        let ids = graph.instances.node_weights().filter(|it| *it.name == *name).map(|it| it.id());
        let ids: Vec<String> = ids.collect();
        pipeline::suggest(id, ids.iter().map(String::as_str))
    } else {
        let mut names: Vec<&str> = graph.instances.node_weights().map(|it| &*it.name).collect();
        names.dedup();
        pipeline::suggest(name, names)
    };
    let hint = hint.map(|it| format!("\nhint: {it}")).unwrap_or_default();
    Err(Failure::usage(format_args!("the pipeline has no node `{id}`{hint}")))
}

/// The instances that a user names, each once.
pub fn select_all(graph: &Graph, ids: &[String]) -> Result<Vec<NodeIndex>, Failure> {
    let mut res = Vec::new();
    for id in ids {
        res.extend(select(graph, id)?);
    }
    res.sort_unstable();
    res.dedup();
    Ok(res)
}
