//! Nodes along axes: what a pipeline expands to, what runs again when items come and go, and what is
//! wrong with an axis.

mod folder;

use std::fs;

use sinew::engine::{
    events::{Outcome, RunReport, Silent},
    graph::Graph,
    pipeline::{self, Settings},
    run::{self, RunOptions},
    store::{Access, Store},
    toy::TOY,
};

use folder::Folder;

impl Folder {
    fn try_load(&self, settings: &Settings) -> Result<Graph, Vec<String>> {
        pipeline::load(&self.path("pipeline.toml"), &TOY, settings).map_err(|e| {
            e.list
                .iter()
                .map(|it| {
                    let hint = it.hint.as_ref().map(|it| format!(" ({it})")).unwrap_or_default();
                    format!(
                        "{}{hint}",
                        it.message.replace(&self.path("").display().to_string(), "")
                    )
                })
                .collect()
        })
    }

    fn load(&self, settings: &Settings) -> Graph {
        self.try_load(settings).unwrap_or_else(|problems| panic!("{problems:#?}"))
    }

    fn run_with(&self, settings: &Settings) -> (Vec<String>, RunReport) {
        let graph = self.load(settings);
        let store = Store::open(&self.path("cache"), Access::ReadWrite).unwrap();
        let options = RunOptions {
            threads: 2,
            output_dir: self.path(""),
            run_id: "test".to_owned(),
            ..RunOptions::default()
        };
        let report = run::run(&graph, &TOY, &store, &options, &mut Silent);
        let ids = graph.instances.node_weights().map(|it| it.id());
        let ran = ids.zip(&report.outcomes).filter(|it| matches!(it.1, Outcome::Ran { .. }));
        (ran.map(|it| it.0).collect(), report)
    }

    /// The instances that ran.
    fn run(&self) -> Vec<String> {
        let (ran, report) = self.run_with(&Settings::default());
        assert!(report.succeeded(), "{report:?}");
        ran
    }

    fn read(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap()
    }
}

fn ids(graph: &Graph) -> Vec<String> {
    graph.instances.node_weights().map(|it| it.id()).collect()
}

fn only(text: &str) -> Settings {
    Settings { only: vec![text.to_owned()], ..Settings::default() }
}

const SWEEP: &str = r#"
[axes.n]
values = [1, 2, 3]
[axes.factor]
values = [10.0, 0.5]

[nodes.base]
kind = "number"
value = 7
[nodes.number]
kind = "number"
value = "${n}"
[nodes.scaled]
kind = "scale"
number = "@number"
factor = "${factor}"
[nodes.sum]
kind = "add"
terms = ["@base", "@scaled"]
over = "n"
[nodes.all]
kind = "gather"
numbers = "@scaled"
over = ["n", "factor"]

[outputs]
"out/sum_${factor}.txt" = "@sum"
"out/all.txt" = "@all"
"out/${n}/${factor}.txt" = "@scaled"
"#;

#[test]
fn a_node_has_the_axes_of_its_parameters_and_inputs_less_what_it_gathers() {
    let folder = Folder::new(&[("pipeline.toml", SWEEP)]);
    let graph = folder.load(&Settings::default());
    assert_eq!(
        ids(&graph),
        [
            "base",
            "number@1",
            "number@2",
            "number@3",
            "scaled@1,10.0",
            "scaled@1,0.5",
            "scaled@2,10.0",
            "scaled@2,0.5",
            "scaled@3,10.0",
            "scaled@3,0.5",
            "sum@10.0",
            "sum@0.5",
            "all",
        ]
    );
    assert_eq!(folder.run().len(), 13);
    assert_eq!(folder.read("out/sum_10.0.txt"), "67\n");
    assert_eq!(folder.read("out/3/10.0.txt"), "30\n");
    assert_eq!(
        folder.read("out/all.txt"),
        "n=1 factor=10.0: 10\nn=1 factor=0.5: 1\nn=2 factor=10.0: 20\nn=2 factor=0.5: 1\n\
         n=3 factor=10.0: 30\nn=3 factor=0.5: 2\n"
    );
    assert_eq!(folder.run(), [""; 0]);
}

