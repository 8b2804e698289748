//! A running program, in a process group of its own.

use std::{
    convert::Infallible,
    fs, io,
    io::{Read, Write},
    os::{
        fd::{AsRawFd, RawFd},
        unix::process::CommandExt,
    },
    process::{Child, ChildStderr, ChildStdout, Command, ExitStatus, Stdio},
    thread,
    time::Duration,
};

use crossbeam_channel::{Sender, bounded};

use super::End;
use crate::engine::cancel::CancelToken;

/// How often a process that prints nothing is looked after, at first and in the end.
const TICKS: [Duration; 2] = [Duration::from_millis(1), Duration::from_millis(20)];

/// More than a pipe holds, in reads of 64 KiB.
const MOST_READS: usize = 32;

/// A running program. Dropping it ends it, with everything that it has started.
#[derive(Debug)]
pub struct Process {
    child: Child,
    has_group: bool,
    stdout: Option<ChildStdout>,
    stderr: Option<ChildStderr>,
    status: Option<ExitStatus>,
}

/// Where a program writes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stream {
    Stdout,
    Stderr,
}

/// The standard input of a program, which stays open until this is dropped.
#[derive(Debug)]
pub struct Input {
    /// Nothing is sent; it is closed.
    _open: Sender<Infallible>,
}

impl Process {
    /// Starts a program; what it writes to pipes is heard.
    ///
    /// `own_group`: it gets a process group of its own, so that Ctrl-C does not reach it and it can be
    /// killed with its children. Otherwise it stays in this group, and whoever ends this group ends it.
    ///
    /// # Errors
    /// If it cannot be started.
    pub fn start(mut command: Command, own_group: bool) -> io::Result<Self> {
        if own_group {
            command.process_group(0);
        }
        // SAFETY: this is a plain system call, which a forked child may make.
        unsafe {
            command.pre_exec(adopt_orphans);
        }
        let mut child = command.stderr(Stdio::piped()).spawn()?;
        let (stdout, stderr) = (child.stdout.take(), child.stderr.take());
        let res = Self { child, has_group: own_group, stdout, stderr, status: None };
        res.pipes().into_iter().flatten().try_for_each(set_nonblocking)?;
        Ok(res)
    }

    /// Writes to its standard input, which is a pipe, while others go on.
    pub fn feed(&mut self, bytes: Vec<u8>) -> Input {
        let stdin = self.child.stdin.take();
        let (sender, receiver) = bounded(0);
        thread::spawn(move || {
            let Some(mut stdin) = stdin else { return };
            // A program that ends without reading says why in another way.
            let _ = stdin.write_all(&bytes);
            let _ = receiver.recv();
        });
        Input { _open: sender }
    }

    /// Hears it until it ends, or until the token says to kill it. Nothing of it is left.
    ///
    /// # Errors
    /// If the pipes cannot be read.
    pub fn watch(
        &mut self,
        cancel: &CancelToken,
        hear: &mut dyn FnMut(Stream, &[u8]),
    ) -> io::Result<End> {
        let [first_tick, last_tick] = TICKS;
        let mut tick = first_tick;
        let end = loop {
            if let Some(end) = self.ended() {
                break end;
            }
            if cancel.is_given_up() {
                break End::GivenUp;
            }
            if cancel.is_late() {
                break End::Late;
            }
            let pipes = self.pipes();
            self.listen(None, tick, hear)?;
            // A program of a millisecond is not kept waiting, nor one that has just closed its streams;
            // one of an hour is not asked all the time.
            tick = if self.pipes() == pipes { (tick * 2).min(last_tick) } else { first_tick };
        };
        self.kill();
        self.listen(None, Duration::ZERO, hear)?;
        Ok(end)
    }

    /// Hears what has been printed, after waiting for some at most `timeout`. Whether there is something
    /// to read from `channel`.
    ///
    /// # Errors
    /// If the pipes cannot be read.
    pub fn listen(
        &mut self,
        channel: Option<RawFd>,
        timeout: Duration,
        hear: &mut dyn FnMut(Stream, &[u8]),
    ) -> io::Result<bool> {
        let [stdout, stderr] = self.pipes();
        let ready = poll([channel, stdout, stderr], timeout)?;
        if ready[1] && !take_in(self.stdout.as_mut(), &mut |it| hear(Stream::Stdout, it))? {
            self.stdout = None;
        }
        if ready[2] && !take_in(self.stderr.as_mut(), &mut |it| hear(Stream::Stderr, it))? {
            self.stderr = None;
        }
        Ok(ready[0])
    }

    /// How it ended, if it has; what it left running is killed.
    pub fn ended(&mut self) -> Option<End> {
        if self.status.is_none() && has_exited(self.child.id()) {
            self.reap();
        }
        self.status.map(End::from)
    }

