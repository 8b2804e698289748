//! The arguments of every command that reads one pipeline.

use std::path::{Path, PathBuf};

use super::{Failure, common::StoreArgs};
use crate::{
    LIBRARY,
    engine::{
        graph::Graph,
        memory,
        pipeline::{self, Settings},
        snapshot,
        store::{Store, disk::Disk},
    },
};

#[derive(clap::Args)]
pub struct PipelineArgs {
    /// The pipeline
    pub file: PathBuf,
    #[command(flatten)]
    pub settings: SettingsArgs,
}

#[derive(clap::Args)]
pub struct SettingsArgs {
    /// Use the parameters of `[profiles.NAME]`
    #[arg(short, long, value_name = "NAME", env = "SINEW_PROFILE")]
    profile: Option<String>,
    /// Set a parameter: `k=60`, or of one node: `eigs.k=60`; can be repeated
    #[arg(long, value_name = "NAME=VALUE")]
    set: Vec<String>,
    /// Use only these items of an axis: `shape=cat,dog-*`; can be repeated
    #[arg(long, value_name = "AXIS=ITEM,…")]
    only: Vec<String>,
    /// Use only the first items of an axis: `shape=5`; can be repeated
    #[arg(long, value_name = "AXIS=N")]
    limit: Vec<String>,
}

impl PipelineArgs {
    /// # Errors
    /// With everything that is wrong with the pipeline.
    pub fn load(&self) -> Result<Graph, Failure> {
        self.settings.load(&self.file)
    }

    /// The graph that a cache has kept, or else the one that reading gives.
    ///
    /// # Errors
    /// As [`PipelineArgs::load`].
    pub fn find_or_load(&self, store: &StoreArgs) -> Result<Graph, Failure> {
        memory::prefer_large_pages();
        let settings = self.settings.to_settings();
        match snapshot::find(&self.file, &LIBRARY, &settings, &Disk::default(), &store.cache) {
            Some(graph) => Ok(graph),
            None => self.load(),
        }
    }

    /// Keeps a graph for [`PipelineArgs::find_or_load`].
    pub fn keep(&self, graph: &Graph, store: &Store) {
        snapshot::keep(graph, &self.file, &LIBRARY, &self.settings.to_settings(), store);
    }
}

impl SettingsArgs {
    /// # Errors
    /// With everything that is wrong with the pipeline.
    pub fn load(&self, file: &Path) -> Result<Graph, Failure> {
        Ok(pipeline::load(file, &LIBRARY, &self.to_settings())?)
    }

    /// As they are written on a command line.
    pub fn to_words(&self) -> Vec<String> {
        let profile = self.profile.iter().flat_map(|it| ["--profile", it]);
        let set = self.set.iter().flat_map(|it| ["--set", it]);
        profile.chain(set).map(str::to_owned).collect()
    }

    pub fn to_settings(&self) -> Settings {
        Settings {
            profile: self.profile.clone(),
            set: self.set.clone(),
            only: self.only.clone(),
            limit: self.limit.clone(),
        }
    }
}
