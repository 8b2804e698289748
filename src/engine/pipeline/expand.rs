//! From files to nodes: inner pipelines become the nodes that they are made of.
//!
//! A file that is used becomes a [`Scope`]: its parameters with their values, and what its names
//! mean. Its plain nodes become [`Draft`]s in one list for all files. Names of nodes in an inner
//! pipeline are written behind the name of the node that uses it: `basis/eigs`.

use std::{collections::HashMap, path::PathBuf, rc::Rc, sync::Arc};

use super::{
    axes::{self, Axis, Choice, Reading},
    diagnostic::{Diagnostic, Problems},
    gather::{self, Gather},
    nearest::{nearest, suggest},
    open_ports,
    parse::{self, Document, NodeTable},
    settings::{self, WrittenSettings},
    sources::Sources,
    substitute::{self, Names, Params},
    value::{AxisId, Data, Entry, Key, Piece, Value},
};
use crate::engine::{graph::Place, library::Library, node::NodeKind, settings::is_node_key};

/// The kind that stands for a whole file.
const PIPELINE: &str = "pipeline";

/// All nodes of a pipeline and its inner pipelines.
pub struct Expansion {
    pub drafts: Vec<Draft>,
    /// The first is the file that was asked for.
    pub scopes: Vec<Scope>,
    /// The axes of all scopes, by [`AxisId`].
    pub axes: Vec<Axis>,
}

/// A node before it is checked and repeated along its axes.
pub struct Draft {
    /// With the names of the pipelines around it.
    pub name: Arc<str>,
    pub kind: &'static NodeKind,
    /// Where its wires are looked up.
    pub scope: usize,
    pub place: Place,
    /// Parameters and wires, with `${}` filled in where it names no axis.
    pub fields: Vec<Entry>,
    pub gather: Gather,
    pub settings: WrittenSettings,
}

impl Draft {
    /// The name by which its own file calls it.
    pub fn local_name(&self) -> &str {
        self.name.rsplit('/').next().unwrap_or(&self.name)
    }
}

/// A file at one of its uses.
pub struct Scope {
    pub document: Rc<Document>,
    /// What `${name}` means here.
    pub names: Names,
    /// By name: what `@name` means here.
    pub targets: HashMap<Arc<str>, Target>,
    /// The scope that uses this one.
    pub parent: Option<usize>,
    /// Wires of the parent for the inputs of this file.
    pub given: HashMap<Arc<str>, Value>,
    /// How its nodes are run if they do not say it themselves.
    pub settings: WrittenSettings,
}

/// What a wire can lead to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Target {
    /// A draft.
    Node(usize),
    /// The scope of an inner pipeline.
    Pipeline(usize),
    /// An input of this file.
    Input,
    /// Something whose mistake has been reported.
    Broken,
}

impl Expansion {
    /// Expands a file; `document` is the first of `sources`.
    pub fn new(
        mut document: Document,
        library: &Library,
        sources: &mut Sources,
        choices: &mut [Choice],
        problems: &mut Problems,
    ) -> Self {
        let mut expander = Expander {
            library,
            sources,
            choices,
            problems,
            documents: HashMap::new(),
            open: vec![0],
            res: Self { drafts: Vec::new(), scopes: Vec::new(), axes: Vec::new() },
        };
        let fields = document.nodes.iter_mut().map(|it| std::mem::take(&mut it.fields)).collect();
        let document = Rc::new(document);
        let given = Given::default();
        expander.expand(Use { document, fields, prefix: "", parent: None, given });
        let Expander { res, choices, problems, .. } = expander;
        axes::report_unknown_axes(choices, &res.axes, problems);
        res
    }
}

/// One use of a file.
struct Use<'a> {
    document: Rc<Document>,
    /// Of its nodes, which need not have them any more.
    fields: Vec<Vec<Entry>>,
    /// `outer/`, or nothing.
    prefix: &'a str,
    parent: Option<usize>,
    given: Given,
}

