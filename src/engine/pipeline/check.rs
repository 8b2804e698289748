//! Holds every node against the declaration of its kind.

use std::{
    collections::{BTreeMap, HashMap},
    path::{Path, PathBuf},
};

use petgraph::graph::{DiGraph, NodeIndex};
use serde_json::{Map, Value as Json};

use super::{
    convert::{Converter, Name},
    cycles,
    diagnostic::{Diagnostic, Problems},
    expand::{Draft, Expansion},
    nearest::{nearest, suggest},
    outputs,
    sources::Sources,
    value::{Data, Entry, Value},
    wires::{self, WireEnd},
};
use crate::engine::{
    artifact::ArtifactType,
    graph::{Graph, Instance, Place, PortRef},
    library::Library,
    node::{AnyNode, NodeKind, Port},
    params::Fields,
};

/// By port: where its artifacts come from.
pub type Wires = BTreeMap<&'static str, Vec<PortRef>>;

/// Checks everything; the graph if all nodes are sound.
pub fn check(
    expansion: &Expansion,
    library: &Library,
    sources: &Sources,
    problems: &mut Problems,
) -> Option<Graph> {
    let mut checker = Checker { expansion, library, sources, problems, fields: HashMap::new() };
    let is_inner = |it: &usize| !expansion.scopes[*it].document.inputs.is_empty() || *it > 0;
    let inner = (0..expansion.scopes.len()).filter(is_inner);
    inner.for_each(|it| checker.check_interface(it));
    let wires: Vec<Wires> = expansion.drafts.iter().map(|it| checker.check_wires(it)).collect();
    cycles::report(&expansion.drafts, &wires, checker.problems);
    let drafts = expansion.drafts.iter().zip(wires);
    let instances: Vec<Option<Instance>> =
        drafts.map(|(draft, wires)| checker.check_draft(draft, wires)).collect();
    let outputs = outputs::check(expansion, library, problems);
    let instances = instances.into_iter().collect::<Option<Vec<Instance>>>()?;
    let document = &expansion.scopes[0].document;
    let cites = expansion.scopes.iter().flat_map(|it| &it.document.cites);
    let mut unique_cites: Vec<String> = Vec::new();
    for cite in cites {
        if !unique_cites.contains(cite) {
            unique_cites.push(cite.clone());
        }
    }
    Some(Graph {
        title: document.title.clone(),
        cites: unique_cites,
        instances: connect(instances),
        outputs,
        sources: Vec::new(),
    })
}

/// The graph of instances whose inputs are known; they keep their order.
fn connect(instances: Vec<Instance>) -> DiGraph<Instance, ()> {
    let mut graph = DiGraph::with_capacity(instances.len(), instances.len() * 2);
    let mut edges = Vec::new();
    for (index, instance) in instances.into_iter().enumerate() {
        let start = edges.len();
        edges.extend(
            instance.inputs.values().flatten().map(|it| (it.instance, NodeIndex::new(index))),
        );
        edges[start..].sort_unstable();
        graph.add_node(instance);
    }
    edges.dedup();
    for (from, to) in edges {
        graph.add_edge(from, to, ());
    }
    graph
}

struct Checker<'a> {
    expansion: &'a Expansion,
    library: &'a Library,
    sources: &'a Sources,
    problems: &'a mut Problems,
    /// Parameters by kind, read from its schema once.
    fields: HashMap<&'static str, Fields>,
}

