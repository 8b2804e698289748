//! Every mistake is told once, at its place, with what to do about it.

use std::{fs, path::Path};

use sinew::engine::{
    pipeline::{self, Diagnostics, Settings},
    toy::TOY,
};

/// Files of a case: texts by name.
type Files<'a> = &'a [(&'a str, &'a str)];

/// Loads `pipeline.toml` from a folder with these files.
fn load(files: Files<'_>, settings: &Settings) -> Result<(), Diagnostics> {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in files {
        fs::write(folder.path().join(name), text).unwrap();
    }
    pipeline::load(&folder.path().join("pipeline.toml"), &TOY, settings).map(|_| ())
}

/// `file:line:column: message (hint)`, without the folder and without the name of the first file.
fn lines(res: Result<(), Diagnostics>) -> Vec<String> {
    let Err(diagnostics) = res else { return Vec::new() };
    let folder = diagnostics.sources[0].path.parent().unwrap_or(Path::new("")).to_owned();
    let prefix = format!("{}/", folder.display());
    let line = |it: &pipeline::Diagnostic| {
        let place = it.place.as_ref().expect("every mistake in a file has a place");
        let (line, column) = diagnostics.line_and_column(place);
        let file = match place.source() {
            0 => String::new(),
            source => format!("{}:", diagnostics.sources[source].path.display()),
        };
        let hint = it.hint.as_ref().map_or(String::new(), |it| format!(" ({it})"));
        format!("{file}{line}:{column}: {}{hint}", it.message).replace(&prefix, "")
    };
    diagnostics.list.iter().map(line).collect()
}

#[track_caller]
fn check_files(files: Files<'_>, expected: &[&str]) {
    let found = lines(load(files, &Settings::default()));
    assert_eq!(found, expected, "\n{}\n", files[0].1);
}

#[track_caller]
fn check(text: &str, expected: &[&str]) {
    check_files(&[("pipeline.toml", text)], expected);
}

#[track_caller]
fn check_settings(text: &str, profile: Option<&str>, set: &[&str], expected: &[&str]) {
    let set = set.iter().map(|it| (*it).to_owned()).collect();
    let settings = Settings { profile: profile.map(str::to_owned), set, ..Settings::default() };
    assert_eq!(lines(load(&[("pipeline.toml", text)], &settings)), expected, "\n{text}\n");
}

const ONE: &str = "[nodes.one]\nkind = \"number\"\nvalue = 1\n";

/// A file that begins with a node `one`; what follows starts at line 4.
#[track_caller]
fn check_after_one(text: &str, expected: &[&str]) {
    check(&format!("{ONE}{text}"), expected);
}

#[test]
fn sound_files_have_no_mistakes() {
    check(ONE, &[]);
    check_after_one("[nodes.b]\nkind = \"add\"\nterms = [\"@one\", \"@one.number\"]", &[]);
    check_after_one("[nodes.b]\nkind = \"add\"\nterms = \"@one\"\nweights = [2]", &[]);
    check_after_one("[nodes.b]\nkind = \"scale\"\nnumber = \"@one\"\nfactor = 2", &[]);
    check_after_one("[outputs]\n\"a.txt\" = \"@one\"", &[]);
    check_after_one("[pipeline]\ntitle = \"t\"\ncite = [\"a\"]\ndescription = \"d\"", &[]);
}

#[test]
fn sections() {
    check("", &["1:1: the pipeline has no nodes (a node is a table `[nodes.NAME]` with a `kind`)"]);
    check("[node.a]\nkind = \"number\"", &["1:2: unknown section `node` (did you mean `nodes`?)"]);
    check_after_one(
        "[pipeline]\ntitel = \"x\"",
        &["5:1: unknown key `titel` in `[pipeline]` (did you mean `title`?)"],
    );
    check_after_one(
        "[pipeline]\ntitle = 3\ncite = [1]",
        &["5:9: `title` must be a text, but is 3", "6:9: `cite` must be a text, but is 1"],
    );
    check_after_one("[axes.k]\nvalues = [1]", &[]);
    check("nodes = 3", &["1:9: `nodes` must be a table, but is 3"]);
    check("[nodes]\na = 3", &["2:5: node `a` must be a table, but is 3"]);
    check(
        "[nodes.\"a b\"]\nkind = \"number\"",
        &["1:8: `a b` is not a name (names are made of letters, digits, `_` and `-`)"],
    );
}