/// What a node of kind `pipeline` hands to its file.
#[derive(Default)]
struct Given {
    params: Params,
    wires: HashMap<Arc<str>, Value>,
    settings: WrittenSettings,
}

struct Expander<'a> {
    library: &'a Library,
    sources: &'a mut Sources,
    choices: &'a mut [Choice],
    problems: &'a mut Problems,
    /// Files read so far, by source; `None` if one cannot be parsed.
    documents: HashMap<usize, Option<Rc<Document>>>,
    /// The sources whose expansion is under way, outermost first.
    open: Vec<usize>,
    res: Expansion,
}

impl Expander<'_> {
    /// Adds the scope of a file and all nodes in it.
    fn expand(&mut self, use_: Use<'_>) -> usize {
        let Use { document, fields, prefix, parent, given } = use_;
        let names = self.names(&document, given.params);
        let inputs = document.inputs.iter().map(|it| (Arc::clone(&it.name.name), Target::Input));
        let scope = self.res.scopes.len();
        self.res.scopes.push(Scope {
            targets: inputs.collect(),
            document: Rc::clone(&document),
            names,
            parent,
            given: given.wires,
            settings: given.settings,
        });
        self.res.scopes[scope].targets.reserve(document.nodes.len());
        for (node, fields) in document.nodes.iter().zip(fields) {
            let target = self.expand_node(node, fields, scope, prefix);
            let name = Arc::clone(&node.name.name);
            let shared = self.res.scopes[scope].targets.insert(name.clone(), target);
            if shared.is_some() {
                // The name of an input as well, which has been reported.
                self.res.scopes[scope].targets.insert(name, Target::Broken);
            }
        }
        scope
    }

    /// Reads the axes of a file and resolves its parameters, which may depend on their items.
    fn names(&mut self, document: &Document, given: Params) -> Names {
        let first = self.res.axes.len();
        let tables = document.axes.iter().enumerate();
        let axes = tables.map(|(i, it)| (Arc::clone(&it.name.name), AxisId(first + i))).collect();
        let names = Names { params: given, axes };
        let names = substitute::resolve_params(&document.params, names, self.problems);
        for table in &document.axes {
            let mut reading = Reading {
                names: &names,
                axes: &names.axes,
                sources: self.sources,
                problems: self.problems,
                choices: self.choices,
            };
            let axis = axes::read(table, &self.res.axes, &mut reading);
            self.res.axes.push(axis);
        }
        names
    }

    fn expand_node(
        &mut self,
        node: &NodeTable,
        mut fields: Vec<Entry>,
        scope: usize,
        prefix: &str,
    ) -> Target {
        self.fill_in(&mut fields, scope);
        let outer = &self.res.scopes[scope].settings;
        let settings = settings::take(&mut fields, outer, self.problems);
        match node.kind.as_text() {
            Some(PIPELINE) => self.expand_pipeline(&node.name, fields, settings, scope, prefix),
            Some(kind) => match self.library.kind(kind) {
                Some(kind) => self.add_draft(node, kind, fields, settings, scope, prefix),
                None => self.report_unknown_kind(kind, &node.kind.place),
            },
            None => Target::Broken,
        }
    }

    /// Replaces every `${}` in the fields of a node that names no axis.
    fn fill_in(&mut self, fields: &mut [Entry], scope: usize) {
        let names = &self.res.scopes[scope].names;
        for value in fields.iter_mut().map(|it| &mut it.value) {
            if substitute::has_names(value) {
                *value = substitute::substitute(value, names, self.problems);
                if !check_axis_fields(value, &self.res.axes, self.problems) {
                    *value = value.broken();
                }
            }
        }
    }

    fn add_draft(
        &mut self,
        node: &NodeTable,
        kind: &'static NodeKind,
        fields: Vec<Entry>,
        settings: WrittenSettings,
        scope: usize,
        prefix: &str,
    ) -> Target {
        let (kind, mut fields) = open_ports::declared(kind, fields, self.library, self.problems);
        let gather = gather::take(&mut fields, kind, self.problems);
        self.res.drafts.push(Draft {
            name: match prefix {
                "" => Arc::clone(&node.name.name),
                _ => format!("{prefix}{}", node.name.name).into(),
            },
            kind,
            scope,
            place: node.name.place.clone(),
            fields,
            gather,
            settings,
        });
        Target::Node(self.res.drafts.len() - 1)
    }

    fn report_unknown_kind(&mut self, kind: &str, place: &Place) -> Target {
        let names = self.library.kinds.iter().map(|it| it.spec.kind).chain([PIPELINE]);
        let hint = suggest(kind, names).unwrap_or("`sinew nodes` lists all kinds".to_owned());
        let message = format!("there is no kind of node `{kind}`");
        self.problems.push(Diagnostic::error(place, message).hint(hint));
        Target::Broken
    }

    fn expand_pipeline(
        &mut self,
        name: &Key,
        mut fields: Vec<Entry>,
        settings: WrittenSettings,
        scope: usize,
        prefix: &str,
    ) -> Target {
        let Some(index) = fields.iter().position(|it| &*it.key.name == "file") else {
            let message = format!("pipeline `{}` names no `file`", name.name);
            self.problems.push(Diagnostic::error(&name.place, message));
            return Target::Broken;
        };
        let file = fields.remove(index).value;
        let Some((source, document)) = self.document(&file) else { return Target::Broken };
        if let Some(start) = self.open.iter().position(|&it| it == source) {
            return self.report_recursion(start, &file.place);
        }
        let given = Given { settings, ..self.give(name, fields, &document) };
        self.open.push(source);
        let prefix = format!("{prefix}{}/", name.name);
        let fields = document.nodes.iter().map(|it| it.fields.clone()).collect();
        let inner =
            self.expand(Use { document, fields, prefix: &prefix, parent: Some(scope), given });
        self.open.pop();
        Target::Pipeline(inner)
    }

    /// The inner file that a `file` names.
    fn document(&mut self, file: &Value) -> Option<(usize, Rc<Document>)> {
        if !file.is_constant() {
            let message = "the file of an inner pipeline cannot depend on an axis";
            self.problems.push(Diagnostic::error(&file.place, message));
            return None;
        }
        let path: PathBuf = {
            let text = parse::text(file, "`file`", self.problems)?;
            self.sources.resolve(file.base, text)
        };
        let source = match self.sources.read(&path) {
            Ok(source) => source,
            Err(message) => {
                self.problems.push(
                    Diagnostic::error(&file.place, message)
                        .related(file.origin.as_ref(), "the path is written here"),
                );
                return None;
            }
        };
        if !self.documents.contains_key(&source) && !self.open.contains(&source) {
            let document = parse::parse(source, &self.sources.list[source], self.problems);
            self.documents.insert(source, document.map(Rc::new));
        }
        match self.documents.get(&source) {
            Some(document) => Some((source, Rc::clone(document.as_ref()?))),
            // The file that was asked for; its use here is a recursion.
            None => Some((source, Rc::new(Document::default()))),
        }
    }

    fn report_recursion(&mut self, start: usize, place: &Place) -> Target {
        let path = |&it: &usize| format!("`{}`", self.sources.list[it].path.display());
        let files: Vec<String> =
            self.open[start..].iter().chain([&self.open[start]]).map(path).collect();
        let message = format!("a pipeline cannot contain itself: {}", files.join(" → "));
        self.problems.push(Diagnostic::error(place, message));
        Target::Broken
    }

    /// Sorts the fields of a pipeline node into the inputs and parameters of its file.
    fn give(&mut self, name: &Key, fields: Vec<Entry>, document: &Document) -> Given {
        self.report_node_keys(document);
        let mut given = Given::default();
        let mut unknown = Vec::new();
        for Entry { key, value } in fields {
            let is_wire = value.as_text().is_some_and(|it| it.starts_with('@'));
            let is_param = document.params.iter().any(|it| it.key.name == key.name);
            if document.inputs.iter().any(|it| it.name.name == key.name) {
                given.wires.insert(key.name, value);
            } else if is_param && is_wire {
                let message = format!("`{}` is a parameter and takes no wire", key.name);
                self.problems.push(Diagnostic::error(&value.place, message));
            } else if is_param {
                given.params.insert(key.name, value);
            } else {
                self.report_unknown_key(name, &key, document);
                unknown.push(nearest(&key.name, keys_of(document)));
            }
        }
        for input in &document.inputs {
            let is_misspelt = unknown.iter().any(|it| *it == Some(&*input.name.name));
            if !given.wires.contains_key(&input.name.name) && !is_misspelt {
                let message = format!("`{}.{}` is not wired", name.name, input.name.name);
                self.problems.push(
                    Diagnostic::error(&name.place, message)
                        .related(Some(&input.name.place), "the input is declared here"),
                );
            }
        }
        given
    }

    /// A node's own settings would hide a parameter or an input of such a name.
    fn report_node_keys(&mut self, document: &Document) {
        let params = document.params.iter().map(|it| &it.key);
        for key in document.inputs.iter().map(|it| &it.name).chain(params) {
            if is_node_key(&key.name) {
                let message =
                    format!("`{}` is a key of every node and needs another name", key.name);
                self.problems.push(
                    Diagnostic::error(&key.place, message)
                        .hint("this file is used as a node".to_owned()),
                );
            }
        }
    }

    fn report_unknown_key(&mut self, name: &Key, key: &Key, document: &Document) {
        let message = format!("pipeline `{}` has no key `{}`", name.name, key.name);
        let hint = settings::suggest_key(&key.name, keys_of(document));
        self.problems.push(Diagnostic::error(&key.place, message).hint(hint));
    }
}

