//! Kind `command`.

use std::{
    collections::{BTreeMap, BTreeSet},
    fmt,
    process::Stdio,
};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{
    Arity, InputFile, Node, NodeError, NodeIo, Output, Question, Spec, TypesAt,
};
use crate::engine::program::{self, End, Printed, Program};
use crate::kernels::text::Text;

mod folder;
mod template;
mod version;

use folder::Folder;
use template::{Part, Slot};

/// Runs a program.
///
/// It starts no shell (unless `shell` says so) and sees nothing but its arguments, `env`, and a fresh
/// folder of its own with the inputs and the declared files; all else that it leaves there is dropped.
/// The arguments say where the paths of files come:
///
/// - `{in:PORT.EXT}`: the artifact at this input, written in any format of its type (`sinew nodes` lists
///   them), among them `.safetensors` and `.npz` for every type. For a list, one argument each. An input
///   of type `files` is a folder: `{in:PORT}`.
/// - `{out:PORT.EXT}`: where the program writes this output: `.npz` (of `numpy.savez`) or `.safetensors`
///   with the arrays and texts of its type, a mesh in any format that `load` reads, a text as `.txt`.
///   `{out:PORT}` is a folder for `files`.
/// - `{file:NAME}`: a copy of a declared file, `files/NAME.EXT`; all of them lie in one folder.
///
/// A program that fails, or leaves out an output, fails its node. When it ends, or its time is over,
/// everything that it has started is ended too.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Command {
    /// The program (a name in `PATH`, an absolute path, or a `{file:NAME}`) and its arguments. With
    /// `shell`, one text.
    pub command: CommandLine,
    /// Wires by the names of the inputs; a list of wires makes the input a list.
    #[serde(default)]
    pub inputs: BTreeMap<String, Arity>,
    /// Types by the names of the outputs.
    #[serde(default)]
    pub outputs: BTreeMap<String, String>,
    /// Files that the program reads, or the program itself, by name. They count by content.
    #[serde(default)]
    pub files: BTreeMap<String, InputFile>,
    /// Its environment, beside `PATH` and `HOME` of the user, a `TMPDIR` of its own, `LANG=C.UTF-8`,
    /// `TZ=UTC`, and one thread for numerical libraries (`OMP_NUM_THREADS=1` and its like).
    #[serde(default)]
    pub env: BTreeMap<String, Argument>,
    /// Whether `command` is one text for `sh -c`.
    #[serde(default)]
    pub shell: bool,
    /// What the program reads from its standard input: a slot, such as `{in:mesh.off}`; nothing if it is
    /// not given.
    #[serde(default)]
    pub stdin: Option<String>,
    /// The output that its standard output is: a slot, such as `{out:report.txt}`. The output `stdout` is
    /// then empty.
    #[serde(default)]
    pub stdout_to: Option<String>,
    /// A command that prints the version of the program, such as `["meshlab", "--version"]`. What it
    /// prints counts. It is asked when the pipeline is planned; the answer of a binary to a single flag is
    /// remembered until the binary changes.
    #[serde(default)]
    pub version: Option<Vec<Argument>>,
}

/// What is run.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum CommandLine {
    /// A program and its arguments.
    Arguments(Vec<Argument>),
    /// A line for a shell.
    Shell(String),
}

/// One argument.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Argument {
    Text(String),
    Integer(i64),
    Number(f64),
}

impl fmt::Display for Argument {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Text(text) => text.fmt(f),
            Self::Integer(value) => value.fmt(f),
            Self::Number(value) => value.fmt(f),
        }
    }
}

impl Command {
    const STDOUT: Output<Text> =
        Output::new("stdout", "what the program printed, of a long text the end");
    const STDERR: Output<Text> =
        Output::new("stderr", "what it printed as errors, of a long text the end");

    /// The arguments as they are written.
    fn arguments(&self) -> Vec<String> {
        match &self.command {
            CommandLine::Arguments(arguments) => shown(arguments),
            CommandLine::Shell(line) => vec![line.clone()],
        }
    }

    /// Every text that may hold slots, with the name of its field.
    fn texts(&self) -> impl Iterator<Item = (&'static str, String)> {
        let arguments = self.arguments().into_iter().map(|it| ("command", it));
        let env = self.env.values().map(|it| ("env", it.to_string()));
        let stdin = self.stdin.iter().map(|it| ("stdin", it.clone()));
        let stdout = self.stdout_to.iter().map(|it| ("stdout_to", it.clone()));
        arguments.chain(env).chain(stdin).chain(stdout)
    }

