//! `[outputs]`: the files that the user wants.

use std::{
    collections::{BTreeSet, HashMap},
    path::{Component, Path, PathBuf},
};

use petgraph::graph::NodeIndex;

use super::{
    axes::{self, Point},
    diagnostic::{Diagnostic, Problems},
    expand::{self, Expansion},
    nearest::one_of,
    repeat::{self, Joined, Repeat},
    substitute,
    value::{AxisId, Data, Key, Piece, Value},
    wires::{self, WireEnd},
};
use crate::engine::{
    graph::{OutputRule, Place, PortRef},
    library::Library,
    node::extension_of,
};

/// The output files of the file that was asked for, for every item.
pub fn check(
    expansion: &Expansion,
    repeats: &[Repeat],
    library: &Library,
    problems: &mut Problems,
) -> Vec<OutputRule> {
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
        let path = substitute::substitute_key(key, &scope.names, problems);
        let is_sound = expand::check_axis_fields(&path, &expansion.axes, problems);
        let Some(end) = end.filter(|_| is_sound) else { continue };
        let producer = &repeats[end.draft];
        let Some(joined) = repeat::join(expansion, &end, producer, problems) else { continue };
        if !check_axes(&path, key, &joined, expansion, problems) {
            continue;
        }
        for point in repeat::points(&joined.axes, &expansion.axes) {
            let path = path_at(&path, key, expansion, &point, problems);
            let Some(path) = path.filter(|it| check_format(it, &end, library, key, problems))
            else {
                break;
            };
            if let Some(other) = places.insert(path.clone(), key.place.clone()) {
                let message = format!("`{}` is written twice", path.display());
                let problem = Diagnostic::error(&key.place, message);
                let other = Some(&other).filter(|it| **it != key.place);
                problems.push(problem.related(other, "also written here"));
                break;
            }
            let instance = producer.instance(&joined.picks, &expansion.axes, &point);
            let from = PortRef { instance: NodeIndex::new(instance), port: end.port.name };
            res.push(OutputRule { path, from, place: key.place.clone() });
        }
    }
    res
}

/// The path must name every axis that its wire has, and no other.
fn check_axes(
    path: &Value,
    key: &Key,
    joined: &Joined,
    expansion: &Expansion,
    problems: &mut Problems,
) -> bool {
    let name = |it: &AxisId| &*expansion.axes[it.0].name;
    let mut named = BTreeSet::new();
    path.axis_fields(&mut |it| {
        named.insert(it.axis);
    });
    if let Some(axis) = joined.axes.iter().find(|it| !named.contains(it)) {
        let axis = name(axis);
        let message = format!("all items of `{axis}` would be written to this one file");
        let hint = format!("write `${{{axis}}}` into the path, or gather them with `over`");
        problems.push(Diagnostic::error(&key.place, message).hint(hint));
        return false;
    }
    if let Some(axis) = named.iter().find(|it| !joined.axes.contains(it)) {
        let message = format!("what is written is the same for all items of `{}`", name(axis));
        problems.push(Diagnostic::error(&key.place, message));
        return false;
    }
    true
}

/// The path with items put in, none of which may lead out of its folder.
fn path_at(
    path: &Value,
    key: &Key,
    expansion: &Expansion,
    point: &Point,
    problems: &mut Problems,
) -> Option<PathBuf> {
    let mut escapes = None;
    path.axis_fields(&mut |field| {
        let item =
            Value { data: Data::Template([Piece::Field(field.clone())].into()), ..path.clone() };
        let text = axes::fill(&item, &expansion.axes, point).written_out().unwrap_or_default();
        let is_plain = |it: Component<'_>| matches!(it, Component::Normal(_));
        if text.is_empty() || text.contains('\0') || !Path::new(&text).components().all(is_plain) {
            escapes = Some((field.written.clone(), text));
        }
    });
    if let Some((written, text)) = escapes {
        let message = format!("`${{{written}}}` is \"{text}\", which is no name of a file");
        problems.push(
            Diagnostic::error(&key.place, message)
                .hint("names of items must stay in the folder that the path names".to_owned()),
        );
        return None;
    }
    let filled = axes::fill(path, &expansion.axes, point);
    match filled.written_out() {
        Some(text) => check_path(&text, key, problems),
        None => {
            if !filled.is_broken() {
                let message = format!("a path must be a text, but this is {}", filled.describe());
                problems.push(Diagnostic::error(&key.place, message));
            }
            None
        }
    }
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
    end: &WireEnd,
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
