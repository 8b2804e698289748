//! The JSON schema of pipeline files, for completion and checks in editors.

use serde_json::{Map, Value as Json, json};

use super::{
    library::Library,
    node::{NodeKind, Port},
    settings::NODE_KEYS,
};

/// The schema of pipeline files over these kinds.
///
/// A node is `oneOf` the kinds, each with its name as a constant: the form that editors complete.
pub fn schema(library: &Library) -> Json {
    let mut definitions = Map::new();
    definitions.insert(
        "template".to_owned(),
        json!({ "type": "string", "pattern": "\\$\\{", "description": "A `${parameter}`." }),
    );
    definitions.insert(
        "wire".to_owned(),
        json!({ "type": "string", "pattern": "^@|\\$\\{", "description": "\"@node.port\"." }),
    );
    definitions.extend(NODE_KEYS.iter().map(|it| {
        let schema = json!({ "description": it.doc, "allOf": [(it.schema)()] });
        (format!("node.{}", it.name), or_template(schema))
    }));
    let types: Vec<&str> = library.types.iter().map(|it| it.ty.name).collect();
    let kinds: Vec<Json> =
        library.kinds.iter().map(|it| kind_schema(it, &types, &mut definitions)).collect();
    let nodes = kinds.into_iter().chain([inner_pipeline_schema()]);
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Sinew pipeline",
        "type": "object",
        "additionalProperties": false,
        "properties": {
            "pipeline": heading_schema(),
            "inputs": inputs_schema(&types),
            "params": table_of(json!({}), "Parameters: `--set name=value` overrides them."),
            "axes": table_of(
                axis_schema(),
                "Lists of items along which nodes are repeated: data sets, sweeps, pairs.",
            ),
            "profiles": table_of(json!({ "type": "object" }), "Parameters for `--profile NAME`."),
            "nodes": table_of(json!({ "oneOf": nodes.collect::<Vec<Json>>() }), "What is computed."),
            "outputs": table_of(
                json!({ "$ref": "#/$defs/wire" }),
                "From paths of files (the extension chooses the format) to wires.",
            ),
        },
        "$defs": definitions,
    })
}

/// As it is committed: indented, with a line end.
pub fn schema_text(library: &Library) -> String {
    format!("{:#}\n", schema(library))
}

fn heading_schema() -> Json {
    json!({
        "type": "object",
        "additionalProperties": false,
        "properties": {
            "title": { "type": "string" },
            "description": { "type": "string" },
            "cite": {
                "description": "BibTeX keys.",
                "anyOf": [
                    { "type": "string" },
                    { "type": "array", "items": { "type": "string" } },
                ],
            },
        },
    })
}

fn inputs_schema(types: &[&str]) -> Json {
    let ty = json!({ "type": "string", "enum": types });
    let table = json!({
        "type": "object",
        "additionalProperties": false,
        "required": ["type"],
        "properties": { "type": ty, "doc": { "type": "string" } },
    });
    table_of(json!({ "anyOf": [ty, table] }), "What an inner pipeline takes, by type.")
}

/// The keys of an axis are those that `pipeline::axes` reads.
fn axis_schema() -> Json {
    let number = json!({ "anyOf": [{ "type": "number" }, { "$ref": "#/$defs/template" }] });
    let patterns = json!({
        "description": "The files that match a pattern, relative to this file: `${axis.path}`, \
            `.name`, `.stem`.",
        "anyOf": [{ "type": "string" }, { "type": "array", "items": { "type": "string" } }],
    });
    json!({
        "type": "object",
        "additionalProperties": false,
        "properties": {
            "values": {
                "description": "Items: values, or tables with the same keys; a table of lists of \
                    one length is taken item by item.",
                "anyOf": [{ "type": "array" }, { "type": "object" }, { "$ref": "#/$defs/template" }],
            },
            "range": {
                "description": "Numbers from one to another, both included.",
                "type": "object",
                "additionalProperties": false,
                "required": ["from", "to"],
                "properties": {
                    "from": number,
                    "to": number,
                    "step": number,
                    "n": { "type": "integer", "minimum": 1 },
                    "log": { "type": "boolean", "description": "Equal ratios instead of steps." },
                },
            },
            "files": patterns,
            "table": { "type": "string", "description": "Rows of a .csv, .tsv or .toml file." },
            "zip": { "type": "object", "description": "Axes of one length, item by item." },
            "pairs": {
                "type": "string",
                "description": "The items of another axis, two by two: `${axis.source.stem}`, \
                    `\"@node[shape=axis.target]\"`.",
            },
            "which": {
                "enum": ["different", "unordered", "all"],
                "description": "Which pairs: without those of an item with itself (the default), \
                    one of each two, or all.",
            },
            "copy_of": { "type": "string", "description": "The items of another axis once more." },
            "where": {
                "type": "string",
                "description": "Which items are kept: `index < 5 and not stem ~ 'test*'`.",
            },
            "label": { "type": "string", "description": "What items are called: `${stem}`." },
        },
    })
}

fn table_of(value: Json, description: &str) -> Json {
    json!({ "type": "object", "description": description, "additionalProperties": value })
}

/// The keys that every node may have, by reference.
fn node_keys() -> impl Iterator<Item = (String, Json)> {
    let reference = |name| json!({ "$ref": format!("#/$defs/node.{name}") });
    NODE_KEYS.iter().map(move |it| (it.name.to_owned(), reference(it.name)))
}