    /// The declared environment as it is written.
    fn environment(&self) -> BTreeMap<String, String> {
        self.env.iter().map(|(name, value)| (name.clone(), value.to_string())).collect()
    }

    /// All slots, each once, with the name of the field that has it.
    fn slots(&self) -> Result<BTreeMap<Slot, &'static str>, String> {
        let mut res = BTreeMap::new();
        for (field, text) in self.texts() {
            let parts = template::parse(&text).map_err(|e| format!("`{field}`: {e}"))?;
            let slots = parts.into_iter().filter_map(|it| match it {
                Part::Slot(slot) => Some(slot),
                Part::Plain(_) => None,
            });
            slots.for_each(|it| {
                res.entry(it).or_insert(field);
            });
        }
        Ok(res)
    }

    fn validate_line(&self) -> Result<(), String> {
        match &self.command {
            CommandLine::Shell(_) if !self.shell => Err("`command` is a text, which only a shell \
                takes apart: write a list of arguments, or `shell = true`"
                .to_owned()),
            CommandLine::Arguments(_) if self.shell => {
                Err("`command` must be one text for `shell`".to_owned())
            }
            CommandLine::Arguments(_) => match self.arguments().first().map(String::as_str) {
                None | Some("") => Err("`command` names no program".to_owned()),
                Some(name) if name.contains('/') && !name.starts_with(['/', '{']) => Err(format!(
                    "`command` runs in a folder of its own, where there is no `{name}`: declare it in \
                     `files` and write `{{file:NAME}}`, or give an absolute path"
                )),
                Some(_) => Ok(()),
            },
            CommandLine::Shell(_) => Ok(()),
        }
    }

    fn validate_slot(&self, slot: &Slot, field: &str) -> Result<(), String> {
        match slot {
            Slot::Input { port, .. } if !self.inputs.contains_key(port) => {
                Err(format!("`{field}` has `{slot}`, but `inputs` has no `{port}`"))
            }
            Slot::File { name } if !self.files.contains_key(name) => {
                Err(format!("`{field}` has `{slot}`, but `files` has no `{name}`"))
            }
            Slot::Output { port, extension } => {
                let Some(ty) = self.outputs.get(port) else {
                    return Err(format!("`{field}` has `{slot}`, but `outputs` has no `{port}`"));
                };
                folder::check_import(ty, extension)
                    .map_err(|known| format!("`{field}` has `{slot}`, but {known}"))
            }
            _ => Ok(()),
        }
    }

    /// Every port has its place, and an output only one.
    fn validate_ports(&self, slots: &BTreeMap<Slot, &'static str>) -> Result<(), String> {
        let unused = |it: &&String| {
            !slots.keys().any(|slot| matches!(slot, Slot::Input { port, .. } if port == *it))
        };
        if let Some(port) = self.inputs.keys().find(unused) {
            return Err(format!(
                "`inputs` has `{port}`, which is not used: write `{{in:{port}.safetensors}}` where its \
                 path should come"
            ));
        }
        for port in self.outputs.keys() {
            let places: Vec<String> = slots
                .keys()
                .filter(|slot| matches!(slot, Slot::Output { port: it, .. } if it == port))
                .map(ToString::to_string)
                .collect();
            match &places[..] {
                [_] => {}
                [] => {
                    return Err(format!(
                        "`outputs` has `{port}`, which is not written: write \
                         `{{out:{port}.safetensors}}` where its path should come"
                    ));
                }
                _ => return Err(format!("`outputs` has `{port}` as {}", places.join(" and "))),
            }
        }
        Ok(())
    }

    /// Lists stand where an argument each can come; standard streams are one file.
    fn validate_places(&self) -> Result<(), String> {
        let is_list = |it: &Part| {
            matches!(it, Part::Slot(Slot::Input { port, .. })
                if self.inputs.get(port).is_some_and(|it| it.takes_list()))
        };
        for (field, text) in self.texts() {
            let parts = template::parse(&text)?;
            let may_be_list = field == "command" && (parts.len() == 1 || self.shell);
            if parts.iter().any(is_list) && !may_be_list {
                return Err(format!(
                    "`{field}` has \"{text}\", where one path comes, but the input is a list"
                ));
            }
            let is_one = match (field, &parts[..]) {
                ("stdin", [Part::Slot(it)]) => !matches!(it, Slot::Output { .. }),
                ("stdout_to", [Part::Slot(it)]) => matches!(it, Slot::Output { .. }),
                ("stdin" | "stdout_to", _) => false,
                _ => true,
            };
            if !is_one {
                return Err(format!("`{field}` must be one slot, but is \"{text}\""));
            }
        }
        Ok(())
    }
}

