//! Interpreters that wait for their next call.

use std::{
    sync::{Mutex, PoisonError},
    thread,
};

use serde_json::Value as Json;

use super::interpreter::{Interpreter, Script};
use crate::engine::digest::Digest;
use crate::engine::node::{CancelToken, NodeError};
use crate::engine::program::Printed;

/// Interpreters by what they are made ready for, the one that has waited longest first. When the program
/// ends, they see the end of their channel and end too.
static WAITING: Mutex<Vec<(Digest, Interpreter)>> = Mutex::new(Vec::new());

/// Calls a function in an interpreter that has run this script: one that waits, or a new one. It waits for
/// the next call unless this one failed. What was printed.
///
/// # Errors
/// See [`Interpreter::call`].
pub fn call(script: &Script, request: &Json, cancel: &CancelToken) -> Result<Printed, NodeError> {
    let text = serde_json::to_vec(script).expect("scripts are plain data");
    let digest = Digest::of(&text);
    let mut interpreter = match waiting(&digest) {
        Some(interpreter) => interpreter,
        None => Interpreter::start(script, cancel)?,
    };
    let printed = interpreter.call(request, cancel)?;
    put_back(digest, interpreter);
    Ok(printed)
}

fn waiting(digest: &Digest) -> Option<Interpreter> {
    loop {
        let mut waiting = WAITING.lock().unwrap_or_else(PoisonError::into_inner);
        let index = waiting.iter().rposition(|it| it.0 == *digest)?;
        let (_, mut interpreter) = waiting.remove(index);
        drop(waiting);
        if interpreter.is_alive() {
            return Some(interpreter);
        }
    }
}

fn put_back(digest: Digest, interpreter: Interpreter) {
    let most = thread::available_parallelism().map_or(1, usize::from);
    let mut waiting = WAITING.lock().unwrap_or_else(PoisonError::into_inner);
    waiting.push((digest, interpreter));
    let n_ended = waiting.len().saturating_sub(most);
    let ended: Vec<(Digest, Interpreter)> = waiting.drain(..n_ended).collect();
    drop(waiting);
    drop(ended);
}
