//! The arguments of every command that reads one pipeline.

use std::path::{Path, PathBuf};

use super::Failure;
use crate::{
    LIBRARY,
    engine::{
        graph::Graph,
        pipeline::{self, Settings},
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
