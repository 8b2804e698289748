//! One interpreter that has run a script and answers calls of its functions.

use std::{
    collections::BTreeMap,
    ffi::OsString,
    io::{self, Read, Write},
    os::{
        fd::{AsRawFd, OwnedFd},
        unix::net::UnixStream,
    },
    process::Stdio,
    sync::{LazyLock, mpsc},
    thread,
    time::Duration,
};

use serde::Serialize;
use serde_json::{Value as Json, json};
use tempfile::TempDir;

use crate::engine::node::{CancelToken, NodeError};
use crate::engine::program::{self, Printed, Process, Program};

/// The other side, in Python.
pub const HOST: &str = include_str!("host.py");

/// How often it is asked whether the result is still wanted.
const TICK: Duration = Duration::from_millis(20);

/// What an interpreter is made ready for.
#[derive(Debug, Serialize)]
pub struct Script {
    pub interpreter: String,
    pub environment: BTreeMap<String, OsString>,
    /// See [`Program::own_group`].
    pub own_group: bool,
    pub script: Source,
    /// By name.
    pub modules: BTreeMap<String, Source>,
}

/// A file of Python.
#[derive(Debug, Serialize)]
pub struct Source {
    /// For messages.
    pub path: String,
    pub source: String,
}

/// A running interpreter. Dropping it ends it and all that it has started.
pub struct Interpreter {
    process: Process,
    channel: UnixStream,
    /// It starts there; every call gets a folder of its own.
    _folder: TempDir,
}

impl Interpreter {
    /// Starts an interpreter and lets it run the script.
    ///
    /// # Errors
    /// If there is none, it has no numpy, or the script fails.
    pub fn start(script: &Script, cancel: &CancelToken) -> Result<Self, NodeError> {
        let name = &script.interpreter;
        let path = program::find(name, &script.environment).map_err(NodeError::environment)?;
        let fail = |e: io::Error| NodeError::environment(format!("cannot start `{name}`: {e}"));
        let folder = tempfile::Builder::new().prefix("sinew-python-").tempdir().map_err(fail)?;
        let mut environment = script.environment.clone();
        environment.insert("TMPDIR".to_owned(), folder.path().into());
        let program = Program {
            path,
            arguments: [name, "-c", HOST, "serve"].map(OsString::from).to_vec(),
            folder: folder.path().to_owned(),
            environment,
            own_group: script.own_group,
        };
        let (channel, theirs) = UnixStream::pair().map_err(fail)?;
        let process = start_detached(program, OwnedFd::from(theirs).into()).map_err(fail)?;
        let mut res = Self { process, channel, _folder: folder };
        let load = json!({ "load": { "script": script.script, "modules": script.modules } });
        res.call(&load, cancel)?;
        Ok(res)
    }

    /// Whether it is still there.
    pub fn is_alive(&mut self) -> bool {
        self.process.ended().is_none()
    }

    /// Sends a request and waits for its response. What was printed meanwhile.
    ///
    /// # Errors
    /// If the function fails, or the interpreter ends, or the result is no longer wanted. The interpreter
    /// must not be used again then.
    pub fn call(&mut self, request: &Json, cancel: &CancelToken) -> Result<Printed, NodeError> {
        let fail = |e: io::Error| NodeError::environment(format!("cannot talk to Python: {e}"));
        // What a thread has printed after the last call belongs to nobody.
        self.process.listen(None, Duration::ZERO, &mut |_, _| {}).map_err(fail)?;
        let mut printed = Printed::default();
        let text = serde_json::to_vec(request).expect("requests are plain data");
        let length = u32::try_from(text.len())
            .map_err(|_| NodeError::failed("the script and its parameters are larger than 4 GB"))?;
        let sent = self.channel.write_all(&length.to_le_bytes());
        if sent.and_then(|()| self.channel.write_all(&text)).is_err() {
            return Err(self.crashed(printed));
        }
        let Some(response) = self.response(cancel, &mut printed).map_err(fail)? else {
            return Err(match cancel.is_cancelled() {
                true => NodeError::failed("stopped"),
                false => self.crashed(printed),
            });
        };
        self.process.listen(None, Duration::ZERO, &mut printed.listener()).map_err(fail)?;
        let Some(mistake) = response.get("mistake").and_then(Json::as_str) else {
            return Ok(printed);
        };
        let trace = response.get("traceback").and_then(Json::as_str);
        let trace = trace.map(|it| format!("\n{}", it.trim_end())).unwrap_or_default();
        Err(NodeError::failed(format!("{mistake}{trace}")))
    }

    /// A whole message; `None` if the interpreter has ended, or nobody wants it any more.
    fn response(
        &mut self,
        cancel: &CancelToken,
        printed: &mut Printed,
    ) -> io::Result<Option<Json>> {
        let mut bytes = Vec::new();
        let mut buffer = [0; 16 << 10];
        loop {
            let channel = Some(self.channel.as_raw_fd());
            if self.process.listen(channel, TICK, &mut printed.listener())? {
                match self.channel.read(&mut buffer) {
                    Ok(0) => return Ok(None),
                    Ok(n) => bytes.extend_from_slice(&buffer[..n]),
                    Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                    Err(error) if error.kind() == io::ErrorKind::ConnectionReset => {
                        return Ok(None);
                    }
                    Err(error) => return Err(error),
                }
                if let Some((length, text)) = bytes.split_first_chunk::<4>()
                    && text.len() == u32::from_le_bytes(*length) as usize
                {
                    return Ok(Some(serde_json::from_slice(text)?));
                }
            }
            // A child of it may hold the channel open after it has ended.
            if cancel.is_cancelled() || self.process.ended().is_some() {
                return Ok(None);
            }
        }
    }

    /// How the interpreter ended, with the last that it printed.
    fn crashed(&mut self, mut printed: Printed) -> NodeError {
        // The channel is closed a moment before the process is over.
        for _ in 0..50 {
            if self.process.ended().is_some() {
                break;
            }
            thread::sleep(Duration::from_millis(10));
        }
        let _ = self.process.listen(None, Duration::ZERO, &mut printed.listener());
        let how = match self.process.ended() {
            Some(end) => end.to_string(),
            None => "does not answer any more".to_owned(),
        };
        NodeError::failed(format!("the interpreter {how}{}", printed.shown_end()))
    }
}

type Order = (Program, Stdio, mpsc::Sender<io::Result<Process>>);

/// Starts a program from a thread that lives as long as we do: it is killed when this thread ends, and an
/// interpreter should outlive the worker that happens to need it first.
fn start_detached(program: Program, stdin: Stdio) -> io::Result<Process> {
    static STARTER: LazyLock<mpsc::Sender<Order>> = LazyLock::new(|| {
        let (orders, queue) = mpsc::channel::<Order>();
        thread::spawn(move || {
            for (program, stdin, reply) in queue {
                let _ = reply.send(program.start(stdin, None));
            }
        });
        orders
    });
    let (reply, answer) = mpsc::channel();
    let gone = |_| io::Error::other("the thread that starts programs is gone");
    STARTER.send((program, stdin, reply)).map_err(|_| gone(mpsc::RecvError))?;
    answer.recv().map_err(gone)?
}
