//! What a sound pipeline file expands to.

use std::{fs, path::Path, time::Duration};

use sinew::{
    engine::{
        graph::Graph,
        pipeline::{self, Settings},
        settings::{Isolation, NodeSettings},
        toy::TOY,
    },
    report::graph,
};

/// Loads `pipeline.toml` from a folder that holds these files.
fn load_from(folder: &Path, files: &[(&str, &str)], set: &[&str]) -> Graph {
    for (name, text) in files {
        let path = folder.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }
    let set = set.iter().map(|it| (*it).to_owned()).collect();
    let settings = Settings { set, ..Settings::default() };
    pipeline::load(&folder.join("pipeline.toml"), &TOY, &settings)
        .unwrap_or_else(|e| panic!("{}", e.render(false)))
}

fn load(files: &[(&str, &str)]) -> Graph {
    load_from(tempfile::tempdir().unwrap().path(), files, &[])
}

fn param(graph: &Graph, node: &str, name: &str) -> serde_json::Value {
    let [index] = graph.select(node)[..] else { panic!("there is no one node `{node}`") };
    graph.instances[index].node.canonical_params()[name].clone()
}

const DOUBLE: &str = r#"
[pipeline]
cite = "inner2020"
[inputs]
x = { type = "number", doc = "what is doubled" }
[params]
times = 2
[nodes.scaled]
kind = "scale"
number = "@x"
factor = "${times}"
[outputs]
result = "@scaled"
"#;

const NESTED: &str = r#"
[pipeline]
title = "Nested"
cite = ["outer2021"]
[params]
by = 3
[nodes.one]
kind = "number"
value = 1
[nodes.first]
kind = "pipeline"
file = "parts/double.toml"
x = "@one"
[nodes.second]
kind = "pipeline"
file = "parts/double.toml"
x = "@first"
times = "${by}"
[nodes.sum]
kind = "add"
terms = ["@one", "@second.result", "@first.result"]
[outputs]
"out/sum_${by}.txt" = "@sum"
"#;

#[test]
fn an_inner_pipeline_becomes_its_nodes() {
    let graph = load(&[("pipeline.toml", NESTED), ("parts/double.toml", DOUBLE)]);
    let names: Vec<&str> = graph.instances.node_weights().map(|it| &*it.name).collect();
    assert_eq!(names, ["one", "first/scaled", "second/scaled", "sum"]);
    assert_eq!(param(&graph, "first/scaled", "factor"), 2.0);
    assert_eq!(param(&graph, "second/scaled", "factor"), 3.0);
    assert_eq!(graph.title.as_deref(), Some("Nested"));
    assert_eq!(graph.cites, ["outer2021", "inner2020"]);
    assert_eq!(graph.outputs[0].path, Path::new("out/sum_3.txt"));
    assert_eq!(graph.sources.len(), 2);
}

#[test]
fn wires_lead_through_the_ports_of_inner_pipelines() {
    let graph = load(&[("pipeline.toml", NESTED), ("parts/double.toml", DOUBLE)]);
    let text = graph::text(&graph);
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(
        lines,
        [
            "one            number",
            "first/scaled   scale   number ← one",
            "second/scaled  scale   number ← first/scaled",
            "sum            add     terms ← one, terms ← second/scaled, terms ← first/scaled",
            "out/sum_3.txt ← sum",
        ]
    );
}

#[test]
fn inputs_pass_through_several_levels_and_can_leave_at_once() {
    let middle = r#"
[inputs]
y = "number"
[nodes.inner]
kind = "pipeline"
file = "parts/double.toml"
x = "@y"
[outputs]
same = "@y"
double = "@inner"
"#;
    let outer = r#"
[nodes.one]
kind = "number"
[nodes.m]
kind = "pipeline"
file = "middle.toml"
y = "@one"
[nodes.sum]
kind = "add"
terms = ["@m.same", "@m.double"]
"#;
    let graph =
        load(&[("pipeline.toml", outer), ("middle.toml", middle), ("parts/double.toml", DOUBLE)]);
    assert!(!graph.select("m/inner/scaled").is_empty());
    assert!(graph::text(&graph).contains("terms ← one, terms ← m/inner/scaled"));
}

