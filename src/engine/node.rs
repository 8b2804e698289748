//! The one trait that a kind of node implements, and what its `run` sees of the world.

use std::{
    borrow::Cow,
    collections::BTreeMap,
    marker::PhantomData,
    ops::Deref,
    path::{Path, PathBuf},
    sync::{Arc, OnceLock},
};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize, de::DeserializeOwned};

pub use super::cancel::CancelToken;
pub use super::facts::{Answer, Facts, Question};
pub use super::labels::Labels;
use super::{
    artifact::{AnyArtifact, Artifact, ArtifactType, Bytes},
    digest::Digest,
    key::params_text,
    labels::InputLabels,
    shared_text::SharedText,
};

/// How many wires a port takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Arity {
    /// Exactly one.
    One,
    /// One or none. An optional output may be left out by a run.
    Optional,
    /// A list, in the order of the pipeline file.
    Many,
    /// A list that may be left out: then it is empty.
    OptionalMany,
}

impl Arity {
    /// Whether a pipeline may wire several artifacts to the port.
    pub fn takes_list(self) -> bool {
        matches!(self, Self::Many | Self::OptionalMany)
    }

    /// Whether a pipeline may leave the port out.
    pub fn may_be_left_out(self) -> bool {
        matches!(self, Self::Optional | Self::OptionalMany)
    }
}

/// What a pipeline sees of a port.
#[derive(Debug, Clone, Copy)]
pub struct Port {
    pub name: &'static str,
    pub doc: &'static str,
    pub ty: ArtifactType,
    pub arity: Arity,
    /// Whether the node is told what the items are called that the port gathers, and which are missing.
    pub labelled: bool,
    /// An output that a wire must name, even where a node has only one other: what a program printed.
    pub aside: bool,
}

impl Port {
    /// The same output, which a wire must name.
    pub const fn aside(self) -> Self {
        Self { aside: true, ..self }
    }
}

