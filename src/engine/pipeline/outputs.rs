//! `[outputs]`: the files that the user wants.

use std::{
    collections::HashMap,
    path::{Component, Path, PathBuf},
};

use petgraph::graph::NodeIndex;

use super::{
    diagnostic::{Diagnostic, Problems},
    expand::Expansion,
    nearest::one_of,
    substitute,
    value::Key,
    wires::{self, WireEnd},
};
use crate::engine::{
    graph::{OutputRule, Place, PortRef},
    library::Library,
    node::extension_of,
};

/// The output files of the file that was asked for.
pub fn check(expansion: &Expansion, library: &Library, problems: &mut Problems) -> Vec<OutputRule> {
    let scope = &expansion.scopes[0];
    if !scope.document.inputs.is_empty() {
        // The outputs of an inner pipeline are names; that it cannot run alone has been reported.
        return Vec::new();
    }
    let mut res = Vec::new();
    let mut places: HashMap<PathBuf, Place> = HashMap::new();
    for entry in &scope.document.outputs {
        let key = &entry.key;
        let end = wires::follow(expansion, 0, &entry.value, problems);
        let path = substitute::substitute_key(key, &scope.params, problems);
        let path = path.and_then(|it| check_path(&it, key, problems));
        let (Some(path), Some(end)) = (path, end) else { continue };
        if !check_format(&path, end, library, key, problems) {
            continue;
        }
        if let Some(other) = places.insert(path.clone(), key.place.clone()) {
            let message = format!("`{}` is written twice", path.display());
            problems.push(
                Diagnostic::error(&key.place, message).related(Some(&other), "also written here"),
            );
        }
        let from = PortRef { instance: NodeIndex::new(end.draft), port: end.port.name };
        res.push(OutputRule { path, from, place: key.place.clone() });
    }
    res
}

/// The path without `.` and `..`, which must stay below the current folder.
fn check_path(path: &str, key: &Key, problems: &mut Problems) -> Option<PathBuf> {
    let mut res = PathBuf::new();
    for component in Path::new(path).components() {
        let inside = match component {
            Component::Normal(name) => {
                res.push(name);
                true
            }
            Component::CurDir => true,
            Component::ParentDir => res.pop(),
            Component::RootDir | Component::Prefix(_) => false,
        };
        if !inside {
            let message = format!("`{path}` lies outside of the current folder");
            problems.push(
                Diagnostic::error(&key.place, message)
                    .hint("outputs are written into the folder where `sinew` is run".to_owned()),
            );
            return None;
        }
    }
    Some(res)
}

fn check_format(
    path: &Path,
    end: WireEnd,
    library: &Library,
    key: &Key,
    problems: &mut Problems,
) -> bool {
    let extension = extension_of(path);
    let ty = end.port.ty;
    let formats = library.formats(ty);
    if formats.iter().any(|it| it.extension == extension) {
        return true;
    }
    let message = match extension.is_empty() {
        true => format!("`{}` has no extension that chooses a format", path.display()),
        false => format!("`{}` cannot be written as .{extension}", ty.name),
    };
    let hint = match formats.is_empty() {
        true => format!("`{}` cannot be written to a file", ty.name),
        false => format!("its formats are {}", one_of(formats.iter().map(|it| it.extension))),
    };
    problems.push(Diagnostic::error(&key.place, message).hint(hint));
    false
}
