//! Holds every node against the declaration of its kind.

use std::{
    collections::{BTreeMap, BTreeSet, HashMap},
    path::{Path, PathBuf},
    sync::Arc,
};

use petgraph::graph::{DiGraph, NodeIndex};
use serde_json::{Map, Value as Json};

use super::{
    axes::{self, Axis, Point},
    convert::{Converter, Name},
    cycles,
    diagnostic::{Diagnostic, Problems},
    expand::{Draft, Expansion},
    nearest::{nearest, suggest},
    outputs,
    repeat::{self, Joined, Repeat},
    settings::suggest_key,
    sources::Sources,
    value::{AxisId, Data, Entry, Value},
    wires::{self, WireEnd},
};
use crate::engine::{
    artifact::{ANY, ArtifactType},
    graph::{Graph, Inputs, Instance, Place, PortRef},
    labels::InputLabels,
    library::Library,
    node::{AnyNode, NodeKind, Port},
    params::Fields,
};

/// By port: the wires of a draft.
pub type Wires = BTreeMap<&'static str, Vec<WireEnd>>;

/// More instances than any machine plans: two axes that were not meant to be multiplied.
const MOST_INSTANCES: usize = 2_000_000;

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
    let order = cycles::order(&expansion.drafts, &wires, checker.problems);
    // Without its items, nothing true can be said of what uses an axis.
    let has_axes = expansion.axes.iter().all(|it| !it.items.is_empty());
    let repeats = order.filter(|_| has_axes).and_then(|it| checker.repeat(&it, &wires));
    let Some(repeats) = repeats else {
        // Parameters can be checked all the same where they depend on no axis.
        checker.check_constant_drafts();
        return None;
    };
    let mut instances = Vec::new();
    let mut sound = true;
    for (draft, (wires, repeat)) in expansion.drafts.iter().zip(wires.iter().zip(&repeats)) {
        sound &= checker.check_draft(draft, wires, repeat, &repeats, &mut instances);
    }
    let repeats: Vec<Repeat> = repeats.into_iter().map(|it| it.repeat).collect();
    let outputs = outputs::check(expansion, &repeats, library, problems);
    if !sound {
        return None;
    }
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

/// How a draft is repeated, and where its wires lead.
struct Repeated {
    repeat: Repeat,
    /// Axes that are gathered, ascending.
    gathered: Vec<AxisId>,
    /// By port, as [`Wires`].
    joined: BTreeMap<&'static str, Vec<Joined>>,
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
                self.report_wire_type(&input.name.name, ty, &end, wire, Some(declared));
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

    /// The axes of all drafts, `None` if one of them is wrong. `order`: producers first.
    fn repeat(&mut self, order: &[usize], wires: &[Wires]) -> Option<Vec<Repeated>> {
        let mut res: Vec<Option<Repeated>> = Vec::new();
        res.resize_with(wires.len(), || None);
        let mut sound = true;
        for &index in order {
            let repeated = self.repeat_draft(&self.expansion.drafts[index], &wires[index], &res);
            sound &= repeated.is_some();
            res[index] = repeated;
        }
        let mut res = res.into_iter().collect::<Option<Vec<Repeated>>>()?;
        let mut first = 0;
        for it in &mut res {
            it.repeat.first = first;
            first += it.repeat.count;
        }
        if first > MOST_INSTANCES {
            let n_nodes = self.expansion.drafts.len();
            let message = format!("axes multiply {n_nodes} nodes to {first} instances");
            let hint = format!("at most {MOST_INSTANCES} can be planned");
            self.problems.push(Diagnostic::without_place(message).hint(hint));
            return None;
        }
        sound.then_some(res)
    }

    fn repeat_draft(
        &mut self,
        draft: &Draft,
        wires: &Wires,
        done: &[Option<Repeated>],
    ) -> Option<Repeated> {
        let axes = &self.expansion.axes;
        let mut joined: BTreeMap<&'static str, Vec<Joined>> = BTreeMap::new();
        let mut of_wires = BTreeSet::new();
        for (&port, ends) in wires {
            for end in ends {
                let producer = &done[end.draft].as_ref()?.repeat;
                let it = repeat::join(self.expansion, end, producer, self.problems)?;
                of_wires.extend(it.axes.iter().copied());
                joined.entry(port).or_default().push(it);
            }
        }
        let n_problems = self.problems.len();
        let gathered = repeat::gathered(draft, &of_wires, axes, self.problems);
        let own = repeat::own_axes(draft);
        for axis in own.intersection(&gathered) {
            let name = &axes[axis.0].name;
            let node = draft.local_name();
            let message = format!("`{node}` gathers the items of `{name}` and cannot name one");
            self.problems.push(Diagnostic::error(&draft.place, message));
        }
        for port in draft.kind.spec.inputs.iter().filter(|it| !it.arity.takes_list()) {
            let wires = joined.get(port.name).into_iter().flatten();
            if let Some(axis) = wires.flat_map(|it| &it.axes).find(|it| gathered.contains(it)) {
                let name = &axes[axis.0].name;
                let message = format!("`{}` takes one wire, not all items of `{name}`", port.name);
                let place = draft.fields.iter().find(|it| *it.key.name == *port.name);
                let place = place.map_or(&draft.place, |it| &it.value.place);
                self.problems.push(Diagnostic::error(place, message));
            }
        }
        if self.problems.len() > n_problems {
            return None;
        }
        let all = own.union(&of_wires).copied().filter(|it| !gathered.contains(it));
        let all: Vec<AxisId> = all.collect();
        let sizes = all.iter().map(|it| axes[it.0].items.len());
        let count = sizes.fold(1, usize::saturating_mul);
        let repeat = Repeat { axes: all, first: 0, count };
        Some(Repeated { repeat, gathered: gathered.into_iter().collect(), joined })
    }

