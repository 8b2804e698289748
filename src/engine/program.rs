//! Other programs: started with nothing but what is declared, in a process group of their own, and ended
//! with everything that they have started.

use std::{
    collections::{BTreeMap, VecDeque},
    ffi::OsString,
    fs, io,
    io::Read,
    os::{
        fd::{AsRawFd, RawFd},
        unix::{
            fs::PermissionsExt,
            process::{CommandExt, ExitStatusExt},
        },
    },
    path::{Path, PathBuf},
    process::{Child, ChildStderr, ChildStdout, Command, ExitStatus, Stdio},
    time::Duration,
};

/// How often a process that prints nothing is looked after.
const TICK: Duration = Duration::from_millis(20);

/// More than a pipe holds, in reads of 64 KiB.
const MOST_READS: usize = 32;

/// So many bytes of what a program prints are kept, of each stream.
const KEPT: usize = 256 << 10;

/// What is started.
#[derive(Debug, Clone)]
pub struct Program {
    /// Where it is; see [`find`].
    pub path: PathBuf,
    /// What it is called, and its arguments.
    pub arguments: Vec<OsString>,
    /// Where it runs.
    pub folder: PathBuf,
    /// All of its environment.
    pub environment: BTreeMap<String, OsString>,
    /// Whether it gets a process group of its own. Otherwise it stays in this one, and whoever ends this
    /// group ends what it started.
    pub own_group: bool,
}

/// How a program ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    Exited(i32),
    /// By a signal that was not ours.
    Signalled(i32),
    /// Its result was no longer wanted.
    Stopped,
}

/// The environment of a program: what every program needs, and what is declared.
///
/// Of the user's variables only `PATH` and `HOME` are passed on. Language and time zone are fixed, and
/// numerical libraries use one thread unless it is declared otherwise: with more, the last bits of a sum
/// depend on the machine.
pub fn environment(
    declared: &BTreeMap<String, String>,
    temporary: &Path,
) -> BTreeMap<String, OsString> {
    let users = ["HOME", "PATH"].into_iter().filter_map(|it| Some((it, std::env::var_os(it)?)));
    let fixed = FIXED.iter().map(|(name, value)| (*name, OsString::from(value)));
    let temporary = [("TMPDIR", temporary.into())];
    let defaults =
        users.chain(fixed).chain(temporary).map(|(name, value)| (name.to_owned(), value));
    let declared = declared.iter().map(|(name, value)| (name.clone(), value.into()));
    defaults.chain(declared).collect()
}

/// Variables that every program gets unless they are declared otherwise.
pub const FIXED: [(&str, &str); 8] = [
    ("LANG", "C.UTF-8"),
    ("TZ", "UTC"),
    ("PYTHONHASHSEED", "0"),
    ("OMP_NUM_THREADS", "1"),
    ("OPENBLAS_NUM_THREADS", "1"),
    ("MKL_NUM_THREADS", "1"),
    ("NUMBA_NUM_THREADS", "1"),
    ("RAYON_NUM_THREADS", "1"),
];

/// Where a program may be: a path as it is, a name in each folder of `PATH`.
pub fn candidates(name: &str, environment: &BTreeMap<String, OsString>) -> Vec<PathBuf> {
    if name.contains('/') {
        return vec![name.into()];
    }
    let path = environment.get("PATH").cloned().unwrap_or_default();
    std::env::split_paths(&path).filter(|it| it.is_absolute()).map(|it| it.join(name)).collect()
}

/// Where a program is: the first candidate that can be started.
///
/// # Errors
/// With a message for the user.
pub fn find(name: &str, environment: &BTreeMap<String, OsString>) -> Result<PathBuf, String> {
    let found = candidates(name, environment).into_iter().find(|it| is_program(it));
    found.ok_or_else(|| match name.contains('/') {
        true => format!("there is no program `{name}`"),
        false => {
            format!(
                "there is no program `{name}` in `PATH`: install it, or add its folder to `PATH`"
            )
        }
    })
}

fn is_program(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|it| it.is_file() && it.permissions().mode() & 0o111 != 0)
}

/// Whether a program is machine code, and no script that may do anything.
pub fn is_binary(path: &Path) -> bool {
    let mut magic = [0; 4];
    fs::File::open(path).and_then(|mut it| it.read_exact(&mut magic)).is_ok()
        && magic == *b"\x7fELF"
}

/// Runs a program to its end, or until `is_unwanted`. Nothing of its process group is left.
///
/// # Errors
/// If it cannot be started.
pub fn run(
    program: &Program,
    stdin: Stdio,
    stdout: Option<Stdio>,
    is_unwanted: &dyn Fn() -> bool,
) -> io::Result<(End, Printed)> {
    let mut process = Process::start(program, stdin, stdout)?;
    let mut tick = Duration::from_millis(1);
    loop {
        if let Some(end) = process.ended() {
            process.listen(None, Duration::ZERO)?;
            return Ok((end, std::mem::take(&mut process.printed)));
        }
        if is_unwanted() {
            process.kill();
            process.listen(None, Duration::ZERO)?;
            return Ok((End::Stopped, std::mem::take(&mut process.printed)));
        }
        process.listen(None, tick)?;
        // A program of a millisecond is not kept waiting; one of an hour is not asked all the time.
        tick = (tick * 2).min(TICK);
    }
}

