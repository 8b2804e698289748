//! Programs as nodes: what they get, what they may leave, how they end.

mod folder;
mod work;

use std::{
    fs,
    os::unix::fs::PermissionsExt,
    path::Path,
    process::Command,
    time::{Duration, Instant},
};

use work::{BODY, Work};

fn work(pipeline: &str) -> Work {
    Work::new(pipeline, &[])
}

/// A node that runs a line of shell, with one text output at `out/res.txt`.
fn shell(line: &str) -> String {
    format!(
        "[nodes.tool]\nkind = \"command\"\nshell = true\ncommand = '''{line}'''\n\
         outputs = {{ res = \"text\" }}\n\n[outputs]\n\"res.txt\" = \"@tool\"\n\
         \"stdout.txt\" = \"@tool.stdout\"\n\"stderr.txt\" = \"@tool.stderr\"\n"
    )
}

#[track_caller]
fn check_fails(pipeline: &str, message: &str) {
    let work = work(pipeline);
    let output = work.sinew(&["check", "pipeline.toml"]);
    let text = String::from_utf8([output.stdout, output.stderr].concat()).unwrap();
    assert!(text.contains(message), "`{message}` is not in:\n{text}");
    assert_eq!(output.status.code(), Some(2), "{text}");
}

#[test]
fn artifacts_go_in_and_come_out_in_any_format() {
    let formats = ["ply", "obj", "off", "safetensors", "glb"];
    for format in formats {
        let work = work(&format!(
            "{BODY}\n[nodes.copy]\nkind = \"command\"\ninputs = {{ mesh = \"@body.mesh\" }}\n\
             outputs = {{ copy = \"mesh\" }}\n\
             command = [\"cp\", \"{{in:mesh.{format}}}\", \"{{out:copy.{format}}}\"]\n\n\
             [outputs]\n\"before.obj\" = \"@body.mesh\"\n\"after.obj\" = \"@copy\"\n"
        ));
        work.succeed();
        assert_eq!(work.read("before.obj"), work.read("after.obj"), "{format}");
        let again = work.succeed();
        assert!(!again.contains("copy"), "{again}");
    }
}

#[test]
fn a_list_of_inputs_is_an_argument_each() {
    let work = work(&format!(
        "{BODY}\n[nodes.all]\nkind = \"command\"\n\
         inputs = {{ meshes = [\"@body.mesh\", \"@body.mesh\"], one = [\"@body.mesh\"] }}\n\
         command = [\"echo\", \"{{in:meshes.off}}\", \"{{in:one.ply}}\"]\n\n\
         [outputs]\n\"stdout.txt\" = \"@all.stdout\"\n"
    ));
    work.succeed();
    assert_eq!(work.read("stdout.txt"), "in/meshes/0.off in/meshes/1.off in/one/0.ply\n");
}

#[test]
fn archives_of_numpy_come_out() {
    let found = Command::new("python3").args(["-c", "import numpy"]).output();
    if !found.is_ok_and(|it| it.status.success()) {
        eprintln!("skipped: python3 with numpy is not there");
        return;
    }
    let script = "import sys, numpy as np\n\
        given = np.load(sys.argv[1])\n\
        np.savez(sys.argv[2], vertices=np.asfortranarray(given['vertices']) * 2,\n\
        \x20   faces=given['faces'].astype(np.int32))\n\
        np.savez(sys.argv[3], target_of_source=np.arange(int(sys.argv[4])), n_target=4)\n\
        np.savez(sys.argv[5], vertices=np.array([3, 1]), names=np.array(['a', 'b']))\n";
    let work = work(&format!(
        "{BODY}\n[nodes.tool]\nkind = \"command\"\ninputs = {{ mesh = \"@body.mesh\" }}\n\
         outputs = {{ mesh2 = \"mesh\", map = \"point_map\", marks = \"landmarks\" }}\n\
         files = {{ tool = \"tool.py\" }}\ncommand = [\"python3\", \"{{file:tool}}\", \
         \"{{in:mesh.npz}}\", \"{{out:mesh2.npz}}\", \"{{out:map.npz}}\", 4, \"{{out:marks.npz}}\"]\n\n\
         [outputs]\n\"mesh.obj\" = \"@tool.mesh2\"\n"
    ));
    work.write("tool.py", script);
    work.succeed();
    let text = work.read("mesh.obj");
    assert!(text.contains("v 2 0 0\nv 0 2 0\nv 0 0 2\n"), "{text}");
    let shown = work.sinew(&["show", "pipeline.toml", "tool.map"]);
    let shown = String::from_utf8(shown.stdout).unwrap();
    assert!(shown.contains("100 %"), "{shown}");
}