    /// Kills it and everything that it has started.
    pub fn kill(&mut self) {
        if self.status.is_some() {
            return;
        }
        let id = self.child.id().cast_signed();
        // Not reaped yet, so the ids are still theirs. Whoever has left the group is found as a
        // descendant: orphans fall to the program, which has been made their reaper.
        let descendants = descendants(id);
        for pid in [id].into_iter().chain(descendants) {
            send_kill(pid);
        }
        self.reap();
    }

    /// Kills its group and takes its status. After an exit of its own that is all that can be found: the
    /// system has given its children away, and looking through `/proc` costs more than a short program.
    fn reap(&mut self) {
        if self.has_group {
            send_kill(-self.child.id().cast_signed());
        }
        self.status = self.child.wait().ok();
    }

    fn pipes(&self) -> [Option<RawFd>; 2] {
        [self.stdout.as_ref().map(AsRawFd::as_raw_fd), self.stderr.as_ref().map(AsRawFd::as_raw_fd)]
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.kill();
    }
}

/// In the child, before the program starts: orphans below it become its children.
fn adopt_orphans() -> io::Result<()> {
    // SAFETY: no memory is touched.
    let result = unsafe { libc::prctl(libc::PR_SET_CHILD_SUBREAPER, 1) };
    if result == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}

/// Whether a child is over; it is not reaped.
fn has_exited(id: u32) -> bool {
    // SAFETY: all zeros are a valid `siginfo_t`, which the call fills in.
    unsafe {
        let mut info: libc::siginfo_t = std::mem::zeroed();
        let flags = libc::WEXITED | libc::WNOHANG | libc::WNOWAIT;
        let result = libc::waitid(libc::P_PID, id, &raw mut info, flags);
        result != 0 || info.si_pid() != 0
    }
}

fn send_kill(pid: i32) {
    // SAFETY: a signal to a child that is not reaped, or to what it started.
    unsafe {
        libc::kill(pid, libc::SIGKILL);
    }
}

/// The processes below this one, as far as they can be seen.
fn descendants(id: i32) -> Vec<i32> {
    let Ok(list) = fs::read_dir("/proc") else { return Vec::new() };
    let parents: Vec<(i32, i32)> = list
        .flatten()
        .filter_map(|it| {
            let pid = it.file_name().to_str()?.parse().ok()?;
            let stat = fs::read_to_string(it.path().join("stat")).ok()?;
            // The name, in brackets, may hold anything; state and parent follow it.
            let parent = stat.rsplit_once(')')?.1.split_whitespace().nth(1)?.parse().ok()?;
            Some((pid, parent))
        })
        .collect();
    let mut res = vec![id];
    let mut next = 0;
    while next < res.len() {
        let parent = res[next];
        res.extend(parents.iter().filter(|it| it.1 == parent).map(|it| it.0));
        next += 1;
    }
    res.split_off(1)
}

fn set_nonblocking(fd: RawFd) -> io::Result<()> {
    // SAFETY: flags of a pipe that is ours.
    let result = unsafe {
        let flags = libc::fcntl(fd, libc::F_GETFL);
        libc::fcntl(fd, libc::F_SETFL, flags | libc::O_NONBLOCK)
    };
    if result == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}

/// Which of these have something to read (or have ended), after waiting for one of them.
fn poll(fds: [Option<RawFd>; 3], timeout: Duration) -> io::Result<[bool; 3]> {
    // A negative descriptor is passed over.
    let mut list =
        fds.map(|fd| libc::pollfd { fd: fd.unwrap_or(-1), events: libc::POLLIN, revents: 0 });
    let millis = i32::try_from(timeout.as_millis()).unwrap_or(i32::MAX);
    // SAFETY: the list is as long as is said.
    let result = unsafe { libc::poll(list.as_mut_ptr(), list.len() as libc::nfds_t, millis) };
    match result {
        -1 => {
            let error = io::Error::last_os_error();
            if error.kind() == io::ErrorKind::Interrupted { Ok([false; 3]) } else { Err(error) }
        }
        _ => Ok(list.map(|it| it.revents != 0)),
    }
}

/// Reads what is there; whether more may come.
fn take_in(pipe: Option<&mut impl Read>, hear: &mut dyn FnMut(&[u8])) -> io::Result<bool> {
    let Some(pipe) = pipe else { return Ok(false) };
    let mut buffer = [0; 64 << 10];
    // Whoever prints without end must not keep us from looking whether time is over.
    for _ in 0..MOST_READS {
        match pipe.read(&mut buffer) {
            Ok(0) => return Ok(false),
            Ok(n) => hear(&buffer[..n]),
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(true),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(true)
}