#[test]
fn one_more_item_runs_itself_and_what_gathers_it() {
    let folder = Folder::new(&[("pipeline.toml", SWEEP)]);
    folder.run();
    folder.write("pipeline.toml", &SWEEP.replace("[1, 2, 3]", "[1, 4, 2, 3]"));
    let mut ran = folder.run();
    ran.sort();
    assert_eq!(ran, ["all", "number@4", "scaled@4,0.5", "scaled@4,10.0", "sum@0.5", "sum@10.0"]);
    folder.write("pipeline.toml", &SWEEP.replace("[1, 2, 3]", "[1, 3]"));
    let mut ran = folder.run();
    ran.sort();
    assert_eq!(ran, ["all", "sum@0.5", "sum@10.0"]);
}

#[test]
fn an_axis_under_another_name_changes_only_what_shows_its_name() {
    let folder = Folder::new(&[("pipeline.toml", SWEEP)]);
    folder.run();
    let renamed =
        SWEEP.replace("[axes.n]", "[axes.m]").replace("${n}", "${m}").replace("\"n\"", "\"m\"");
    folder.write("pipeline.toml", &renamed);
    assert_eq!(folder.run(), ["all"]);
}

#[test]
fn a_run_can_be_narrowed_to_some_items() {
    let folder = Folder::new(&[("pipeline.toml", SWEEP)]);
    let narrowed = |settings: &Settings| ids(&folder.load(settings)).len();
    assert_eq!(narrowed(&only("n=2")), 1 + 1 + 2 + 2 + 1);
    assert_eq!(narrowed(&only("factor=0*")), 1 + 3 + 3 + 1 + 1);
    let limit = vec!["n=2".to_owned(), "factor=1".to_owned()];
    assert_eq!(narrowed(&Settings { limit, ..Settings::default() }), 1 + 2 + 2 + 1 + 1);
    let check = |settings: &Settings, expected: &str| {
        assert_eq!(folder.try_load(settings).err().unwrap(), [expected]);
    };
    check(&only("n=5"), "axis `n` has no item `5` (expected `1`, `2` or `3`)");
    check(&only("k=5"), "there is no axis `k` (expected `n` or `factor`)");
    check(&only("n"), "`--only` is written as `axis=item,item`");
    let limit = vec!["n=0".to_owned()];
    check(&Settings { limit, ..Settings::default() }, "`--limit` is written as `axis=number`");
    // Narrowing computes no more than what is left.
    assert_eq!(folder.run_with(&only("n=2")).0.len(), 7);
    assert_eq!(folder.run().len(), 13 - 7 + 3);
}

#[test]
fn axes_can_be_set_from_the_command_line() {
    let folder = Folder::new(&[("pipeline.toml", SWEEP)]);
    let set = vec!["axes.n.values=[5]".to_owned()];
    let graph = folder.load(&Settings { set, ..Settings::default() });
    assert_eq!(graph.select("number").len(), 1);
    assert_eq!(graph.select("scaled@5,0.5").len(), 1);
    assert_eq!(graph.select("scaled@factor=0.5").len(), 1);
    assert_eq!(graph.select("scaled@5").len(), 2);
}

const FILES: &str = r#"
[axes.file]
files = "data/*.txt"
[nodes.text]
kind = "text_file"
path = "${file.path}"
[nodes.length]
kind = "count"
text = "@text"
[nodes.total]
kind = "add"
terms = "@length"
over = "file"
[outputs]
"out/${file.stem}.txt" = "@length"
"out/total.txt" = "@total"
"#;

#[test]
fn a_file_that_comes_is_computed_and_one_that_goes_is_gathered_no_more() {
    let data = [("data/b.txt", "bb"), ("data/a.txt", "a"), ("data/.hidden.txt", "no")];
    let folder = Folder::new(&[&data[..], &[("pipeline.toml", FILES)]].concat());
    assert_eq!(folder.run().len(), 5);
    assert_eq!(folder.read("out/total.txt"), "3\n");
    folder.write("data/c.txt", "ccc");
    assert_eq!(folder.run(), ["text@c", "length@c", "total"]);
    assert_eq!(folder.read("out/total.txt"), "6\n");
    fs::remove_file(folder.path("data/c.txt")).unwrap();
    // Its gathering is remembered from before.
    assert_eq!(folder.run(), [""; 0]);
    fs::remove_file(folder.path("data/a.txt")).unwrap();
    assert_eq!(folder.run(), ["total"]);
    assert_eq!(folder.read("out/total.txt"), "2\n");
    // The content counts, not the name.
    fs::rename(folder.path("data/b.txt"), folder.path("data/z.txt")).unwrap();
    assert_eq!(folder.run(), [""; 0]);
    assert_eq!(folder.read("out/z.txt"), "2\n");
}