#[test]
fn standard_streams_are_files_where_the_pipeline_says_so() {
    let work = work(&format!(
        "{BODY}\n[nodes.upper]\nkind = \"command\"\ninputs = {{ mesh = \"@body.mesh\" }}\n\
         outputs = {{ text = \"text\" }}\ncommand = [\"head\", \"-n\", \"2\"]\n\
         stdin = \"{{in:mesh.off}}\"\nstdout_to = \"{{out:text.txt}}\"\n\n\
         [outputs]\n\"text.txt\" = \"@upper.text\"\n\"stdout.txt\" = \"@upper.stdout\"\n"
    ));
    work.succeed();
    assert_eq!(work.read("text.txt"), "OFF\n4 4 0\n");
    assert_eq!(work.read("stdout.txt"), "");
}

#[test]
fn no_shell_looks_at_the_arguments() {
    let work = work(
        "[nodes.echo]\nkind = \"command\"\ncommand = [\"echo\", \"$HOME; `ls` > x *\"]\n\n\
         [outputs]\n\"stdout.txt\" = \"@echo.stdout\"\n",
    );
    work.succeed();
    assert_eq!(work.read("stdout.txt"), "$HOME; `ls` > x *\n");
}

#[test]
fn the_environment_is_what_is_declared() {
    let work = work(
        "[nodes.env]\nkind = \"command\"\ncommand = [\"env\"]\n\
         env = { MINE = \"declared\", OMP_NUM_THREADS = \"4\" }\n\n\
         [outputs]\n\"env.txt\" = \"@env.stdout\"\n",
    );
    work.succeed();
    let text = work.read("env.txt");
    let mut names: Vec<&str> = text.lines().filter_map(|it| Some(it.split_once('=')?.0)).collect();
    names.sort_unstable();
    let mut expected = vec!["HOME", "PATH", "TMPDIR", "MINE"];
    expected.extend(sinew::engine::program::FIXED.map(|it| it.0));
    expected.sort_unstable();
    assert_eq!(names, expected);
    assert!(text.contains("MINE=declared\n") && text.contains("OMP_NUM_THREADS=4\n"), "{text}");
}

#[test]
fn declared_files_count_by_content_and_are_copies() {
    let work = work(
        "[nodes.tool]\nkind = \"command\"\nfiles = { tool = \"tool.sh\", data = \"data.txt\" }\n\
         command = [\"{file:tool}\", \"{file:data}\"]\n\n\
         [outputs]\n\"stdout.txt\" = \"@tool.stdout\"\n",
    );
    work.write("data.txt", "1\n");
    work.write("tool.sh", "#!/bin/sh\necho $1; cat $1; echo changed > $1; cd files; echo *\n");
    work.fail(1, "`files/tool.sh` cannot be run: its file is not executable");
    fs::set_permissions(work.path("tool.sh"), fs::Permissions::from_mode(0o755)).unwrap();
    // The mode is no content: what failed is tried again.
    work.succeed();
    assert_eq!(work.read("stdout.txt"), "files/data.txt\n1\ndata.txt tool.sh\n");
    assert_eq!(work.read("data.txt"), "1\n", "the program changed its copy");
    work.write("data.txt", "2\n");
    let text = work.succeed();
    assert!(text.contains("file `files.data` changed") || text.contains("tool"), "{text}");
    assert_eq!(work.read("stdout.txt"), "files/data.txt\n2\ndata.txt tool.sh\n");
}