/// What a program printed.
#[derive(Debug, Default)]
pub struct Printed {
    pub stdout: Tail,
    pub stderr: Tail,
}

/// A running program. Dropping it ends it.
#[derive(Debug)]
pub struct Process {
    child: Child,
    has_group: bool,
    stdout: Option<ChildStdout>,
    stderr: Option<ChildStderr>,
    pub printed: Printed,
    status: Option<ExitStatus>,
}

impl Process {
    /// Starts a program. It is killed when the thread that starts it ends, however that comes about.
    ///
    /// # Errors
    /// If it cannot be started.
    pub fn start(program: &Program, stdin: Stdio, stdout: Option<Stdio>) -> io::Result<Self> {
        let mut command = Command::new(&program.path);
        command
            .arg0(&program.arguments[0])
            .args(&program.arguments[1..])
            .current_dir(&program.folder)
            .env_clear()
            .envs(&program.environment)
            .stdin(stdin)
            .stdout(stdout.unwrap_or_else(Stdio::piped))
            .stderr(Stdio::piped());
        if program.own_group {
            command.process_group(0);
        }
        let parent = std::process::id();
        // SAFETY: these are plain system calls, which a forked child may make.
        unsafe {
            command.pre_exec(move || tie_to_parent(parent));
        }
        let mut child = command.spawn()?;
        let (stdout, stderr) = (child.stdout.take(), child.stderr.take());
        let res = Self {
            child,
            has_group: program.own_group,
            stdout,
            stderr,
            printed: Printed::default(),
            status: None,
        };
        let pipes = [
            res.stdout.as_ref().map(AsRawFd::as_raw_fd),
            res.stderr.as_ref().map(AsRawFd::as_raw_fd),
        ];
        pipes.into_iter().flatten().try_for_each(set_nonblocking)?;
        Ok(res)
    }

    /// Takes in what has been printed, after waiting for some at most `timeout`. Whether there is
    /// something to read from `channel`.
    ///
    /// # Errors
    /// If the pipes cannot be read.
    pub fn listen(&mut self, channel: Option<RawFd>, timeout: Duration) -> io::Result<bool> {
        let stdout = self.stdout.as_ref().map(AsRawFd::as_raw_fd);
        let stderr = self.stderr.as_ref().map(AsRawFd::as_raw_fd);
        let ready = poll([channel, stdout, stderr], timeout)?;
        if ready[1] && !take_in(self.stdout.as_mut(), &mut self.printed.stdout)? {
            self.stdout = None;
        }
        if ready[2] && !take_in(self.stderr.as_mut(), &mut self.printed.stderr)? {
            self.stderr = None;
        }
        Ok(ready[0])
    }

    /// How it ended, if it has; what it left running in its group is killed.
    pub fn ended(&mut self) -> Option<End> {
        if self.status.is_none() {
            if !has_exited(self.child.id()) {
                return None;
            }
            self.kill();
        }
        let status = self.status?;
        Some(match status.code() {
            Some(code) => End::Exited(code),
            None => End::Signalled(status.signal().unwrap_or_default()),
        })
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
        if self.has_group {
            send_kill(-id);
        }
        self.status = self.child.wait().ok();
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.kill();
    }
}