#[test]
fn pairs_share_what_is_computed_for_their_items() {
    let text = r#"
[axes.shape]
values = [1, 2, 3]
[axes.pair]
pairs = "shape"
where = "source != 3"
[nodes.number]
kind = "number"
value = "${shape}"
[nodes.difference]
kind = "add"
terms = ["@number[shape=pair.source]", "@number[shape=pair.target]"]
weights = [1, -1]
[nodes.to_first]
kind = "add"
terms = ["@number", "@number[shape=1]"]
[nodes.all]
kind = "gather"
numbers = "@difference"
over = "pair"
[outputs]
"out/${pair.source}_${pair.target}.txt" = "@difference"
"out/${pair}.txt" = "@difference"
"#;
    let folder = Folder::new(&[("pipeline.toml", text)]);
    let graph = folder.load(&Settings::default());
    assert_eq!(graph.select("number").len(), 3);
    assert_eq!(graph.select("to_first").len(), 3);
    let pairs = graph.select("difference");
    let labels: Vec<String> = pairs.iter().map(|&it| graph.instances[it].id()).collect();
    assert_eq!(
        labels,
        ["difference@1-to-2", "difference@1-to-3", "difference@2-to-1", "difference@2-to-3"]
    );
    folder.run();
    assert_eq!(folder.read("out/1_3.txt"), "-2\n");
    assert_eq!(folder.read("out/2-to-1.txt"), "1\n");
    let count = |which: &str| {
        folder.write(
            "pipeline.toml",
            &text.replace("where =", &format!("which = \"{which}\"\nwhere =")),
        );
        folder.load(&Settings::default()).select("difference").len()
    };
    assert_eq!((count("all"), count("unordered"), count("different")), (6, 3, 4));
}

#[test]
fn a_copy_of_an_axis_makes_a_grid() {
    let text = r#"
[axes.a]
range = { from = 1, to = 3 }
[axes.b]
copy_of = "a"
where = "b < 3"
label = "no${b}"
[nodes.number]
kind = "number"
value = "${a}"
[nodes.product]
kind = "add"
terms = ["@number", "@number[a=b]"]
weights = [10, 1]
[nodes.again]
kind = "number"
value = "${b}"
[nodes.all]
kind = "gather"
numbers = "@product"
over = "*"
[outputs]
"out/all.txt" = "@all"
"out/${b}_${b.label}.txt" = "@again"
"#;
    let folder = Folder::new(&[("pipeline.toml", text)]);
    folder.run();
    assert_eq!(folder.read("out/2_no2.txt"), "2\n");
    assert_eq!(
        folder.read("out/all.txt"),
        "a=1 b=no1: 11\na=1 b=no2: 12\na=2 b=no1: 21\na=2 b=no2: 22\na=3 b=no1: 31\na=3 b=no2: 32\n"
    );
}

#[test]
fn zipped_lists_and_tables_give_several_fields() {
    let text = r#"
[axes.case]
values = { n = [1, 2], factor = [3.0, 4.0] }
[axes.row]
table = "rows.csv"
where = "use == true and name ~ 'cat*'"
[axes.file]
zip = { text = { files = "data/*" }, times = { range = { from = 1, to = 2 } } }
[nodes.scaled]
kind = "scale"
number = "@n"
factor = "${case.factor}"
[nodes.n]
kind = "number"
value = "${case.n}"
[nodes.row]
kind = "number"
value = "${row.value}"
[nodes.text]
kind = "text_file"
path = "${file.text.path}"
[nodes.letters]
kind = "count"
text = "@text"
[nodes.times]
kind = "scale"
number = "@letters"
factor = "${file.times}"
"#;
    let folder = Folder::new(&[
        ("pipeline.toml", text),
        (
            "rows.csv",
            "\u{feff}name, value, use\ncat-a,5,true\n\"cat,b\",6,true\ncat-c,7,false\ndog,8,true\n",
        ),
        ("data/x", "xx"),
        ("data/y", "yyy"),
    ]);
    let graph = folder.load(&Settings::default());
    assert_eq!(
        ids(&graph),
        [
            "scaled@1-3.0",
            "scaled@2-4.0",
            "n@1-3.0",
            "n@2-4.0",
            "row@cat-a",
            "row@cat,b",
            "text@x-1",
            "text@y-2",
            "letters@x-1",
            "letters@y-2",
            "times@x-1",
            "times@y-2",
        ]
    );
    folder.run();
}

