//! Asks an interpreter for its version and those of packages.

use std::{collections::BTreeMap, ffi::OsString, path::PathBuf, process::Stdio, time::Duration};

use serde::Deserialize;

use super::interpreter::HOST;
use crate::engine::node::{Answer, CancelToken, Facts, Question};
use crate::engine::program::{self, End, Program};

/// Longer than any interpreter takes to look around.
const TIME_LIMIT: Duration = Duration::from_secs(60);

/// What `facts` of the host prints.
#[derive(Deserialize)]
struct Found {
    facts: Facts,
    missing: Vec<String>,
    witnesses: Vec<PathBuf>,
}

/// The versions of an interpreter (`python`) and of packages, by their names.
pub fn question(
    interpreter: String,
    packages: Vec<String>,
    environment: BTreeMap<String, OsString>,
) -> Question {
    let shown = serde_json::json!(["versions of python", interpreter, packages, environment, HOST]);
    let ask = move || ask(&interpreter, &packages, &environment);
    Question { text: shown.to_string(), ask: Box::new(ask) }
}

fn ask(
    interpreter: &str,
    packages: &[String],
    environment: &BTreeMap<String, OsString>,
) -> Result<Answer, String> {
    let hint = "set `python` to one with the packages, such as `.venv/bin/python`";
    let path = program::find(interpreter, environment).map_err(|e| format!("{e}; or {hint}"))?;
    let folder = tempfile::tempdir().map_err(|e| format!("cannot make a folder: {e}"))?;
    let arguments = [interpreter, "-c", HOST, "facts"].into_iter();
    let program = Program {
        path: path.clone(),
        arguments: arguments.chain(packages.iter().map(String::as_str)).map(Into::into).collect(),
        folder: folder.path().to_owned(),
        environment: environment.clone(),
        own_group: true,
    };
    let cancel = CancelToken::never().with_limit(Some(TIME_LIMIT));
    let (end, printed) = program
        .run(Stdio::null(), None, &cancel)
        .map_err(|e| format!("cannot start `{interpreter}`: {e}"))?;
    if end != End::Exited(0) {
        let last = printed.stderr.last_lines(6);
        return Err(format!("`{interpreter}` cannot tell its version: {last}"));
    }
    let printed = printed.stdout.text();
    let line = printed.lines().last().unwrap_or_default();
    let Found { facts, missing, witnesses } = serde_json::from_str(line)
        .map_err(|_| format!("`{interpreter}` is no Python 3.8 or later: it printed {line:?}"))?;
    if let Some(package) = missing.first() {
        let python = path.display();
        return Err(format!(
            "`{python}` has no package `{package}`: install it (`{python} -m pip install {package}`), \
             or {hint}"
        ));
    }
    // A script may start any interpreter (pyenv's do), and nothing tells which one next time.
    let witnesses = program::is_binary(&path).then(|| {
        let own = program::candidates_up_to(&path, interpreter, environment);
        own.into_iter().chain(witnesses).collect()
    });
    Ok(Answer { facts, witnesses })
}