    /// Checks the parameters of drafts although the graph cannot be made.
    fn check_constant_drafts(&mut self) {
        for draft in &self.expansion.drafts {
            if draft.fields.iter().all(|it| it.value.is_constant()) {
                self.check_node(draft, &draft.fields, None);
            }
        }
    }

    /// Adds the instances of a draft; false if one of them is wrong.
    fn check_draft(
        &mut self,
        draft: &Draft,
        wires: &Wires,
        repeated: &Repeated,
        all: &[Repeated],
        instances: &mut Vec<Instance>,
    ) -> bool {
        let axes = &self.expansion.axes;
        let field_places: Arc<BTreeMap<String, Place>> = Arc::new(
            draft
                .fields
                .iter()
                .map(|it| {
                    let written = it.value.origin.as_ref().unwrap_or(&it.value.place);
                    (it.key.name.to_string(), written.clone())
                })
                .collect(),
        );
        let is_constant = draft.fields.iter().all(|it| it.value.is_constant());
        let shared = if is_constant {
            match self.check_node(draft, &draft.fields, Some(wires)) {
                Some(node) => Some(node),
                None => return false,
            }
        } else {
            None
        };
        let settings = draft.settings.clone().complete();
        let (n_problems, n_before) = (self.problems.len(), instances.len());
        for point in repeated.repeat.points(axes) {
            let node = match &shared {
                Some(node) => Some(node.clone()),
                None => self.check_item(draft, wires, &point),
            };
            // The same mistake at thousands of items is told a few times.
            if self.problems.len() > n_problems + 5 {
                return false;
            }
            let Some((node, files)) = node else { continue };
            let (inputs, input_labels) = inputs(draft, wires, repeated, all, axes, &point);
            instances.push(Instance {
                name: draft.name.clone(),
                labels: repeated.repeat.labels(axes, &point),
                kind: draft.kind,
                node,
                inputs,
                input_labels,
                shows_missing: draft.gather.shows_missing,
                files,
                settings: settings.clone(),
                place: draft.place.clone(),
                field_places: Arc::clone(&field_places),
            });
        }
        // A value that is broken has been reported where it is written.
        instances.len() - n_before == repeated.repeat.count
    }

    /// The node at one item of its axes.
    fn check_item(
        &mut self,
        draft: &Draft,
        wires: &Wires,
        point: &Point,
    ) -> Option<(Arc<dyn AnyNode>, BTreeMap<PathBuf, PathBuf>)> {
        let axes = &self.expansion.axes;
        let fields: Vec<Entry> = draft
            .fields
            .iter()
            .map(|Entry { key, value }| Entry {
                key: key.clone(),
                value: axes::fill(value, axes, point),
            })
            .collect();
        self.check_node(draft, &fields, Some(wires))
    }