/// In the child, before the program starts.
fn tie_to_parent(parent: u32) -> io::Result<()> {
    // SAFETY: no memory is touched.
    let is_tied = unsafe {
        libc::prctl(libc::PR_SET_CHILD_SUBREAPER, 1);
        libc::prctl(libc::PR_SET_PDEATHSIG, libc::SIGKILL) == 0
            && libc::getppid() == parent.cast_signed()
    };
    if is_tied { Ok(()) } else { Err(io::Error::last_os_error()) }
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
fn take_in(pipe: Option<&mut impl Read>, tail: &mut Tail) -> io::Result<bool> {
    let Some(pipe) = pipe else { return Ok(false) };
    let mut buffer = [0; 64 << 10];
    // Whoever prints without end must not keep us from looking whether time is over.
    for _ in 0..MOST_READS {
        match pipe.read(&mut buffer) {
            Ok(0) => return Ok(false),
            Ok(n) => tail.push(&buffer[..n]),
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(true),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(true)
}

/// The end of a stream of bytes.
#[derive(Debug, Clone, Default)]
pub struct Tail {
    kept: VecDeque<u8>,
    n_bytes: u64,
}

impl Tail {
    pub fn push(&mut self, bytes: &[u8]) {
        self.n_bytes += bytes.len() as u64;
        let bytes = &bytes[bytes.len().saturating_sub(KEPT)..];
        let excess = (self.kept.len() + bytes.len()).saturating_sub(KEPT);
        self.kept.drain(..excess.min(self.kept.len()));
        self.kept.extend(bytes);
    }

    pub fn is_empty(&self) -> bool {
        self.n_bytes == 0
    }

    /// As text. What was cut off is counted in the first line.
    pub fn text(&self) -> String {
        let bytes: Vec<u8> = self.kept.iter().copied().collect();
        if self.n_bytes == bytes.len() as u64 {
            return String::from_utf8_lossy(&bytes).into_owned();
        }
        // From the start of a line, unless the line is longer than all that is kept.
        let start = bytes.iter().position(|&it| it == b'\n').map_or(0, |it| it + 1);
        let n_cut = self.n_bytes - (bytes.len() - start) as u64;
        format!(
            "[{n_cut} bytes before this are not kept]\n{}",
            String::from_utf8_lossy(&bytes[start..])
        )
    }

    /// The last lines, for a message.
    pub fn last_lines(&self, n_lines: usize) -> String {
        let text = self.text();
        let lines: Vec<&str> = text.lines().filter(|it| !it.trim().is_empty()).collect();
        lines[lines.len().saturating_sub(n_lines)..].join("\n")
    }
}

#[cfg(test)]
mod tests {
    use std::{cell::Cell, time::Instant};

    use super::*;

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

    fn is_running(pid: &str) -> bool {
        let stat = fs::read_to_string(format!("/proc/{}/stat", pid.trim())).unwrap_or_default();
        !stat.is_empty() && !stat.contains(") Z ")
    }

    #[test]
    fn what_is_unwanted_ends_with_all_that_it_has_started() {
        let folder = tempfile::tempdir().unwrap();
        // A child, one in a session of its own, and one of these whose parent is gone.
        let line = "sleep 1000 & echo $!; setsid sleep 1000 & echo $!; \
                    (setsid sh -c 'echo $$; exec sleep 1000' &); sleep 1000";
        let started = Instant::now();
        let seen = Cell::new(0);
        let is_unwanted = || {
            seen.set(seen.get() + 1);
            started.elapsed() > Duration::from_millis(300)
        };
        let program = shell(line, folder.path());
        let (end, printed) = run(&program, Stdio::null(), None, &is_unwanted).unwrap();
        assert_eq!(end, End::Stopped);
        assert!(seen.get() > 3, "it is asked again and again");
        let text = printed.stdout.text();
        let pids: Vec<&str> = text.lines().collect();
        assert_eq!(pids.len(), 3, "{text}");
        let start = Instant::now();
        while pids.iter().any(|it| is_running(it)) {
            assert!(start.elapsed() < Duration::from_secs(10), "{pids:?} are still there");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    #[test]
    fn nobody_waits_for_a_pipe_that_is_kept_open() {
        let folder = tempfile::tempdir().unwrap();
        let program = shell("echo before; setsid sleep 5 & exit 7", folder.path());
        let start = Instant::now();
        let (end, printed) = run(&program, Stdio::null(), None, &|| false).unwrap();
        assert_eq!((end, printed.stdout.text().as_str()), (End::Exited(7), "before\n"));
        assert!(start.elapsed() < Duration::from_secs(4));
    }

    #[test]
    fn who_prints_without_end_can_be_stopped() {
        let folder = tempfile::tempdir().unwrap();
        let start = Instant::now();
        let is_unwanted = || start.elapsed() > Duration::from_millis(100);
        let program = shell("exec yes", folder.path());
        let (end, printed) = run(&program, Stdio::null(), None, &is_unwanted).unwrap();
        assert_eq!(end, End::Stopped);
        assert!(printed.stdout.text().ends_with("y\n"));
    }

    #[test]
    fn a_tail_begins_with_a_line_and_counts_what_is_cut() {
        let mut tail = Tail::default();
        for index in 0..100_000 {
            tail.push(format!("line {index}\n").as_bytes());
        }
        let text = tail.text();
        let (first, rest) = text.split_once('\n').unwrap();
        let n_cut: usize = first[1..].split(' ').next().unwrap().parse().unwrap();
        let whole: String = (0..100_000).map(|it| format!("line {it}\n")).collect();
        assert_eq!(rest, &whole[n_cut..]);
        assert!(rest.starts_with("line ") && rest.len() > KEPT - 20 && rest.len() <= KEPT);
        assert_eq!(tail.last_lines(2), "line 99998\nline 99999");
        let mut short = Tail::default();
        short.push(b"all\xff");
        assert_eq!(short.text(), "all\u{fffd}");
    }

    #[test]
    fn a_program_is_found_where_its_environment_says() {
        let folder = tempfile::tempdir().unwrap();
        let tool = folder.path().join("tool");
        fs::write(&tool, "#!/bin/sh\n").unwrap();
        let path = BTreeMap::from([("PATH".to_owned(), folder.path().into())]);
        let message = find("tool", &path).unwrap_err();
        assert!(message.starts_with("there is no program `tool` in `PATH`"), "{message}");
        fs::set_permissions(&tool, fs::Permissions::from_mode(0o755)).unwrap();
        assert_eq!(find("tool", &path).as_ref(), Ok(&tool));
        assert!(!is_binary(&tool) && is_binary(Path::new("/proc/self/exe")));
        assert_eq!(find("/none", &path).unwrap_err(), "there is no program `/none`");
    }
}
