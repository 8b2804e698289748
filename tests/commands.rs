//! The commands that only read pipelines, as their users see them.

use std::{
    fs,
    path::Path,
    process::{Command, Output},
};

struct Folder(tempfile::TempDir);

impl Folder {
    fn with(files: &[(&str, &str)]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in files {
            fs::write(folder.path().join(name), text).unwrap();
        }
        Self(folder)
    }

    fn path(&self) -> &Path {
        self.0.path()
    }

    /// Runs `sinew` here; the exit code, standard output and standard error.
    fn sinew(&self, args: &[&str]) -> (i32, String, String) {
        let output: Output = Command::new(env!("CARGO_BIN_EXE_sinew"))
            .args(args)
            .current_dir(self.path())
            .env_remove("NO_COLOR")
            .env_remove("CLICOLOR_FORCE")
            .output()
            .unwrap();
        let text = |bytes| String::from_utf8(bytes).unwrap();
        (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
    }
}

const BAD: &str = "[nodes.a]\nkind = \"nothing_of_this_name\"\n\n[nodez]\n";

#[test]
fn check_tells_every_mistake_and_ends_with_2() {
    let folder = Folder::with(&[("bad.toml", BAD)]);
    let (code, stdout, stderr) = folder.sinew(&["check", "bad.toml"]);
    assert_eq!((code, stdout.as_str()), (2, ""));
    for line in [
        "error: there is no kind of node `nothing_of_this_name`",
        " --> bad.toml:2:8",
        "2 | kind = \"nothing_of_this_name\"",
        "  |        ^^^^^^^^^^^^^^^^^^^^^^",
        "error: unknown section `nodez`",
        "did you mean `nodes`?",
        "error: 2 mistakes",
    ] {
        assert!(stderr.contains(line), "{line}\n{stderr}");
    }
    assert!(!stderr.contains('\x1b'), "no colours where there is no terminal");
}

#[test]
fn colours_are_given_when_they_are_asked_for() {
    let folder = Folder::with(&[("bad.toml", BAD)]);
    let (_, _, stderr) = folder.sinew(&["--color", "always", "check", "bad.toml"]);
    assert!(stderr.contains('\x1b'));
}

#[test]
fn check_writes_json_to_standard_output() {
    let folder = Folder::with(&[("bad.toml", BAD)]);
    let (code, stdout, _) = folder.sinew(&["check", "--json", "bad.toml"]);
    assert_eq!(code, 2);
    let lines: Vec<serde_json::Value> =
        stdout.lines().map(|it| serde_json::from_str(it).unwrap()).collect();
    assert_eq!(lines.len(), 2);
    assert_eq!(lines[0]["severity"], "error");
    assert_eq!((&lines[0]["line"], &lines[0]["column"]), (&2.into(), &8.into()));
    assert_eq!(lines[1]["file"], "bad.toml");
    assert_eq!(lines[1]["hint"], "did you mean `nodes`?");
}

#[test]
fn a_file_that_is_not_there_is_wrong_usage() {
    let folder = Folder::with(&[]);
    let (code, _, stderr) = folder.sinew(&["check", "missing.toml"]);
    assert_eq!(code, 2);
    assert!(stderr.contains("there is no file `missing.toml`"), "{stderr}");
}

#[test]
fn a_folder_can_be_entered_first() {
    let folder = Folder::with(&[]);
    fs::create_dir(folder.path().join("inner")).unwrap();
    fs::write(folder.path().join("inner/bad.toml"), BAD).unwrap();
    let (code, _, stderr) = folder.sinew(&["-C", "inner", "check", "bad.toml"]);
    assert_eq!(code, 2);
    assert!(stderr.contains("--> bad.toml:2:8"), "{stderr}");
    let (code, _, stderr) = folder.sinew(&["-C", "nowhere", "check", "bad.toml"]);
    assert_eq!(code, 2);
    assert!(stderr.contains("cannot go to the folder `nowhere`"), "{stderr}");
}

#[test]
fn nodes_lists_all_kinds_and_shows_one() {
    let folder = Folder::with(&[]);
    let (code, list, _) = folder.sinew(&["nodes"]);
    assert_eq!(code, 0);
    assert_eq!(list.lines().count(), sinew::LIBRARY.kinds.len());
    let (code, one, _) = folder.sinew(&["nodes", "table"]);
    assert_eq!(code, 0);
    assert!(one.starts_with("## table\n"), "{one}");
    let (code, json, _) = folder.sinew(&["nodes", "table", "--json"]);
    assert_eq!(code, 0);
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["kind"], "table");
    let (code, _, stderr) = folder.sinew(&["nodes", "tabel"]);
    assert_eq!(code, 2);
    assert!(stderr.contains("did you mean `table`?"), "{stderr}");
}