#[test]
fn inner_pipelines_are_repeated_where_they_depend_on_an_item() {
    let inner = r#"
[inputs]
x = "number"
[params]
value = 1
factor = 2.0
[nodes.constant]
kind = "number"
value = 100
[nodes.own]
kind = "number"
value = "${value}"
[nodes.sum]
kind = "add"
terms = ["@x", "@own", "@constant"]
[nodes.scaled]
kind = "scale"
number = "@sum"
factor = "${factor}"
[outputs]
result = "@scaled"
own = "@own"
"#;
    let outer = r#"
[params]
twice = "${n}"
[axes.n]
values = [1, 2]
[axes.m]
values = [3, 4]
[nodes.x]
kind = "number"
value = "${m}"
[nodes.inner]
kind = "pipeline"
file = "inner.toml"
x = "@x"
value = "${twice}"
[nodes.sum]
kind = "add"
terms = "@inner.result"
over = ["n", "m"]
[nodes.own]
kind = "add"
terms = "@inner.own"
over = ["n"]
[outputs]
"sum.txt" = "@sum"
"own.txt" = "@own"
"#;
    let folder = Folder::new(&[("pipeline.toml", outer), ("inner.toml", inner)]);
    let graph = folder.load(&Settings::default());
    let count = |name: &str| graph.select(name).len();
    assert_eq!(
        (count("inner/constant"), count("inner/own"), count("inner/sum"), count("inner/scaled")),
        (1, 2, 4, 4)
    );
    folder.run();
    assert_eq!((folder.read("sum.txt"), folder.read("own.txt")), ("840\n".into(), "3\n".into()));
}

#[test]
fn an_inner_pipeline_has_axes_of_its_own() {
    let inner = r#"
[axes.n]
values = [1, 2, 3]
[nodes.number]
kind = "number"
value = "${n}"
[nodes.sum]
kind = "add"
terms = "@number"
over = "n"
[outputs]
numbers = "@number"
sum = "@sum"
"#;
    let outer = r#"
[axes.n]
values = [10, 20]
[nodes.inner]
kind = "pipeline"
file = "inner.toml"
[nodes.outer]
kind = "number"
value = "${n}"
[nodes.both]
kind = "gather"
numbers = ["@inner.numbers", "@outer", "@inner.sum"]
over = "n"
[outputs]
"both.txt" = "@both"
"#;
    let folder = Folder::new(&[("pipeline.toml", outer), ("inner.toml", inner)]);
    folder.run();
    assert_eq!(folder.read("both.txt"), "n=1: 1\nn=2: 2\nn=3: 3\nn=10: 10\nn=20: 20\n: 6\n");
}

const MISSING: &str = r#"
[axes.n]
values = [0, 1, 2]
[nodes.number]
kind = "number"
value = "${n}"
[nodes.by]
kind = "reciprocal"
of = "@number"
[nodes.next]
kind = "add"
terms = ["@by"]
[nodes.all]
kind = "gather"
numbers = "@next"
over = "n"
missing = "show"
[outputs]
"all.txt" = "@all"
"#;

#[test]
fn what_failed_is_shown_by_those_who_can() {
    let folder = Folder::new(&[("pipeline.toml", MISSING)]);
    let (ran, report) = folder.run_with(&Settings::default());
    assert_eq!(ran.len(), 3 + 2 + 2 + 1, "{ran:?}");
    let counts = report.counts();
    assert_eq!((counts.failed, counts.skipped), (1, 1));
    assert!(!report.succeeded());
    let shown = folder.read("all.txt");
    let lines: Vec<&str> = shown.lines().collect();
    assert_eq!(lines, ["n=0: missing, `by@0` failed: division by zero", "n=1: 1000", "n=2: 500"]);
    // The failure is tried again; what it is shown by is the same as before.
    let (ran, report) = folder.run_with(&Settings::default());
    assert_eq!((ran.len(), report.counts().failed), (0, 1));
    // Once it is mended, the gathering runs again.
    folder.write("pipeline.toml", &MISSING.replace("[0, 1, 2]", "[4, 1, 2]"));
    assert_eq!(folder.run(), ["number@4", "by@4", "next@4", "all"]);
    assert_eq!(folder.read("all.txt"), "n=4: 250\nn=1: 1000\nn=2: 500\n");
}

