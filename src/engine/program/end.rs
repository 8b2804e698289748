//! How programs end.

use std::{fmt, os::unix::process::ExitStatusExt, process::ExitStatus};

/// How a program ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    Exited(i32),
    /// By a signal that was not ours.
    Signalled(i32),
    /// Killed by us: the run was given up.
    GivenUp,
    /// Killed by us: the time limit is over.
    Late,
}

impl From<ExitStatus> for End {
    fn from(status: ExitStatus) -> Self {
        match status.code() {
            Some(code) => Self::Exited(code),
            None => Self::Signalled(status.signal().unwrap_or_default()),
        }
    }
}

/// In words, to follow the name of the program.
impl fmt::Display for End {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Exited(code) => write!(f, "ended with exit code {code}"),
            Self::Signalled(signal) => {
                write!(f, "was killed by signal {signal} ({})", signal_name(*signal))
            }
            Self::GivenUp => write!(f, "was stopped"),
            Self::Late => write!(f, "was stopped at its time limit"),
        }
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
