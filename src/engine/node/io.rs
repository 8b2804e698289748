//! What a running node sees of the world.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::Arc,
};

use super::{
    CancelToken, Input, Inputs, LabelledInputs, Labels, NodeError, OptionalInput, OptionalInputs,
    OptionalOutput, Output, Port, Spec,
};
use crate::engine::{
    artifact::{AnyArtifact, Artifact, EncodedArtifact},
    digest::Digest,
    labels::InputLabels,
};

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
    pub fn put_any(&mut self, port: &'static str, (artifact, bytes): EncodedArtifact) {
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
    /// [`Node::files`]: super::Node::files
    /// [`Node::side_files`]: super::Node::side_files
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

/// What a run wrote.
#[derive(Default)]
pub struct NodeOutputs {
    /// By port.
    pub artifacts: BTreeMap<&'static str, EncodedArtifact>,
    /// Optional outputs that were left out, and why.
    pub absent: BTreeMap<&'static str, String>,
    /// Remarks for the user, kept with the result.
    pub notes: Vec<String>,
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