#[test]
fn a_set_of_files_is_a_folder() {
    let work = work(
        "[nodes.make]\nkind = \"command\"\nshell = true\n\
         command = \"mkdir {out:made}/a; echo 1 > {out:made}/a/b.txt; echo 2 > {out:made}/c\"\n\
         outputs = { made = \"files\" }\n\n\
         [nodes.list]\nkind = \"command\"\nshell = true\ninputs = { given = \"@make\" }\n\
         command = \"cd {in:given}; cat a/b.txt c\"\n\n\
         [outputs]\n\"stdout.txt\" = \"@list.stdout\"\n",
    );
    work.succeed();
    assert_eq!(work.read("stdout.txt"), "1\n2\n");
}

#[test]
fn failures_say_how_and_show_the_end_of_what_was_printed() {
    work(&shell("echo first >&2; echo the reason >&2; exit 3; {out:res.txt}"))
        .fail(1, "`sh` ended with exit code 3; it printed:");
    work(&shell("echo the reason; exit 3; {out:res.txt}")).fail(1, "the reason");
    work(&shell("kill -SEGV $$; {out:res.txt}"))
        .fail(1, "`sh` was killed by signal 11 (segmentation fault)");
    let missing = "output `res`: `out/res.txt` is not there; the program left `out/res.TXT`";
    let text =
        work(&shell("echo hint >&2; echo 1 > out/res.TXT; true {out:res.txt}")).fail(1, missing);
    assert!(text.contains("hint"), "{text}");
    let unknown = "[nodes.tool]\nkind = \"command\"\ncommand = [\"no-such-program\"]\n";
    work(unknown).fail(3, "there is no program `no-such-program` in `PATH`");
}

#[test]
fn outputs_are_checked() {
    let garbage = |ty: &str, extension: &str| {
        format!(
            "[nodes.tool]\nkind = \"command\"\nshell = true\noutputs = {{ res = \"{ty}\" }}\n\
             command = \"echo garbage > {{out:res.{extension}}}\"\n"
        )
    };
    let check = |ty, extension, message: &str| {
        work(&garbage(ty, extension)).fail(1, message);
    };
    check("mesh", "ply", "output `res`: `out/res.ply` is no `mesh`: PLY file");
    check("mesh", "obj", "output `res`: `out/res.obj` is no `mesh`: OBJ file");
    let damaged = "output `res`: `out/res.safetensors` is no `basis`: the file is damaged";
    check("basis", "safetensors", damaged);
    work(&shell("printf '\\377' > {out:res.txt}"))
        .fail(1, "output `res`: `out/res.txt` is no `text`: byte 0 is no UTF-8");
}

#[test]
fn outputs_cannot_lie_elsewhere() {
    let link = "is or lies behind a symbolic link";
    work(&shell("ln -s /etc/hostname {out:res.txt}")).fail(1, link);
    work(&shell("rm -r out; ln -s /tmp out; echo > {out:res.txt}")).fail(1, link);
    work(&shell("mkdir {out:res.txt}")).fail(1, "is a folder, not a file");
    work(&shell("mkfifo {out:res.txt}")).fail(1, "is no ordinary file");
    let files = "[nodes.tool]\nkind = \"command\"\nshell = true\noutputs = { res = \"files\" }\n\
                 command = \"ln -s /etc/hostname {out:res}/x\"\n";
    work(files).fail(1, "`x` is a link or no ordinary file");
}

#[test]
fn a_flood_is_read_to_its_end_and_its_tail_is_kept() {
    let work = work(&shell(
        "yes 0123456789 | head -c 100000000; echo the end; echo quiet >&2; echo > {out:res.txt}",
    ));
    work.succeed();
    let text = work.read("stdout.txt");
    assert!(text.starts_with("[99"), "{}", &text[..60]);
    assert!(text.contains("bytes before this are not kept]\n0123456789\n"), "{}", &text[..60]);
    assert!(text.ends_with("the end\n") && text.len() < 300_000, "{}", text.len());
    assert_eq!(work.read("stderr.txt"), "quiet\n");
}

