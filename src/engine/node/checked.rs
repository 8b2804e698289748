//! Nodes of any kind, behind one face.

use std::{
    borrow::Cow,
    ops::Deref,
    path::{Path, PathBuf},
    sync::OnceLock,
};

use super::{InputFile, Node, NodeError, NodeIo, NodeKind, Question, Spec, TypesAt};
use crate::engine::{key::params_text, shared_text::SharedText};

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
