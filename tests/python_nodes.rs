//! Functions of Python scripts as nodes.

mod folder;
mod work;

use std::{fs, path::PathBuf, process::Command, sync::LazyLock};

use work::{BODY, Work};

/// Whether this machine has what these tests need; says so if not.
fn has_numpy() -> bool {
    static HAS: LazyLock<bool> = LazyLock::new(|| {
        let found = Command::new("python3").args(["-c", "import numpy"]).output();
        found.is_ok_and(|it| it.status.success())
    });
    if !*HAS {
        eprintln!("skipped: python3 with numpy is not there");
    }
    *HAS
}

/// A pipeline with a script beside it.
fn work(pipeline: &str, script: &str) -> Work {
    let res = Work::new(pipeline, &["-j", "1"]);
    res.write("script.py", script);
    res
}

/// A node that calls `f` of the script, with these further lines.
fn node(name: &str, rest: &str) -> String {
    format!(
        "[nodes.{name}]\nkind = \"python\"\nscript = \"script.py\"\nfunction = \"f\"\n{rest}\n\n"
    )
}

/// What a run would do, a line a node.
fn plan(work: &Work) -> String {
    let output = work.sinew(&["plan", "pipeline.toml"]);
    String::from_utf8([output.stdout, output.stderr].concat()).unwrap()
}

#[test]
fn artifacts_go_in_and_come_out_as_arrays_texts_and_tables() {
    if !has_numpy() {
        return;
    }
    let script = r#"
import numpy

def f(mesh, again, scale, words):
    assert mesh.type == "mesh" and mesh["vertices"].shape == (4, 3)
    assert [it.type for it in again] == ["mesh", "mesh"]
    assert scale == 2 and isinstance(scale, int) and words == {"a": [1.5, "x"]}
    mesh.vertices *= scale                        # a copy: the stored mesh stays as it is
    assert again[0].vertices.max() == 1
    return {
        "mesh": {"vertices": mesh.vertices[::-1][::-1], "faces": mesh.faces.astype(int)},
        "map": {"target_of_source": numpy.array([2, 1, 0], numpy.int32), "n_target": 3},
        "marks": {"vertices": [3, 1], "names": ["head", "foot"]},
        "table": {"name": ["a", "b"], "error [mm]": [1, 2.5]},
        "functions": {"values": [[1.0], [0.0]], "names": ["x"]},
        "report": "all well\n",
        "files": {"a/b.txt": "text", "c": b"\x00\x01"},
    }
"#;
    let check = r#"
import numpy

def f(mesh, map, marks, table, functions, report, documents):
    assert functions.values.tolist() == [[1], [0]] and functions.names == ["x"]
    assert dict(functions).keys() == {"values", "names"} and "values" in functions
    assert mesh.vertices.max() == 2 and mesh.faces.dtype == numpy.uint32
    assert map.target_of_source.tolist() == [2, 1, 0] and map.n_target == "3"
    assert marks.names == ["head", "foot"] and marks.vertices.tolist() == [3, 1]
    assert table["name"] == ["a", "b"] and table["error"].tolist() == [1, 2.5]
    assert report == "all well\n" and documents == {"a/b.txt": b"text", "c": b"\x00\x01"}
    print("checked")
    return [{"x": 1, "y": "p"}, {"x": 2.5, "y": "q"}]
"#;
    let all = "mesh = \"@make.mesh\", map = \"@make.map\", marks = \"@make.marks\", \
               table = \"@make.table\", functions = \"@make.functions\", report = \"@make.report\", documents = \"@make.files\"";
    let pipeline = format!(
        "{BODY}{}[nodes.check]\nkind = \"python\"\nscript = \"check.py\"\nfunction = \"f\"\n\
         inputs = {{ {all} }}\noutputs = {{ rows = \"table\" }}\n\n\
         [outputs]\n\"rows.csv\" = \"@check\"\n\"stdout.txt\" = \"@check.stdout\"\n\
         \"table.csv\" = \"@make.table\"\n",
        node(
            "make",
            "inputs = { mesh = \"@body.mesh\", again = [\"@body.mesh\", \"@body.mesh\"] }\n\
             params = { scale = 2, words = { a = [1.5, \"x\"] } }\n\
             outputs = { mesh = \"mesh\", map = \"point_map\", marks = \"landmarks\", \
             table = \"table\", functions = \"descriptors\", report = \"text\", files = \"files\" }"
        )
    );
    let work = work(&pipeline, script);
    work.write("check.py", check);
    work.succeed();
    assert_eq!(work.read("rows.csv"), "x,y\n1,p\n2.5,q\n");
    assert_eq!(work.read("table.csv"), "name,error [mm]\na,1\nb,2.5\n");
    assert_eq!(work.read("stdout.txt"), "checked\n");
    let again = work.succeed();
    assert!(again.contains("up to date"), "{again}");
}