#[test]
fn settings_reach_parameters_and_nodes_with_toml_types() {
    let folder = tempfile::tempdir().unwrap();
    let files = [("pipeline.toml", NESTED), ("parts/double.toml", DOUBLE)];
    let set = ["by=7", "one.value=-4", "first.times=0.5", "sum.weights=[1, 2, 3]"];
    let graph = load_from(folder.path(), &files, &set);
    assert_eq!(param(&graph, "second/scaled", "factor"), 7.0);
    assert_eq!(param(&graph, "one", "value"), -4);
    assert_eq!(param(&graph, "first/scaled", "factor"), 0.5);
    assert_eq!(param(&graph, "sum", "weights"), serde_json::json!([1, 2, 3]));
    assert_eq!(graph.outputs[0].path, Path::new("out/sum_7.txt"));
}

#[test]
fn a_setting_that_is_no_toml_is_a_text() {
    let folder = tempfile::tempdir().unwrap();
    let text = "[nodes.f]\nkind = \"fail\"\nmessage = \"x\"\n";
    let graph = load_from(folder.path(), &[("pipeline.toml", text)], &["f.message=so it = is"]);
    assert_eq!(param(&graph, "f", "message"), "so it = is");
}

#[test]
fn a_profile_overrides_parameters_and_a_setting_overrides_the_profile() {
    let text = "[params]\na = 1\nb = 1\nc = \"${a}\"\n[profiles.fast]\na = 2\nb = 2\n\
        [nodes.x]\nkind = \"number\"\nvalue = \"${c}\"\n\
        [nodes.y]\nkind = \"number\"\nvalue = \"${b}\"\n";
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("pipeline.toml"), text).unwrap();
    let settings = Settings {
        profile: Some("fast".to_owned()),
        set: vec!["b=3".to_owned()],
        ..Settings::default()
    };
    let graph = pipeline::load(&folder.path().join("pipeline.toml"), &TOY, &settings);
    let graph = graph.unwrap_or_else(|e| panic!("{}", e.render(false)));
    assert_eq!((param(&graph, "x", "value"), param(&graph, "y", "value")), (2.into(), 3.into()));
}

#[test]
fn paths_start_where_they_are_written() {
    let inner = r#"
[params]
file = "own.txt"
[nodes.own]
kind = "text_file"
path = "${file}"
[nodes.fixed]
kind = "text_file"
path = "own.txt"
"#;
    let outer = r#"
[params]
name = "data/outer"
[nodes.a]
kind = "pipeline"
file = "parts/read.toml"
[nodes.c]
kind = "text_file"
path = "${name}.txt"
"#;
    let folder = tempfile::tempdir().unwrap();
    let files = [
        ("pipeline.toml", outer),
        ("parts/read.toml", inner),
        ("parts/own.txt", "include more.txt\n"),
        ("parts/more.txt", ""),
        ("data/outer.txt", ""),
    ];
    let graph = load_from(folder.path(), &files, &[]);
    let paths = |node: &str| -> Vec<String> {
        let instance = &graph.instances[graph.select(node)[0]];
        let relative =
            |it: &std::path::PathBuf| it.strip_prefix(folder.path()).unwrap().display().to_string();
        instance.files.values().map(relative).collect()
    };
    assert_eq!(paths("a/own"), ["parts/more.txt", "parts/own.txt"]);
    assert_eq!(paths("a/fixed"), ["parts/more.txt", "parts/own.txt"]);
    assert_eq!(paths("c"), ["data/outer.txt"]);
}

#[test]
fn places_name_the_lines_of_nodes_and_parameters() {
    let graph = load(&[("pipeline.toml", NESTED), ("parts/double.toml", DOUBLE)]);
    let instance = &graph.instances[graph.select("second/scaled")[0]];
    assert!(graph.show_place(&instance.place).ends_with("parts/double.toml:8"));
    let factor = instance.field_place("factor").expect("it is written");
    assert!(graph.show_place(factor).ends_with("pipeline.toml:6"));
}

