//! The reference of kinds, made from their declarations and doc comments alone.

use std::fmt::Write;

use serde_json::{Value as Json, json};

use super::{
    library::Library,
    node::{Arity, NodeKind, Port},
    params::{Field, Fields, Shape},
    settings::NODE_KEYS,
};

/// All kinds as one Markdown document.
pub fn markdown(library: &Library) -> String {
    let mut res = "# Kinds of nodes\n\n\
        Generated from the declarations of the kinds; `sinew nodes KIND` shows one of them.\n\n\
        | kind | |\n|---|---|\n"
        .to_owned();
    for kind in library.kinds {
        let name = kind.spec.kind;
        let _ = writeln!(res, "| [`{name}`](#{name}) | {} |", summary(kind));
    }
    for kind in library.kinds {
        let _ = write!(res, "\n{}", kind_markdown(kind));
    }
    res.push_str(&node_keys_markdown());
    res.push_str(&types_markdown(library));
    res
}

/// What every node's table may say.
fn node_keys_markdown() -> String {
    let mut res = "\n# Keys of every node\n\n\
        How a node is run. None of them changes a result or its key.\n\
        A node of kind `pipeline` hands them to all its nodes that do not say otherwise.\n\
        A duration is a number of seconds, or a text such as \"250ms\", \"90s\", \"10m\" or \"2h\".\n\n\
        | Key | values; default | |\n|---|---|---|\n"
        .to_owned();
    for key in &NODE_KEYS {
        let _ = writeln!(res, "| `{}` | {} | {} |", key.name, cell(key.values), cell(key.doc));
    }
    res
}

/// The first paragraph of a kind's docs, on one line.
pub fn summary(kind: &NodeKind) -> String {
    doc(kind).split("\n\n").next().unwrap_or_default().replace('\n', " ")
}

/// One kind: docs, ports, parameters, citations, an example.
pub fn kind_markdown(kind: &NodeKind) -> String {
    let spec = &kind.spec;
    let mut res = format!("## {}\n\n{}\n", spec.kind, doc(kind));
    ports_markdown(&mut res, "Inputs", spec.inputs);
    params_markdown(&mut res, &Fields::of(kind));
    ports_markdown(&mut res, "Outputs", spec.outputs);
    if !spec.cites.is_empty() {
        let _ = write!(res, "\nPapers: {}.\n", spec.cites.join(", "));
    }
    let _ = write!(res, "\n```toml\n{}\n```\n", spec.example.trim());
    res
}

/// The same as data.
pub fn kind_json(kind: &NodeKind) -> Json {
    let spec = &kind.spec;
    json!({
        "kind": spec.kind,
        "version": spec.version,
        "doc": doc(kind),
        "inputs": spec.inputs.iter().map(port_json).collect::<Vec<Json>>(),
        "outputs": spec.outputs.iter().map(port_json).collect::<Vec<Json>>(),
        "params": (kind.schema)(),
        "cites": spec.cites,
        "example": spec.example,
    })
}

fn doc(kind: &NodeKind) -> String {
    let schema = (kind.schema)();
    schema.get("description").and_then(Json::as_str).unwrap_or_default().to_owned()
}

fn ports_markdown(res: &mut String, title: &str, ports: &[Port]) {
    if ports.is_empty() {
        return;
    }
    let _ = write!(res, "\n| {title} | type | |\n|---|---|---|\n");
    for port in ports {
        let arity = match port.arity {
            Arity::One => "",
            Arity::Optional => ", optional",
            Arity::Many if port.labelled => ", labelled list",
            Arity::Many => ", list",
            Arity::OptionalMany => ", optional list",
        };
        let _ = writeln!(res, "| `{}` | {}{arity} | {} |", port.name, port.ty.name, cell(port.doc));
    }
}

fn params_markdown(res: &mut String, fields: &Fields) {
    if fields.list.is_empty() {
        return;
    }
    res.push_str("\n| Parameter | default | |\n|---|---|---|\n");
    for field in &fields.list {
        let (name, default) = (&field.name, default_text(field));
        let details = details_text(&field.shape);
        let shape = cell(&field.shape.describe());
        let doc = cell(&field.doc);
        let _ =
            writeln!(res, "| `{name}` | {default} | {doc} *{}.*{details} |", capitalized(&shape));
    }
}

fn default_text(field: &Field) -> String {
    match &field.default {
        _ if field.required => "required".to_owned(),
        None | Some(Json::Null) => "none".to_owned(),
        Some(value) => format!("`{value}`"),
    }
}

/// The docs of each choice and of each key of a table, if there are any.
fn details_text(shape: &Shape) -> String {
    let line = |name: &str, doc: &str| match doc {
        "" => String::new(),
        doc => format!("<br>`{name}`: {}", cell(doc)),
    };
    match shape {
        Shape::Choice(names) => names.iter().map(|(name, doc)| line(name, doc)).collect(),
        Shape::Table(fields) => fields.list.iter().map(|it| line(&it.name, &it.doc)).collect(),
        Shape::List { item, .. } => details_text(item),
        Shape::OneOf(shapes) => shapes.iter().map(details_text).collect(),
        _ => String::new(),
    }
}

fn types_markdown(library: &Library) -> String {
    let mut res = "\n# Types of artifacts\n\n| type | |\n|---|---|\n".to_owned();
    for kind in library.types {
        let formats: Vec<String> =
            library.formats(kind.ty).iter().map(|it| format!("`.{}`", it.extension)).collect();
        let formats = match formats.is_empty() {
            true => String::new(),
            false => format!("<br>Files: {}.", formats.join(", ")),
        };
        let _ = writeln!(res, "| `{}` | {}{formats} |", kind.ty.name, cell(kind.ty.doc));
    }
    res
}

/// A text within a table: one line, no bars.
fn cell(text: &str) -> String {
    text.replace('\n', " ").replace('|', "\\|")
}

fn capitalized(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |it| it.to_uppercase().chain(letters).collect())
}

fn port_json(port: &Port) -> Json {
    json!({
        "name": port.name,
        "type": port.ty.name,
        "doc": port.doc,
        "arity": match port.arity {
            Arity::One => "one",
            Arity::Optional => "optional",
            Arity::Many => "many",
            Arity::OptionalMany => "optional_many",
        },
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::toy::TOY;

    #[test]
    fn a_kind_is_shown_with_all_that_it_declares() {
        let text = kind_markdown(TOY.kind("scale").unwrap());
        for line in [
            "## scale",
            "Multiplies a number.",
            "| `number` | number | what is multiplied |",
            "| `factor` | required | What it is multiplied by. *A number from 0 to 1000.* |",
            "| `limit` | none | No result is larger. *An integer of at least 1.* |",
            "factor = 2.0",
        ] {
            assert!(text.contains(line), "{line}\n{text}");
        }
    }
}