fn inner_pipeline_schema() -> Json {
    let mut properties = Map::new();
    properties.insert("kind".to_owned(), json!({ "const": "pipeline" }));
    let file = json!({ "type": "string", "description": "Relative to this file." });
    properties.insert("file".to_owned(), file);
    properties.extend(node_keys());
    json!({
        "title": "pipeline",
        "description": "Another file: its inputs, parameters and outputs are those of this node.",
        "type": "object",
        "required": ["kind", "file"],
        "properties": properties,
    })
}

fn kind_schema(kind: &NodeKind, types: &[&str], definitions: &mut Map<String, Json>) -> Json {
    let spec = &kind.spec;
    let mut schema = Json::from((kind.schema)());
    rename_references(&mut schema, spec.kind);
    if let Some(Json::Object(own)) = schema.get_mut("$defs").map(Json::take) {
        let named = own.into_iter().map(|(name, it)| (format!("{}.{name}", spec.kind), it));
        definitions.extend(named);
    }
    let description = schema.get("description").cloned().unwrap_or_default();
    let mut properties = Map::new();
    properties.insert("kind".to_owned(), json!({ "const": spec.kind, "description": description }));
    if spec.inputs.iter().any(|it| it.arity.takes_list()) {
        properties.insert("over".to_owned(), over_schema());
    }
    if spec.inputs.iter().any(|it| it.labelled) {
        properties.insert("missing".to_owned(), missing_schema());
    }
    properties.extend(spec.inputs.iter().map(|it| (it.name.to_owned(), port_schema(it))));
    if let Some(Json::Object(params)) = schema.get_mut("properties").map(Json::take) {
        properties.extend(params.into_iter().map(|(name, it)| (name, or_template(it))));
    }
    properties.extend(node_keys());
    if kind.open {
        declare_ports(&mut properties, types);
    }
    let ports = spec.inputs.iter().filter(|it| !it.arity.may_be_left_out()).map(|it| it.name);
    let mut required: Vec<Json> = ["kind"].into_iter().chain(ports).map(Json::from).collect();
    if let Some(Json::Array(params)) = schema.get_mut("required").map(Json::take) {
        required.extend(params);
    }
    json!({
        "title": spec.kind,
        "description": description,
        "type": "object",
        "additionalProperties": false,
        "required": required,
        "properties": properties,
    })
}

fn over_schema() -> Json {
    json!({
        "description": "Axes whose items are gathered; \"*\" for all that the inputs have.",
        "anyOf": [{ "type": "string" }, { "type": "array", "items": { "type": "string" } }],
    })
}

fn missing_schema() -> Json {
    json!({
        "enum": ["fail", "show"],
        "description": "Whether items that failed stop this node as well (the default), or are shown.",
    })
}

/// What a pipeline writes for the ports of an open kind, where the parameters say what becomes of it.
fn declare_ports(properties: &mut Map<String, Json>, types: &[&str]) {
    let values =
        [("inputs", wire_or_list()), ("outputs", json!({ "type": "string", "enum": types }))];
    for (name, value) in values {
        let description = properties[name]["description"].clone();
        properties[name] = json!({
            "description": description,
            "type": "object",
            "additionalProperties": value,
        });
    }
}

fn wire_or_list() -> Json {
    let wire = json!({ "$ref": "#/$defs/wire" });
    json!({ "anyOf": [wire, { "type": "array", "items": wire }] })
}

fn port_schema(port: &Port) -> Json {
    let wire = json!({ "$ref": "#/$defs/wire" });
    let description = format!("`{}`: {}", port.ty.name, port.doc);
    if port.arity.takes_list() {
        json!({ "description": description, "anyOf": wire_or_list()["anyOf"] })
    } else {
        json!({ "description": description, "allOf": [wire] })
    }
}

/// A parameter, or the `${}` that stands for it; docs and default stay outside.
fn or_template(mut param: Json) -> Json {
    let mut res = Map::new();
    if let Some(object) = param.as_object_mut() {
        for key in ["description", "default"] {
            res.extend(object.shift_remove(key).map(|it| (key.to_owned(), it)));
        }
    }
    res.insert("anyOf".to_owned(), json!([param, { "$ref": "#/$defs/template" }]));
    Json::Object(res)
}

/// Puts the name of the kind before the names of its own definitions.
fn rename_references(schema: &mut Json, kind: &str) {
    match schema {
        Json::Object(object) => {
            if let Some(Json::String(target)) = object.get_mut("$ref") {
                *target = target.replace("#/$defs/", &format!("#/$defs/{kind}."));
            }
            object.values_mut().for_each(|it| rename_references(it, kind));
        }
        Json::Array(items) => items.iter_mut().for_each(|it| rename_references(it, kind)),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::toy::TOY;

    #[test]
    fn a_node_is_one_of_the_kinds_by_a_constant() {
        let schema = schema(&TOY);
        let nodes = schema["properties"]["nodes"]["additionalProperties"]["oneOf"].as_array();
        let scale = nodes.unwrap().iter().find(|it| it["title"] == "scale").unwrap();
        assert_eq!(scale["properties"]["kind"]["const"], "scale");
        assert_eq!(scale["required"], json!(["kind", "number", "factor"]));
        assert_eq!(scale["properties"]["rounding"]["default"], "nearest");
        assert_eq!(scale["properties"]["factor"]["anyOf"][0]["maximum"], 1000.0);
        assert_eq!(scale["description"], "Multiplies a number.");
    }

    #[test]
    fn every_reference_has_its_definition() {
        let schema = schema(&TOY);
        let text = schema.to_string();
        for reference in text.split("\"#/$defs/").skip(1) {
            let name = reference.split('"').next().unwrap();
            assert!(!schema["$defs"][name].is_null(), "{name}");
        }
    }
}
