//! Arguments and steps that several commands share.

use std::path::{Path, PathBuf};

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
        Store::open(&self.cache, Access::ReadWrite).map_err(|it| cache_stop(&it))
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

/// The instance that a user names.
pub fn find(graph: &Graph, id: &str) -> Result<NodeIndex, Failure> {
    graph.find(id).ok_or_else(|| {
        let ids: Vec<String> = graph.instances.node_weights().map(|it| it.id()).collect();
        let hint = pipeline::suggest(id, ids.iter().map(String::as_str));
        let hint = hint.map(|it| format!("\nhint: {it}")).unwrap_or_default();
        Failure::usage(format_args!("the pipeline has no node `{id}`{hint}"))
    })
}

/// The instances that a user names.
pub fn find_all(graph: &Graph, ids: &[String]) -> Result<Vec<NodeIndex>, Failure> {
    ids.iter().map(|id| find(graph, id)).collect()
}
