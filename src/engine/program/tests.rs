//! Programs of the system, run to their ends.

use std::{
    collections::BTreeMap,
    ffi::OsString,
    fs,
    path::Path,
    process::{Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use super::*;
use crate::engine::cancel::Canceller;

fn shell(line: &str, folder: &Path) -> Program {
    let environment = environment(&BTreeMap::new(), folder);
    Program {
        path: find("sh", &environment).unwrap(),
        arguments: ["sh", "-c", line].map(OsString::from).to_vec(),
        folder: folder.to_owned(),
        environment,
        own_group: true,
    }
}

/// Runs a line of the shell; how it ended and what it printed.
fn run(line: &str, cancel: &CancelToken) -> (End, Printed) {
    let folder = tempfile::tempdir().unwrap();
    shell(line, folder.path()).run(Stdio::null(), None, cancel).unwrap()
}

fn limit(millis: u64) -> CancelToken {
    CancelToken::never().with_limit(Some(Duration::from_millis(millis)))
}

/// A process that has ended but is not reaped by its new parent is dead as well.
fn is_running(pid: &str) -> bool {
    let stat = fs::read_to_string(format!("/proc/{}/stat", pid.trim())).unwrap_or_default();
    !stat.is_empty() && !stat.contains(") Z ")
}

/// All processes whose numbers a program printed end, and there are so many.
#[track_caller]
fn check_ended(printed: &Printed, expected: usize) {
    let text = printed.stdout.text();
    assert_eq!(text.lines().count(), expected, "{text}");
    let start = Instant::now();
    while text.lines().any(is_running) {
        assert!(start.elapsed() < Duration::from_secs(10), "some are still there: {text}");
        thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn who_is_late_ends_with_all_that_it_has_started() {
    // A child, one in a session of its own, and one of these whose parent is gone.
    let line = "sleep 1000 & echo $!; setsid sleep 1000 & echo $!; \
                (setsid sh -c 'echo $$; exec sleep 1000' &); sleep 1000";
    let (end, printed) = run(line, &limit(300));
    assert_eq!(end, End::Late);
    check_ended(&printed, 3);
}

#[test]
fn what_a_program_leaves_running_ends_with_it() {
    let (end, printed) = run("sleep 1000 & echo $!", &limit(20_000));
    assert_eq!(end, End::Exited(0));
    check_ended(&printed, 1);
}

#[test]
fn a_run_that_is_given_up_kills_its_programs() {
    let mut canceller = Canceller::new();
    let token = canceller.token();
    let program = thread::spawn(move || run("echo $$; exec sleep 1000", &token));
    thread::sleep(Duration::from_millis(20));
    canceller.cancel();
    assert_eq!(program.join().unwrap().0, End::GivenUp);
}

#[test]
fn nobody_waits_for_a_pipe_that_is_kept_open() {
    let start = Instant::now();
    let (end, printed) = run("echo before; setsid sleep 5 & exit 7", &CancelToken::never());
    assert_eq!((end, printed.stdout.text().as_str()), (End::Exited(7), "before\n"));
    assert!(start.elapsed() < Duration::from_secs(4));
}

#[test]
fn who_prints_without_end_can_be_stopped() {
    let (end, printed) = run("exec yes", &limit(100));
    assert_eq!(end, End::Late);
    assert!(printed.stdout.text().ends_with("y\n"));
}

#[test]
fn what_is_written_just_before_the_end_is_heard() {
    // A pipe full at the end, on both streams.
    let line = "head -c 60000 /dev/zero | tr '\\0' x; head -c 60000 /dev/zero >&2; exit 3";
    let (end, printed) = run(line, &CancelToken::never());
    assert_eq!(end, End::Exited(3));
    assert_eq!([&printed.stdout, &printed.stderr].map(|it| it.text().len()), [60_000; 2]);
}

#[test]
fn ends_are_described() {
    let end = |line| run(line, &limit(20_000)).0.to_string();
    assert_eq!(end("exit 3"), "ended with exit code 3");
    assert_eq!(end("kill -SEGV $$"), "was killed by signal 11 (segmentation fault)");
}

#[test]
fn a_program_is_asked_and_answers_in_lines() {
    let mut command = Command::new("sh");
    // It sees the end of its input only when that is let go, long after it has been written.
    command.args(["-c", "read x; echo got $x; echo enough; cat; echo bad >&2; exit 3"]);
    command.stdin(Stdio::piped()).stdout(Stdio::piped());
    let mut process = Process::start(command, true).unwrap();
    let mut input = Some(process.feed(b"hello\n".to_vec()));
    let (mut lines, mut heard, mut errors) = (Lines::default(), Vec::new(), Tail::default());
    let end = process.watch(&limit(20_000), &mut |stream, bytes| match stream {
        Stream::Stdout => lines.push(bytes, |line| {
            heard.push(line.to_owned());
            if line == "enough" {
                input = None;
            }
        }),
        Stream::Stderr => errors.push(bytes),
    });
    assert_eq!((end.unwrap(), errors.text().as_str()), (End::Exited(3), "bad\n"));
    assert_eq!(heard, ["got hello", "enough"]);
}