#[test]
fn what_failed_stops_those_who_show_nothing() {
    let folder = Folder::new(&[("pipeline.toml", &MISSING.replace("missing = \"show\"", ""))]);
    let (_, report) = folder.run_with(&Settings::default());
    let counts = report.counts();
    assert_eq!((counts.failed, counts.skipped), (1, 2));
    assert!(!folder.path("all.txt").exists());
}

/// The messages with their hints, for a pipeline of these lines.
fn check(text: &str, expected: &[&str]) {
    let folder = Folder::new(&[
        ("pipeline.toml", text),
        ("rows.csv", "name,value\na,1\nb\n"),
        ("data/x.txt", "x"),
    ]);
    let found = folder.try_load(&Settings::default()).map(|it| ids(&it));
    assert_eq!(found.err().unwrap_or_default(), expected, "{text}");
}

/// An axis `n` with this line, and a node that uses it.
fn check_axis(line: &str, expected: &[&str]) {
    let node = "[nodes.a]\nkind = \"number\"\nvalue = \"${n}\"\n";
    check(&format!("[axes.n]\n{line}\n{node}"), expected);
}

#[test]
fn an_axis_that_makes_no_sense_is_said() {
    check_axis(
        "",
        &[
            "axis `n` has no items (it needs `values`, `range`, `files`, `table`, `zip`, `pairs` or `copy_of`)",
        ],
    );
    check_axis("values = []", &["axis `n` has no items"]);
    check_axis("value = [1]", &["an axis has no key `value` (did you mean `values`?)"]);
    check_axis(
        "values = [1]\nfiles = \"data/*\"",
        &["axis `n` has `values` and `files`: its items come from one of them"],
    );
    check_axis(
        "values = [1, [2]]",
        &["an item must be a text or a number, but this is a list of 1 value"],
    );
    check_axis(
        "values = [1, 1]",
        &["axis `n` has two items `1` (`label = \"${field}\"` makes other labels)"],
    );
    check_axis("values = [{ a = 1 }, { b = 2 }]", &["this item has no `a`, but the first has"]);
    check_axis(
        "values = { a = [1], b = [1, 2] }",
        &["`b` has 2 items, but `a` has 1 (lists that are zipped have one length)"],
    );
    check_axis("files = \"data/*.off\"", &["no file matches `data/*.off`"]);
    check_axis(
        "files = \"data/[\"",
        &["`data/[` is not a pattern of files: invalid range pattern"],
    );
    check_axis("table = \"rows.csv\"", &["this row has 1 cells, but the heading has 2"]);
    check_axis("table = \"none.csv\"", &["there is no file `none.csv`"]);
    check_axis("range = { from = 1 }", &["a range needs `from` and `to`"]);
    check_axis("pairs = \"m\"", &["there is no axis `m` above this one"]);
    check_axis("values = [1, 2]\nwhere = \"n > 2\"", &["axis `n` has no items"]);
    check_axis(
        "values = [1, 2]\nwhere = \"m > 2\"",
        &["the items have no field `m` (fields are `index`)"],
    );
    check_axis(
        "values = [1]\nlabel = \"${m}\"",
        &["there is no parameter `m` (expected `index` or `n`)"],
    );
    check_axis("values = [1]\nwhich = \"all\"", &["`which` is for `pairs`"]);
    check_axis("values = [1.5]", &["`value` must be an integer, but is 1.5"]);
    check(
        "[params]\nn = 1\n[axes.n]\nvalues = [1]\n[nodes.a]\nkind = \"number\"\nvalue = \"${n}\"\n",
        &["`n` is a parameter as well as an axis"],
    );
    check(
        "[axes.a]\nvalues = [1]\n[axes.b]\nvalues = [\"${a}\"]\n[nodes.a]\nkind = \"number\"\nvalue = \"${b}\"\n",
        &[
            "an axis cannot depend on the items of another one (`pairs` and `copy_of` make an axis from another)",
        ],
    );
}