    /// The node with its files, from parameters in which everything is filled in.
    fn check_node(
        &mut self,
        draft: &Draft,
        fields: &[Entry],
        wires: Option<&Wires>,
    ) -> Option<(Arc<dyn AnyNode>, BTreeMap<PathBuf, PathBuf>)> {
        let n_problems = self.problems.len();
        let params = self.check_params(draft, fields);
        let node = self.parse(draft, fields, params?, wires)?;
        let files = self.check_files(draft, fields, node.as_ref());
        (self.problems.len() == n_problems).then(|| (Arc::from(node), files))
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

    fn check_port(&mut self, draft: &Draft, port: &Port, value: &Value) -> Vec<WireEnd> {
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

    fn check_wire(&mut self, draft: &Draft, port: &Port, wire: &Value) -> Option<WireEnd> {
        let end = wires::follow(self.expansion, draft.scope, wire, self.problems)?;
        if end.port.ty.name != port.ty.name && port.ty != ANY {
            self.report_wire_type(port.name, port.ty, &end, wire, None);
            return None;
        }
        Some(end)
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
        end: &WireEnd,
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
    fn converting_kind(&self, end: &WireEnd, wanted: ArtifactType) -> Option<String> {
        let has = |ports: &[Port], ty: ArtifactType| ports.iter().any(|it| it.ty.name == ty.name);
        let kinds = self.library.kinds.iter().map(|it| &it.spec);
        let kind = kinds
            .filter(|it| has(it.inputs, end.port.ty) && has(it.outputs, wanted))
            .min_by_key(|it| it.inputs.iter().filter(|it| !it.arity.may_be_left_out()).count())?;
        let (kind, wanted, given) = (kind.kind, wanted.name, end.port.ty.name);
        Some(format!("a `{kind}` node makes `{wanted}` from `{given}`"))
    }

    /// The parameters as data, `None` if one of them is wrong.
    fn check_params(&mut self, draft: &Draft, given: &[Entry]) -> Option<Json> {
        let kind = draft.kind;
        let fields = fields_of(&mut self.fields, kind);
        let mut converter = Converter { sources: self.sources, problems: &mut *self.problems };
        let mut res = Some(Map::new());
        for Entry { key, value } in given {
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

    fn parse(
        &mut self,
        draft: &Draft,
        fields: &[Entry],
        params: Json,
        wires: Option<&Wires>,
    ) -> Option<Box<dyn AnyNode>> {
        let checked = (draft.kind.parse)(params).map_err(|e| e.to_string()).and_then(|node| {
            node.validate()?;
            wires.map_or(Ok(()), |it| node.check_inputs(&types_of(it)))?;
            Ok(node)
        });
        checked
            .map_err(|message| {
                // A message that starts with a field's name is shown at that field.
                let name = message.strip_prefix('`').and_then(|it| it.split('`').next());
                let field = name.and_then(|name| fields.iter().find(|it| *it.key.name == *name));
                let origin = field.and_then(|it| it.value.origin.as_ref());
                let place = field.map_or(&draft.place, |it| &it.value.place);
                self.problems.push(
                    Diagnostic::error(place, message).related(origin, "the value is written here"),
                );
            })
            .ok()
    }

    /// The files of a node and the files that these refer to; all of them must be there.
    fn check_files(
        &mut self,
        draft: &Draft,
        fields: &[Entry],
        node: &dyn AnyNode,
    ) -> BTreeMap<PathBuf, PathBuf> {
        let mut res = BTreeMap::new();
        for (field, file) in node.files() {
            let path = &file.0;
            let value = field_value(fields, &field);
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

/// Where the wires of an instance lead, and what the items are called that labelled ports gather.
fn inputs(
    draft: &Draft,
    wires: &Wires,
    repeated: &Repeated,
    all: &[Repeated],
    axes: &[Axis],
    point: &Point,
) -> (Inputs, InputLabels) {
    let (mut inputs, mut labels) = (Inputs::new(), InputLabels::new());
    for (&name, ends) in wires {
        let port = draft.kind.spec.inputs.iter().find(|it| it.name == name);
        let is_labelled = port.is_some_and(|it| it.labelled);
        let (mut refs, mut port_labels) = (Vec::new(), Vec::new());
        let joined = repeated.joined.get(name).into_iter().flatten();
        for (end, joined) in ends.iter().zip(joined) {
            let producer = &all[end.draft].repeat;
            let over: Vec<AxisId> =
                joined.axes.iter().copied().filter(|it| repeated.gathered.contains(it)).collect();
            for gathered in repeat::points(&over, axes) {
                let whole: Vec<(AxisId, usize)> = point.iter().chain(&gathered).copied().collect();
                let instance = producer.instance(&joined.picks, axes, &whole);
                refs.push(PortRef { instance: NodeIndex::new(instance), port: end.port.name });
                if is_labelled {
                    port_labels.push(repeated.repeat.labels(axes, &gathered));
                }
            }
        }
        inputs.insert(name, refs);
        if is_labelled {
            labels.insert(name, port_labels);
        }
    }
    (inputs, labels)
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

/// The types of the artifacts that are wired to each input.
fn types_of(wires: &Wires) -> BTreeMap<&'static str, Vec<ArtifactType>> {
    let types = |ends: &Vec<WireEnd>| ends.iter().map(|it| it.port.ty).collect();
    wires.iter().map(|(port, ends)| (*port, types(ends))).collect()
}

/// The value of a field, or of a name in a field that is a table (`files.script`).
fn field_value<'a>(fields: &'a [Entry], field: &str) -> Option<&'a Value> {
    let (field, name) = field.split_once('.').map_or((field, None), |it| (it.0, Some(it.1)));
    let value = &fields.iter().find(|it| *it.key.name == *field)?.value;
    match (name, &value.data) {
        (Some(name), Data::Table(entries)) => {
            entries.iter().find(|it| *it.key.name == *name).map(|it| &it.value)
        }
        _ => Some(value),
    }
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
        None => suggest_key(&key.name, names),
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
