//! `--profile` and `--set`: other values for parameters of the file that was asked for.

use std::path::PathBuf;

use toml::de::DeTable;

use super::{
    Settings,
    diagnostic::{Diagnostic, Problems},
    nearest::suggest,
    parse::{Document, NodeTable, Profile},
    sources::Sources,
    value::{self, Data, Entry, Key, Value},
};
use crate::engine::graph::Place;

/// Applies the profile, then every `--set` in its order.
pub fn apply(
    document: &mut Document,
    settings: &Settings,
    sources: &mut Sources,
    problems: &mut Problems,
) {
    check_profiles(document, problems);
    if let Some(name) = &settings.profile {
        apply_profile(document, name, sources, problems);
    }
    for text in &settings.set {
        let source = sources.add("--set".into(), text, PathBuf::new());
        if let Some(set) = read_set(text, source, problems) {
            apply_set(document, set, problems);
        }
    }
}

/// Every profile may only name parameters that there are.
fn check_profiles(document: &Document, problems: &mut Problems) {
    for Profile { name: profile, params } in &document.profiles {
        for Key { name, place } in params.iter().map(|it| &it.key) {
            if document.params.iter().all(|it| it.key.name != *name) {
                let message = format!("profile `{}` sets no parameter: `{name}`", profile.name);
                let names = document.params.iter().map(|it| &*it.key.name);
                problems.push(Diagnostic::error(place, message).hint(suggest(name, names)));
            }
        }
    }
}

fn apply_profile(
    document: &mut Document,
    name: &str,
    sources: &mut Sources,
    problems: &mut Problems,
) {
    let Some(profile) = document.profiles.iter().find(|it| *it.name.name == *name) else {
        let source = sources.add("--profile".into(), name, PathBuf::new());
        let place = Place::new(source, 0..name.len());
        let names = document.profiles.iter().map(|it| &*it.name.name);
        let hint = suggest(name, names).or_else(|| Some("the file has no profiles".to_owned()));
        let message = format!("there is no profile `{name}`");
        problems.push(Diagnostic::error(&place, message).hint(hint));
        return;
    };
    for Entry { key, value } in &profile.params {
        if let Some(param) = document.params.iter_mut().find(|it| it.key.name == key.name) {
            param.value = value.clone();
        }
    }
}

/// `path=value`.
struct Set<'a> {
    /// Of a parameter; or a node and one of its keys.
    path: Vec<&'a str>,
    value: Value,
    /// Of the path.
    place: Place,
}

fn read_set<'a>(text: &'a str, source: usize, problems: &mut Problems) -> Option<Set<'a>> {
    let Some((path, value)) = text.split_once('=').filter(|it| !it.0.trim().is_empty()) else {
        let place = Place::new(source, 0..text.len());
        problems.push(
            Diagnostic::error(&place, "a setting is written as `name=value`")
                .hint("for example `--set k=60` or `--set eigs.k=60`".to_owned()),
        );
        return None;
    };
    let place = Place::new(source, 0..path.trim_end().len());
    let value = read_value(path, value, source, problems).unwrap_or_else(|| {
        let place = Place::new(source, path.len() + 1..text.len());
        Value::new(Data::Text(value.into()), place)
    });
    let mut path: Vec<&str> = path.trim().split('.').collect();
    if path.len() > 1 && (path[0] == "params" || path[0] == "nodes") {
        path.remove(0);
    }
    Some(Set { path, value, place })
}

/// The value as TOML, with the places that it has behind `path=`; `None` if it is a plain text.
fn read_value(path: &str, value: &str, source: usize, problems: &mut Problems) -> Option<Value> {
    // A key of the same length stands for the path, whose dots and names mean something else here.
    let aligned = format!("{:1$}={value}", "v", path.len());
    let mut entries = DeTable::parse(&aligned).ok()?.into_inner().into_iter();
    let (_, parsed) = entries.next()?;
    let is_value = entries.next().is_none() && !parsed.get_ref().is_datetime();
    is_value.then(|| value::read(parsed, source, problems))
}

fn apply_set(document: &mut Document, set: Set<'_>, problems: &mut Problems) {
    match set.path[..] {
        [name] => match document.params.iter_mut().find(|it| *it.key.name == *name) {
            Some(param) => param.value = set.value,
            None => {
                let names = document.params.iter().map(|it| &*it.key.name);
                let hint = suggest(name, names)
                    .unwrap_or_else(|| "the file has no such `[params]`".to_owned());
                let message = format!("there is no parameter `{name}`");
                problems.push(Diagnostic::error(&set.place, message).hint(hint));
            }
        },
        ["axes", axis, ref keys @ ..] => {
            match document.axes.iter_mut().find(|it| *it.name.name == *axis) {
                Some(axis) => insert(&mut axis.fields, keys, &set),
                None => {
                    let names = document.axes.iter().map(|it| &*it.name.name);
                    let message = format!("there is no axis `{axis}`");
                    let hint = suggest(axis, names);
                    problems.push(Diagnostic::error(&set.place, message).hint(hint));
                }
            }
        }
        [node, ref keys @ ..] => {
            match document.nodes.iter_mut().find(|it| *it.name.name == *node) {
                Some(node) => set_field(node, keys, &set),
                None => {
                    let names = document.nodes.iter().map(|it| &*it.name.name);
                    let message = format!("there is no node `{node}`");
                    let hint = suggest(node, names);
                    problems.push(Diagnostic::error(&set.place, message).hint(hint));
                }
            }
        }
        [] => unreachable!("splitting gives at least one part"),
    }
}

/// Replaces or adds a field; whether there is such a field is checked later like any other.
fn set_field(node: &mut NodeTable, keys: &[&str], set: &Set<'_>) {
    let mut fields = std::mem::take(&mut node.fields);
    insert(&mut fields, keys, set);
    node.fields = fields;
}

fn insert(fields: &mut Vec<Entry>, keys: &[&str], set: &Set<'_>) {
    let [name, rest @ ..] = keys else { return };
    let key = Key { name: (*name).into(), place: set.place.clone() };
    let found = fields.iter_mut().position(|it| *it.key.name == **name);
    let old = found.map(|index| fields.remove(index).value);
    let value = if rest.is_empty() {
        set.value.clone()
    } else {
        let mut inner = match old {
            Some(Value { data: Data::Table(entries), .. }) => entries.to_vec(),
            _ => Vec::new(),
        };
        insert(&mut inner, rest, set);
        Value { data: Data::Table(inner.into()), ..set.value.clone() }
    };
    fields.push(Entry { key, value });
}
