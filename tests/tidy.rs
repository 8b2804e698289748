//! Rules of the source tree that the compiler does not know. `UPDATE=1` rewrites what is generated.

use std::{
    fs,
    path::{Path, PathBuf},
};

use sinew::{
    LIBRARY,
    engine::{params::Fields, reference, schema, settings::is_node_key},
};

/// Which folder of `src` may import which.
const MAY_IMPORT: [(&str, &[&str]); 5] = [
    ("kernels", &["kernels"]),
    ("engine", &["engine"]),
    ("artifacts", &["artifacts", "engine", "kernels"]),
    ("nodes", &["nodes", "artifacts", "engine", "kernels"]),
    ("report", &["report", "artifacts", "engine", "kernels"]),
];

/// The folders of `src/kernels` from the ground up: each imports only those before it.
const FLOORS: [&str; 15] = [
    "numerics",
    "geometry",
    "spectral",
    "rigs",
    "table",
    "io",
    "remeshing",
    "motion",
    "curve_skeletons",
    "sensors",
    "maps",
    "transfer",
    "pictures",
    "synthetic",
    "matching",
];

/// Parts of the engine that are more than a contract: artifacts and nodes stay away from them.
const CONTRACT: [&str; 5] = ["artifact", "digest", "library", "node", "program"];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// All Rust files below a folder of `src`, sorted.
fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let mut res = Vec::new();
    let Ok(entries) = fs::read_dir(folder) else { return res };
    for entry in entries {
        let path = entry.unwrap().path();
        if path.is_dir() {
            res.extend(rust_files(&path));
        } else if path.extension().is_some_and(|it| it == "rs") {
            res.push(path);
        }
    }
    res.sort();
    res
}

/// Every path below `crate` that a file names, from `use` lists and from the text: `engine::node`.
/// Unit tests, which may use everything, are left out.
fn imports(file: &Path) -> Vec<String> {
    let text = fs::read_to_string(file).unwrap();
    let text = text.split("#[cfg(test)]").next().unwrap_or_default();
    let code: Vec<&str> = text.lines().filter(|it| !it.trim_start().starts_with("//")).collect();
    let code = code.join("\n");
    let mut res = Vec::new();
    for (start, found) in code.match_indices("crate::") {
        let rest = &code[start + found.len()..];
        res.extend(expand(rest).into_iter().filter(|it| !it.is_empty()));
    }
    res
}

/// The first two parts of each path at the start of a text: `a::{b, c::d}` gives `a::b`, `a::c`.
fn expand(text: &str) -> Vec<String> {
    let name_end = text.find(|it: char| !it.is_alphanumeric() && it != '_').unwrap_or(text.len());
    let (name, rest) = text.split_at(name_end);
    if name.is_empty() {
        return items_of_list(text).iter().flat_map(|it| expand(it)).collect();
    }
    let Some(rest) = rest.strip_prefix("::") else { return vec![name.to_owned()] };
    if rest.starts_with('{') {
        return items_of_list(rest)
            .iter()
            .map(|it| format!("{name}::{}", first_name(it)))
            .collect();
    }
    vec![format!("{name}::{}", first_name(rest))]
}

/// The items between the braces at the start of a text.
fn items_of_list(text: &str) -> Vec<&str> {
    let Some(inner) = text.strip_prefix('{') else { return Vec::new() };
    let mut res = Vec::new();
    let (mut depth, mut start) = (0, 0);
    for (index, letter) in inner.char_indices() {
        match letter {
            '{' => depth += 1,
            '}' if depth > 0 => depth -= 1,
            '}' | ',' if depth == 0 => {
                res.push(inner[start..index].trim());
                start = index + 1;
                if letter == '}' {
                    break;
                }
            }
            _ => {}
        }
    }
    res.retain(|it| !it.is_empty());
    res
}

fn first_name(text: &str) -> &str {
    text.split(|it: char| !it.is_alphanumeric() && it != '_').next().unwrap_or_default()
}

#[test]
fn imports_go_one_way() {
    let mut bad = Vec::new();
    for (folder, allowed) in MAY_IMPORT {
        for file in rust_files(&root().join("src").join(folder)) {
            for import in imports(&file) {
                if !allowed.contains(&first_name(&import)) {
                    let file = file.strip_prefix(root()).unwrap().display();
                    bad.push(format!("{file}: `{folder}` may not import `{import}`"));
                }
            }
        }
    }
    assert!(bad.is_empty(), "\n{}\n", bad.join("\n"));
}

#[test]
fn kernels_are_built_on_floors() {
    let kernels = root().join("src/kernels");
    let folders = fs::read_dir(&kernels).unwrap().map(|it| it.unwrap());
    let folders = folders.filter(|it| it.path().is_dir());
    for folder in folders.map(|it| it.file_name().into_string().unwrap()) {
        assert!(FLOORS.contains(&folder.as_str()), "`{folder}` has no place among the floors");
    }
    let mut bad = Vec::new();
    for (floor, folder) in FLOORS.into_iter().enumerate() {
        let is_test =
            |it: &Path| it.file_stem().is_some_and(|it| it.to_string_lossy().ends_with("tests"));
        for file in rust_files(&kernels.join(folder)).into_iter().filter(|it| !is_test(it)) {
            let imports = imports(&file);
            let others = imports.iter().filter_map(|it| it.strip_prefix("kernels::"));
            for other in others.filter(|it| FLOORS[floor + 1..].contains(it)) {
                let file = file.strip_prefix(root()).unwrap().display();
                bad.push(format!("{file}: `{folder}` may not import `{other}`, which is above it"));
            }
        }
    }
    assert!(bad.is_empty(), "\n{}\n", bad.join("\n"));
}