impl Node for Command {
    const SPEC: Spec = Spec {
        kind: "command",
        version: 1,
        inputs: &[],
        outputs: &[Self::STDOUT.port().aside(), Self::STDERR.port().aside()],
        cites: &[],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.copy]
kind = "command"
command = ["cp", "--verbose", "{in:mesh.ply}", "{out:copy.ply}"]
inputs = { mesh = "@body.mesh" }
outputs = { copy = "mesh" }
version = ["cp", "--version"]

[nodes.laplacian]
kind = "laplacian"
mesh = "@copy"
"#,
    };

    const HANDLES_LIMITS: bool = true;

    fn validate(&self) -> Result<(), String> {
        self.validate_line()?;
        let slots = self.slots()?;
        slots.iter().try_for_each(|(slot, field)| self.validate_slot(slot, field))?;
        self.validate_ports(&slots)?;
        self.validate_places()?;
        if let Some(name) = self.env.keys().find(|it| it.is_empty() || it.contains(['=', '\0'])) {
            return Err(format!("`env` has \"{name}\", which is no name of a variable"));
        }
        let texts = self.texts().map(|it| it.1);
        let version = self.version.iter().flatten().map(ToString::to_string);
        if texts.chain(version).any(|it| it.contains('\0')) {
            return Err("a text has a zero byte, which no program can be given".to_owned());
        }
        match &self.version {
            Some(arguments) if arguments.is_empty() => Err("`version` names no program".to_owned()),
            _ => Ok(()),
        }
    }

    fn check_inputs(&self, types: TypesAt<'_>) -> Result<(), String> {
        for (slot, field) in self.slots()? {
            let Slot::Input { port, extension } = &slot else { continue };
            let names: BTreeSet<&str> = types(port).iter().map(|it| it.name).collect();
            for name in names {
                folder::check_export(name, extension)
                    .map_err(|known| format!("`{field}` has `{slot}`, but {known}"))?;
            }
        }
        Ok(())
    }

    fn file_table(&self) -> Option<(&'static str, &BTreeMap<String, InputFile>)> {
        Some(("files", &self.files))
    }

    fn question(&self) -> Option<Question> {
        let arguments = shown(self.version.as_ref()?);
        Some(version::question(&arguments, &self.environment()))
    }

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let slots = self.slots().map_err(NodeError::failed)?;
        let folder = Folder::new()?;
        folder.write_files(io, &self.files)?;
        for slot in slots.keys() {
            folder.prepare(io, slot)?;
        }
        let printed = self.start(io, &folder)?;
        for slot in slots.keys() {
            folder.collect(io, slot).map_err(|message| {
                let last = printed.stderr.shown_end();
                NodeError::failed(format!("{message}{last}"))
            })?;
        }
        io.put(Self::STDOUT, Text(printed.stdout.text()));
        io.put(Self::STDERR, Text(printed.stderr.text()));
        Ok(())
    }
}

impl Command {
    /// Runs the program; what it printed if it ended well.
    fn start(&self, io: &NodeIo<'_>, folder: &Folder) -> Result<Printed, NodeError> {
        let fill = |text: &str| folder.filled_in(io, text, &self.files);
        let one = |text: &str| fill(text).join(" ");
        let declared = self.environment().into_iter().map(|(name, it)| (name, one(&it))).collect();
        let environment = program::environment(&declared, &folder.temporary());
        let arguments: Vec<String> = match &self.command {
            CommandLine::Arguments(_) => self.arguments().iter().flat_map(|it| fill(it)).collect(),
            CommandLine::Shell(line) => vec!["sh".to_owned(), "-c".to_owned(), one(line)],
        };
        let name = arguments[0].clone();
        let path = folder.program(&name, &environment)?;
        io.progress(None, &format!("running `{name}`"));
        let program = Program {
            path,
            arguments: arguments.into_iter().map(Into::into).collect(),
            folder: folder.path().to_owned(),
            environment,
            own_group: !io.surroundings().isolated,
        };
        let stdin = match &self.stdin {
            Some(text) => folder.open(&one(text))?,
            None => Stdio::null(),
        };
        let stdout = self.stdout_to.as_ref().map(|it| folder.create(&one(it))).transpose()?;
        let (end, printed) = program
            .run(stdin, stdout, io.cancel())
            .map_err(|e| NodeError::environment(format!("cannot start `{name}`: {e}")))?;
        match end {
            End::Exited(0) => Ok(printed),
            _ => Err(NodeError::failed(format!("`{name}` {end}{}", printed.shown_end()))),
        }
    }
}

fn shown(arguments: &[Argument]) -> Vec<String> {
    arguments.iter().map(ToString::to_string).collect()
}