#[test]
fn a_use_of_an_axis_that_makes_no_sense_is_said() {
    let with = |rest: &str| {
        format!(
            "[axes.n]\nvalues = [1, 2]\n[nodes.a]\nkind = \"number\"\nvalue = \"${{n}}\"\n\
             [nodes.s]\nkind = \"add\"\nterms = \"@a\"\nover = \"n\"\n{rest}"
        )
    };
    let add = |line: &str| with(&format!("[nodes.b]\nkind = \"add\"\nterms = \"@a\"\n{line}\n"));
    check(&add("over = \"m\""), &["no input of `b` has the axis `m` (they have `n`)"]);
    check(
        &add("over = \"n\"\nweights = [\"${n}\"]"),
        &["`b` gathers the items of `n` and cannot name one"],
    );
    check(&add("missing = \"show\""), &["kind `add` cannot show what is missing"]);
    check(
        &add("missing = \"hide\""),
        &["`missing` cannot be \"hide\" (expected `fail` or `show`)"],
    );
    check(
        &with("[nodes.b]\nkind = \"scale\"\nnumber = \"@a\"\nfactor = 1.0\nover = \"n\"\n"),
        &["kind `scale` has no list of inputs to gather into"],
    );
    let wire = |wire: &str| with(&format!("[nodes.b]\nkind = \"add\"\nterms = [\"{wire}\"]\n"));
    check(&wire("@a[n=3]"), &["`3` is no item of axis `n` (expected `1` or `2`)"]);
    check(&wire("@a[m=1]"), &["`a` has no axis `m` (expected `n`)"]);
    check(&wire("@s[n=1]"), &["`s` has no axis `n` (it is there once for all items)"]);
    check(&wire("@a[n=1"), &["`[` is not closed by `]`"]);
    check(&wire("@a[1]"), &["`[1]` selects no items (write \"@node[axis=item].port\")"]);
    check(
        &wire("@a_${n}"),
        &[
            "a wire cannot be named after the item of an axis (nodes have the axes of what they read; \
           `\"@node[axis=item]\"` selects an item)",
        ],
    );
    let output = |path: &str, wire: &str| with(&format!("[outputs]\n\"{path}\" = \"{wire}\"\n"));
    check(
        &output("a.txt", "@a"),
        &[
            "all items of `n` would be written to this one file (write `${n}` into the path, or gather \
           them with `over`)",
        ],
    );
    check(&output("${n}.txt", "@s"), &["what is written is the same for all items of `n`"]);
    check(
        &output("${n.size}.txt", "@a"),
        &["the items of axis `n` have no `size` (expected `index` or `label`)"],
    );
    let text = output("out/${n}.txt", "@a")
        .replace("[1, 2]", "[\"..\"]")
        .replace("value = \"${n}\"", "value = \"${n.index}\"");
    check(
        &text,
        &[
            "`${n}` is \"..\", which is no name of a file (names of items must stay in the folder that \
           the path names)",
        ],
    );
}

#[test]
fn a_mistake_at_thousands_of_items_is_told_a_few_times() {
    let text = "[axes.n]\nrange = { from = -5000, to = 5000 }\n[nodes.a]\nkind = \"number\"\n\
                value = 1\n[nodes.b]\nkind = \"scale\"\nnumber = \"@a\"\nfactor = \"${n}\"\n";
    let folder = Folder::new(&[("pipeline.toml", text)]);
    let problems = folder.try_load(&Settings::default()).err().unwrap();
    assert!((1..10).contains(&problems.len()), "{problems:?}");
}

#[test]
fn a_mistake_in_a_table_is_shown_in_its_row() {
    let pipeline = "[axes.n]\ntable = \"rows.csv\"\n[nodes.a]\nkind = \"number\"\nvalue = 1\n";
    for (rows, message, expected) in [
        ("\u{feff}n,m\r\n\r\n1,2\r\n3\r\n4,5\r\n", "this row has 1 cells", "3"),
        ("n,m\n1,2\n\n3,\"4\n5,6\n", "a quote is not closed in this row", "3,\"4"),
        ("n,m\r\n1,2\r\n3,\"4\"\"\r\n", "a quote is not closed in this row", "3,\"4\"\""),
    ] {
        let folder = Folder::new(&[("pipeline.toml", pipeline), ("rows.csv", rows)]);
        let path = folder.path("pipeline.toml");
        let problems = pipeline::load(&path, &TOY, &Settings::default()).err().unwrap();
        let problem = problems.list.iter().find(|it| it.message.starts_with(message));
        let place =
            problem.unwrap_or_else(|| panic!("{:#?}", problems.list)).place.clone().unwrap();
        assert_eq!(&problems.sources[place.source()].text[place.span()], expected, "{rows:?}");
    }
}
