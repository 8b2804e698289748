//! Kind `python`.

use std::{
    collections::{BTreeMap, BTreeSet},
    ffi::OsString,
    path::Path,
};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json, json};

use crate::engine::node::{
    Arity, InputFile, Node, NodeError, NodeIo, Output, ProgramName, Question, Spec,
};
use crate::engine::program;
use crate::kernels::text::Text;

mod handover;
mod interpreter;
mod pool;
mod versions;

use handover::{Given, Taken};
use interpreter::{Script, Source};

/// Calls a function of a Python script.
///
/// It is called with the inputs, `params` and the paths of `files` as keyword arguments. An input has
/// its numpy arrays as attributes and by name (`source.eigenvectors`, `source["eigenvectors"]`). A list of wires gives a list, whose `labels` say what the items of axes are
/// called; with `missing = "show"`, what failed is `None` in it, and `missing` says why. A `table` is a dictionary of columns, a `text`
/// a `str`, `files` a dictionary of `bytes`. What it returns has the same form: a dictionary of outputs,
/// or the one output itself. For a table, a list of records does too.
///
/// The script and the declared files count by their content, the interpreter and `packages` by their
/// versions. Other modules than the declared ones and the installed packages are not found.
/// One interpreter is kept for all calls of a script, so modules are imported once; it must hold nothing
/// that a later call depends on. Before every call, `random` and `numpy.random` are seeded with 0.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Python {
    /// The script, relative to the pipeline file.
    pub script: InputFile,
    /// The function of it that is called.
    pub function: String,
    /// Wires by the names of the inputs; a list of wires makes the input a list.
    #[serde(default)]
    pub inputs: BTreeMap<String, Arity>,
    /// Types by the names of the outputs.
    #[serde(default)]
    pub outputs: BTreeMap<String, String>,
    /// Further arguments by name.
    #[serde(default)]
    pub params: Map<String, Json>,
    /// Packages whose versions count, by the names that `pip` knows. A module without a version counts
    /// by its files, and so does a package that is installed to be edited.
    #[serde(default = "numpy")]
    pub packages: Vec<String>,
    /// Further files, by name: a `.py` is a module that the script can import by this name, any other is
    /// handed to the function as an argument of this name, with its path.
    #[serde(default)]
    pub files: BTreeMap<String, InputFile>,
    /// Its environment, beside `PATH` and `HOME` of the user, a `TMPDIR` of its own, `LANG=C.UTF-8`,
    /// `TZ=UTC`, and one thread for numerical libraries (`OMP_NUM_THREADS=1` and its like).
    #[serde(default)]
    pub env: BTreeMap<String, String>,
    /// The interpreter, with numpy: a name in `PATH`, or a path (`.venv/bin/python`). It counts by its
    /// version, not by its path.
    #[serde(default = "python3")]
    pub python: ProgramName,
}

fn numpy() -> Vec<String> {
    vec!["numpy".to_owned()]
}

fn python3() -> ProgramName {
    ProgramName("python3".to_owned())
}

impl Python {
    const STDOUT: Output<Text> =
        Output::new("stdout", "what the call printed, of a long text the end");
    const STDERR: Output<Text> =
        Output::new("stderr", "what it printed as errors, of a long text the end");

    /// The names under which the function gets something, with the fields that say so.
    fn arguments(&self) -> impl Iterator<Item = (&str, &'static str)> {
        let inputs = self.inputs.keys().map(|it| (it.as_str(), "inputs"));
        let params = self.params.keys().map(|it| (it.as_str(), "params"));
        let files = self.files.iter().filter(|it| !is_module(it.1));
        inputs.chain(params).chain(files.map(|it| (it.0.as_str(), "files")))
    }

    /// Where the interpreter is, and its environment.
    fn interpreter(&self) -> (String, BTreeMap<String, OsString>) {
        let name = match self.python.0.contains('/') {
            true => {
                let path = std::path::absolute(&self.python.0).unwrap_or_default();
                path.to_string_lossy().into_owned()
            }
            false => self.python.0.clone(),
        };
        (name, program::environment(&self.env, &std::env::temp_dir()))
    }

    /// What an interpreter is made ready for.
    fn script(&self, io: &NodeIo<'_>) -> Result<Script, NodeError> {
        let source = |file: &InputFile| -> Result<Source, NodeError> {
            let path = absolute(io.path(&file.0));
            let source = String::from_utf8(io.read(&file.0)?)
                .map_err(|_| NodeError::failed(format!("`{path}` is no text in UTF-8")))?;
            Ok(Source { path, source })
        };
        let modules = self.files.iter().filter(|it| is_module(it.1));
        let modules = modules
            .map(|(name, file)| Ok((name.clone(), source(file)?)))
            .collect::<Result<BTreeMap<String, Source>, NodeError>>()?;
        let (interpreter, environment) = self.interpreter();
        let (script, own_group) = (source(&self.script)?, !io.surroundings().isolated);
        Ok(Script { interpreter, environment, own_group, script, modules })
    }