impl Checker<'_> {
    /// Checks what enters an inner pipeline and what leaves it.
    fn check_interface(&mut self, scope_index: usize) {
        let scope = &self.expansion.scopes[scope_index];
        for input in &scope.document.inputs {
            let Some(ty) = self.input_type(&input.ty) else { continue };
            let wire = scope.given.get(&input.name.name);
            let (Some(wire), Some(parent)) = (wire, scope.parent) else { continue };
            if let Some(end) = wires::follow(self.expansion, parent, wire, self.problems)
                && end.port.ty.name != ty.name
            {
                let declared = (&input.name.place, "the input is declared here");
                self.report_wire_type(&input.name.name, ty, end, wire, Some(declared));
            }
        }
        for output in &scope.document.outputs {
            super::parse::check_name(&output.key, self.problems);
            wires::follow(self.expansion, scope_index, &output.value, self.problems);
        }
    }

    fn input_type(&mut self, ty: &Value) -> Option<ArtifactType> {
        let name = super::parse::text(ty, "the type of an input", self.problems)?;
        let found = self.library.artifact_kind(name);
        if found.is_none() {
            let names = self.library.types.iter().map(|it| it.ty.name);
            let message = format!("there is no type `{name}`");
            self.problems.push(Diagnostic::error(&ty.place, message).hint(suggest(name, names)));
        }
        Some(found?.ty)
    }

    fn check_draft(&mut self, draft: &Draft, inputs: Wires) -> Option<Instance> {
        let n_problems = self.problems.len();
        let params = self.check_params(draft);
        let node = self.parse(draft, params?)?;
        let files = self.check_files(draft, node.as_ref());
        (self.problems.len() == n_problems).then(|| Instance {
            name: draft.name.clone(),
            labels: draft.labels.clone(),
            kind: draft.kind,
            node,
            inputs,
            files,
            place: draft.place.clone(),
            field_places: draft
                .fields
                .iter()
                .map(|it| (it.key.name.to_string(), it.value.place.clone()))
                .collect(),
        })
    }

    fn check_wires(&mut self, draft: &Draft) -> Wires {
        let mut res = Wires::new();
        for port in draft.kind.spec.inputs {
            match draft.fields.iter().find(|it| *it.key.name == *port.name) {
                Some(field) => {
                    res.insert(port.name, self.check_port(draft, port, &field.value));
                }
                None if port.arity.may_be_left_out() => {}
                // A misspelt key is reported as such.
                None if is_given(draft, port.name, fields_of(&mut self.fields, draft.kind)) => {}
                None => self.report_missing_wire(draft, port),
            }
        }
        res
    }

    fn check_port(&mut self, draft: &Draft, port: &Port, value: &Value) -> Vec<PortRef> {
        let wires = match &value.data {
            Data::List(_) if !port.arity.takes_list() => {
                let message = format!("`{}` takes one wire, not a list", port.name);
                self.problems.push(Diagnostic::error(&value.place, message));
                return Vec::new();
            }
            Data::List(wires) => wires,
            _ => std::slice::from_ref(value),
        };
        wires.iter().filter_map(|wire| self.check_wire(draft, port, wire)).collect()
    }

    fn check_wire(&mut self, draft: &Draft, port: &Port, wire: &Value) -> Option<PortRef> {
        let end = wires::follow(self.expansion, draft.scope, wire, self.problems)?;
        if end.port.ty.name != port.ty.name {
            self.report_wire_type(port.name, port.ty, end, wire, None);
            return None;
        }
        Some(PortRef { instance: NodeIndex::new(end.draft), port: end.port.name })
    }

    fn report_missing_wire(&mut self, draft: &Draft, port: &Port) {
        let name = draft.local_name();
        let list = match port.arity {
            it if it.takes_list() => format!("; `{} = []` if there are none", port.name),
            _ => String::new(),
        };
        self.problems.push(
            Diagnostic::error(&draft.place, format!("`{name}.{}` is not wired", port.name))
                .hint(format!("it takes `{}`: {}{list}", port.ty.name, port.doc)),
        );
    }

    fn report_wire_type(
        &mut self,
        input: &str,
        wanted: ArtifactType,
        end: WireEnd,
        wire: &Value,
        declared: Option<(&Place, &str)>,
    ) {
        let source = &self.expansion.drafts[end.draft];
        let message =
            format!("`{input}` takes `{}`, but this is `{}`", wanted.name, end.port.ty.name);
        let hint = other_output(source, wanted).or_else(|| self.converting_kind(end, wanted));
        let mut problem = Diagnostic::error(&wire.place, message)
            .label(format!("`{}` of `{}`", end.port.name, source.kind.spec.kind))
            .hint(hint);
        if let Some((place, label)) = declared {
            problem = problem.related(Some(place), label);
        }
        self.problems.push(problem);
    }

    /// The kind that makes the wanted type from what the wire carries, with fewest other inputs.
    fn converting_kind(&self, end: WireEnd, wanted: ArtifactType) -> Option<String> {
        let has = |ports: &[Port], ty: ArtifactType| ports.iter().any(|it| it.ty.name == ty.name);
        let kinds = self.library.kinds.iter().map(|it| &it.spec);
        let kind = kinds
            .filter(|it| has(it.inputs, end.port.ty) && has(it.outputs, wanted))
            .min_by_key(|it| it.inputs.iter().filter(|it| !it.arity.may_be_left_out()).count())?;
        let (kind, wanted, given) = (kind.kind, wanted.name, end.port.ty.name);
        Some(format!("a `{kind}` node makes `{wanted}` from `{given}`"))
    }

    /// The parameters as data, `None` if one of them is wrong.
    fn check_params(&mut self, draft: &Draft) -> Option<Json> {
        let kind = draft.kind;
        let fields = fields_of(&mut self.fields, kind);
        let mut converter = Converter { sources: self.sources, problems: &mut *self.problems };
        let mut res = Some(Map::new());
        for Entry { key, value } in &draft.fields {
            if kind.spec.inputs.iter().any(|it| *it.name == *key.name) {
                continue;
            }
            let converted = match fields.get(&key.name) {
                Some(field) => converter.convert(Name::Field(&field.name), value, &field.shape),
                None => {
                    report_unknown_key(draft, key, fields, converter.problems);
                    None
                }
            };
            match (&mut res, converted) {
                (Some(map), Some(value)) => drop(map.insert(key.name.to_string(), value)),
                _ => res = None,
            }
        }
        for field in fields.list.iter().filter(|it| it.required) {
            if !is_given(draft, &field.name, fields) {
                let message = format!("`{}` needs `{}`", draft.local_name(), field.name);
                let hint = format!("{}: {}", field.shape.describe(), field.doc);
                self.problems.push(Diagnostic::error(&draft.place, message).hint(hint));
                res = None;
            }
        }
        res.map(Json::Object)
    }

    fn parse(&mut self, draft: &Draft, params: Json) -> Option<Box<dyn AnyNode>> {
        let checked = (draft.kind.parse)(params)
            .map_err(|e| e.to_string())
            .and_then(|node| node.validate().map(|()| node));
        checked
            .map_err(|message| {
                // A message that starts with a field's name is shown at that field.
                let field = message.strip_prefix('`').and_then(|it| it.split('`').next());
                let place = field
                    .and_then(|name| draft.fields.iter().find(|it| *it.key.name == *name))
                    .map_or(&draft.place, |it| &it.value.place);
                self.problems.push(Diagnostic::error(place, message));
            })
            .ok()
    }

    /// The files of a node and the files that these refer to; all of them must be there.
    fn check_files(&mut self, draft: &Draft, node: &dyn AnyNode) -> BTreeMap<PathBuf, PathBuf> {
        let mut res = BTreeMap::new();
        for (field, file) in node.files() {
            let path = &file.0;
            let value = draft.fields.iter().find(|it| *it.key.name == *field).map(|it| &it.value);
            if !self.check_file(draft, value, path) {
                continue;
            }
            for side_file in node.side_files(path) {
                self.check_file(draft, value, &side_file);
                res.insert(side_file.clone(), side_file);
            }
            res.insert(path.clone(), path.clone());
        }
        res
    }

    fn check_file(&mut self, draft: &Draft, value: Option<&Value>, path: &Path) -> bool {
        let metadata = std::fs::metadata(path);
        let mut hint = None;
        let message = match &metadata {
            Ok(it) if it.is_file() => return true,
            Ok(_) => format!("`{}` is not a file", path.display()),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
                hint = near_file(path);
                format!("there is no file `{}`", path.display())
            }
            Err(e) => format!("cannot read `{}`: {e}", path.display()),
        };
        let place = value.map_or(&draft.place, |it| &it.place);
        self.problems.push(
            Diagnostic::error(place, message)
                .hint(hint)
                .related(value.and_then(|it| it.origin.as_ref()), "the path is written here"),
        );
        false
    }
}