#[test]
fn new_writes_a_pipeline_and_never_over_another() {
    let folder = Folder::with(&[]);
    let (code, stdout, _) = folder.sinew(&["new", "first"]);
    assert_eq!((code, stdout.as_str()), (0, ""));
    let text = fs::read_to_string(folder.path().join("first.toml")).unwrap();
    assert!(text.contains("[nodes.source]"));
    fs::write(folder.path().join("first.toml"), "mine").unwrap();
    let (code, _, stderr) = folder.sinew(&["new", "first.toml"]);
    assert_eq!(code, 2);
    assert!(stderr.contains("`first.toml` is there already"), "{stderr}");
    assert_eq!(fs::read_to_string(folder.path().join("first.toml")).unwrap(), "mine");
    let (code, _, _) = folder.sinew(&["new", "no/such/folder/x"]);
    assert_eq!(code, 3);
}

#[test]
fn schema_and_completions_are_data() {
    let folder = Folder::with(&[]);
    let (code, stdout, stderr) = folder.sinew(&["schema"]);
    assert_eq!((code, stderr.as_str()), (0, ""));
    let schema: serde_json::Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!(schema["title"], "Sinew pipeline");
    for shell in ["bash", "zsh", "fish"] {
        let (code, stdout, _) = folder.sinew(&["completions", shell]);
        assert_eq!(code, 0);
        assert!(stdout.contains("sinew"), "{shell}");
    }
}

#[test]
fn wrong_usage_ends_with_2() {
    let folder = Folder::with(&[]);
    assert_eq!(folder.sinew(&["chekc"]).0, 2);
    assert_eq!(folder.sinew(&["check"]).0, 2);
    assert_eq!(folder.sinew(&["graph", "x.toml", "--dot", "--svg"]).0, 2);
}

#[test]
fn pinned_runs_outlive_housekeeping() {
    let text = "[nodes.a]\nkind = \"synthesize\"\nn_vertices = 1000\n\n\
                [nodes.b]\nkind = \"normalize\"\nmesh = \"@a.mesh\"\n";
    let folder = Folder::with(&[("p.toml", text)]);
    let ok = |args: &[&str]| {
        let (code, stdout, stderr) = folder.sinew(args);
        assert_eq!(code, 0, "{args:?}: {stderr}");
        stdout + &stderr
    };
    ok(&["run", "p.toml"]);
    assert!(ok(&["cache", "pin", "latest", "a"]).contains("pinned 1 results of `"));
    let pins = ok(&["cache", "pins"]);
    let (run, rest) = pins.split_once(' ').unwrap();
    assert_eq!(rest, " 1 results\n");
    let removed = ok(&["cache", "rm", "--all"]);
    assert!(removed.contains("1 results stay\n1 of them because they are pinned"), "{removed}");
    assert!(ok(&["run", "p.toml"]).contains("1 ran, 1 cached"));
    let (code, _, stderr) = folder.sinew(&["cache", "pin", "latest", "nobody"]);
    assert!(code == 2 && stderr.contains("has no result of `nobody`"), "{stderr}");
    ok(&["cache", "unpin", run]);
    assert_eq!(folder.sinew(&["cache", "unpin", run]).0, 2);
    assert!(ok(&["cache", "gc", "--max-size", "0"]).contains("0 results stay"));
}