#[test]
fn a_list_knows_what_it_gathers_and_what_is_missing() {
    if !has_numpy() {
        return;
    }
    let script = r#"
def f(case):
    if case == "b":
        raise ValueError("no result for b")
    return case

def g(all):
    rows = zip(all.labels, all, all.missing)
    return "".join(f"{labels['case']} {item} {why is not None}\n" for labels, item, why in rows)
"#;
    let work = work(
        &format!(
            "[axes]\ncase = {{ values = [\"a\", \"b\", \"c\"] }}\n\n{}[nodes.all]\nkind = \"python\"\n\
             script = \"script.py\"\nfunction = \"g\"\nover = \"case\"\nmissing = \"show\"\n\
             inputs = {{ all = [\"@one\"] }}\noutputs = {{ res = \"text\" }}\n\n\
             [outputs]\n\"all.txt\" = \"@all\"\n",
            node("one", "params = { case = \"${case}\" }\noutputs = { res = \"text\" }")
        ),
        script,
    );
    work.fail(1, "no result for b");
    assert_eq!(work.read("all.txt"), "a a False\nb None True\nc c False\n");
}

#[test]
fn mistakes_of_a_function_fail_its_node_only() {
    if !has_numpy() {
        return;
    }
    let check = |body: &str, outputs: &str, message: &str| {
        let script =
            format!("import os, sys\ndef f(**arguments):\n    {body}\ndef g():\n    pass\n");
        let fine = "[nodes.fine]\nkind = \"python\"\nscript = \"script.py\"\nfunction = \"g\"\n";
        let pipeline = format!("{}{fine}", node("bad", outputs));
        let work = work(&pipeline, &script);
        let text = work.fail(1, message);
        assert!(text.contains("1 failed of 2 nodes"), "the other one runs: {text}");
        text
    };
    let one = "outputs = { res = \"functional_map\" }";
    let text = check("return {}['x']", one, "KeyError: 'x'");
    assert!(text.contains("script.py\", line 3, in f") && !text.contains("<string>"), "{text}");
    check("sys.exit(3)", one, "it called `sys.exit(3)`");
    check("print('last words'); sys.stdout.flush(); os._exit(4)", one, "ended with exit code 4");
    check(
        "os.kill(os.getpid(), 11)",
        one,
        "the interpreter was killed by signal 11 (segmentation fault)",
    );
    check("return 3", one, "output `res`: a `functional_map` is a dictionary of arrays, not `int`");
    let missing = "output `res` is no `functional_map`: array `source_from_target` is missing";
    check("return {'x': [[1.0]]}", one, missing);
    let nan = "output `res` is no `functional_map`: array `source_from_target` holds NaN";
    check("return {'source_from_target': [[float('nan')]]}", one, nan);
    let objects = "`source_from_target` is an array of `object`, and artifacts hold numbers";
    check("return {'source_from_target': [[{}]]}", one, objects);
    let two = "outputs = { a = \"text\", b = \"text\" }";
    check("return {'a': ''}", two, "the outputs `a`, `b`, but returned `a`");
    let faces = "output `m` is no `mesh`: array `faces` holds -1, which is no U32";
    check(
        "return {'vertices': [[0.0, 0, 0]] * 3, 'faces': [[0, 1, -1]]}",
        "outputs = { m = \"mesh\" }",
        faces,
    );
    let columns = "column `b` has 1 rows, and others 2";
    check("return {'a': [1, 2], 'b': [1]}", "outputs = { t = \"table\" }", columns);
}