fn fields_of<'a>(
    fields: &'a mut HashMap<&'static str, Fields>,
    kind: &'static NodeKind,
) -> &'a Fields {
    fields.entry(kind.spec.kind).or_insert_with(|| Fields::of(kind))
}

/// Whether a key is there, or one that is reported as a misspelling of it.
fn is_given(draft: &Draft, name: &str, fields: &Fields) -> bool {
    let spec = &draft.kind.spec;
    let known = || spec.inputs.iter().map(|it| it.name).chain(fields.names());
    let is_meant = |key: &str| {
        key == name || (!known().any(|it| it == key) && nearest(key, known()) == Some(name))
    };
    draft.fields.iter().any(|it| is_meant(&it.key.name))
}

fn report_unknown_key(
    draft: &Draft,
    key: &super::value::Key,
    fields: &Fields,
    problems: &mut Problems,
) {
    let NodeKind { spec, .. } = draft.kind;
    let names = spec.inputs.iter().map(|it| it.name).chain(fields.names()).chain(["kind"]);
    let output = spec.outputs.iter().find(|it| *it.name == *key.name);
    let hint = match output {
        Some(_) => Some(format!("`{}` is an output", key.name)),
        None => suggest(&key.name, names),
    };
    let message = format!("kind `{}` has no key `{}`", spec.kind, key.name);
    problems.push(Diagnostic::error(&key.place, message).hint(hint));
}

fn other_output(source: &Draft, wanted: ArtifactType) -> Option<String> {
    let outputs = source.kind.spec.outputs;
    let output = outputs.iter().find(|it| it.ty.name == wanted.name)?;
    Some(format!("\"@{}.{}\" is `{}`", source.local_name(), output.name, wanted.name))
}

/// A file of nearly this name in the same folder.
fn near_file(path: &Path) -> Option<String> {
    let folder = path.parent().filter(|it| !it.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let entries = match std::fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(_) => return Some(format!("there is no folder `{}`", folder.display())),
    };
    let mut names: Vec<String> =
        entries.flatten().map(|it| it.file_name().to_string_lossy().into_owned()).collect();
    names.sort_unstable();
    let wrong = path.file_name()?.to_str()?;
    let name = nearest(wrong, names.iter().map(String::as_str))?;
    Some(format!("did you mean `{name}`?"))
}