    /// The keyword arguments that are no artifacts.
    fn plain_arguments(&self, io: &NodeIo<'_>) -> Map<String, Json> {
        let mut res = self.params.clone();
        for (name, file) in self.files.iter().filter(|it| !is_module(it.1)) {
            res.insert(name.clone(), absolute(io.path(&file.0)).into());
        }
        res
    }
}

impl Node for Python {
    const SPEC: Spec = Spec {
        kind: "python",
        version: 1,
        inputs: &[],
        outputs: &[Self::STDOUT.port().aside(), Self::STDERR.port().aside()],
        cites: &[],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.lengths]
kind = "python"
script = "lengths.py"          # def edge_lengths(mesh, digits): … return {"length": …}
function = "edge_lengths"
inputs = { mesh = "@body.mesh" }
params = { digits = 6 }
outputs = { lengths = "table" }
"#,
    };

    const HANDLES_LIMITS: bool = true;

    const WHERE: &'static [&'static str] = &["python"];

    fn validate(&self) -> Result<(), String> {
        if !is_identifier(&self.function) {
            return Err(format!("`function` is \"{}\", which is no name in Python", self.function));
        }
        let mut known = BTreeMap::new();
        for (name, field) in self.arguments() {
            if !is_identifier(name) {
                return Err(format!("`{field}` has \"{name}\", which is no name in Python"));
            }
            if let Some(other) = known.insert(name, field) {
                return Err(format!("`{field}` has `{name}`, and so has `{other}`"));
            }
        }
        let modules: BTreeSet<&String> =
            self.files.iter().filter(|it| is_module(it.1)).map(|it| it.0).collect();
        if let Some(name) = modules.into_iter().find(|it| !is_identifier(it)) {
            return Err(format!("`files` has \"{name}\", which is no name of a module"));
        }
        if let Some(name) = self.packages.iter().find(|it| it.is_empty() || it.starts_with('-')) {
            return Err(format!("`packages` has \"{name}\", which is no name of a package"));
        }
        if let Some(name) = self.env.keys().find(|it| it.is_empty() || it.contains(['=', '\0'])) {
            return Err(format!("`env` has \"{name}\", which is no name of a variable"));
        }
        Ok(())
    }

    fn files(&self) -> Vec<(&'static str, &InputFile)> {
        vec![("script", &self.script)]
    }

    fn file_table(&self) -> Option<(&'static str, &BTreeMap<String, InputFile>)> {
        Some(("files", &self.files))
    }

    fn question(&self) -> Option<Question> {
        let (interpreter, environment) = self.interpreter();
        Some(versions::question(interpreter, self.packages.clone(), environment))
    }

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let folder = tempfile::Builder::new().prefix("sinew-").tempdir().map_err(|e| {
            let parent = std::env::temp_dir();
            NodeError::environment(format!("cannot make a folder in `{}`: {e}", parent.display()))
        })?;
        let given = Given::new(io)?;
        let taken = Taken::new(io.outputs().iter().filter(|it| !it.aside))?;
        let request = json!({
            "function": self.function,
            "folder": absolute(folder.path()),
            "params": self.plain_arguments(io),
            "inputs": given.request(),
            "outputs": taken.request(),
        });
        io.progress(None, &format!("calling `{}`", self.function));
        let printed = pool::call(&self.script(io)?, &request, io.cancel())?;
        for (port, artifact) in taken.read()? {
            io.put_any(port, artifact);
        }
        io.put(Self::STDOUT, Text(printed.stdout.text()));
        io.put(Self::STDERR, Text(printed.stderr.text()));
        Ok(())
    }
}

fn is_module(file: &InputFile) -> bool {
    file.extension() == "py"
}

fn absolute(path: &Path) -> String {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned()).to_string_lossy().into_owned()
}

/// Whether Python takes it as a name; letters beyond ASCII are left out.
fn is_identifier(name: &str) -> bool {
    let is_letter = |it: char| it.is_ascii_alphabetic() || it == '_';
    name.starts_with(is_letter)
        && name.chars().all(|it| is_letter(it) || it.is_ascii_digit())
        && !KEYWORDS.contains(&name)
}

const KEYWORDS: [&str; 35] = [
    "False", "None", "True", "and", "as", "assert", "async", "await", "break", "class", "continue",
    "def", "del", "elif", "else", "except", "finally", "for", "from", "global", "if", "import",
    "in", "is", "lambda", "nonlocal", "not", "or", "pass", "raise", "return", "try", "while",
    "with", "yield",
];