#[test]
fn syntax() {
    check("[nodes.a]\nkind = number", &[r#"2:8: a text must stand in quotes (write "number")"#]);
    check("[nodes.a\nkind = \"number\"", &["1:9: unclosed table, expected `]`"]);
    check(
        "[nodes.a]\nkind = \"number\nvalue = 3",
        &[r#"2:15: invalid basic string, expected `"`"#],
    );
    check("[nodes.a]\nkind = \"number\"\nkind = \"add\"", &["3:1: `kind` is given twice"]);
    check(
        "[nodes.a]\nkind = \"number\"\n\n[nodes.a]\nkind = \"add\"",
        &["4:8: `a` is given twice"],
    );
    check(
        "[nodes.a]\nkind = \"number\"\nvalue = [1, 2\n\n[nodes.b]\nkind = = 3",
        &[
            "5:1: missing comma between array elements, expected `,` (or a `]` is missing further up)",
        ],
    );
    check("[nodes.a]\nkind = \"number\"\nvalue =\n", &["3:8: the value is missing"]);
    check("[nodes.a]\nkind = \"number\"\nvalue = 1e", &["3:11: invalid exponent, expected digits"]);
    check(
        "a = 1 b = 2\n[x\nc = \"\\q\"",
        &[
            "1:9: unexpected key or value, expected newline, `#`",
            "2:3: unclosed table, expected `]`",
        ],
    );
}

#[test]
fn kinds_and_keys() {
    check(
        "[nodes.a]\nkind = \"numbr\"",
        &["2:8: there is no kind of node `numbr` (did you mean `number`?)"],
    );
    check(
        "[nodes.a]\nkind = \"transmogrify\"",
        &["2:8: there is no kind of node `transmogrify` (`sinew nodes` lists all kinds)"],
    );
    check("[nodes.a]\nvalue = 3", &["1:8: node `a` has no `kind` (`sinew nodes` lists all kinds)"]);
    check("[nodes.a]\nkind = 3", &["2:8: `kind` must be a text, but is 3"]);
    check(
        "[nodes.a]\nkind = \"number\"\nvalu = 3",
        &["3:1: kind `number` has no key `valu` (did you mean `value`?)"],
    );
    check(
        "[nodes.a]\nkind = \"number\"\nnumber = 3",
        &["3:1: kind `number` has no key `number` (`number` is an output)"],
    );
    check(
        "[nodes.a]\nkind = \"number\"\nx = 3\ny = 4",
        &[
            "3:1: kind `number` has no key `x` (expected `value` or `kind`)",
            "4:1: kind `number` has no key `y` (expected `value` or `kind`)",
        ],
    );
}

#[test]
fn parameters() {
    check(
        "[nodes.a]\nkind = \"number\"\nvalue = \"three\"",
        &[r#"3:9: `value` must be an integer, but is the text "three""#],
    );
    check(
        "[nodes.a]\nkind = \"number\"\nvalue = 3.5",
        &["3:9: `value` must be an integer, but is 3.5"],
    );
    check("[nodes.a]\nkind = \"number\"\nvalue = nan", &["3:9: `nan` is not a finite number"]);
    check(
        "[nodes.a]\nkind = \"number\"\nvalue = 99999999999999999999",
        &["3:9: `99999999999999999999` does not fit into 64 bits"],
    );
    check(
        "[nodes.a]\nkind = \"number\"\nvalue = 2020-01-01",
        &["3:9: a date is not a value of a pipeline"],
    );
    check_after_one(
        "[nodes.b]\nkind = \"scale\"\nnumber = \"@one\"",
        &["4:8: `b` needs `factor` (a number from 0 to 1000: What it is multiplied by.)"],
    );
    let scale = |fields: &str| format!("[nodes.b]\nkind = \"scale\"\nnumber = \"@one\"\n{fields}");
    check_after_one(
        &scale("factor = -0.5"),
        &["7:10: `factor` must be a number from 0 to 1000, but is -0.5"],
    );
    check_after_one(
        &scale("factor = 1001"),
        &["7:10: `factor` must be a number from 0 to 1000, but is 1001"],
    );
    check_after_one(
        &scale("factor = 1\nlimit = 0"),
        &["8:9: `limit` must be an integer of at least 1, but is 0"],
    );
    check_after_one(&scale("factor = inf"), &["7:10: `inf` is not a finite number"]);
    check_after_one(
        &scale("factor = 1\nlimit = 5000000000"),
        &["4:8: invalid value: integer `5000000000`, expected u32"],
    );
    check_after_one(
        &scale("factor = true\nrounding = \"dwon\""),
        &[
            "7:10: `factor` must be a number from 0 to 1000, but is true",
            r#"8:12: `rounding` cannot be "dwon" (did you mean `down`?)"#,
        ],
    );
    check_after_one(
        &scale("factor = [1]\nrounding = 3"),
        &[
            "7:10: `factor` must be a number from 0 to 1000, but is a list of 1 value",
            r#"8:12: `rounding` must be "nearest" or "down" or "up", but is 3"#,
        ],
    );
    check_after_one(
        "[nodes.b]\nkind = \"add\"\nterms = \"@one\"\nweights = [1, \"x\"]",
        &[r#"7:15: `weights[1]` must be an integer, but is the text "x""#],
    );
    check_after_one(
        "[nodes.b]\nkind = \"divide\"\nnumber = \"@one\"\nby = 0",
        &["7:6: `by` must not be zero"],
    );
    check(
        "[nodes.a]\nkind = \"fail\"\nmessage = \"@one\"",
        &["3:11: `message` is a parameter and takes no wire"],
    );
    check(
        "[nodes.a]\nkind = \"fail\"\nenvironment = 1",
        &["3:15: `environment` must be `true` or `false`, but is 1"],
    );
}

#[test]
fn wires() {
    let scale =
        |number: &str| format!("[nodes.b]\nkind = \"scale\"\nfactor = 1\nnumber = {number}\n");
    check_after_one(&scale("\"@on\""), &["7:10: there is no node `on` (did you mean `one`?)"]);
    check_after_one(
        &scale("\"one\""),
        &[r#"7:10: expected a wire, but this is the text "one" (write "@one")"#],
    );
    check_after_one(
        &scale("3"),
        &[r#"7:10: expected a wire, but this is 3 (a wire is written as "@node.port")"#],
    );
    check_after_one(&scale("[\"@one\"]"), &["7:10: `number` takes one wire, not a list"]);
    check_after_one(
        &scale("\"@one.nubmer\""),
        &["7:10: `one` has no output `nubmer` (did you mean `number`?)"],
    );
    check_after_one(
        "[nodes.b]\nkind = \"scale\"\nfactor = 1",
        &["4:8: `b.number` is not wired (it takes `number`: what is multiplied)"],
    );
    check_after_one(
        "[nodes.b]\nkind = \"add\"",
        &[
            "4:8: `b.terms` is not wired (it takes `number`: what is added; `terms = []` if there are none)",
        ],
    );
    check_after_one(
        "[nodes.b]\nkind = \"add\"\ntrms = [\"@one\"]",
        &["6:1: kind `add` has no key `trms` (did you mean `terms`?)"],
    );
    check_after_one(
        "[nodes.b]\nkind = \"add\"\nterms = [\"@one\", 3, \"@two\"]",
        &[
            r#"6:18: expected a wire, but this is 3 (a wire is written as "@node.port")"#,
            "6:21: there is no node `two` (expected `one` or `b`)",
        ],
    );
    check_after_one(
        "[nodes.b]\nkind = \"count\"\ntext = \"@one\"",
        &[
            "6:8: `text` takes `text`, but this is `number` (a `gather` node makes `text` from `number`)",
        ],
    );
    let divide = "[nodes.c]\nkind = \"divide\"\nby = 2\nnumber = \"@one\"\n";
    check_after_one(
        &format!("{}{divide}", scale("\"@c\"")),
        &[r#"7:10: `c` has 2 outputs: name one of them (write "@c.quotient" or "@c.remainder")"#],
    );
    check(
        "[nodes.a]\nkind = \"numbr\"\n[nodes.b]\nkind = \"add\"\nterms = [\"@a\"]",
        &["2:8: there is no kind of node `numbr` (did you mean `number`?)"],
    );
}

#[test]
fn wire_types_name_the_converting_kind() {
    let note = "[nodes.note]\nkind = \"text_file\"\npath = \"note.txt\"\n";
    let add = "[nodes.b]\nkind = \"add\"\nterms = [\"@note\"]\n";
    let text = format!("{note}{add}");
    check_files(
        &[("pipeline.toml", &text), ("note.txt", "")],
        &[
            "6:10: `terms` takes `number`, but this is `text` (a `count` node makes `number` from `text`)",
        ],
    );
}

#[test]
fn files() {
    let note = |path: &str| format!("[nodes.note]\nkind = \"text_file\"\npath = \"{path}\"\n");
    check_files(
        &[("pipeline.toml", &note("noet.txt")), ("note.txt", "")],
        &["3:8: there is no file `noet.txt` (did you mean `note.txt`?)"],
    );
    check(
        &note("data/note.txt"),
        &["3:8: there is no file `data/note.txt` (there is no folder `data`)"],
    );
    check(&note("."), &["3:8: `.` is not a file"]);
    check_files(
        &[("pipeline.toml", &note("a.txt")), ("a.txt", "include b.txt\n")],
        &["3:8: there is no file `b.txt` (did you mean `a.txt`?)"],
    );
    let text = format!("[params]\nfile = \"x.txt\"\n{}", note("${file}"));
    check(&text, &["5:8: there is no file `x.txt`"]);
}

#[test]
fn substitution() {
    check(
        "[params]\nk = 3\n[nodes.a]\nkind = \"number\"\nvalue = \"${kk}\"",
        &["5:9: there is no parameter `kk` (did you mean `k`?)"],
    );
    check(
        "[nodes.a]\nkind = \"number\"\nvalue = \"${k}\"",
        &["3:9: there is no parameter `k` (parameters are declared in `[params]`)"],
    );
    check(
        "[params]\nk = \"x\"\n[nodes.a]\nkind = \"number\"\nvalue = \"${k}\"",
        &[r#"5:9: `value` must be an integer, but is the text "x""#],
    );
    check(
        "[nodes.a]\nkind = \"fail\"\nmessage = \"${k\"",
        &["3:11: `${` is not closed by `}` (`$${` stands for `${` itself)"],
    );
    check(
        "[params]\na = \"${b}\"\nb = \"${a}\"\n[nodes.a]\nkind = \"number\"\nvalue = \"${a}\"",
        &["2:5: parameters refer to each other in a circle: `a` → `b` → `a`"],
    );
    check(
        "[params]\na = [1]\n[nodes.a]\nkind = \"fail\"\nmessage = \"${a}.\"",
        &["5:11: `${a}` is a list of 1 value and cannot stand inside of a text"],
    );
    check(
        "[params]\na = \"@one\"\n[nodes.one]\nkind = \"number\"",
        &["2:5: parameter `a` cannot be a wire (artifacts enter a pipeline through `[inputs]`)"],
    );
}

#[test]
fn cycles() {
    let add =
        |name: &str, term: &str| format!("[nodes.{name}]\nkind = \"add\"\nterms = [\"@{term}\"]\n");
    check(&add("a", "a"), &["1:8: nodes wait for each other: `a` → `a`"]);
    check(
        &[add("a", "b"), add("b", "c"), add("c", "a"), add("d", "c")].concat(),
        &["1:8: nodes wait for each other: `a` → `c` → `b` → `a`"],
    );
    check(
        &[add("a", "b"), add("b", "a"), add("c", "d"), add("d", "c")].concat(),
        &[
            "1:8: nodes wait for each other: `a` → `b` → `a`",
            "7:8: nodes wait for each other: `c` → `d` → `c`",
        ],
    );
}

#[test]
fn outputs() {
    check_after_one(
        "[outputs]\n\"a.glb\" = \"@one\"",
        &["5:1: `number` cannot be written as .glb (its formats are `txt`)"],
    );
    check_after_one(
        "[outputs]\n\"a\" = \"@one\"",
        &["5:1: `a` has no extension that chooses a format (its formats are `txt`)"],
    );
    check_after_one(
        "[outputs]\n\"a.txt\" = \"one\"",
        &[r#"5:11: expected a wire, but this is the text "one" (write "@one")"#],
    );
    check_after_one(
        "[outputs]\n\"a.txt\" = \"@two\"",
        &["5:11: there is no node `two` (expected `one`)"],
    );
    check_after_one(
        "[outputs]\n\"a.txt\" = \"@one\"\n\"./a.txt\" = \"@one\"",
        &["6:1: `a.txt` is written twice"],
    );
    check_after_one(
        "[outputs]\n\"../a.txt\" = \"@one\"",
        &[
            "5:1: `../a.txt` lies outside of the current folder (outputs are written into the folder where `sinew` is run)",
        ],
    );
    check_after_one(
        "[outputs]\n\"/tmp/a.txt\" = \"@one\"",
        &[
            "5:1: `/tmp/a.txt` lies outside of the current folder (outputs are written into the folder where `sinew` is run)",
        ],
    );
    check_after_one(
        "[outputs]\n\"${k}.txt\" = \"@one\"",
        &["5:1: there is no parameter `k` (parameters are declared in `[params]`)"],
    );
    check_after_one(
        "[params]\nk = \"x/../../y\"\n[outputs]\n\"${k}.txt\" = \"@one\"",
        &[
            "7:1: `x/../../y.txt` lies outside of the current folder (outputs are written into the folder where `sinew` is run)",
        ],
    );
}

#[test]
fn profiles_and_settings() {
    let text =
        "[params]\nk = 3\n[profiles.fast]\nk = 1\n[nodes.a]\nkind = \"number\"\nvalue = \"${k}\"\n";
    check_settings(text, Some("fast"), &["k=4", "a.value=5"], &[]);
    check_settings(
        text,
        Some("fsat"),
        &[],
        &["--profile:1:1: there is no profile `fsat` (did you mean `fast`?)"],
    );
    check_settings(
        ONE,
        Some("fast"),
        &[],
        &["--profile:1:1: there is no profile `fast` (the file has no profiles)"],
    );
    check_settings(
        text,
        None,
        &["kk=4"],
        &["--set:1:1: there is no parameter `kk` (did you mean `k`?)"],
    );
    check_settings(
        text,
        None,
        &["k"],
        &[
            "--set:1:1: a setting is written as `name=value` (for example `--set k=60` or `--set eigs.k=60`)",
        ],
    );
    check_settings(text, None, &["b.value=4"], &["--set:1:1: there is no node `b` (expected `a`)"]);
    check_settings(
        text,
        None,
        &["a.valu=4"],
        &["--set:1:1: kind `number` has no key `valu` (did you mean `value`?)"],
    );
    check_settings(
        text,
        None,
        &["a.value=abc"],
        &[r#"--set:1:9: `value` must be an integer, but is the text "abc""#],
    );
    check_settings(text, None, &["k=4.5"], &["7:9: `value` must be an integer, but is 4.5"]);
    check_settings(text, None, &["k=nan"], &["--set:1:3: `nan` is not a finite number"]);
    check_settings(
        text,
        None,
        &["=3"],
        &[
            "--set:1:1: a setting is written as `name=value` (for example `--set k=60` or `--set eigs.k=60`)",
        ],
    );
    check_settings(
        text,
        None,
        &["params.k=[1, \"x\"]"],
        &["7:9: `value` must be an integer, but is a list of 2 values"],
    );
    check_settings(
        text,
        None,
        &["k=abc def"],
        &[r#"7:9: `value` must be an integer, but is the text "abc def""#],
    );
    check(
        "[params]\nk = 3\n[profiles.fast]\nkk = 1\n[nodes.a]\nkind = \"number\"",
        &["4:1: profile `fast` sets no parameter: `kk` (did you mean `k`?)"],
    );
}

#[test]
fn inner_pipelines() {
    let inner = "[inputs]\nx = \"number\"\n[params]\nk = 2.0\n[nodes.s]\nkind = \"scale\"\n\
                 number = \"@x\"\nfactor = \"${k}\"\n[outputs]\ny = \"@s\"\n";
    let check_use = |fields: &str, inner: &str, expected: &[&str]| {
        let text = format!("{ONE}[nodes.p]\nkind = \"pipeline\"\n{fields}\n");
        check_files(&[("pipeline.toml", &text), ("inner.toml", inner)], expected);
    };
    let file = "file = \"inner.toml\"\n";
    check_use(&format!("{file}x = \"@one\"\nk = 3"), inner, &[]);
    check_use("", inner, &["4:8: pipeline `p` names no `file`"]);
    check_use("file = \"iner.toml\"", inner, &["6:8: there is no file `iner.toml`"]);
    check_use(file, inner, &["4:8: `p.x` is not wired"]);
    check_use(
        &format!("{file}x = \"@one\"\nkk = 3"),
        inner,
        &["8:1: pipeline `p` has no key `kk` (did you mean `k`?)"],
    );
    check_use(
        &format!("{file}x = \"@one\"\nk = \"@one\""),
        inner,
        &["8:5: `k` is a parameter and takes no wire"],
    );
    check_use(
        &format!("{file}x = \"@one\"\nk = -3"),
        inner,
        &["inner.toml:8:10: `factor` must be a number from 0 to 1000, but is -3"],
    );
    check_use(
        &format!("{file}x = \"@one\""),
        &inner.replace("@s", "@t"),
        &["inner.toml:10:5: there is no node `t` (expected `s` or `x`)"],
    );
    check_use(
        &format!("{file}x = \"@one\""),
        &inner.replace("@x", "@x.y"),
        &[r#"inner.toml:7:10: `x` is an input of this pipeline and has no ports (write "@x")"#],
    );
    check_use(
        &format!("{file}x = \"@one\""),
        &inner.replace("\"number\"", "\"numbr\""),
        &["inner.toml:2:5: there is no type `numbr` (did you mean `number`?)"],
    );
    check_use(
        &format!("{file}x = \"@one\""),
        &inner.replace("x = \"number\"", "x = \"text\""),
        &[
            "7:5: `x` takes `text`, but this is `number` (a `gather` node makes `text` from `number`)",
        ],
    );
    check_use(
        &format!("{file}x = \"@one\""),
        &inner.replace("x = \"number\"", "x = { typ = \"number\" }"),
        &["inner.toml:2:7: unknown key `typ` of an input (did you mean `type`?)"],
    );
    check_use(
        &format!("{file}x = \"@one\""),
        &inner.replace("kind = \"scale\"", "kind = "),
        &["inner.toml:6:8: the value is missing"],
    );
    check_use(
        &format!("{file}x = \"@one\""),
        &inner.replace("nodes.s", "nodes.x").replace("@s", "@x"),
        &["inner.toml:5:8: `x` is an input as well as a node"],
    );
    check_use(
        &format!("{file}x = \"@p\""),
        inner,
        &["inner.toml:5:8: nodes wait for each other: `p/s` → `p/s`"],
    );
    check_use(
        "file = \"pipeline.toml\"",
        inner,
        &["6:8: a pipeline cannot contain itself: `pipeline.toml` → `pipeline.toml`"],
    );
    check(
        inner,
        &[
            r#"2:1: a pipeline with inputs cannot run on its own (use it as a node with `kind = "pipeline"`)"#,
        ],
    );
    let uses = format!(
        "{ONE}[nodes.p]\nkind = \"pipeline\"\n{file}x = \"@one\"\n\
                        [nodes.q]\nkind = \"pipeline\"\n{file}x = \"@p.z\"\n[nodes.r]\nkind = \"add\"\nterms = \"@q\""
    );
    let wrong = inner.replace("factor", "fcator");
    check_files(
        &[("pipeline.toml", &uses), ("inner.toml", &wrong)],
        &[
            "11:5: `p` has no output `z` (expected `y`)",
            "inner.toml:8:1: kind `scale` has no key `fcator` (did you mean `factor`?)",
        ],
    );
}

#[test]
fn a_file_that_is_not_there() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("missing.toml");
    let diagnostics = pipeline::load(&path, &TOY, &Settings::default()).err().unwrap();
    let message = &diagnostics.list[0].message;
    assert_eq!(*message, format!("there is no file `{}`", path.display()));
}

#[test]
fn keys_of_every_node() {
    let text = |keys: &str| format!("[nodes.one]\nkind = \"number\"\n{keys}\n");
    check(&text("retries = 3\nbackoff = 0\ntimeout = \"10m\"\nisolate = true"), &[]);
    check(&text("timeout = 0.5\nisolate = { memory = \"4 GB\" }"), &[]);
    for (keys, expected) in [
        ("retries = -1", "3:11: `retries` must be an integer from 0 to 100, but is -1"),
        ("retries = 1.5", "3:11: `retries` must be an integer from 0 to 100, but is 1.5"),
        ("retires = 1", "3:1: kind `number` has no key `retires` (did you mean `retries`?)"),
        ("timeout = 0", "3:11: `timeout` must be above 0"),
        ("timeout = -1", "3:11: `timeout` must be a number of seconds, but is -1"),
        (
            "timeout = [1]",
            "3:11: `timeout` must be seconds or a text like \"10m\", but is a list of 1 value",
        ),
        (
            "timeout = \"3 days\"",
            "3:11: `timeout` is wrong: `days` is no unit of time: `ms`, `s`, `m` and `h` are",
        ),
        (
            "backoff = \"soon\"",
            "3:11: `backoff` is wrong: `soon` is no unit of time: `ms`, `s`, `m` and `h` are",
        ),
        (
            "isolate = \"yes\"",
            "3:11: `isolate` must be `true`, `false` or a table with a `memory`, but is the text \"yes\"",
        ),
        (
            "isolate = { memroy = 1 }",
            "3:13: `isolate` has no key `memroy` (did you mean `memory`?)",
        ),
        (
            "isolate = { memory = 0 }",
            "3:22: `isolate.memory` must be a size such as \"4 GB\", but is 0",
        ),
        (
            "isolate = { memory = \"4 GX\" }",
            "3:22: `isolate.memory` is wrong: `GX` is no unit: K, M, G and T are",
        ),
    ] {
        check(&text(keys), &[expected]);
    }
    check_settings(
        &text(""),
        None,
        &["one.retries=many"],
        &["--set:1:13: `retries` must be an integer from 0 to 100, but is the text \"many\""],
    );
}

#[test]
fn an_inner_pipeline_has_no_parameter_that_is_a_key_of_every_node() {
    let inner = "[inputs]\ntimeout = \"number\"\n[params]\nretries = 2\n[nodes.a]\n\
                 kind = \"number\"\nvalue = \"${retries}\"\n";
    let outer =
        format!("{ONE}[nodes.p]\nkind = \"pipeline\"\nfile = \"inner.toml\"\ntimeout = 3\n");
    let hint = "(this file is used as a node)";
    check_files(
        &[("pipeline.toml", &outer), ("inner.toml", inner)],
        &[
            "4:8: `p.timeout` is not wired",
            &format!(
                "inner.toml:2:1: `timeout` is a key of every node and needs another name {hint}"
            ),
            &format!(
                "inner.toml:4:1: `retries` is a key of every node and needs another name {hint}"
            ),
        ],
    );
}
