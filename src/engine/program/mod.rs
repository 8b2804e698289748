//! Other programs: started in a process group of their own, heard, and ended with everything that they
//! have started.
//!
//! A [`Program`] is started with nothing but what is declared. [`Process`] runs any other: a worker
//! process, which is this same program.

mod end;
mod environment;
mod lines;
mod process;
mod tail;
#[cfg(test)]
mod tests;

use std::{
    collections::BTreeMap,
    ffi::OsString,
    io,
    os::unix::process::CommandExt,
    path::PathBuf,
    process::{Command, Stdio},
};

pub use self::{
    end::End,
    environment::{FIXED, candidates_up_to, environment, find, is_binary},
    lines::Lines,
    process::{Input, Process, Stream},
    tail::Tail,
};
use super::cancel::CancelToken;

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
    /// Whether it gets a process group of its own; see [`Process::start`].
    pub own_group: bool,
}

impl Program {
    /// Starts it. It is killed when the thread that starts it ends, however that comes about.
    ///
    /// `stdout`: where its standard output goes instead of being heard.
    ///
    /// # Errors
    /// If it cannot be started.
    pub fn start(&self, stdin: Stdio, stdout: Option<Stdio>) -> io::Result<Process> {
        let mut command = Command::new(&self.path);
        command
            .arg0(&self.arguments[0])
            .args(&self.arguments[1..])
            .current_dir(&self.folder)
            .env_clear()
            .envs(&self.environment)
            .stdin(stdin)
            .stdout(stdout.unwrap_or_else(Stdio::piped));
        let parent = std::process::id();
        // SAFETY: these are plain system calls, which a forked child may make.
        unsafe {
            command.pre_exec(move || tie_to_parent(parent));
        }
        Process::start(command, self.own_group)
    }

    /// Runs it to its end, or until the token says to kill it. Nothing of it is left.
    ///
    /// # Errors
    /// If it cannot be started.
    pub fn run(
        &self,
        stdin: Stdio,
        stdout: Option<Stdio>,
        cancel: &CancelToken,
    ) -> io::Result<(End, Printed)> {
        let mut printed = Printed::default();
        let end = self.start(stdin, stdout)?.watch(cancel, &mut printed.listener())?;
        Ok((end, printed))
    }
}

/// What a program printed.
#[derive(Debug, Default)]
pub struct Printed {
    pub stdout: Tail,
    pub stderr: Tail,
}

impl Printed {
    /// Takes in what is heard.
    pub fn listener(&mut self) -> impl FnMut(Stream, &[u8]) {
        |stream, bytes| match stream {
            Stream::Stdout => self.stdout.push(bytes),
            Stream::Stderr => self.stderr.push(bytes),
        }
    }

    /// The last lines of its errors, or of what it printed if there are none, to follow a message.
    pub fn shown_end(&self) -> String {
        let last = if self.stderr.is_empty() { &self.stdout } else { &self.stderr };
        last.shown_end()
    }
}

/// In the child, before the program starts.
fn tie_to_parent(parent: u32) -> io::Result<()> {
    // SAFETY: no memory is touched.
    let is_tied = unsafe {
        libc::prctl(libc::PR_SET_PDEATHSIG, libc::SIGKILL) == 0
            && libc::getppid() == parent.cast_signed()
    };
    if is_tied { Ok(()) } else { Err(io::Error::last_os_error()) }
}
