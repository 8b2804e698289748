//! `sinew run` as its user sees it: what it says at the end, and how it stops.

use std::{
    fs,
    io::{BufRead, BufReader, Read},
    os::unix::process::CommandExt,
    path::Path,
    process::{Child, Command, Stdio},
};

const BAD: &str = "[nodes.bad]\nkind = \"load\"\npath = \"bad.off\"\n\n\
    [nodes.after]\nkind = \"normalize\"\nmesh = \"@bad.mesh\"\n\n\
    [nodes.last]\nkind = \"normalize\"\nmesh = \"@after.mesh\"\n\n\
    [nodes.good]\nkind = \"load\"\npath = \"good.off\"\n";

const GOOD_OFF: &str =
    "OFF\n4 4 6\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n";

fn folder(pipeline: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("my pipeline.toml"), pipeline).unwrap();
    fs::write(folder.path().join("bad.off"), "OFF\n1 1").unwrap();
    fs::write(folder.path().join("good.off"), GOOD_OFF).unwrap();
    folder
}

fn spawn(folder: &Path, args: &[&str]) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sinew"));
    command.args(["run", "-v", "my pipeline.toml"]).args(args).current_dir(folder);
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    // Who runs the tests may ignore signals (`nohup`), and children inherit that.
    // SAFETY: `signal` may be called between fork and exec.
    unsafe {
        command.pre_exec(|| {
            for signal in [libc::SIGINT, libc::SIGTERM, libc::SIGHUP] {
                libc::signal(signal, libc::SIG_DFL);
            }
            Ok(())
        });
    }
    command.spawn().unwrap()
}

/// Runs to the end: the exit code and standard error.
fn run(folder: &Path, args: &[&str]) -> (i32, String) {
    let output = spawn(folder, args).wait_with_output().unwrap();
    (output.status.code().unwrap(), String::from_utf8(output.stderr).unwrap())
}

fn send(child: &Child, signal: i32) {
    // SAFETY: a plain system call; the child is not reaped yet.
    assert_eq!(unsafe { libc::kill(child.id() as i32, signal) }, 0);
}

/// Reads standard error until there was a line with each of these words, in any order.
fn wait_for(stderr: &mut impl BufRead, words: &[&str]) {
    let mut left = words.to_vec();
    let mut line = String::new();
    while !left.is_empty() {
        line.clear();
        assert!(stderr.read_line(&mut line).unwrap() > 0, "no {left:?}");
        left.retain(|it| !line.contains(it));
    }
}

#[test]
fn the_end_names_what_failed_what_was_skipped_and_how_to_run_it_again() {
    let folder = folder(BAD);
    let (code, text) = run(folder.path(), &[]);
    let (_, summary) = text.split_once("  Finished").unwrap_or_else(|| panic!("{text}"));
    let lines: Vec<&str> = summary.lines().skip(1).collect();
    let expected = [
        "    failed  bad  `bad.off`: OFF file: the file ends before vertex 0 of 1",
        "   skipped  after, last, for want of bad",
        "     again  sinew run 'my pipeline.toml' bad",
    ];
    assert_eq!((code, &lines[..]), (1, &expected[..]), "{text}");
    let (code, text) = run(folder.path(), &["bad"]);
    assert!(code == 1 && text.contains("1 failed of 4 nodes"), "{text}");
    fs::write(folder.path().join("bad.off"), GOOD_OFF).unwrap();
    let (code, text) = run(folder.path(), &["bad"]);
    assert!(code == 0 && !text.contains("again"), "{text}");
}

/// Fails, and waits for its next try longer than any test.
fn patient() -> String {
    BAD.replacen("\n\n", "\nretries = 3\nbackoff = \"10 h\"\n\n", 1)
}

#[test]
fn each_signal_stops_a_run_at_once_if_nothing_runs() {
    for signal in [libc::SIGINT, libc::SIGTERM, libc::SIGHUP] {
        let folder = folder(&patient());
        let mut child = spawn(folder.path(), &[]);
        let mut stderr = BufReader::new(child.stderr.take().unwrap());
        let retry = "retry  bad    1/3 in 10h 00m: `bad.off`: OFF file";
        wait_for(&mut stderr, &[retry, "ran  good"]);
        send(&child, signal);
        let mut rest = String::new();
        stderr.read_to_string(&mut rest).unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(130), "{rest}");
        let last = rest.lines().last().unwrap();
        let go_on = "   stopped  run the same command again to go on: 1 of 4 nodes are done";
        assert_eq!(last, go_on, "{rest}");
        let record = fs::read_dir(folder.path().join("cache/runs")).unwrap().next().unwrap();
        let record = fs::read_to_string(record.unwrap().path()).unwrap();
        assert!(record.lines().last().unwrap().ends_with("\"stopped\":true}"), "{record}");
        assert!(record.contains("{\"event\":\"stopping\","), "{record}");
    }
}

#[test]
fn a_terminal_that_goes_away_stops_a_run_and_breaks_nothing() {
    let folder = folder(&patient());
    let mut child = spawn(folder.path(), &["--json"]);
    let mut stderr = BufReader::new(child.stderr.take().unwrap());
    wait_for(&mut stderr, &["retry  bad"]);
    drop(stderr);
    drop(child.stdout.take());
    send(&child, libc::SIGHUP);
    assert_eq!(child.wait().unwrap().code(), Some(130));
}

#[test]
fn a_second_signal_ends_a_run_whatever_it_does() {
    let text = "[nodes.long]\nkind = \"synthesize\"\nn_vertices = 250000\n\n\
                [nodes.apart]\nkind = \"synthesize\"\nn_vertices = 240000\nisolate = true\n";
    let folder = folder(text);
    let mut child = spawn(folder.path(), &["-j", "2"]);
    let mut stderr = BufReader::new(child.stderr.take().unwrap());
    wait_for(&mut stderr, &["start  long", "start  apart"]);
    send(&child, libc::SIGINT);
    let waits = "stopping  waits for 2 running nodes; Ctrl-C again ends at once";
    wait_for(&mut stderr, &[waits]);
    send(&child, libc::SIGINT);
    let go_on = "stopped  run the same command again to go on: 0 of 2 nodes are done";
    wait_for(&mut stderr, &[go_on]);
    assert_eq!(child.wait().unwrap().code(), Some(130));
    // The cache is sound, and nobody holds it.
    let verified = Command::new(env!("CARGO_BIN_EXE_sinew"))
        .args(["cache", "verify"])
        .current_dir(folder.path())
        .output()
        .unwrap();
    assert!(verified.status.success(), "{}", String::from_utf8_lossy(&verified.stderr));
}
