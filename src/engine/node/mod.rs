//! The one trait that a kind of node implements, and what its `run` sees of the world.

mod checked;
mod files;
mod io;
mod port;

pub use checked::{AnyNode, CheckedNode};
pub use files::{InputFile, ProgramName, extension_of};
pub use io::{Labelled, NodeIo, NodeOutputs, PortInputs, ProgressFn, StoredFileFn, Surroundings};
pub use port::{
    Arity, Input, Inputs, LabelledInputs, OptionalInput, OptionalInputs, OptionalOutput, Output,
    Port,
};

pub use super::cancel::CancelToken;
pub use super::facts::{Answer, Facts, Question};
pub use super::labels::Labels;

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use schemars::JsonSchema;
use serde::{Serialize, de::DeserializeOwned};

use super::artifact::ArtifactType;

/// A kind of node. The implementing struct holds the parameters; its doc comments are their reference.
pub trait Node: Serialize + DeserializeOwned + JsonSchema + Send + Sync + 'static {
    const SPEC: Spec;

    /// Whether `run` itself ends soon after [`NodeIo::cancel`] says so, by killing the program that it
    /// waits for. A time limit puts other kinds into a process of their own, which can be killed.
    const HANDLES_LIMITS: bool = false;

    /// Parameters that say where something is found, and so are not part of the key: what is found there
    /// counts by the answer to [`Node::question`].
    const WHERE: &'static [&'static str] = &[];

    /// Checks what no single field can express. Must not touch the outside world.
    ///
    /// # Errors
    /// With a message for the user, lower case, fields in backticks.
    fn validate(&self) -> Result<(), String> {
        Ok(())
    }

    /// Checks what an open kind can do with the types of artifacts that are wired to each of its inputs.
    ///
    /// # Errors
    /// As [`Node::validate`].
    fn check_inputs(&self, _types: TypesAt<'_>) -> Result<(), String> {
        Ok(())
    }

    /// The files that the node reads, by the names of their fields. They count by content.
    fn files(&self) -> Vec<(&'static str, &InputFile)> {
        Vec::new()
    }

    /// A field that is a table of files, with its name. They count as well, as `field.name`.
    fn file_table(&self) -> Option<(&'static str, &BTreeMap<String, InputFile>)> {
        None
    }

    /// Files that a declared file refers to (the buffers of a `.gltf`). They count as well.
    fn side_files(&self, _path: &Path) -> Vec<PathBuf> {
        Vec::new()
    }

    /// What else the result depends on and must be asked of the machine: the version of a program.
    fn question(&self) -> Option<Question> {
        None
    }

    /// Reads ports and files from `io`, computes, writes every output.
    ///
    /// # Errors
    /// With a message for the user; the engine adds which node it was.
    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError>;
}

/// The types of the artifacts that are wired to an input, by its name.
pub type TypesAt<'a> = &'a dyn Fn(&str) -> Vec<ArtifactType>;

/// The declaration of a kind.
#[derive(Debug, Clone, Copy)]
pub struct Spec {
    /// As written in pipelines; the name of the kind's file.
    pub kind: &'static str,
    /// Raise it whenever the same inputs and parameters may give other outputs.
    pub version: u32,
    pub inputs: &'static [Port],
    pub outputs: &'static [Port],
    /// BibTeX keys of the papers that the kind implements.
    pub cites: &'static [&'static str],
    /// A small pipeline that uses the kind. It is shown in the reference and run by the tests.
    pub example: &'static str,
}

/// Why a node failed.
///
/// Every error converts into [`NodeError::Failed`], so `?` works on the errors of kernels.
#[derive(Debug)]
pub enum NodeError {
    /// The inputs or parameters do not allow a result.
    Failed(String),
    /// The machine does: disk, network, permissions. Ends with another exit code.
    Environment(String),
}

impl NodeError {
    pub fn failed(message: impl Into<String>) -> Self {
        Self::Failed(message.into())
    }

    pub fn environment(message: impl Into<String>) -> Self {
        Self::Environment(message.into())
    }

    pub fn message(&self) -> &str {
        match self {
            Self::Failed(message) | Self::Environment(message) => message,
        }
    }
}

impl<E: std::error::Error> From<E> for NodeError {
    fn from(error: E) -> Self {
        Self::Failed(error.to_string())
    }
}

/// One line of the registry of kinds.
pub struct NodeKind {
    pub spec: Spec,
    /// Parameters from plain data, after `${}` has been filled in.
    pub parse: fn(serde_json::Value) -> Result<Box<dyn AnyNode>, serde_json::Error>,
    pub schema: fn() -> schemars::Schema,
    /// See [`Node::HANDLES_LIMITS`].
    pub handles_limits: bool,
    /// The pipeline declares its ports beside those of the spec: tables `inputs` and `outputs` in the
    /// node's own table, which are parameters `inputs` and `outputs` of the kind.
    pub open: bool,
    /// Whether the list inputs of an open kind are labelled.
    pub labels_lists: bool,
    /// It was made of an open kind: its ports are declared, and it takes artifacts as files.
    pub declared: bool,
}

impl NodeKind {
    pub const fn of<N: Node>() -> Self {
        Self {
            spec: N::SPEC,
            parse: |params| Ok(Box::new(serde_json::from_value::<N>(params)?)),
            schema: || schemars::schema_for!(N),
            handles_limits: N::HANDLES_LIMITS,
            open: false,
            labels_lists: false,
            declared: false,
        }
    }

    /// A kind whose ports the pipeline declares. Its struct has the parameters
    /// `inputs: BTreeMap<String, Arity>` and `outputs: BTreeMap<String, String>` (names of types).
    pub const fn open<N: Node>() -> Self {
        Self { open: true, ..Self::of::<N>() }
    }

    /// The same; it is told what the items are called that its lists gather, and which are missing.
    pub const fn open_labelled<N: Node>() -> Self {
        Self { labels_lists: true, ..Self::open::<N>() }
    }
}
