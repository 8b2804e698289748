//! Ports that a pipeline declares: `inputs` and `outputs` in the table of a node of an open kind.
//!
//! They become the ports of a kind of its own, made once for each set of ports. So everything behind
//! sees kinds with fixed ports only, and a pipeline of many such nodes costs no more than another.

use std::{
    collections::HashMap,
    hash::{Hash, Hasher},
    sync::{Arc, LazyLock, Mutex},
};

use serde_json::Value as Json;

use super::{
    diagnostic::{Diagnostic, Problems},
    nearest::suggest,
    parse,
    value::{Data, Entry, Key, Value},
};
use crate::engine::{
    artifact::{ANY, ArtifactType},
    library::Library,
    node::{Arity, NodeKind, Port, Spec},
    params::Fields,
    settings::is_node_key,
};

const INPUTS: &str = "inputs";
const OUTPUTS: &str = "outputs";

/// Keys of nodes, which would be taken for an input of such a name, beside those of [`is_node_key`].
const RESERVED: [&str; 3] = ["kind", "missing", "over"];

/// The kind with the ports that the fields of a node declare, and the fields with every wire under the
/// name of its port. What is left of `inputs` says which ports take lists: that is a parameter, since
/// one artifact and a list of one are not the same to a program.
pub fn declared(
    kind: &'static NodeKind,
    mut fields: Vec<Entry>,
    library: &Library,
    problems: &mut Problems,
) -> (&'static NodeKind, Vec<Entry>) {
    if !kind.open {
        return (kind, fields);
    }
    let mut ports = Ports::default();
    let mut wires = Vec::new();
    for Entry { key, value } in &mut fields {
        let read = match &*key.name {
            INPUTS => read_inputs(value, kind, &mut ports, &mut wires, problems),
            OUTPUTS => read_outputs(value, kind, library, &mut ports, problems),
            _ => true,
        };
        if !read {
            *value = value.broken();
        }
    }
    fields.extend(wires);
    (kind_with(ports, kind), fields)
}

/// The kind with the ports that its parameters are left with; any other kind as it is.
///
/// # Panics
/// If the parameters are not those of a checked node.
pub fn with_ports(kind: &'static NodeKind, params: &Json, library: &Library) -> &'static NodeKind {
    if !kind.open {
        return kind;
    }
    let table = |name: &str| params[name].as_object().into_iter().flatten();
    let arity = |it: &Json| serde_json::from_value(it.clone()).expect("checked parameters");
    let ty = |it: &Json| {
        let known = it.as_str().and_then(|it| library.artifact_kind(it));
        Type(known.expect("checked parameters").ty)
    };
    let inputs = table(INPUTS).map(|(name, it)| (name.as_str().into(), arity(it))).collect();
    let outputs = table(OUTPUTS).map(|(name, it)| (name.as_str().into(), ty(it))).collect();
    kind_with(Ports { inputs, outputs }, kind)
}

/// The ports of one node, in the order of the file.
#[derive(Default, PartialEq, Eq, Hash)]
struct Ports {
    inputs: Vec<(Arc<str>, Arity)>,
    outputs: Vec<(Arc<str>, Type)>,
}

/// A type of artifacts; a library has one of each name.
struct Type(ArtifactType);

impl PartialEq for Type {
    fn eq(&self, other: &Self) -> bool {
        self.0.name == other.0.name
    }
}

impl Eq for Type {}

impl Hash for Type {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.0.name.hash(state);
    }
}

/// Moves the wires out of `inputs`. Whether all of it can be read.
fn read_inputs(
    value: &mut Value,
    kind: &'static NodeKind,
    ports: &mut Ports,
    wires: &mut Vec<Entry>,
    problems: &mut Problems,
) -> bool {
    let Data::Table(entries) = &value.data else { return report_no_table(value, INPUTS, problems) };
    let mut arities = Vec::new();
    for Entry { key, value } in entries.iter() {
        if !parse::check_name(key, problems) {
            return false;
        }
        if RESERVED.contains(&&*key.name) || is_node_key(&key.name) {
            let message = format!("`{}` is a key of every node", key.name);
            let hint = "give the input another name".to_owned();
            problems.push(Diagnostic::error(&key.place, message).hint(hint));
            return false;
        }
        if with_open_kind(kind, |it| it.params.get(&key.name).is_some()) {
            let message = format!("`{}` is a parameter of `{}`", key.name, kind.spec.kind);
            let hint = "give the input another name".to_owned();
            problems.push(Diagnostic::error(&key.place, message).hint(hint));
            return false;
        }
        let (arity, word) = match value.data {
            Data::List(_) => (Arity::Many, "many"),
            _ => (Arity::One, "one"),
        };
        ports.inputs.push((Arc::clone(&key.name), arity));
        wires.push(Entry { key: key.clone(), value: value.clone() });
        let data = Data::Text(word.into());
        arities.push(Entry { key: key.clone(), value: Value { data, ..value.clone() } });
    }
    value.data = Data::Table(arities.into());
    true
}