#[test]
fn what_a_script_prints_or_starts_does_not_disturb_the_call() {
    if !has_numpy() {
        return;
    }
    let script = r#"
import ctypes, os, subprocess, sys

def f(case):
    print("to stdout", case)
    print("to stderr", file=sys.stderr)
    os.write(1, b"{\"result\": 1}\n")
    ctypes.CDLL(None).puts(b"from C")
    subprocess.run(["echo", "from a child"])
    assert sys.stdin.read() == ""
    if os.fork() == 0:
        return "from the fork"
    os.wait()
    sys.stdout = None
    return f"case {case}\n"
"#;
    let two = |name: &str, case: u32| {
        node(name, &format!("params = {{ case = {case} }}\noutputs = {{ res = \"text\" }}"))
    };
    let outputs = "[outputs]\n\"1.txt\" = \"@one.res\"\n\"2.txt\" = \"@two.res\"\n\
                   \"1.out\" = \"@one.stdout\"\n\"1.err\" = \"@one.stderr\"\n\"2.out\" = \"@two.stdout\"\n";
    let outputs = outputs.replace(".out\"", "-out.txt\"").replace(".err\"", "-err.txt\"");
    let work = work(&format!("{}{}{outputs}", two("one", 1), two("two", 2)), script);
    work.succeed();
    assert_eq!((work.read("1.txt"), work.read("2.txt")), ("case 1\n".into(), "case 2\n".into()));
    for case in [1, 2] {
        let text = work.read(&format!("{case}-out.txt"));
        let mut lines: Vec<&str> = text.lines().collect();
        lines.sort_unstable();
        let first = format!("to stdout {case}");
        // The fork has a copy of what was not flushed yet.
        lines.dedup();
        assert_eq!(lines, ["from C", "from a child", &first, "{\"result\": 1}"], "{text}");
    }
    assert_eq!(work.read("1-err.txt"), "to stderr\n");
}

#[test]
fn calls_see_declared_things_only_and_the_same_state() {
    if !has_numpy() {
        return;
    }
    let script = r#"
import os, random, numpy
import helper

def f(data, **rest):
    try:
        import undeclared
        raise AssertionError("it is beside the script, but not declared")
    except ImportError:
        pass
    assert "SECRET" not in os.environ and os.environ["MINE"] == "1"
    assert os.environ["OMP_NUM_THREADS"] == "1"
    os.environ["LEFT"] = "behind"
    assert os.listdir(".") == []
    open("left", "w").close()
    numbers = [random.random(), numpy.random.rand()]
    return f"{helper.VALUE} {open(data).read().strip()} {numbers}\n"
"#;
    let rest = |n: u32| {
        format!(
            "files = {{ helper = \"lib/helper.py\", data = \"data.txt\" }}\nparams = {{ n = {n} }}\n\
             env = {{ MINE = \"1\" }}\noutputs = {{ res = \"text\" }}"
        )
    };
    let outputs = "[outputs]\n\"1.txt\" = \"@one\"\n\"2.txt\" = \"@two\"\n";
    let pipeline = format!("{}{}{outputs}", node("one", &rest(1)), node("two", &rest(2)));
    let work = work(&pipeline, script);
    work.write("lib/helper.py", "VALUE = 'first'\n");
    work.write("undeclared.py", "");
    work.write("data.txt", "data\n");
    work.succeed();
    assert!(work.read("1.txt").starts_with("first data [0."));
    assert_eq!(
        work.read("1.txt"),
        work.read("2.txt"),
        "the second call finds nothing of the first"
    );
    work.write("lib/helper.py", "VALUE = 'second'\n");
    assert!(plan(&work).contains("file `files.helper` changed"), "{}", plan(&work));
    work.succeed();
    assert!(work.read("1.txt").starts_with("second data"));
    work.write("data.txt", "other\n");
    work.succeed();
    assert!(work.read("1.txt").starts_with("second other"));
}