/// Waits for a process to be gone.
#[track_caller]
fn assert_gone(pid: &str) {
    let start = Instant::now();
    let stat = || fs::read_to_string(Path::new("/proc").join(pid.trim()).join("stat"));
    // A zombie that its new parent has not reaped yet is gone as well.
    while stat().is_ok_and(|it| !it.contains(") Z ")) {
        assert!(start.elapsed() < Duration::from_secs(10), "{pid} is still there");
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn what_a_program_leaves_running_is_ended() {
    let work = work(&shell("sleep 1000 & echo $! > {out:res.txt}"));
    let start = Instant::now();
    work.succeed();
    assert!(start.elapsed() < Duration::from_secs(100), "nobody waits for what is left");
    assert_gone(&work.read("res.txt"));
}

#[test]
fn a_time_limit_ends_a_program_with_all_that_it_has_started() {
    for isolate in ["", "isolate = true\n"] {
        let pipeline = shell(
            "sleep 1000 & echo $! > PIDS; setsid sleep 1000 & echo $! >> PIDS; \
                              sleep 1000; true {out:res.txt}",
        );
        let limited = format!("timeout = 2\n{isolate}outputs = {{ res");
        let work = work("");
        let pids = work.path("pids.txt");
        let pipeline = pipeline.replace("PIDS", pids.to_str().unwrap());
        work.write("pipeline.toml", &pipeline.replace("outputs = { res", &limited));
        let start = Instant::now();
        work.fail(1, "took longer than its time limit of 2 s");
        assert!(start.elapsed() < Duration::from_secs(100));
        work.read("pids.txt")
            .lines()
            .take(if isolate.is_empty() { 2 } else { 1 })
            .for_each(assert_gone);
    }
}

#[test]
fn a_program_runs_in_a_process_of_its_own_as_well() {
    let work = work(&format!(
        "{BODY}\n[nodes.copy]\nkind = \"command\"\nisolate = true\n\
         inputs = {{ mesh = \"@body.mesh\", list = [\"@body.mesh\"] }}\noutputs = {{ copy = \"mesh\" }}\n\
         command = [\"cp\", \"-v\", \"{{in:list.ply}}\", \"{{out:copy.ply}}\"]\nstdin = \"{{in:mesh.ply}}\"\n\n\
         [outputs]\n\"stdout.txt\" = \"@copy.stdout\"\n\"copy.obj\" = \"@copy\"\n"
    ));
    work.succeed();
    assert_eq!(work.read("stdout.txt"), "'in/list/0.ply' -> 'out/copy.ply'\n");
}

#[test]
fn tables_come_out_as_text() {
    let work = work(
        "[nodes.tool]\nkind = \"command\"\nshell = true\noutputs = { res = \"table\" }\n\
         command = \"printf 'name,error [mm]\\\\na,1.5\\\\n' > {out:res.csv}\"\n\n\
         [outputs]\n\"res.json\" = \"@tool\"\n\"res.csv\" = \"@tool\"\n",
    );
    work.succeed();
    assert_eq!(work.read("res.csv"), "name,error [mm]\na,1.5\n");
}

#[test]
fn mistakes_are_found_before_anything_runs() {
    let tool = |rest: &str| format!("{BODY}\n[nodes.tool]\nkind = \"command\"\n{rest}\n");
    let check = |rest: &str, message: &str| check_fails(&tool(rest), message);
    check("command = \"ls | wc\"", "`command` is a text, which only a shell takes apart");
    check("command = []", "`command` names no program");
    check("command = [\"./tool\"]", "there is no `./tool`: declare it in `files`");
    check("command = [\"ls\", \"{in:mesh.ply}\"]", "`inputs` has no `mesh`");
    check("command = [\"ls\", \"{out:mesh.ply}\"]", "`outputs` has no `mesh`");
    check("command = [\"ls\", \"{file:x}\"]", "`files` has no `x`");
    check("command = [\"ls\", \"{out:../x.ply}\"]", "must hold a name");
    let wired = "inputs = { mesh = \"@body.mesh\" }\n";
    check(&format!("command = [\"ls\"]\n{wired}"), "`mesh`, which is not used");
    check(
        &format!("command = [\"ls\", \"{{in:mesh.png}}\"]\n{wired}"),
        "`mesh` is written as `.ply`",
    );
    check(&format!("command = [\"ls\", \"{{in:mesh}}\"]\n{wired}"), "`mesh` is written as `.ply`");
    let listed = "inputs = { mesh = [\"@body.mesh\"] }\n";
    check(&format!("command = [\"ls\", \"-i{{in:mesh.ply}}\"]\n{listed}"), "the input is a list");
    let out = "outputs = { res = \"mesh\" }\n";
    check(&format!("command = [\"ls\"]\n{out}"), "`res`, which is not written");
    check(&format!("command = [\"ls\", \"{{out:res.npy}}\"]\n{out}"), "`mesh` is read as `.glb`");
    check(
        &format!("command = [\"ls\", \"{{out:res.ply}}\", \"{{out:res.obj}}\"]\n{out}"),
        "as {out:res.obj} and {out:res.ply}",
    );
    check("command = [\"ls\"]\noutputs = { res = \"mash\" }", "did you mean `mesh`?");
    check("command = [\"ls\"]\noutputs = { stdout = \"text\" }", "has the output `stdout`");
    check("command = [\"ls\"]\ninputs = { env = \"@body.mesh\" }", "`env` is a parameter");
    check("command = [\"ls\"]\ninputs = { x = \"@body.mash\" }", "has no output `mash`");
    check("command = [\"ls\"]\ninputs = { x = 3 }", "expected a wire, but this is 3");
    check("command = [\"ls\"]\ninputs = \"@body.mesh\"", "`inputs` must be a table");
    check("command = [\"ls\"]\nfiles = { x = \"none.py\" }", "there is no file `none.py`");
}

#[test]
fn the_version_of_a_program_counts() {
    let work = work(
        "[nodes.tool]\nkind = \"command\"\ncommand = [\"true\"]\nversion = [\"cat\", \"VERSION\"]\n",
    );
    let tool = work.path("VERSION").display().to_string();
    let pipeline = work.read("pipeline.toml").replace("VERSION", &tool);
    work.write("pipeline.toml", &pipeline);
    work.write("VERSION", "tool 1.0\n");
    assert!(work.succeed().contains("tool"));
    let planned = || {
        let output = work.sinew(&["explain", "pipeline.toml", "tool"]);
        String::from_utf8(output.stdout).unwrap()
    };
    assert!(planned().contains("cached"), "{}", planned());
    assert!(planned().contains("tool 1.0"), "{}", planned());
    work.write("VERSION", "tool 1.1\n");
    assert!(planned().contains("`version`: tool 1.0 -> tool 1.1"), "{}", planned());
    fs::remove_file(work.path("VERSION")).unwrap();
    work.fail(3, "which should print a version, failed: cat:");
}

#[test]
fn ports_and_names_are_no_content_but_whether_a_list_is() {
    let pipeline = |node: &str, wires: &str| {
        format!(
            "{BODY}\n[nodes.{node}]\nkind = \"command\"\ncommand = [\"echo\", \"{{in:x.off}}\"]\n\
             inputs = {{ x = {wires} }}\n"
        )
    };
    let work = work(&pipeline("a", "\"@body.mesh\""));
    work.succeed();
    let n_ran = |text: &str| {
        work.write("pipeline.toml", text);
        let output = work.sinew(&["run", "pipeline.toml", "--json"]);
        let text = String::from_utf8(output.stdout).unwrap();
        text.lines().filter(|it| it.contains("\"node_start\"")).count()
    };
    assert_eq!(n_ran(&pipeline("b", "\"@body.mesh\"")), 0);
    assert_eq!(n_ran(&pipeline("b", "[\"@body.mesh\"]")), 1);
}