macro_rules! port_key {
    ($(#[$doc:meta])* $name:ident, $arity:ident, labelled: $labelled:literal) => {
        $(#[$doc])*
        pub struct $name<T> {
            name: &'static str,
            doc: &'static str,
            of: PhantomData<fn() -> T>,
        }

        impl<T> Clone for $name<T> {
            fn clone(&self) -> Self {
                *self
            }
        }

        impl<T> Copy for $name<T> {}

        impl<T: Artifact> $name<T> {
            pub const fn new(name: &'static str, doc: &'static str) -> Self {
                Self { name, doc, of: PhantomData }
            }

            pub const fn port(&self) -> Port {
                Port {
                    name: self.name,
                    doc: self.doc,
                    ty: T::TYPE,
                    arity: Arity::$arity,
                    labelled: $labelled,
                    aside: false,
                }
            }
        }
    };
}

port_key!(
    /// A typed key for something a node reads.
    Input,
    One,
    labelled: false
);
port_key!(
    /// A typed key for something a node reads if it is wired.
    OptionalInput,
    Optional,
    labelled: false
);
port_key!(
    /// A typed key for any number of artifacts, in the order in which they are listed.
    Inputs,
    Many,
    labelled: false
);
port_key!(
    /// A typed key for a list whose node wants to know what each artifact is called, by the items of
    /// the axes that it gathers. With `missing = "show"`, some of them may be missing.
    LabelledInputs,
    Many,
    labelled: true
);
port_key!(
    /// A typed key for any number of artifacts, or none if it is not wired.
    OptionalInputs,
    OptionalMany,
    labelled: false
);
port_key!(
    /// A typed key for something a node writes.
    Output,
    One,
    labelled: false
);
port_key!(
    /// A typed key for something a node writes if its inputs have it.
    OptionalOutput,
    Optional,
    labelled: false
);

/// A file that a node reads, named by a parameter. Only its content and its extension count.
///
/// The path is relative to the folder of the pipeline file that names it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct InputFile(#[schemars(extend("format" = "input-file"))] pub PathBuf);

impl InputFile {
    /// In lower case, without the dot; empty if there is none.
    pub fn extension(&self) -> String {
        extension_of(&self.0)
    }
}

/// A program that a node starts: a name that is looked up in `PATH`, or a path relative to the folder of
/// the pipeline file that names it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct ProgramName(#[schemars(extend("format" = "program"))] pub String);

/// A path's extension in lower case, without the dot; empty if there is none.
pub fn extension_of(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_lowercase()
}

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

/// The types of the artifacts that are wired to an input, by its name.
pub type TypesAt<'a> = &'a dyn Fn(&str) -> Vec<ArtifactType>;

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

/// What surrounds a run and never changes its result.
#[derive(Debug, Clone, Default)]
pub struct Surroundings {
    /// Folders where downloads are looked up first (`SINEW_MIRROR`).
    pub mirrors: Vec<PathBuf>,
    /// No network.
    pub offline: bool,
    /// The node runs in a process of its own, which is killed with its whole process group: programs
    /// that it starts should stay in this group.
    pub isolated: bool,
}

/// A progress report of a running node: the done fraction if it is known, and what is being done.
pub type ProgressFn<'a> = &'a (dyn Fn(Option<f64>, &str) + Sync);

/// What is at an input: artifacts in order, or why one is missing.
pub type PortInputs = Vec<Result<AnyArtifact, Arc<str>>>;

/// One of the artifacts that a labelled port gathers.
pub struct Labelled<T> {
    /// (axis, item), of the axes that are gathered.
    pub labels: Labels,
    /// Why it is missing, if it is.
    pub value: Result<Arc<T>, Arc<str>>,
}
/// Finds the file in which an artifact is stored, if it has one.
pub type StoredFileFn<'a> = &'a (dyn Fn(&Digest) -> Option<PathBuf> + Sync);

/// A node's window on the world: its ports, its files, its surroundings.
pub struct NodeIo<'a> {
    spec: &'a Spec,
    inputs: BTreeMap<&'static str, PortInputs>,
    input_labels: InputLabels,
    files: BTreeMap<PathBuf, PathBuf>,
    surroundings: &'a Surroundings,
    progress: ProgressFn<'a>,
    cancel: CancelToken,
    stored_file: StoredFileFn<'a>,
    outputs: NodeOutputs,
}

/// What a run wrote.
#[derive(Default)]
pub struct NodeOutputs {
    /// By port: the artifact and its bytes.
    pub artifacts: BTreeMap<&'static str, (AnyArtifact, Bytes)>,
    /// Optional outputs that were left out, and why.
    pub absent: BTreeMap<&'static str, String>,
    /// Remarks for the user, kept with the result.
    pub notes: Vec<String>,
}

impl<'a> NodeIo<'a> {
    /// `files` leads from the paths of parameters to the real paths.
    pub fn new(
        spec: &'a Spec,
        inputs: BTreeMap<&'static str, PortInputs>,
        input_labels: InputLabels,
        files: BTreeMap<PathBuf, PathBuf>,
        surroundings: &'a Surroundings,
        progress: ProgressFn<'a>,
    ) -> Self {
        Self {
            spec,
            inputs,
            input_labels,
            files,
            surroundings,
            progress,
            cancel: CancelToken::never(),
            stored_file: &|_| None,
            outputs: NodeOutputs::default(),
        }
    }

    /// The same, for a run that can be given up or that has a time limit.
    pub fn with_cancel(self, cancel: CancelToken) -> Self {
        Self { cancel, ..self }
    }

    /// The same, with a way to the files of stored artifacts.
    pub fn with_stored_files(self, stored_file: StoredFileFn<'a>) -> Self {
        Self { stored_file, ..self }
    }

    /// The artifact at an input.
    ///
    /// # Panics
    /// If the port is not in the kind's spec.
    pub fn get<T: Artifact>(&self, port: Input<T>) -> Arc<T> {
        self.all(port.name).next().expect("a checked pipeline wires every input")
    }

    /// The artifact at an optional input, if it is wired.
    pub fn get_optional<T: Artifact>(&self, port: OptionalInput<T>) -> Option<Arc<T>> {
        self.all(port.name).next()
    }

    /// The artifacts at a list input.
    pub fn get_all<T: Artifact>(&self, port: Inputs<T>) -> Vec<Arc<T>> {
        self.all(port.name).collect()
    }

    /// The artifacts at a list input that may be left out.
    pub fn get_all_optional<T: Artifact>(&self, port: OptionalInputs<T>) -> Vec<Arc<T>> {
        self.all(port.name).collect()
    }

    /// The artifacts that a labelled port gathers, with their labels.
    pub fn get_labelled<T: Artifact>(&self, port: LabelledInputs<T>) -> Vec<Labelled<T>> {
        self.assert_input(port.name);
        let inputs = self.inputs.get(port.name).into_iter().flatten();
        let mut labels = self.input_labels.get(port.name).into_iter().flatten().cloned();
        inputs
            .map(|it| Labelled {
                labels: labels.next().unwrap_or_default(),
                value: it
                    .as_ref()
                    .map_err(Arc::clone)
                    .map(|it| it.downcast().expect("a checked pipeline wires equal types")),
            })
            .collect()
    }

    fn assert_input(&self, name: &str) {
        assert!(
            self.spec.inputs.iter().any(|it| it.name == name),
            "`{}` does not declare its input `{name}`",
            self.spec.kind
        );
    }

    fn all<T: Artifact>(&self, name: &'static str) -> impl Iterator<Item = Arc<T>> + '_ {
        self.assert_input(name);
        self.inputs
            .get(name)
            .into_iter()
            .flatten()
            .flatten()
            .map(|it| it.downcast().expect("a checked pipeline wires equal types"))
    }

    /// The artifacts at every wired input, in the order of the pipeline file: for kinds whose inputs the
    /// pipeline declares.
    pub fn inputs(&self) -> impl Iterator<Item = (&'static Port, &PortInputs)> {
        self.spec.inputs.iter().filter_map(|port| Some((port, self.inputs.get(port.name)?)))
    }

    /// What the items are called that a labelled input gathers; empty for other inputs.
    pub fn labels(&self, port: &str) -> &[Labels] {
        self.input_labels.get(port).map_or(&[], |it| it)
    }

    /// The file in which an artifact is stored as it is encoded, if there is one: it can be mapped.
    pub fn stored_file(&self, artifact: &AnyArtifact) -> Option<PathBuf> {
        (self.stored_file)(&artifact.digest())
    }

    /// The outputs: for kinds whose outputs the pipeline declares.
    pub fn outputs(&self) -> &'static [Port] {
        self.spec.outputs
    }

    /// Writes an output whose type is known at run time only: the artifact and its bytes.
    ///
    /// # Panics
    /// If the port has another type.
    pub fn put_any(&mut self, port: &'static str, (artifact, bytes): (AnyArtifact, Bytes)) {
        self.assert_declared(port);
        let ty = self.spec.outputs.iter().find(|it| it.name == port).map(|it| it.ty);
        assert_eq!(Some(artifact.ty()), ty, "the type of the output `{port}`");
        self.outputs.artifacts.insert(port, (artifact, bytes));
    }

    /// Writes an output.
    pub fn put<T: Artifact>(&mut self, port: Output<T>, value: T) {
        self.write(port.name, value);
    }

    /// Writes an optional output, or says why it is left out (`the file has no skin`).
    pub fn put_optional<T: Artifact>(
        &mut self,
        port: OptionalOutput<T>,
        value: Option<T>,
        why_absent: &str,
    ) {
        match value {
            Some(value) => self.write(port.name, value),
            None => {
                self.assert_declared(port.name);
                self.outputs.absent.insert(port.name, why_absent.to_owned());
            }
        }
    }

    fn write<T: Artifact>(&mut self, name: &'static str, value: T) {
        self.assert_declared(name);
        self.outputs.artifacts.insert(name, AnyArtifact::encode(value));
    }

    fn assert_declared(&self, name: &str) {
        assert!(
            self.spec.outputs.iter().any(|it| it.name == name),
            "`{}` does not declare its output `{name}`",
            self.spec.kind
        );
    }

    /// Reads a file that [`Node::files`] or [`Node::side_files`] declares.
    ///
    /// # Errors
    /// [`NodeError::Environment`] with the path.
    pub fn read(&self, path: &Path) -> Result<Vec<u8>, NodeError> {
        let real = self.path(path);
        std::fs::read(real)
            .map_err(|e| NodeError::Environment(format!("cannot read `{}`: {e}", real.display())))
    }

    /// The real path of a declared file.
    ///
    /// # Panics
    /// If the node does not declare it.
    pub fn path(&self, path: &Path) -> &Path {
        self.files.get(path).unwrap_or_else(|| {
            panic!("`{}` does not declare the file `{}`", self.spec.kind, path.display())
        })
    }

    pub fn surroundings(&self) -> &Surroundings {
        self.surroundings
    }

    /// Reports what is being done, and the done fraction if it is known.
    pub fn progress(&self, fraction: Option<f64>, message: &str) {
        (self.progress)(fraction, message);
    }

    /// Says when the result is no longer wanted: the run was stopped, or the time limit is over.
    ///
    /// Whoever waits for something outside (a program, a network) ends it then and returns an error;
    /// what that error says does not matter. A computation need not look: it is left to finish, or
    /// runs in a process that is killed.
    pub fn cancel(&self) -> &CancelToken {
        &self.cancel
    }

    /// Leaves a remark for the user, kept with the result.
    pub fn note(&mut self, message: impl Into<String>) {
        self.outputs.notes.push(message.into());
    }

    /// Ends the run.
    ///
    /// # Panics
    /// If an output is missing: a bug of the kind.
    pub fn finish(self) -> NodeOutputs {
        for port in self.spec.outputs {
            let known = self.outputs.artifacts.contains_key(port.name)
                || self.outputs.absent.contains_key(port.name);
            assert!(known, "`{}` did not write its output `{}`", self.spec.kind, port.name);
        }
        self.outputs
    }
}

/// The object-safe face of [`Node`], made by the blanket implementation.
pub trait AnyNode: Send + Sync {
    fn spec(&self) -> &'static Spec;
    /// Parameters as [`NodeKind::parse`] takes them.
    fn params(&self) -> serde_json::Value;
    /// Parameters with every default filled in; files are replaced by their extensions.
    fn canonical_params(&self) -> serde_json::Value;
    fn validate(&self) -> Result<(), String>;
    fn check_inputs(&self, types: TypesAt<'_>) -> Result<(), String>;
    /// All files, with the names of their fields: `path`, `files.script`.
    fn files(&self) -> Vec<(Cow<'static, str>, &InputFile)>;
    fn side_files(&self, path: &Path) -> Vec<PathBuf>;
    fn question(&self) -> Option<Question>;
    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError>;
}

impl<N: Node> AnyNode for N {
    fn spec(&self) -> &'static Spec {
        const { &N::SPEC }
    }

    fn params(&self) -> serde_json::Value {
        serde_json::to_value(self).expect("parameters are plain data")
    }

    fn canonical_params(&self) -> serde_json::Value {
        let mut params = self.params();
        for (field, file) in AnyNode::files(self) {
            let value = field.split('.').fold(&mut params, |it, name| &mut it[name]);
            *value = serde_json::json!({ "file": file.extension() });
        }
        if let Some(fields) = params.as_object_mut() {
            N::WHERE.iter().for_each(|it| drop(fields.shift_remove(*it)));
        }
        params
    }

    fn validate(&self) -> Result<(), String> {
        Node::validate(self)
    }

    fn check_inputs(&self, types: TypesAt<'_>) -> Result<(), String> {
        Node::check_inputs(self, types)
    }

    fn files(&self) -> Vec<(Cow<'static, str>, &InputFile)> {
        let fields =
            Node::files(self).into_iter().map(|(field, file)| (Cow::Borrowed(field), file));
        let table = Node::file_table(self).into_iter().flat_map(|(field, files)| {
            files.iter().map(move |(name, file)| (Cow::Owned(format!("{field}.{name}")), file))
        });
        fields.chain(table).collect()
    }

    fn side_files(&self, path: &Path) -> Vec<PathBuf> {
        Node::side_files(self, path)
    }

    fn question(&self) -> Option<Question> {
        Node::question(self)
    }

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        Node::run(self, io)
    }
}

/// A node whose parameters were checked: the node itself, or what it is made from when somebody needs it.
pub struct CheckedNode {
    kind: &'static NodeKind,
    node: OnceLock<Box<dyn AnyNode>>,
    /// Its parameters as JSON, if it was not made at once.
    params: Option<SharedText>,
    /// Made when it is asked for first: a node may be shared by all items of an axis.
    key_params: OnceLock<SharedText>,
    /// It has no question.
    asks_nothing: bool,
}

impl CheckedNode {
    pub fn new(kind: &'static NodeKind, node: Box<dyn AnyNode>) -> Self {
        let node = OnceLock::from(node);
        Self { kind, node, params: None, key_params: OnceLock::new(), asks_nothing: false }
    }

    /// A node that was checked before, from what it said of itself then.
    pub fn of_params(
        kind: &'static NodeKind,
        params: SharedText,
        key_params: SharedText,
        asks: bool,
    ) -> Self {
        let (node, key_params) = (OnceLock::new(), OnceLock::from(key_params));
        Self { kind, node, params: Some(params), key_params, asks_nothing: !asks }
    }

    pub fn kind(&self) -> &'static NodeKind {
        self.kind
    }

    /// Its parameters as they are written in keys.
    pub fn key_params(&self) -> &str {
        self.key_params.get_or_init(|| params_text(&self.canonical_params()).into())
    }

    /// As [`Node::question`].
    pub fn question(&self) -> Option<Question> {
        if self.asks_nothing { None } else { self.deref().question() }
    }
}

impl Deref for CheckedNode {
    type Target = dyn AnyNode;

    fn deref(&self) -> &Self::Target {
        let make = || {
            let params = self.params.as_deref().expect("it has a node or parameters");
            let params = serde_json::from_str(params).expect("it was written as JSON");
            (self.kind.parse)(params).expect("these parameters were checked")
        };
        self.node.get_or_init(make).as_ref()
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
