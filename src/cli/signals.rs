//! Ctrl-C, and other ways to ask a run to stop.

use std::{
    io::{self, PipeReader, Read},
    os::fd::IntoRawFd,
    ptr,
    sync::atomic::{AtomicI32, Ordering},
    thread,
    time::Duration,
};

use crossbeam_channel::{Receiver, Sender, unbounded};

use super::Exit;

/// Where the handler writes: a pipe, which wakes a thread that may do more than a handler may.
static WAKE: AtomicI32 = AtomicI32::new(-1);

/// How long a run that shall end at once has to kill what it has started and to say so.
const LAST_WORDS: Duration = Duration::from_millis(500);

/// Turns SIGINT, SIGTERM and SIGHUP into messages. Half a second after the second one this process
/// ends, whatever it is doing. A signal that is ignored (`nohup`) stays so.
pub fn stop_requests() -> io::Result<Receiver<()>> {
    let (reader, writer) = io::pipe()?;
    WAKE.store(writer.into_raw_fd(), Ordering::SeqCst);
    for signal in [libc::SIGINT, libc::SIGTERM, libc::SIGHUP] {
        handle(signal)?;
    }
    let (sender, receiver) = unbounded();
    thread::spawn(move || pass_on(reader, &sender));
    Ok(receiver)
}

fn pass_on(mut reader: PipeReader, to: &Sender<()>) {
    let mut n_signals = 0;
    while reader.read_exact(&mut [0]).is_ok() {
        n_signals += 1;
        let _ = to.send(());
        if n_signals == 2 {
            thread::sleep(LAST_WORDS);
            std::process::exit(Exit::Interrupted as i32);
        }
    }
}

extern "C" fn wake(_signal: libc::c_int) {
    // SAFETY: `write` may be called by a handler; its `errno` must not disturb what is interrupted.
    unsafe {
        let errno = libc::__errno_location();
        let before = *errno;
        libc::write(WAKE.load(Ordering::SeqCst), [0u8].as_ptr().cast(), 1);
        *errno = before;
    }
}

fn handle(signal: libc::c_int) -> io::Result<()> {
    // SAFETY: plain system calls with structs that live; the handler only writes to a pipe.
    unsafe {
        let mut action: libc::sigaction = std::mem::zeroed();
        if libc::sigaction(signal, ptr::null(), &raw mut action) == -1 {
            return Err(io::Error::last_os_error());
        }
        if action.sa_sigaction == libc::SIG_IGN {
            return Ok(());
        }
        let handler: extern "C" fn(libc::c_int) = wake;
        action.sa_sigaction = handler as libc::sighandler_t;
        action.sa_flags = libc::SA_RESTART;
        libc::sigemptyset(&raw mut action.sa_mask);
        match libc::sigaction(signal, &raw const action, ptr::null_mut()) {
            -1 => Err(io::Error::last_os_error()),
            _ => Ok(()),
        }
    }
}