/// Reads the names and types of outputs. Whether all of it can be read.
fn read_outputs(
    value: &Value,
    kind: &NodeKind,
    library: &Library,
    ports: &mut Ports,
    problems: &mut Problems,
) -> bool {
    let Data::Table(entries) = &value.data else {
        return report_no_table(value, OUTPUTS, problems);
    };
    let mut all_read = true;
    for Entry { key, value } in entries.iter() {
        let is_taken = kind.spec.outputs.iter().any(|it| *it.name == *key.name);
        if is_taken {
            let message = format!("every `{}` has the output `{}`", kind.spec.kind, key.name);
            let hint = "give this one another name".to_owned();
            problems.push(Diagnostic::error(&key.place, message).hint(hint));
        }
        match output_type(key, value, library, problems) {
            Some(ty) if !is_taken => ports.outputs.push((Arc::clone(&key.name), Type(ty))),
            _ => all_read = false,
        }
    }
    all_read
}

fn output_type(
    key: &Key,
    value: &Value,
    library: &Library,
    problems: &mut Problems,
) -> Option<ArtifactType> {
    if !parse::check_name(key, problems) {
        return None;
    }
    let name = parse::text(value, &format!("the type of the output `{}`", key.name), problems)?;
    let found = library.artifact_kind(name);
    if found.is_none() {
        let names = library.types.iter().map(|it| it.ty.name);
        let hint = suggest(name, names).unwrap_or("`sinew nodes` lists all types".to_owned());
        let message = format!("there is no type `{name}`");
        problems.push(Diagnostic::error(&value.place, message).hint(hint));
    }
    Some(found?.ty)
}

fn report_no_table(value: &Value, name: &str, problems: &mut Problems) -> bool {
    if !value.is_broken() {
        let message = format!("`{name}` must be a table, but is {}", value.describe());
        let example = match name {
            INPUTS => "inputs = { mesh = \"@node.mesh\" }",
            _ => "outputs = { map = \"functional_map\" }",
        };
        problems.push(Diagnostic::error(&value.place, message).hint(format!("write `{example}`")));
    }
    false
}

/// An open kind: its parameters, and the kinds that were made of it. These live as long as the program,
/// as all kinds do; there are as many as there are different sets of ports.
struct OpenKind {
    params: Fields,
    kinds: HashMap<Ports, &'static NodeKind>,
}

/// By the address of the open kind, since two libraries may have kinds of one name.
static OPEN_KINDS: LazyLock<Mutex<HashMap<usize, OpenKind>>> = LazyLock::new(Mutex::default);

fn with_open_kind<T>(kind: &'static NodeKind, then: impl FnOnce(&mut OpenKind) -> T) -> T {
    let mut kinds = OPEN_KINDS.lock().expect("nothing that is done with an open kind panics");
    let new = || OpenKind { params: Fields::of(kind), kinds: HashMap::new() };
    then(kinds.entry(std::ptr::from_ref(kind).addr()).or_insert_with(new))
}

/// The one kind that is `open` with these ports.
fn kind_with(ports: Ports, open: &'static NodeKind) -> &'static NodeKind {
    with_open_kind(open, |it| {
        if let Some(kind) = it.kinds.get(&ports) {
            return *kind;
        }
        let kind: &NodeKind = Box::leak(Box::new(new_kind(&ports, open)));
        it.kinds.insert(ports, kind);
        kind
    })
}

fn new_kind(ports: &Ports, open: &NodeKind) -> NodeKind {
    let port = |name: &str, doc, ty, arity: Arity| {
        let name = Box::leak(name.to_owned().into_boxed_str());
        let labelled = open.labels_lists && arity.takes_list();
        Port { name, doc, ty, arity, labelled, aside: false }
    };
    let input = |(name, arity): &(Arc<str>, Arity)| {
        port(name, "what the pipeline wires to it", ANY, *arity)
    };
    let output =
        |(name, ty): &(Arc<str>, Type)| port(name, "what the pipeline declares", ty.0, Arity::One);
    let inputs = open.spec.inputs.iter().copied().chain(ports.inputs.iter().map(input));
    let outputs = ports.outputs.iter().map(output).chain(open.spec.outputs.iter().copied());
    let spec = Spec {
        inputs: Vec::leak(inputs.collect()),
        outputs: Vec::leak(outputs.collect()),
        ..open.spec
    };
    NodeKind { spec, open: false, declared: true, ..*open }
}