#[test]
fn one_interpreter_is_kept_until_a_call_fails() {
    if !has_numpy() {
        return;
    }
    let script = r#"
import os
calls = 0

def f(n):
    global calls
    calls += 1
    if n == 3:
        raise ValueError("three")
    return f"{calls} {os.getpid()}\n"
"#;
    let mut pipeline = String::new();
    let mut outputs = "[outputs]\n".to_owned();
    for n in 1..=5 {
        let rest = format!("params = {{ n = {n} }}\noutputs = {{ res = \"text\" }}");
        pipeline += &node(&format!("n{n}"), &rest);
        outputs += &format!("\"{n}.txt\" = \"@n{n}\"\n");
    }
    let work = work(&(pipeline + &outputs), script);
    work.fail(1, "ValueError: three");
    let read = |n: u32| work.read(&format!("{n}.txt"));
    let pid = |n: u32| read(n).split(' ').nth(1).unwrap().to_owned();
    assert!(read(1).starts_with("1 ") && read(2).starts_with("2 "), "{} {}", read(1), read(2));
    assert!(read(4).starts_with("1 ") && read(5).starts_with("2 "), "{} {}", read(4), read(5));
    assert_eq!((pid(1), pid(4)), (pid(2), pid(5)));
    assert_ne!(pid(1), pid(4));
    for pid in [pid(1), pid(4)] {
        let path = PathBuf::from("/proc").join(pid.trim());
        let start = std::time::Instant::now();
        while path.exists() {
            assert!(start.elapsed().as_secs() < 10, "no interpreter outlives the run");
            std::thread::sleep(std::time::Duration::from_millis(10));
        }
    }
}

#[test]
fn a_time_limit_ends_the_interpreter_and_the_next_call_has_a_new_one() {
    if !has_numpy() {
        return;
    }
    let script = "import os, subprocess, time\n\
                  def f(path, slow):\n    if slow:\n        child = subprocess.Popen(['sleep', '1000'])\n\
                  \x20       open(path, 'w').write(f'{child.pid} {os.getpid()}')\n        time.sleep(1000)\n\
                  \x20   return 'fast'\n";
    let work = work("", script);
    let pids = work.path("pids.txt").display().to_string();
    let rest = |slow: bool| {
        let limit = if slow { "timeout = 4\n" } else { "" };
        format!(
            "params = {{ path = \"{pids}\", slow = {slow} }}\n{limit}outputs = {{ res = \"text\" }}"
        )
    };
    let outputs = "[outputs]\n\"fast.txt\" = \"@fast\"\n";
    let pipeline = format!("{}{}{outputs}", node("slow", &rest(true)), node("fast", &rest(false)));
    work.write("pipeline.toml", &pipeline);
    let text = work.fail(1, "took longer than its time limit of 4 s");
    assert!(text.contains("1 failed of 2 nodes"), "{text}");
    assert_eq!(work.read("fast.txt"), "fast");
    for pid in work.read("pids.txt").split(' ') {
        let path = PathBuf::from("/proc").join(pid).join("stat");
        let start = std::time::Instant::now();
        while fs::read_to_string(&path).is_ok_and(|it| !it.contains(") Z ")) {
            assert!(start.elapsed().as_secs() < 10, "{pid} is still there");
            std::thread::sleep(std::time::Duration::from_millis(10));
        }
    }
}

#[test]
fn a_call_runs_in_a_process_of_its_own_as_well() {
    if !has_numpy() {
        return;
    }
    let script = "def f(mesh, all):\n    return f'{len(all)} {mesh.vertices.sum()}'\n";
    let rest = "isolate = true\noutputs = { res = \"text\" }\n\
                inputs = { mesh = \"@body.mesh\", all = [\"@body.mesh\"] }";
    let outputs = "[outputs]\n\"res.txt\" = \"@x\"\n";
    let work = work(&format!("{BODY}{}{outputs}", node("x", rest)), script);
    work.succeed();
    assert_eq!(work.read("res.txt"), "1 3.0");
}