#[test]
fn drawings_show_inner_pipelines_as_groups() {
    let graph = load(&[("pipeline.toml", NESTED), ("parts/double.toml", DOUBLE)]);
    let dot = graph::dot(&graph);
    assert!(dot.contains("subgraph \"cluster_first\" {\n    label=\"first\";\n    n1"), "{dot}");
    assert!(dot.contains("n0 -> n3 [label=\"terms\"];"), "{dot}");
    let mermaid = graph::mermaid(&graph);
    assert!(mermaid.contains("subgraph g_second[\"second\"]\n    n2[\"scaled<br>scale\"]"));
    let svg = graph::svg(&graph);
    assert_eq!(svg.matches("class=\"group\"").count(), 2);
    assert_eq!(svg.matches("class=\"node\"").count(), 4);
    assert_eq!(svg.matches("class=\"node file\"").count(), 1);
    assert_eq!(svg.matches("class=\"wire\"").count(), 6);
    assert_eq!(svg, graph::svg(&graph));
}

#[test]
fn a_file_with_inputs_can_be_checked_on_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("double.toml");
    fs::write(&path, DOUBLE).unwrap();
    let check = || pipeline::check(&path, &TOY, &Settings::default());
    assert_eq!(check().map_err(|e| e.to_string()), Ok(1));
    fs::write(&path, DOUBLE.replace("factor", "fcator").replace("\"number\",", "\"nubmer\","))
        .unwrap();
    assert_eq!(check().unwrap_err().list.len(), 2);
}

#[test]
fn no_damage_to_a_file_makes_the_reader_panic() {
    let text = format!("{NESTED}[nodes.ü]\nkind = \"fail\"\nmessage = \"→ ${{by}}\"\n");
    let read = |damaged: &str| {
        let folder = std::path::PathBuf::from("nowhere");
        let settings = Settings { set: vec![damaged.replace('\n', "=")], ..Settings::default() };
        for settings in [Settings::default(), settings] {
            if let Err(diagnostics) = pipeline::load_text(damaged, folder.clone(), &TOY, &settings)
            {
                assert!(!diagnostics.list.is_empty());
                diagnostics.render(true);
                diagnostics.to_json();
            }
        }
    };
    for (start, letter) in text.char_indices() {
        let (before, rest) = text.split_at(start);
        read(before);
        read(&format!("{before}{}", &rest[letter.len_utf8()..]));
        read(&format!("{before}\"{rest}"));
        read(&format!("{before}[{rest}"));
    }
}

#[test]
fn how_a_node_is_run_is_no_parameter_and_is_handed_to_inner_nodes() {
    let inner = "[inputs]\nx = \"number\"\n[nodes.a]\nkind = \"add\"\nterms = \"@x\"\nretries = 5\n\
                 [nodes.b]\nkind = \"add\"\nterms = \"@a\"\nisolate = false\n[outputs]\ny = \"@b\"\n";
    let outer = "[params]\nlimit = \"2m\"\n[nodes.one]\nkind = \"number\"\n\
                 [nodes.p]\nkind = \"pipeline\"\nfile = \"inner.toml\"\nx = \"@one\"\nretries = 2\n\
                 backoff = \"250ms\"\ntimeout = \"${limit}\"\nisolate = { memory = \"1 GB\" }\n";
    let files = [("pipeline.toml", outer), ("inner.toml", inner)];
    let graph = load_from(tempfile::tempdir().unwrap().path(), &files, &["p.retries=7"]);
    let settings = |node: &str| graph.instances[graph.select(node)[0]].settings.clone();
    assert_eq!(settings("one"), NodeSettings::default());
    let given = NodeSettings {
        retries: 7,
        backoff: Duration::from_millis(250),
        timeout: Some(Duration::from_secs(120)),
        isolate: Some(Isolation { memory: Some(1 << 30) }),
    };
    assert_eq!(settings("p/a"), NodeSettings { retries: 5, ..given.clone() });
    assert_eq!(settings("p/b"), NodeSettings { isolate: None, ..given });
    assert_eq!(param(&graph, "p/a", "retries"), serde_json::Value::Null);
}