#[test]
fn artifacts_and_nodes_see_only_the_contract_of_the_engine() {
    let mut bad = Vec::new();
    for folder in ["artifacts", "nodes"] {
        for file in rust_files(&root().join("src").join(folder)) {
            for import in imports(&file) {
                let inside = import.strip_prefix("engine::");
                if inside.is_some_and(|it| !CONTRACT.contains(&it)) {
                    bad.push(format!("{}: `{import}`", file.display()));
                }
            }
        }
    }
    assert!(bad.is_empty(), "\n{}\n", bad.join("\n"));
}

#[test]
fn no_kind_imports_another() {
    for file in rust_files(&root().join("src/nodes")) {
        let others = imports(&file).into_iter().find(|it| it.starts_with("nodes"));
        let text = fs::read_to_string(&file).unwrap();
        let is_list = file.file_name().is_some_and(|it| it == "mod.rs");
        // In the folder of a kind, `super` is that kind.
        let is_part = file.parent().is_some_and(|it| !it.ends_with("nodes"));
        assert!(others.is_none(), "{}: {others:?}", file.display());
        assert!(is_list || !text.contains("super::super"), "{}", file.display());
        let own_tests = text.find("#[cfg(test)]").unwrap_or(text.len());
        let is_own = is_list || is_part;
        assert!(is_own || !text[..own_tests].contains("use super::"), "{}", file.display());
    }
}

#[test]
fn imports_are_found_in_lists() {
    let items = |text| expand(text).join(" ");
    assert_eq!(items("engine::{node::{Input, Node}, graph};"), "engine::node engine::graph");
    assert_eq!(items("{engine::graph::Graph, kernels};"), "engine::graph kernels");
    assert_eq!(items("LIBRARY;"), "LIBRARY");
}

#[test]
fn every_file_of_a_kind_is_registered_under_its_name() {
    // A folder beside a file holds what only that kind uses.
    let files = rust_files(&root().join("src/nodes"));
    let own = |it: &&std::path::PathBuf| it.parent().is_some_and(|it| it.ends_with("nodes"));
    let stems = files.iter().filter(own).filter_map(|it| it.file_stem()?.to_str());
    let mut stems: Vec<&str> = stems.filter(|it| *it != "mod").collect();
    stems.sort_unstable();
    let kinds: Vec<&str> = LIBRARY.kinds.iter().map(|it| it.spec.kind).collect();
    assert_eq!(stems, kinds, "the files of src/nodes and the kinds in src/nodes/mod.rs");
}

#[test]
fn registries_are_sorted() {
    assert!(LIBRARY.kinds.is_sorted_by(|a, b| a.spec.kind < b.spec.kind), "nodes::ALL");
    assert!(LIBRARY.types.is_sorted_by(|a, b| a.ty.name < b.ty.name), "artifacts::ALL");
}

#[test]
fn every_kind_is_documented() {
    let mut bad = Vec::new();
    for kind in LIBRARY.kinds {
        let spec = &kind.spec;
        let mut check = |is_good: bool, what: String| {
            if !is_good {
                bad.push(format!("{}: {what}", spec.kind));
            }
        };
        check(!reference::summary(kind).is_empty(), "the struct has no doc comment".to_owned());
        check(spec.example.contains(&format!("kind = \"{}\"", spec.kind)), "example".to_owned());
        let fields = Fields::of(kind);
        check(!fields.open, "unknown parameters are allowed".to_owned());
        for field in &fields.list {
            check(!field.doc.is_empty(), format!("`{}` has no doc comment", field.name));
            let is_port = spec.inputs.iter().any(|it| it.name == field.name);
            check(!is_port, format!("`{}` is a port and a parameter", field.name));
            let is_taken = is_node_key(&field.name);
            check(!is_taken, format!("parameter `{}` is a key of every node", field.name));
        }
        for port in spec.inputs.iter().chain(spec.outputs) {
            check(!port.doc.is_empty(), format!("port `{}` has no doc", port.name));
            let is_taken = is_node_key(port.name);
            check(!is_taken, format!("port `{}` is a key of every node", port.name));
            let is_known = LIBRARY.artifact_kind(port.ty.name).is_some();
            check(is_known, format!("the type of port `{}` is not registered", port.name));
        }
    }
    assert!(bad.is_empty(), "\n{}\n", bad.join("\n"));
}

#[test]
fn the_schema_is_fresh() {
    check_generated("sinew.schema.json", &schema::schema_text(&LIBRARY));
}

#[test]
fn the_reference_is_fresh() {
    check_generated("docs/nodes.md", &reference::markdown(&LIBRARY));
}

/// Compares a committed file with what would be generated.
fn check_generated(name: &str, text: &str) {
    let path = root().join(name);
    if std::env::var_os("UPDATE").is_some() {
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, text).unwrap();
    }
    let found = fs::read_to_string(&path).unwrap_or_default();
    assert!(found == text, "{name} is stale: run `UPDATE=1 cargo test --test tidy`");
}
