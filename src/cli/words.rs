//! Words that several commands say.

use crate::engine::events::Failure;

/// `1 mistake`, `2 mistakes`.
pub fn count(n: usize, what: &str) -> String {
    if n == 1 { format!("{n} {what}") } else { format!("{n} {what}s") }
}

/// A failure's message; a panic is called the bug that it is.
pub fn show_failure(failure: &Failure) -> String {
    match failure {
        Failure::Node(message) | Failure::Environment(message) => message.clone(),
        Failure::Panic(message) => format!("this is a bug of Sinew, please report it: {message}"),
    }
}

/// What to do about a run that was stopped.
pub fn go_on(n_done: usize, n_wanted: usize) -> String {
    format!("run the same command again to go on: {n_done} of {n_wanted} nodes are done")
}
