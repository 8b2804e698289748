//! Runs another program that can be stopped with everything that it has started.
//!
//! A program is the leader of a process group of its own (unless the group around it is killed as a
//! whole anyway), so that a signal reaches its children too, and Ctrl-C on the terminal does not.

use std::{
    collections::VecDeque,
    io::{self, BufRead, BufReader, Read, Write},
    os::unix::process::{CommandExt, ExitStatusExt},
    process::{Child, Command, ExitStatus, Stdio},
    thread,
    time::{Duration, Instant},
};

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, at, never, select, unbounded};

use super::cancel::CancelToken;

/// Lines of standard error that are kept for a message.
const TAIL_LINES: usize = 20;

/// A longer line is cut.
const MAX_LINE: u64 = 1 << 20;

/// How long the streams of a program that has ended are still read: something that it has started,
/// and that has left its group, may hold them open for ever.
const DRAIN: Duration = Duration::from_millis(500);

/// How a program ended.
#[derive(Debug)]
pub struct Ended {
    pub status: ExitStatus,
    /// Why it was killed, if it was killed by us.
    pub stopped: Option<Stopped>,
    /// The last lines of its standard error.
    pub stderr: Vec<String>,
}

/// Why a program was killed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stopped {
    /// The run was given up.
    GivenUp,
    /// The time limit is over.
    Late,
}

/// What a program says.
enum Heard {
    Out(String),
    Err(String),
    /// It has ended, but is not reaped yet.
    Ended,
}

/// Something that a watched program reads, and that says what it writes.
pub struct Watched<'a> {
    /// What it is given on standard input, which then stays open until [`Answer::Close`].
    pub stdin: &'a [u8],
    /// Called with every line of its standard output.
    pub on_line: &'a mut dyn FnMut(&str) -> Answer,
    /// Called with every line of its standard error.
    pub on_error_line: &'a mut dyn FnMut(&str),
}

/// What becomes of a program's standard input after a line of its output.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Answer {
    Nothing,
    Close,
}

/// Runs a program until it ends, or until the token says to kill it. Its whole group dies with it.
///
/// `keeps_group`: it stays in the process group of this process.
///
/// # Errors
/// If it cannot be started.
pub fn run(
    mut command: Command,
    keeps_group: bool,
    cancel: &CancelToken,
    watched: Watched<'_>,
) -> io::Result<Ended> {
    if !keeps_group {
        command.process_group(0);
    }
    let mut child =
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn()?;
    let Watched { stdin, on_line, on_error_line } = watched;
    let (sender, heard) = unbounded();
    let stdout = child.stdout.take().expect("it is piped");
    let stderr = child.stderr.take().expect("it is piped");
    spawn_reader(stdout, sender.clone(), Heard::Out);
    spawn_reader(stderr, sender.clone(), Heard::Err);
    spawn_waiter(&child, sender);
    let input = spawn_input(&mut child, stdin.to_owned());
    let mut watch = Watch {
        child,
        keeps_group,
        heard,
        input: Some(input),
        stopped: None,
        tail: VecDeque::new(),
        on_line,
        on_error_line,
    };
    watch.until_it_ends(cancel);
    watch.drain();
    let status = watch.child.wait()?;
    Ok(Ended { status, stopped: watch.stopped, stderr: watch.tail.into() })
}

struct Watch<'a> {
    child: Child,
    keeps_group: bool,
    heard: Receiver<Heard>,
    /// Dropped to close the program's standard input.
    input: Option<Sender<()>>,
    stopped: Option<Stopped>,
    tail: VecDeque<String>,
    on_line: &'a mut dyn FnMut(&str) -> Answer,
    on_error_line: &'a mut dyn FnMut(&str),
}

impl Watch<'_> {
    fn until_it_ends(&mut self, cancel: &CancelToken) {
        let late = cancel.deadline.map_or_else(never, at);
        loop {
            select! {
                recv(self.heard) -> heard => match heard {
                    Ok(heard) => if self.hear(heard) { break },
                    Err(_) => break,
                },
                recv(late) -> _ => {
                    self.stopped = Some(Stopped::Late);
                    break;
                }
                recv(cancel.given_up()) -> _ => {
                    self.stopped = Some(Stopped::GivenUp);
                    break;
                }
            }
        }
        // What it has left running would go on unseen.
        self.kill();
    }

    /// Takes in one thing; true if it is the end.
    fn hear(&mut self, heard: Heard) -> bool {
        match heard {
            Heard::Out(line) => {
                if (self.on_line)(&line) == Answer::Close {
                    self.input = None;
                }
            }
            Heard::Err(line) => {
                (self.on_error_line)(&line);
                if self.tail.len() == TAIL_LINES {
                    self.tail.pop_front();
                }
                self.tail.push_back(line);
            }
            Heard::Ended => return true,
        }
        false
    }

    /// Hears what was written before the end.
    fn drain(&mut self) {
        let end = Instant::now() + DRAIN;
        loop {
            match self.heard.recv_deadline(end) {
                Ok(heard) => drop(self.hear(heard)),
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => return,
            }
        }
    }

    /// Kills the program and its group. It has not been reaped, so its number is still its own.
    fn kill(&mut self) {
        let pid = self.child.id() as libc::pid_t;
        // SAFETY: a plain system call.
        unsafe { libc::kill(if self.keeps_group { pid } else { -pid }, libc::SIGKILL) };
    }
}

