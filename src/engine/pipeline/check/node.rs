//! Holds the parameters and files of one node against the declaration of its kind.

use std::{
    collections::{BTreeMap, HashMap},
    path::{Path, PathBuf},
    sync::Arc,
};

use serde_json::{Map, Value as Json};

use super::{Checker, Wires};
use crate::engine::{
    artifact::ArtifactType,
    node::{AnyNode, CheckedNode, NodeKind},
    params::Fields,
    pipeline::{
        convert::{Converter, Name},
        diagnostic::{Diagnostic, Problems},
        expand::Draft,
        nearest::nearest,
        settings::suggest_key,
        value::{Data, Entry, Key, Value},
    },
};

impl Checker<'_> {
    /// The node with its files, from parameters in which everything is filled in.
    pub(super) fn check_node(
        &mut self,
        draft: &Draft,
        fields: &[Entry],
        wires: Option<&Wires>,
    ) -> Option<(Arc<CheckedNode>, BTreeMap<PathBuf, PathBuf>)> {
        let n_problems = self.problems.len();
        let params = self.check_params(draft, fields);
        let node = self.parse(draft, fields, params?, wires)?;
        let files = self.check_files(draft, fields, node.as_ref());
        (self.problems.len() == n_problems)
            .then(|| (Arc::new(CheckedNode::new(draft.kind, node)), files))
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
            wires.map_or(Ok(()), |it| node.check_inputs(&|port| types_at(it, port)))?;
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

pub(super) fn fields_of<'a>(
    fields: &'a mut HashMap<&'static str, Fields>,
    kind: &'static NodeKind,
) -> &'a Fields {
    fields.entry(kind.spec.kind).or_insert_with(|| Fields::of(kind))
}

/// Whether a key is there, or one that is reported as a misspelling of it.
pub(super) fn is_given(draft: &Draft, name: &str, fields: &Fields) -> bool {
    let spec = &draft.kind.spec;
    let known = || spec.inputs.iter().map(|it| it.name).chain(fields.names());
    let is_meant = |key: &str| !known().any(|it| it == key) && nearest(key, known()) == Some(name);
    let is_there = draft.fields.iter().any(|it| *it.key.name == *name);
    is_there || draft.fields.iter().any(|it| is_meant(&it.key.name))
}

/// The types of the artifacts that are wired to an input.
fn types_at(wires: &Wires, port: &str) -> Vec<ArtifactType> {
    wires.get(port).into_iter().flatten().map(|it| it.port.ty).collect()
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

fn report_unknown_key(draft: &Draft, key: &Key, fields: &Fields, problems: &mut Problems) {
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