/// Reports fields of axes that their items do not have, or that cannot stand inside of a text.
pub fn check_axis_fields(value: &Value, axes: &[Axis], problems: &mut Problems) -> bool {
    match &value.data {
        Data::List(items) => {
            let checks = items.iter().map(|it| check_axis_fields(it, axes, problems));
            return checks.fold(true, |all, it| all & it);
        }
        Data::Table(entries) => {
            let checks = entries.iter().map(|it| check_axis_fields(&it.value, axes, problems));
            return checks.fold(true, |all, it| all & it);
        }
        _ => {}
    }
    let Data::Template(pieces) = &value.data else { return true };
    for piece in pieces.iter() {
        let Piece::Field(field) = piece else { continue };
        let axis = &axes[field.axis.0];
        if axis.items.is_empty() {
            // What is wrong with it has been reported.
            return false;
        }
        let Some(index) = axis.field(&field.field) else {
            let message = format!("the items of axis `{}` have no `{}`", axis.name, field.field);
            let hint = suggest(&field.field, axis.named_fields());
            problems.push(
                Diagnostic::error(&value.place, message)
                    .related(Some(&axis.place), "the axis is declared here")
                    .hint(hint),
            );
            return false;
        };
        let is_listed = |it: &axes::Item| it.values[index].written_out().is_none();
        if pieces.len() > 1
            && let Some(item) = axis.items.iter().find(|it| is_listed(it))
        {
            let (written, what) = (&field.written, item.values[index].describe());
            let message = format!("`${{{written}}}` is {what} and cannot stand inside of a text");
            problems.push(Diagnostic::error(&value.place, message));
            return false;
        }
    }
    true
}

/// What a node can say to an inner pipeline.
fn keys_of(document: &Document) -> impl Iterator<Item = &str> {
    let inputs = document.inputs.iter().map(|it| &*it.name.name);
    let params = document.params.iter().map(|it| &*it.key.name);
    inputs.chain(params).chain(["file"])
}