/// Reads a stream by lines in a thread of its own.
fn spawn_reader(stream: impl Read + Send + 'static, to: Sender<Heard>, heard: fn(String) -> Heard) {
    let read = move || {
        let mut stream = BufReader::new(stream);
        let mut line = Vec::new();
        loop {
            line.clear();
            match stream.by_ref().take(MAX_LINE).read_until(b'\n', &mut line) {
                Ok(0) | Err(_) => return,
                Ok(_) => {}
            }
            let text = String::from_utf8_lossy(&line).trim_end_matches(['\r', '\n']).to_owned();
            if to.send(heard(text)).is_err() {
                return;
            }
        }
    };
    thread::spawn(read);
}

/// Says when the program has ended, and leaves it to be reaped.
fn spawn_waiter(child: &Child, to: Sender<Heard>) {
    let pid = child.id();
    thread::spawn(move || {
        // SAFETY: `info` is plain data that the call fills in.
        let wait = || unsafe {
            let mut info: libc::siginfo_t = std::mem::zeroed();
            libc::waitid(libc::P_PID, pid, &raw mut info, libc::WEXITED | libc::WNOWAIT)
        };
        while wait() == -1 && io::Error::last_os_error().kind() == io::ErrorKind::Interrupted {}
        let _ = to.send(Heard::Ended);
    });
}

/// Writes to the program's standard input and keeps it open until the sender is dropped.
fn spawn_input(child: &mut Child, bytes: Vec<u8>) -> Sender<()> {
    let (sender, receiver) = unbounded();
    let mut stdin = child.stdin.take().expect("it is piped");
    thread::spawn(move || {
        // A program that ends without reading says why in another way.
        let _ = stdin.write_all(&bytes);
        let _ = receiver.recv();
    });
    sender
}

/// How a program ended, in words: `ended with exit code 3`, `was killed by signal 11
/// (segmentation fault)`.
pub fn describe(status: ExitStatus) -> String {
    match (status.signal(), status.code()) {
        (Some(signal), _) => format!("was killed by signal {signal} ({})", signal_name(signal)),
        (None, Some(code)) => format!("ended with exit code {code}"),
        (None, None) => "ended in an unknown way".to_owned(),
    }
}

fn signal_name(signal: i32) -> &'static str {
    match signal {
        libc::SIGHUP => "hangup",
        libc::SIGINT => "interrupt",
        libc::SIGQUIT => "quit",
        libc::SIGILL => "illegal instruction",
        libc::SIGTRAP => "trap",
        libc::SIGABRT => "abort",
        libc::SIGBUS => "bus error",
        libc::SIGFPE => "arithmetic error",
        libc::SIGKILL => "kill",
        libc::SIGSEGV => "segmentation fault",
        libc::SIGPIPE => "broken pipe",
        libc::SIGTERM => "termination",
        libc::SIGXCPU => "out of processor time",
        libc::SIGXFSZ => "file too large",
        libc::SIGSYS => "bad system call",
        _ => "unnamed",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::cancel::Canceller;

    /// Runs a shell script; how it ended and what it wrote.
    fn shell(script: &str, cancel: &CancelToken) -> (Ended, Vec<String>) {
        let mut command = Command::new("sh");
        command.args(["-c", script]);
        let mut lines = Vec::new();
        let mut on_line = |line: &str| {
            lines.push(line.to_owned());
            if line == "enough" { Answer::Close } else { Answer::Nothing }
        };
        let watched =
            Watched { stdin: b"hello\n", on_line: &mut on_line, on_error_line: &mut |_| {} };
        let ended = run(command, false, cancel, watched).unwrap();
        (ended, lines)
    }

    fn limit(millis: u64) -> CancelToken {
        CancelToken::never().with_limit(Some(Duration::from_millis(millis)))
    }

    fn is_alive(pid: &str) -> bool {
        // A process that has ended but is not reaped by its new parent is dead as well.
        let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        !stat.is_empty() && !stat.contains(") Z ")
    }

    #[test]
    fn what_a_program_says_is_heard_to_the_end() {
        let script = "read x; echo got $x; echo enough; cat; echo bad >&2; exit 3";
        let (ended, lines) = shell(script, &CancelToken::never());
        assert_eq!(lines, ["got hello", "enough"]);
        assert_eq!(
            (describe(ended.status).as_str(), ended.stopped),
            ("ended with exit code 3", None)
        );
        assert_eq!(ended.stderr, ["bad"]);
        let (ended, _) = shell("seq 100 >&2", &CancelToken::never());
        assert_eq!((ended.stderr.len(), ended.stderr[0].as_str()), (TAIL_LINES, "81"));
    }

    #[test]
    fn a_signal_is_named() {
        let (ended, _) = shell("kill -SEGV $$", &CancelToken::never());
        assert_eq!(describe(ended.status), "was killed by signal 11 (segmentation fault)");
    }

    #[test]
    fn the_time_limit_kills_the_whole_group() {
        let (ended, lines) = shell("sleep 1000 & echo $!; echo $$; wait", &limit(100));
        assert_eq!(ended.stopped, Some(Stopped::Late));
        assert!(lines.len() == 2 && !lines.iter().any(|it| is_alive(it)), "{lines:?}");
    }

    #[test]
    fn what_a_program_leaves_running_ends_with_it() {
        let (ended, lines) = shell("sleep 1000 & echo $!", &limit(20_000));
        assert!(ended.stopped.is_none() && !is_alive(&lines[0]));
    }

    #[test]
    fn a_run_that_is_given_up_kills_its_programs() {
        let mut canceller = Canceller::new();
        let token = canceller.token();
        let program = thread::spawn(move || shell("echo $$; exec sleep 1000", &token));
        thread::sleep(Duration::from_millis(20));
        canceller.cancel();
        assert_eq!(program.join().unwrap().0.stopped, Some(Stopped::GivenUp));
    }
}