#[test]
fn what_counts_is_the_script_and_the_versions_of_packages() {
    if !has_numpy() {
        return;
    }
    let script = "import peer\ndef f():\n    return peer.__name__ + '\\n'\n";
    let work = work("", script);
    let pipeline = |name: &str| {
        let lib = work.path("lib");
        let rest = format!(
            "packages = [\"numpy\", \"peer\", \"loose\"]\noutputs = {{ res = \"text\" }}\n\
             env = {{ PYTHONPATH = \"{}\" }}",
            lib.display()
        );
        format!("{}{BODY}", node(name, &rest))
    };
    let metadata =
        |version: &str| format!("Metadata-Version: 2.1\nName: peer\nVersion: {version}\n");
    work.write("lib/peer.py", "");
    work.write("lib/loose.py", "x = 1\n");
    work.write("lib/peer-1.0.dist-info/METADATA", &metadata("1.0"));
    work.write("pipeline.toml", &pipeline("peer"));
    work.succeed();
    assert!(work.succeed().contains("up to date"));

    work.write("pipeline.toml", &pipeline("renamed"));
    assert!(work.succeed().contains("up to date"));
    work.write("lib/peer-1.0.dist-info/METADATA", &metadata("1.1"));
    assert!(plan(&work).contains("`peer`: 1.0 -> 1.1"), "{}", plan(&work));
    assert!(work.succeed().contains("1 cached, 1 to do"));
    work.write("lib/loose.py", "x = 2\n");
    assert!(plan(&work).contains("`loose`: files "), "{}", plan(&work));
    assert!(work.succeed().contains("1 cached, 1 to do"));
    work.write("script.py", &format!("{script}# a remark\n"));
    assert!(plan(&work).contains("file `script` changed"), "{}", plan(&work));
    assert!(work.succeed().contains("1 cached, 1 to do"));

    fs::remove_dir_all(work.path("lib/peer-1.0.dist-info")).unwrap();
    fs::remove_file(work.path("lib/peer.py")).unwrap();
    work.fail(3, "has no package `peer`: install it");
}

#[test]
fn an_interpreter_is_a_place_and_not_part_of_the_key() {
    if !has_numpy() {
        return;
    }
    let script = "def f():\n    return ''\n";
    let rest = "python = \"${python}\"\noutputs = { res = \"text\" }";
    let pipeline = format!("[params]\npython = \"python3\"\n\n{}", node("x", rest));
    let work = work(&pipeline, script);
    work.succeed();
    let found = Command::new("python3").args(["-c", "import sys; print(sys.executable)"]).output();
    let found = String::from_utf8(found.unwrap().stdout).unwrap();
    std::os::unix::fs::symlink(found.trim(), work.path("python")).unwrap();
    let version = || Command::new(work.path("python")).args(["-c", "import numpy"]).output();
    if !version().unwrap().status.success() {
        return;
    }
    let output = work.sinew(&["run", "pipeline.toml", "--set", "python=./python"]);
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(text.contains("up to date"), "{text}");
    let output = work.sinew(&["run", "pipeline.toml", "--set", "python=./none"]);
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(text.contains("there is no program `") && text.contains("/none`"), "{text}");
    assert_eq!(output.status.code(), Some(3));
}

#[test]
fn mistakes_in_the_pipeline_are_found_before_anything_runs() {
    let check = |rest: &str, message: &str| {
        let work = work(&format!("{BODY}{}", node("x", rest)), "");
        let output = work.sinew(&["check", "pipeline.toml"]);
        let text = String::from_utf8([output.stdout, output.stderr].concat()).unwrap();
        assert!(text.contains(message), "`{message}` is not in:\n{text}");
        assert_eq!(output.status.code(), Some(2), "{text}");
    };
    check("inputs = { def = \"@body.mesh\" }", "`inputs` has \"def\", which is no name in Python");
    check("inputs = { a-b = \"@body.mesh\" }", "\"a-b\", which is no name in Python");
    let both = "inputs = { a = \"@body.mesh\" }\nparams = { a = 1 }";
    check(both, "`params` has `a`, and so has `inputs`");
    check("files = { a = \"none.txt\" }", "there is no file `none.txt`");
    check("packages = [\"-x\"]", "which is no name of a package");
    check("outputs = { res = \"textt\" }", "did you mean `text`?");
    check("paramz = { a = 1 }", "has no key `paramz`");
}
