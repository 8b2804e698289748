//! Asks a program for its version.

use std::{collections::BTreeMap, path::Path, process::Stdio, time::Duration};

use crate::engine::node::{Answer, CancelToken, Facts, Question};
use crate::engine::program::{self, End, Program};

/// Longer than any program takes to print its version.
const TIME_LIMIT: Duration = Duration::from_secs(30);

/// What a command prints; it counts as `version`.
pub fn question(arguments: &[String], env: &BTreeMap<String, String>) -> Question {
    let path = std::env::var("PATH").unwrap_or_default();
    let text = serde_json::json!(["version of a command", arguments, env, path]).to_string();
    let (arguments, env) = (arguments.to_vec(), env.clone());
    Question { text, ask: Box::new(move || ask(&arguments, &env)) }
}

fn ask(arguments: &[String], env: &BTreeMap<String, String>) -> Result<Answer, String> {
    let shown = arguments.join(" ");
    let folder = tempfile::tempdir().map_err(|e| format!("cannot make a folder: {e}"))?;
    let environment = program::environment(env, folder.path());
    let path = program::find(&arguments[0], &environment)?;
    let program = Program {
        path: path.clone(),
        arguments: arguments.iter().map(Into::into).collect(),
        folder: folder.path().to_owned(),
        environment: environment.clone(),
        own_group: true,
    };
    let cancel = CancelToken::never().with_limit(Some(TIME_LIMIT));
    let (end, printed) = program
        .run(Stdio::null(), None, &cancel)
        .map_err(|e| format!("cannot start `{shown}`: {e}"))?;
    if end != End::Exited(0) {
        let last = printed.stderr.last_lines(4);
        return Err(format!("`{shown}`, which should print a version, failed: {last}"));
    }
    let printed = if printed.stdout.is_empty() { &printed.stderr } else { &printed.stdout };
    let facts = Facts::from([("version".to_owned(), printed.text().trim().to_owned())]);
    Ok(Answer { facts, witnesses: witnesses(arguments, &path, &environment) })
}

/// The program, and where one of its name would come before it. Nothing tells what a script reads, or a
/// binary with more arguments than one flag (`python -c …`).
fn witnesses(
    arguments: &[String],
    path: &Path,
    environment: &BTreeMap<String, std::ffi::OsString>,
) -> Option<Vec<std::path::PathBuf>> {
    let is_flag = matches!(arguments, [_, flag] if flag.starts_with('-'));
    if !is_flag || !program::is_binary(path) {
        return None;
    }
    Some(program::candidates_up_to(path, &arguments[0], environment))
}
